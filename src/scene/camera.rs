//! The viewer: a right-handed pinhole camera, depth range 0 (near) … 1 (far), clip space y up.

use super::check::within_ranges;
use fathom_base::settings;
use glam::dcamera::rh::proj::directx;
use glam::dcamera::rh::view;
use glam::{DMat4, DVec3};

settings! {
    /// Position, orientation and lens of the viewer.
    pub struct Camera required {
        /// Where the camera stands.
        position_m: [f64; 3] => -1e5 ..= 1e5, "m";
        /// The point in the middle of the picture.
        target_m: [f64; 3] => -1e5 ..= 1e5, "m";
        /// Direction that points up in the picture, not parallel to the view.
        #[serde(default = "up")]
        up: [f64; 3] => -1e5 ..= 1e5, "1";
        /// Vertical opening angle.
        fov_y_deg: f64 => 1.0 ..= 170.0, "°";
        /// Distance of the near clipping plane.
        z_near_m: f64 => 1e-4 ..= 1e5, "m";
        /// Distance of the far clipping plane, more than `z_near_m`. With the near plane it sets the point at which the light looks (UW §3.1), so
        /// keep it at the scene's depth.
        z_far_m: f64 => 1e-4 ..= 1e5, "m";
    }
}

fn up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

impl Camera {
    /// A camera whose picture is upright, with its near and far clipping planes, metres.
    pub fn new(position_m: [f64; 3], target_m: [f64; 3], fov_y_deg: f64, z_m: [f64; 2]) -> Camera {
        let [z_near_m, z_far_m] = z_m;
        Camera { position_m, target_m, up: up(), fov_y_deg, z_near_m, z_far_m }
    }

    pub fn position(&self) -> DVec3 {
        DVec3::from(self.position_m)
    }

    pub fn direction(&self) -> DVec3 {
        (DVec3::from(self.target_m) - self.position()).normalize()
    }

    /// World to view space (right-handed, looking along −z).
    pub fn view(&self) -> DMat4 {
        view::look_to_mat4(self.position(), self.direction(), DVec3::from(self.up).normalize())
    }

    /// View to clip space; `aspect` is width / height.
    pub fn projection(&self, aspect: f64) -> DMat4 {
        directx::perspective(self.fov_y_deg.to_radians(), aspect, self.z_near_m, self.z_far_m)
    }

    /// World to clip space; `aspect` is width / height.
    pub fn view_projection(&self, aspect: f64) -> DMat4 {
        self.projection(aspect) * self.view()
    }

    /// Distance along the view direction, metres, of a depth 0 … 1.
    pub fn view_depth_m(&self, depth: f64) -> f64 {
        let (n, f) = (self.z_near_m, self.z_far_m);
        n * f / (f - depth * (f - n))
    }

    /// The middle of the view frustum, at which the light looks:
    /// `p_mid = p_viewer + (z_near + z_far) / 2 · l_viewer` (UW 3.1).
    pub fn middle(&self) -> DVec3 {
        self.position() + self.direction() * (0.5 * (self.z_near_m + self.z_far_m))
    }

    /// The camera mirrored about the water plane y = 0, for reflections. Its up vector stays up, so
    /// its picture is upside down against a true mirror image: a point p seen by this camera at
    /// (x, y) of normalized device coordinates has its mirror image seen by the mirrored camera
    /// at (x, −y), at the same depth.
    pub fn mirrored(&self) -> Camera {
        let flip = |[x, y, z]: [f64; 3]| [x, -y, z];
        let [position_m, target_m] = [self.position_m, self.target_m].map(flip);
        let [x, y, z] = self.up;
        Camera { position_m, target_m, up: [-x, y, -z], ..self.clone() }
    }

    /// The eight corners of the view frustum: near plane first, counter-clockwise from bottom left.
    pub fn frustum_corners(&self, aspect: f64) -> [DVec3; 8] {
        let inverse = self.view_projection(aspect).inverse();
        let ring = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        std::array::from_fn(|i| {
            let (x, y) = ring[i % 4];
            inverse.project_point3(DVec3::new(x, y, if i < 4 { 0.0 } else { 1.0 }))
        })
    }

    /// Whether the camera can be used; the error names the parameter and its valid range.
    pub fn validate(&self) -> Result<(), String> {
        within_ranges("camera", self)?;
        if self.z_near_m >= self.z_far_m {
            return Err(format!(
                "camera.z_near_m = {} must be less than camera.z_far_m = {}",
                self.z_near_m, self.z_far_m
            ));
        }
        let gaze = DVec3::from(self.target_m) - self.position();
        if gaze == DVec3::ZERO {
            return Err("camera.target_m must differ from camera.position_m".into());
        }
        let side = gaze.normalize().cross(DVec3::from(self.up).normalize());
        if !side.is_finite() || side.length() < 1e-6 {
            return Err("camera.up must be non-zero and not parallel to the line from camera.position_m to camera.target_m".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::{InvalidCase, assert_refused};
    use super::super::frustum::frustum_planes;
    use super::*;

    fn camera() -> Camera {
        Camera::new([1.0, -2.0, 5.0], [0.5, -1.0, -3.0], 60.0, [0.1, 20.0])
    }

    #[test]
    fn depth_runs_from_zero_at_near_to_one_at_far() {
        let c = camera();
        let m = c.view_projection(1.0);
        let at = |d: f64| m.project_point3(c.position() + c.direction() * d);
        assert!((at(c.z_near_m) - DVec3::ZERO).length() < 1e-9);
        assert!((at(c.z_far_m) - DVec3::Z).length() < 1e-9);
        let above = m.project_point3(c.position() + c.direction() * 3.0 + DVec3::Y);
        assert!(above.y > 0.0, "clip space y points up");
    }

    #[test]
    fn mirrored_camera_sees_mirror_images_upside_down() {
        let mut c = camera();
        c.up = [0.1, 0.9, 0.05];
        let (m, r) = (c.view_projection(1.3), c.mirrored().view_projection(1.3));
        let p = DVec3::new(0.2, -1.5, 0.4);
        let (a, b) = (m.project_point3(p), r.project_point3(p * DVec3::new(1.0, -1.0, 1.0)));
        assert!((a - DVec3::new(b.x, -b.y, b.z)).length() < 1e-12);
    }

    #[test]
    fn corners_lie_on_the_planes() {
        let c = camera();
        for corner in c.frustum_corners(1.2) {
            let planes = frustum_planes(&c.view_projection(1.2));
            let on = planes.iter().filter(|p| p.dot(corner.extend(1.0)).abs() < 1e-6);
            assert_eq!(on.count(), 3, "{corner}");
        }
    }

    #[test]
    fn bad_values_are_named() {
        let cases: &[InvalidCase<Camera>] = &[
            (|c| c.z_near_m = 30.0, "camera.z_near_m"),
            (|c| c.z_near_m = 0.0, "camera.z_near_m"),
            (|c| c.z_far_m = f64::INFINITY, "camera.z_far_m"),
            (|c| c.fov_y_deg = 180.0, "camera.fov_y_deg"),
            (|c| c.position_m[1] = f64::NAN, "camera.position_m"),
            (|c| c.target_m = c.position_m, "camera.target_m"),
            (|c| c.up = [0.0; 3], "camera.up"),
        ];
        assert_refused(&camera(), Camera::validate, cases);
    }
}

//! The light and the frustum from which it casts photons.

use glam::dcamera::rh::proj::directx;
use glam::dcamera::rh::view;
use glam::{DMat4, DVec2, DVec3, DVec4};

use super::bounds::Bounds;
use super::camera::Camera;
use super::check::within_ranges;
use super::frustum::{Rectangle, clip_polygon, surface_within, visible_points};
use super::light_frame::{LightFrame, LightKind, MIN_DEPTH, POINT_MAX_TANGENT, tangent};
use super::photon_start::{PhotonStart, Refraction, hull};
use super::water::Water;
use fathom_base::settings;

/// Slack of the near and far planes around the bounds, as a share of their diagonal: 25 cm in scene tank.
const DEPTH_SLACK: f64 = 0.014_145_4;

/// Nearest depth of a point light's frustum, as a share of the same: 5 cm in scene tank.
const POINT_NEAR: f64 = 0.002_829_1;

settings! {
    /// The one light of a scene (UW §4.1: directional, 9.2 W/sr).
    pub struct Light {
        /// Parallel rays or rays from a point.
        kind: LightKind = LightKind::Directional;
        /// The way a directional light's rays travel: downwards, of any length.
        direction: [f64; 3] = [0.25, -1.0, -0.15] => -1e5 ..= 1e5, "1";
        /// Where a point light stands, above the water.
        position_m: [f64; 3] = [0.0, 10.0, 0.0] => -1e5 ..= 1e5, "m";
        /// Radiant intensity of a point light. For a directional light the same number is read as irradiance at normal
        /// incidence, W/m².
        intensity_w_sr: f64 = 9.2 => 0.0 ..= 1e9, "W/sr";
        /// Distance of a directional light's position from the middle of the camera frustum.
        distance_m: f64 = 50.0 => 1e-3 ..= 1e5, "m";
        /// Half the width of the light frustum, for a point light at the distance of the camera frustum's middle; 0 fits it to
        /// what the camera sees, and photons to the water in view.
        half_extent_m: f64 = 0.0 => 0.0 ..= 1e5, "m";
    }
}

impl Light {
    /// The light frustum that follows the camera frustum (UW 3.1): it looks at the camera's
    /// [`Camera::middle`] and holds the part of the camera frustum that lies within `bounds`
    /// together with where light that reaches it enters the water; never more than
    /// `bounds`. A camera that sees nothing of `bounds` gets all of it.
    ///
    /// With `photons_fitted` photons start only where they can land in view. UW §3.1: "we must ensure that most of them intersect the
    /// visible portion of the scene". An extent that is set ([`Light::half_extent_m`]) is kept.
    pub fn frame(
        &self,
        camera: &Camera,
        aspect: f64,
        bounds: &Bounds,
        water: &Water,
        photons_fitted: bool,
    ) -> LightFrame {
        let middle = camera.middle();
        let position = match self.kind {
            LightKind::Directional => middle - self.travel() * self.distance_m,
            LightKind::Point => DVec3::from(self.position_m),
        };
        let forward = (middle - position).try_normalize().unwrap_or(DVec3::NEG_Y);
        let view = view::look_to_mat4(position, forward, up_vector(forward));
        let reach = (middle - position).length();
        let mut points = visible_points(camera, aspect, bounds);
        let (kind, steepest) = (self.kind, water.steepest());
        let refraction = Refraction { kind, position, forward, water, steepest };
        let entries = refraction.entries((camera, aspect), bounds);
        points.extend(&entries);
        if points.is_empty() {
            points.extend(bounds.corners());
        }
        let (projection, rectangle) = match self.kind {
            LightKind::Directional => self.orthographic(&view, &points, bounds),
            LightKind::Point => self.pyramid(&view, &points, bounds, reach),
        };
        let view_projection = projection * view;
        let inverse = view_projection.inverse();
        let frame = LightFrame {
            kind: self.kind,
            position,
            forward,
            view,
            projection,
            view_projection,
            inverse,
            photon_grid: inverse,
            grid_area: rectangle.area(),
            emitted_w: self.flux_w(&rectangle),
        };
        let fits = photons_fitted && self.half_extent_m == 0.0;
        let start = fits.then(|| PhotonStart::new(&frame, &entries, water));
        match start.flatten().filter(|start| start.rectangle().area() < frame.grid_area) {
            Some(start) => LightFrame {
                photon_grid: frame.inverse * start.placement(&frame.projection),
                grid_area: start.rectangle().area(),
                emitted_w: self.flux_w(start.rectangle()),
                ..frame
            },
            None => frame,
        }
    }

    /// Flux through a rectangle across the axis, at any turn about it: m² of a directional light, tangents of a point light.
    fn flux_w(&self, rectangle: &Rectangle) -> f64 {
        let size = match self.kind {
            LightKind::Directional => rectangle.area(),
            LightKind::Point => solid_angle(rectangle),
        };
        self.intensity_w_sr * size
    }

    /// Whether the light can be used; the error names the parameter and its valid range.
    pub fn validate(&self) -> Result<(), String> {
        within_ranges("light", self)?;
        let directional = self.kind == LightKind::Directional;
        if directional && DVec3::from(self.direction).try_normalize().is_none() {
            return Err(format!(
                "light.direction = {:?} has no direction: a component must differ from 0",
                self.direction
            ));
        }
        if directional && self.travel().y > -0.01 {
            return Err(format!(
                "light.direction = {:?} must point downwards, into the water: its y, at unit length, must be below -0.01",
                self.direction
            ));
        }
        if !directional && self.position_m[1] <= 0.0 {
            return Err(format!(
                "light.position_m = {:?} must lie above the water: its y must be greater than 0",
                self.position_m
            ));
        }
        Ok(())
    }

    /// Unit direction in which a directional light's rays travel.
    fn travel(&self) -> DVec3 {
        DVec3::from(self.direction).try_normalize().unwrap_or(DVec3::NEG_Y)
    }

    /// A box along the view's −z around `seen`, and its cross-section.
    fn orthographic(&self, view: &DMat4, seen: &[DVec3], bounds: &Bounds) -> (DMat4, Rectangle) {
        let across = |points: &[DVec3]| {
            Rectangle::from_points(points.iter().map(|p| view.transform_point3(*p).truncate()))
        };
        let (near, far) = depth_range(view, &bounds.corners());
        let r = match self.half_extent_m {
            h if h > 0.0 => Rectangle::square(h),
            _ => across(seen).intersection(&across(&bounds.corners())),
        };
        let slack_m = DEPTH_SLACK * bounds.size().length();
        let (near, far) = (near - slack_m, far + slack_m);
        let projection = directx::orthographic(r.min.x, r.max.x, r.min.y, r.max.y, near, far);
        (projection, r)
    }

    /// A pyramid along the view's −z around `seen`, and its cross-section at unit distance.
    fn pyramid(
        &self,
        view: &DMat4,
        seen: &[DVec3],
        bounds: &Bounds,
        reach: f64,
    ) -> (DMat4, Rectangle) {
        let tangents = |points: &[DVec3]| {
            let points: Vec<DVec3> = points.iter().map(|p| view.transform_point3(*p)).collect();
            let [x, y] = [DVec3::X, DVec3::Y].map(|side| tangent_range(&points, side));
            Rectangle { min: DVec2::new(x[0], y[0]), max: DVec2::new(x[1], y[1]) }
        };
        let r = match self.half_extent_m {
            h if h > 0.0 => Rectangle::square((h / reach).min(POINT_MAX_TANGENT)),
            _ => tangents(seen).intersection(&tangents(&bounds.corners())),
        };
        let (nearest, farthest) = depth_range(view, &lit_within(bounds, view, &r));
        let size_m = bounds.size().length();
        let near = (nearest - DEPTH_SLACK * size_m).max(POINT_NEAR * size_m);
        let far = (farthest + DEPTH_SLACK * size_m).max(2.0 * near);
        let (low, high) = (r.min * near, r.max * near);
        let projection = directx::frustum(low.x, high.x, low.y, high.y, near, far);
        (projection, r)
    }
}

/// An up vector that is never parallel to `forward`.
fn up_vector(forward: DVec3) -> DVec3 {
    if forward.z.abs() < 0.9 { DVec3::Z } else { DVec3::X }
}

/// Smallest and largest distance of points along the view direction.
fn depth_range(view: &DMat4, points: &[DVec3]) -> (f64, f64) {
    let depths = || points.iter().map(|point| -view.transform_point3(*point).z);
    (depths().fold(f64::INFINITY, f64::min), depths().fold(f64::NEG_INFINITY, f64::max))
}

/// Corners of the part of the bounds within a point light's pyramid; all of the bounds where there is none. Bounds beside or
/// behind the light must not bring the near plane to it: 32-bit floats then place rays a millimetre off at 25 m.
fn lit_within(bounds: &Bounds, view: &DMat4, r: &Rectangle) -> Vec<DVec3> {
    // A point's depth is −z: its tangents are at least the rectangle's smallest, and at most its largest.
    let sides = [
        DVec4::new(1.0, 0.0, r.min.x, 0.0),
        DVec4::new(-1.0, 0.0, -r.max.x, 0.0),
        DVec4::new(0.0, 1.0, r.min.y, 0.0),
        DVec4::new(0.0, -1.0, -r.max.y, 0.0),
    ];
    let mut points = surface_within(bounds, &sides.map(|side| view.transpose() * side));
    let light = view.inverse().transform_point3(DVec3::ZERO);
    points.extend(bounds.contains(light).then_some(light));
    if points.is_empty() { bounds.corners().to_vec() } else { points }
}

/// Smallest and largest tangent along a side of what of the points' hull, in view space, lies before a light: where the hull passes beside
/// the light counts, and not what of it is behind.
fn tangent_range(points: &[DVec3], side: DVec3) -> [f64; 2] {
    let flat = points.iter().map(|p| DVec2::new(p.dot(side), p.z)).collect::<Vec<_>>();
    let outline = hull(&flat).iter().map(|p| DVec3::new(p.x, 0.0, p.y)).collect();
    let ahead = clip_polygon(outline, &[DVec4::new(0.0, 0.0, -1.0, -MIN_DEPTH)]);
    let tangents = ahead.iter().map(|p| tangent(*p).x);
    tangents.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], t| [a.min(t), b.max(t)])
}

/// Solid angle of the pyramid with these tangents, steradians.
fn solid_angle(r: &Rectangle) -> f64 {
    let quadrant = |x: f64, y: f64| (x * y).atan2((1.0 + x * x + y * y).sqrt());
    quadrant(r.max.x, r.max.y) - quadrant(r.min.x, r.max.y) - quadrant(r.max.x, r.min.y)
        + quadrant(r.min.x, r.min.y)
}

#[cfg(test)]
mod tests {
    use itertools::iproduct;

    use super::super::check::{InvalidCase, assert_refused};
    use super::*;

    fn camera() -> Camera {
        Camera::new([0.0, -1.0, 6.0], [0.0, -2.0, 0.0], 60.0, [0.1, 14.0])
    }

    fn bounds() -> Bounds {
        Bounds { min: DVec3::new(-6.0, -4.0, -7.0), max: DVec3::new(6.0, 1.0, 7.0) }
    }

    fn steep() -> Light {
        Light { direction: [0.0, -1.0, 0.0], ..Light::default() }
    }

    fn point(position_m: [f64; 3]) -> Light {
        Light { kind: LightKind::Point, position_m, ..Light::default() }
    }

    fn frames() -> [LightFrame; 3] {
        let lights = [Light::default(), point([1.0, 9.0, 2.0]), steep()];
        lights.map(|light| light.frame(&camera(), 1.0, &bounds(), &Water::default(), false))
    }

    /// Points of the floor that the camera sees.
    fn visible_floor() -> Vec<DVec3> {
        let m = camera().view_projection(1.0);
        let points = iproduct!(0..60, 0..60).map(|(i, j)| {
            DVec3::new(-6.0 + f64::from(i) * 0.2, -4.0, -7.0 + f64::from(j) * 14.0 / 60.0)
        });
        points.filter(|p| holds(&m, *p, 0.0)).collect()
    }

    /// Whether a frustum, this much wider, holds a point.
    fn holds(view_projection: &DMat4, p: DVec3, slack: f64) -> bool {
        let ndc = view_projection.project_point3(p);
        ndc.truncate().abs().max_element() <= 1.0 + slack && (0.0..=1.0).contains(&ndc.z)
    }

    #[test]
    fn frustum_holds_the_visible_floor_and_its_entry_points() {
        let floor = visible_floor();
        assert!(floor.len() > 100);
        for frame in frames() {
            let held = |p: DVec3| holds(&frame.view_projection, p, 1e-9);
            for p in &floor {
                assert!(held(*p), "{:?} {p}", frame.kind);
                let entry = DVec3::new(p.x, 0.0, p.z);
                assert!(held(entry) || !bounds().contains(entry), "{:?} {entry}", frame.kind);
            }
        }
    }

    #[test]
    fn frustum_never_exceeds_the_bounds() {
        let wide = Camera { fov_y_deg: 150.0, z_far_m: 500.0, ..camera() };
        let frame = steep().frame(&wide, 1.0, &bounds(), &Water::default(), false);
        assert!(frame.emitted_w <= 9.2 * 12.0 * 14.0 + 1e-9, "{}", frame.emitted_w);
        // A camera that sees nothing gets all of them.
        let away = Camera { position_m: [0.0, 50.0, 0.0], target_m: [0.0, 60.0, 1.0], ..camera() };
        let frame = steep().frame(&away, 1.0, &bounds(), &Water::default(), false);
        assert!((frame.emitted_w - 9.2 * 12.0 * 14.0).abs() < 1e-6);
    }

    #[test]
    fn near_plane_of_a_point_light_is_as_far_as_what_lies_in_its_frustum() {
        let wide = Bounds { min: DVec3::new(-60.0, -4.0, -60.0), max: DVec3::new(60.0, 1.0, 60.0) };
        let near_m = |position_m: [f64; 3]| {
            let light = Light { half_extent_m: 2.0, ..point(position_m) };
            let frame = light.frame(&camera(), 1.0, &wide, &Water::default(), false);
            let cells = iproduct!(0..=240, 0..=10, 0..=240);
            let places =
                cells.map(|(i, j, k)| wide.min + DVec3::from([i, j, k].map(f64::from)) * 0.5);
            let mut held = 0;
            for p in places {
                let ndc = frame.view_projection * p.extend(1.0);
                if ndc.w > 0.0 && (ndc.truncate().truncate() / ndc.w).abs().max_element() <= 1.0 {
                    assert!((0.0..=1.0).contains(&(ndc.z / ndc.w)), "{position_m:?} {p}");
                    held += 1;
                }
            }
            assert!(held > 100);
            (frame.ray(0.0, 0.0).0 - frame.position).length()
        };
        // Of these bounds some lies behind the light, and none of that in its frustum.
        assert!(near_m([20.0, 9.0, 2.0]) > 8.0);
        let min_m = POINT_NEAR * wide.size().length();
        assert!((near_m([20.0, 0.5, 2.0]) - min_m).abs() < 1e-6);
    }

    #[test]
    fn a_set_extent_and_a_view_of_no_water_keep_the_whole_frustum() {
        let water = Water::default();
        let set = Light { half_extent_m: 2.0, ..Light::default() };
        let away = Camera { position_m: [0.0, 50.0, 0.0], target_m: [0.0, 60.0, 1.0], ..camera() };
        for (light, camera) in [(set, camera()), (Light::default(), away)] {
            let frame = |fitted| light.frame(&camera, 1.0, &bounds(), &water, fitted);
            assert_eq!(frame(true), frame(false));
        }
    }

    #[test]
    fn flux_is_intensity_times_solid_angle_or_area() {
        let full = Rectangle::square(1.0);
        // One face of a cube seen from its centre: a sixth of the sphere.
        let sixth = 4.0 * std::f64::consts::PI / 6.0;
        assert!((solid_angle(&full) - sixth).abs() < 1e-12);
        let light = Light { half_extent_m: 2.0, ..Light::default() };
        let frame = light.frame(&camera(), 1.0, &bounds(), &Water::default(), false);
        assert!((frame.emitted_w - 9.2 * 16.0).abs() < 1e-9);
        let light = Light { half_extent_m: 1.0, ..point([0.0, 5.0, 0.0]) };
        let frame = light.frame(&camera(), 1.0, &bounds(), &Water::default(), false);
        let reach = (camera().middle() - DVec3::new(0.0, 5.0, 0.0)).length();
        let expected = 9.2 * solid_angle(&Rectangle::square(1.0 / reach));
        assert!((frame.emitted_w - expected).abs() < 1e-9);
    }

    #[test]
    fn bad_values_are_named() {
        let cases: &[InvalidCase<Light>] = &[
            (|l| l.direction = [0.0, 1.0, 0.0], "light.direction"),
            (|l| l.direction = [0.0; 3], "has no direction"),
            (|l| l.direction = [0.0, -1e-200, 0.0], "has no direction"),
            (|l| l.intensity_w_sr = f64::INFINITY, "light.intensity_w_sr"),
            (|l| l.half_extent_m = -1.0, "light.half_extent_m"),
            (|l| (l.kind, l.position_m[1]) = (LightKind::Point, -1.0), "light.position_m"),
        ];
        assert_refused(&Light::default(), Light::validate, cases);
    }
}

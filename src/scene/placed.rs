//! A bare mesh as a scene: on a plate, lit, and seen so that it fills the picture.

use std::path::Path;

use glam::{DQuat, DVec3, EulerRot};

use super::{Bounds, Camera, Mesh, SceneError, SceneFile, Transform};

/// Largest extent of the mesh in its scene, metres: lengths that are not scaled with a scene, such as those of waves, suit it.
const EXTENT_M: f64 = 2.0;
/// Size of the plate over the mesh's.
const PLATE: f64 = 1.2;
/// Smallest side of the plate over the mesh's largest extent.
const MIN_PLATE: f64 = 0.2;
/// From where a mesh is seen unless asked otherwise: angle about the vertical from +z to +x, and height above the horizon.
const VIEW_DEG: [f64; 2] = [25.0, 25.0];
const FOV_Y_DEG: f64 = 40.0;
/// Share of a square picture that the box of what is seen takes.
const FILLED: f64 = 0.92;

impl Camera {
    /// Looks at the middle of a box from this direction (azimuth from +z to +x, elevation, degrees), from as near as a square picture
    /// holds the box.
    pub fn around(bounds: &Bounds, [azimuth_deg, elevation_deg]: [f64; 2]) -> Camera {
        let [azimuth, elevation] = [azimuth_deg, elevation_deg.clamp(-89.0, 89.0)];
        let [yaw, pitch] = [azimuth, -elevation].map(f64::to_radians);
        let rotation = DQuat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0);
        let target = bounds.center();
        let slope = FILLED * (FOV_Y_DEG / 2.0).to_radians().tan();
        // Of a corner: right, up, and towards the camera.
        let corners = bounds.corners().map(|corner| rotation.inverse() * (corner - target));
        let distance = corners.map(|c| c.x.abs().max(c.y.abs()) / slope + c.z);
        let distance = distance.into_iter().fold(f64::MIN_POSITIVE, f64::max);
        let near = (distance - 0.75 * bounds.size().length()).max(0.05 * distance);
        let position = target + rotation * DVec3::Z * distance;
        let z_m = [near, 2.0 * distance - near];
        Camera::new(position.to_array(), target.to_array(), FOV_Y_DEG, z_m)
    }
}

/// Its camera, plate and mesh are those of the file.
const SCENE: &str = r#"
name = "mesh"
description = "A mesh on a plate"
floor_depth_m = 3.0
camera = { position_m = [0, 0, 1], target_m = [0, 0, 0], fov_y_deg = 40, z_near_m = 0.1, z_far_m = 10 }
light.direction = [0.5, -1.0, -0.55]

[[object]]
name = "plate"
generator = "plane"
material.receiver = true

[[object]]
name = "mesh"
file = "a.obj"
"#;

impl SceneFile {
    /// The scene of a mesh file.
    pub(super) fn of_mesh(path: &Path) -> Result<SceneFile, SceneError> {
        let mesh = Mesh::read(path).map_err(SceneError::Mesh)?;
        let mut scene = SceneFile::parse("", SCENE)?;
        let factor = EXTENT_M / mesh.bounds().size().max_element();
        let transform = Transform { fit_m: EXTENT_M, ..Transform::default() };
        let matrix = transform.matrix(&mesh.bounds(), scene.floor_depth_m);
        let bounds = mesh.transformed(&matrix).bounds();
        let side = |extent: f64| PLATE * extent.max(MIN_PLATE * EXTENT_M);
        let sides = [("width_m", side(bounds.size().x)), ("depth_m", side(bounds.size().z))];
        scene.objects[0].params = sides.map(|(name, side)| (name.to_owned(), side.into())).into();
        (scene.objects[1].file, scene.objects[1].transform) = (Some(path.to_owned()), transform);
        scene.camera = Camera::around(&bounds, VIEW_DEG);
        scene.description =
            format!("A mesh on a plate, scaled to {EXTENT_M} m ({factor:.4} times its own size)");
        scene.name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From every side, and whatever its shape: no corner is outside, and some corner is near the edge.
    #[test]
    fn a_camera_around_a_box_fills_its_picture() {
        let box_of =
            |size: [f64; 3]| Bounds { min: DVec3::ONE, max: DVec3::ONE + DVec3::from(size) };
        for bounds in [[1.0; 3], [100.0, 1.0, 1e-3], [0.0, 2.0, 5.0]].map(box_of) {
            for view in [[0.0, 0.0], [25.0, 25.0], [200.0, -40.0], [90.0, 90.0]] {
                let camera = Camera::around(&bounds, view);
                assert_eq!(camera.validate(), Ok(()), "{bounds:?}, {view:?}");
                let matrix = camera.view_projection(1.0);
                let seen = bounds.corners().map(|corner| matrix.project_point3(corner));
                let widest = seen.map(|at| at.x.abs().max(at.y.abs()));
                let widest = widest.into_iter().fold(0.0, f64::max);
                assert!((0.9..0.93).contains(&widest), "{bounds:?}, {view:?}: {widest}");
                assert!(seen.iter().all(|at| (0.0..=1.0).contains(&at.z)), "{bounds:?}, {view:?}");
            }
        }
    }
}

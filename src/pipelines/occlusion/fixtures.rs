//! A corner and what a G-buffer has of it, for tests.

use super::*;
use fathom_scene::Mesh;

/// A floor y = 0 and a wall x = 0 above it, 8 m wide.
pub fn corner() -> Vec<Object> {
    let [x, y, z] = DVec3::AXES.map(|axis| 4.0 * axis);
    let quads = [Mesh::parallelogram(x, z, x), Mesh::parallelogram(y, y, z)];
    quads.map(|mesh| Object::new("quad", mesh)).into()
}

pub fn camera(position_m: [f64; 3]) -> Camera {
    Camera::new(position_m, [0.5, 0.5, 0.0], 50.0, [0.1, 50.0])
}

/// Depths and normals as a G-buffer has them.
pub fn gbuffer(tracer: &Tracer, camera: &Camera, [width, height]: [u32; 2]) -> [Pixels; 2] {
    let rays = PixelRays::new(camera, width, height);
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let (mut depth, mut normal) = (Vec::new(), Vec::new());
    for (x, y) in pixels {
        let hit = rays.cast(tracer, x, y);
        depth.push(hit.as_ref().map_or(1.0, |(_, depth)| *depth as f32));
        let n = hit.map_or(DVec3::ZERO, |(hit, _)| hit.shading_normal);
        normal.extend(n.extend(1.0).as_vec4().to_array());
    }
    [(1, depth), (4, normal)].map(|(channels, data)| Pixels { width, height, channels, data })
}

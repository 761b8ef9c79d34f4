//! Surfaces told apart by the camera's depth: what is seen at a pixel, continued as a plane.

use super::image::{Image, behind};
use fathom_scene::Camera;

/// What a camera sees.
#[derive(Clone, Copy)]
pub struct CameraDepth<'a> {
    /// Device depth, 0 near … 1 far, at the size of the viewport.
    pub depth: &'a Image,
    pub camera: &'a Camera,
}

/// The surface at a texel of the depth. Device depth is linear on planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePlane {
    pub texel: [i64; 2],
    pub z: f64,
    /// Change of device depth per texel, to the right and downwards: the smaller of the differences to both neighbours, as the
    /// other may cross an edge.
    pub slope: [f64; 2],
}

impl CameraDepth<'_> {
    /// The texel behind a pixel of a buffer of another size.
    pub fn texel(&self, [x, y]: [i64; 2], own: [u32; 2]) -> [i64; 2] {
        behind([x as f64, y as f64], own, self.depth.size())
    }

    pub fn plane(&self, texel: [i64; 2]) -> SurfacePlane {
        let [x, y] = texel;
        let z = self.depth.clamped(x, y);
        let along = |[dx, dy]: [i64; 2]| {
            let neighbours = [(x + dx, y + dy, 1.0), (x - dx, y - dy, -1.0)];
            let inside = neighbours.into_iter().filter(|(x, y, _)| self.depth.contains(*x, *y));
            let slopes = inside.map(|(x, y, sign)| sign * (self.depth.clamped(x, y) - z));
            slopes.reduce(|a, b| if a.abs() < b.abs() { a } else { b }).unwrap_or(0.0)
        };
        SurfacePlane { texel, z, slope: [along([1, 0]), along([0, 1])] }
    }

    /// Distance along the view.
    pub fn view_m(&self, z: f64) -> f64 {
        self.camera.view_depth_m(z.clamp(0.0, 1.0))
    }

    /// Metres along the view from the plane to what is seen at another texel; negative before the plane.
    pub fn beyond_m(&self, plane: &SurfacePlane, [x, y]: [i64; 2]) -> f64 {
        let [dx, dy] = [x - plane.texel[0], y - plane.texel[1]].map(|d| d as f64);
        let plane_z = plane.z + plane.slope[0] * dx + plane.slope[1] * dy;
        self.view_m(self.depth.clamped(x, y)) - self.view_m(plane_z)
    }
}

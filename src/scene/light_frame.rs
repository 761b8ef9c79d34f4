//! The frustum in which a light's photons start.

use glam::{DMat4, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use fathom_base::choices;

/// Largest tangent of a point light's frustum (79° off its axis).
pub const POINT_MAX_TANGENT: f64 = 5.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightKind {
    /// Parallel rays; the position tracks the camera (UW 3.1).
    Directional,
    /// Rays from a fixed point.
    Point,
}

choices!(LightKind);

/// The light's frustum for one view: the space in which photons start and the shadow map lies.
#[derive(Clone, Debug, PartialEq)]
pub struct LightFrame {
    pub kind: LightKind,
    /// Metres.
    pub position: DVec3,
    /// Unit vector `l = p_mid − p_light` (UW 3.1).
    pub forward: DVec3,
    /// World to light space (right-handed, looking along −z).
    pub view: DMat4,
    /// Light to clip space, depth 0 … 1: orthographic (directional) or perspective (point), in
    /// general not centred on the axis.
    pub projection: DMat4,
    /// World to clip space.
    pub view_projection: DMat4,
    pub inverse: DMat4,
    /// From places of the photon grid, −1 … 1 along each side, and a depth to the world: all of the frustum, or the part of it that is
    /// fitted to the water in view.
    pub photon_grid: DMat4,
    /// Area of the photon grid: m² across a directional light's rays, m²/m² on the plane at unit distance from a point light.
    pub grid_area: f64,
    /// Flux through the photon grid, watts: irradiance × area (directional) or intensity × solid angle (point).
    pub emitted_w: f64,
}

impl LightFrame {
    /// Origin on the near plane and unit direction of the ray through normalized device coordinates.
    pub fn ray(&self, ndc_x: f64, ndc_y: f64) -> (DVec3, DVec3) {
        self.ray_from(self.inverse.project_point3(DVec3::new(ndc_x, ndc_y, 0.0)))
    }

    /// Origin on the near plane and unit direction of a photon at a place of the grid, −1 … 1 along each side.
    pub fn photon_ray(&self, place: [f64; 2]) -> (DVec3, DVec3) {
        self.ray_from(self.photon_grid.project_point3(DVec2::from(place).extend(0.0)))
    }

    fn ray_from(&self, origin: DVec3) -> (DVec3, DVec3) {
        let direction = match self.kind {
            LightKind::Directional => self.forward,
            LightKind::Point => (origin - self.position).normalize(),
        };
        (origin, direction)
    }
}

/// Least depth of a view-space point.
pub const MIN_DEPTH: f64 = 1e-9;

/// Tangents of a view-space point's angles off the axis, limited to [`POINT_MAX_TANGENT`].
pub fn tangent(p: DVec3) -> DVec2 {
    let depth = (-p.z).max(MIN_DEPTH);
    (p.truncate() / depth).clamp(DVec2::splat(-POINT_MAX_TANGENT), DVec2::splat(POINT_MAX_TANGENT))
}

//! Light that something outside the camera's frustum stops: UW §2 says that tracing in the camera's screen space misses it.

use glam::{DMat4, DVec3};

use fathom_reference::rays::{Hit, Tracer};
use fathom_stages::photon::Photon;
use fathom_stages::uniforms::View;

/// A ray goes on this far behind a surface, so as not to meet it again, metres in scene tank.
const BEYOND_M: f64 = 1e-6;
/// Surfaces of a ray that are looked at: it meets few.
const MAX_SURFACES: usize = 16;

/// The camera's frustum.
pub struct Frustum {
    view_projection: DMat4,
    beyond_m: f64,
}

impl Frustum {
    /// `times` is the scene's size, in times of scene tank.
    pub fn new(view: &View, times: f64) -> Self {
        let view_projection = view.camera.view_projection(view.aspect());
        Self { view_projection, beyond_m: BEYOND_M * times }
    }

    pub fn holds(&self, place: DVec3) -> bool {
        let clip = self.view_projection * place.extend(1.0);
        clip.x.abs() <= clip.w && clip.y.abs() <= clip.w && (0.0..=clip.w).contains(&clip.z)
    }

    /// What a ray that ends on a surface would meet behind it.
    pub fn hits_behind(
        &self,
        tracer: &Tracer,
        hit: Hit,
        direction: DVec3,
    ) -> impl Iterator<Item = Hit> {
        let next = move |hit: &Hit| tracer.cast(hit.position, direction, self.beyond_m, f64::MAX);
        std::iter::successors(next(&hit), next).take(MAX_SURFACES)
    }

    /// Whether a ray ends out of view, and would come into view if nothing stood there.
    pub fn is_hidden_entry(&self, tracer: &Tracer, hit: &Hit, direction: DVec3) -> bool {
        !self.holds(hit.position)
            && self.hits_behind(tracer, *hit, direction).any(|next| self.holds(next.position))
    }

    /// Whether a photon that ends out of view was found in view, behind that.
    pub fn is_leak(&self, found: &Photon, exact: DVec3) -> bool {
        let distance_m = |end: DVec3| end.distance(found.entry());
        found.has_landed() && self.holds(found.hit()) && distance_m(found.hit()) > distance_m(exact)
    }
}

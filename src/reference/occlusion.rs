//! Ambient occlusion by casting rays at triangles: the answer that volume and screen-space methods approximate.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};

use super::rays::Tracer;

/// How far along the normal rays begin, share of r_max: clears the rounding of points that come from a depth buffer (a
/// quarter of this at 25 m in scene sponza), and is short enough that what it skips weighs nothing.
const ORIGIN_OFFSET: f64 = 1e-3;

/// ρ(d), the obscurity of an occluder at a distance, on (0, r_max]; 0 beyond. VAO Eq. 1 leaves it open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obscurity {
    /// 1 − d / r_max.
    Linear,
    /// 1.
    Hard,
}

impl Obscurity {
    /// ρ at a distance of `share` × r_max.
    pub fn value_at(self, share: f64) -> f64 {
        match self {
            _ if share > 1.0 => 0.0,
            Obscurity::Linear => 1.0 - share,
            Obscurity::Hard => 1.0,
        }
    }
}

/// A(p) of VAO Eq. 1 by casting `rays` cosine-distributed low-discrepancy rays: 0 open … 1 closed, without bias.
///
/// The hemisphere is that of `normal`, which has unit length. Rays begin 10⁻³ r_max along it, and distances count from
/// there. The same arguments give the same number.
pub fn occlusion(
    tracer: &Tracer,
    position: DVec3,
    normal: DVec3,
    r_max_m: f64,
    attenuation: Obscurity,
    rays: u32,
) -> f64 {
    let origin = position + normal * (ORIGIN_OFFSET * r_max_m);
    over_hemisphere(normal, rays, |direction| {
        let hit = tracer.cast(origin, direction, 0.0, r_max_m)?;
        Some(attenuation.value_at(hit.distance_m / r_max_m))
    })
}

/// The mean over `rays` cosine-distributed low-discrepancy directions around a unit normal; what has no value counts as 0.
pub(super) fn over_hemisphere(
    normal: DVec3,
    rays: u32,
    value: impl Fn(DVec3) -> Option<f64>,
) -> f64 {
    let frame = tangent_frame(normal);
    let directions = (0..rays).map(|i| frame * cosine_direction(hammersley(i, rays)));
    directions.filter_map(value).sum::<f64>() / f64::from(rays.max(1))
}

/// A(p) of VAO Eq. 3 where surfaces let light through: γ of a ray is 1 − Π (1 − α) over the surfaces that it crosses within r_max,
/// without attenuation by distance. `alphas` are the objects' opacities. Rays as in [`occlusion`].
pub fn occlusion_through(
    tracer: &Tracer,
    position: DVec3,
    normal: DVec3,
    r_max_m: f64,
    alphas: &[f64],
    rays: u32,
) -> f64 {
    let origin = position + normal * (ORIGIN_OFFSET * r_max_m);
    over_hemisphere(normal, rays, |direction| {
        let (mut open, mut from_m) = (1.0, 0.0);
        while open > 0.0
            && let Some(hit) = tracer.cast(origin, direction, from_m, r_max_m)
        {
            open *= 1.0 - alphas[hit.object];
            // Past the edge that two triangles of a surface share.
            from_m = hit.distance_m + SAME_SURFACE * r_max_m;
        }
        Some(1.0 - open)
    })
}

/// Hits nearer to one another than this share of r_max are one crossing.
const SAME_SURFACE: f64 = 1e-7;

/// Point i of a Hammersley set of `count`, in [0, 1)²; the first coordinate lies in the middle of its stratum.
fn hammersley(i: u32, count: u32) -> [f64; 2] {
    [(f64::from(i) + 0.5) / f64::from(count), f64::from(i.reverse_bits()) / 4_294_967_296.0]
}

/// Direction in the hemisphere around +z with density cos θ / π, from a point of [0, 1)² (Malley's method: a point of the
/// unit disc, lifted).
pub fn cosine_direction([u, v]: [f64; 2]) -> DVec3 {
    let (sin, cos) = (TAU * v).sin_cos();
    DVec3::new(u.sqrt() * cos, u.sqrt() * sin, (1.0 - u).sqrt())
}

/// Rotation that brings +z to a unit normal.
pub fn tangent_frame(n: DVec3) -> DMat3 {
    // Adding 0 makes 0 of −0, whose sign would turn the frame.
    let (x, y) = (n + DVec3::ZERO).any_orthonormal_pair();
    DMat3::from_cols(x, y, n)
}

/// Occlusion at `share` × r_max from an endless wall that stands on an endless floor. Directions that meet the wall within
/// r_max have a component of at least k = `share` towards it; on the unit disc of VAO Eq. 1's cosine weight that is a segment.
pub fn occlusion_beside_wall(share: f64, attenuation: Obscurity) -> f64 {
    if share >= 1.0 {
        return 0.0;
    }
    let k = share.max(1e-12);
    let root = (1.0 - k * k).sqrt();
    let segment = k.acos() - k * root;
    let distances = 2.0 * k * (((1.0 + root) / k).ln() - root);
    match attenuation {
        Obscurity::Hard => segment / PI,
        Obscurity::Linear => (segment - distances) / PI,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_scene::{Mesh, Object};

    #[test]
    fn sheets_of_glass_let_their_shares_through() {
        let [across, along] = [100.0 * DVec3::X, 100.0 * DVec3::Z];
        let mesh = |y: f64| Mesh::parallelogram(DVec3::Y * y, across, along);
        let tracer = Tracer::new(&[0.0, 1.0, 2.0].map(|y| Object::new("sheet", mesh(y))));
        // All rays of a long reach cross both sheets. Within 1.5 m they meet the first alone where cos θ > 1 / 1.5: cos² θ is uniform.
        for (r_max_m, exact) in [(200.0, 1.0 - 0.7 * 0.5), (1.5, 0.3 * (1.0 - 1.0 / 2.25))] {
            let alphas = [1.0, 0.3, 0.5];
            let cast = occlusion_through(&tracer, DVec3::ZERO, DVec3::Y, r_max_m, &alphas, 4096);
            assert!((cast - exact).abs() < 1e-3, "{cast} {exact}");
        }
    }
}

//! Participating media: what a ray keeps of its light, and how much of the light that arrives at a point the medium around it
//! holds off. VAO §5.2.2 to §5.2.4 in f64: closed forms, and marching through a field on the host.

use std::f64::consts::PI;

use glam::{DVec3, UVec3};

use super::occlusion::{cosine_direction, tangent_frame};
use super::optics::transmittance;
use fathom_scene::Volume;

/// Intervals of one-dimensional integrals, by the midpoint rule.
const INTERVALS: u32 = 4096;

/// Light that gets through a view ray's points below which no more of them are looked at.
const LEAST_THROUGH: f64 = 1.0 / 256.0;

/// What the values of a field mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// Opacities of a voxel of this edge, metres.
    Opacity { voxel_m: f64 },
    /// Shares of this attenuation coefficient, 1/m.
    Beer { density_per_m: f64 },
}

impl Law {
    /// Attenuation coefficient of a value, 1/m: σ̂ = −ln(1 − V) / v_s (VAO §5.2.3), or Beer's σ.
    pub fn attenuation(self, value: f64) -> f64 {
        match self {
            Law::Opacity { voxel_m } => -(1.0 - value).ln() / voxel_m,
            Law::Beer { density_per_m } => density_per_m * value,
        }
    }

    /// Opacity of a length of constant value. VAO Eq. 6.
    pub fn opacity(self, value: f64, length_m: f64) -> f64 {
        1.0 - transmittance(self.attenuation(value), length_m)
    }
}

/// Rays through a field, as VAO §5.2.2 marches them.
#[derive(Clone, Debug, PartialEq)]
pub struct Marching {
    pub law: Law,
    pub r_max_m: f64,
    pub samples: u32,
    /// Whether samples of falling value count for nothing (Eq. 4).
    pub rejection: bool,
    /// V_thres: a counted sample of more than this value ends the ray; infinity: none does.
    pub threshold: f64,
}

impl Marching {
    /// γ along a ray: Eq. 5, with Eq. 6 for opacities. `jitter` is the place of each sample in its stratum, 0 … 1. The march
    /// does not end where the obscurance comes near 1.
    pub fn obscurance(&self, field: &Volume, origin: DVec3, direction: DVec3, jitter: f64) -> f64 {
        let stratum_m = self.r_max_m / f64::from(self.samples);
        let mut before = interpolated(field, origin);
        let mut depth = 0.0;
        for k in 0..self.samples {
            let distance_m = (f64::from(k) + jitter) * stratum_m;
            let position = origin + direction * distance_m;
            if !field.bounds().contains(position) {
                break;
            }
            let value = interpolated(field, position);
            let counts = !self.rejection || value >= before;
            before = value;
            if counts {
                depth += self.law.attenuation(value) * stratum_m;
                if value > self.threshold {
                    break;
                }
            }
        }
        1.0 - (-depth).exp()
    }

    /// A of Eq. 3 over the hemisphere of a unit normal: the mean of γ over `rays` cosine-distributed directions.
    pub fn hemispherical(&self, field: &Volume, position: DVec3, normal: DVec3, rays: u32) -> f64 {
        let frame = tangent_frame(normal);
        self.mean(field, position, rays, |u| frame * cosine_direction(u))
    }

    /// A_P of Eq. 8: the mean of γ over `rays` directions of the whole sphere.
    pub fn positional(&self, field: &Volume, position: DVec3, rays: u32) -> f64 {
        self.mean(field, position, rays, sphere_direction)
    }

    /// A along a view ray: that of each of its points, weighted by what the point sends to the viewer. None where the ray meets nothing.
    pub fn along_view(
        &self,
        field: &Volume,
        (origin, direction, length_m): (DVec3, DVec3, f64),
        step_m: f64,
        occlusion: impl Fn(DVec3) -> f64,
    ) -> Option<f64> {
        let (mut through, mut sum) = (1.0, 0.0);
        for k in 0..(length_m / step_m).ceil() as u32 {
            let position = origin + direction * ((f64::from(k) + 0.5) * step_m);
            let weight = through * self.law.opacity(interpolated(field, position), step_m);
            if weight > 0.0 {
                sum += weight * occlusion(position);
                through -= weight;
            }
            if through < LEAST_THROUGH {
                break;
            }
        }
        (through < 1.0).then(|| sum / (1.0 - through))
    }

    fn mean(
        &self,
        field: &Volume,
        position: DVec3,
        rays: u32,
        direction: impl Fn([f64; 2]) -> DVec3,
    ) -> f64 {
        let sum: f64 = (0..rays)
            .map(|i| {
                let [u, v, jitter] = halton(i);
                self.obscurance(field, position, direction([u, v]), jitter)
            })
            .sum();
        sum / f64::from(rays.max(1))
    }
}

/// Point i of the Halton sequence in bases 2, 3 and 5.
fn halton(i: u32) -> [f64; 3] {
    [2, 3, 5].map(|base| {
        let (mut rest, mut scale, mut sum) = (i + 1, 1.0, 0.0);
        while rest > 0 {
            scale /= f64::from(base);
            sum += scale * f64::from(rest % base);
            rest /= base;
        }
        sum
    })
}

/// Direction with density 1 / 4π, from a point of [0, 1)².
fn sphere_direction([u, v]: [f64; 2]) -> DVec3 {
    let z = 1.0 - 2.0 * u;
    let (sin, cos) = (2.0 * PI * v).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(radius * cos, radius * sin, z)
}

/// A field's value at a point: trilinear between cell centres, constant from the outer ones to the border, 0 beyond.
pub fn interpolated(field: &Volume, position: DVec3) -> f64 {
    if !field.bounds().contains(position) {
        return 0.0;
    }
    let place = (position - field.origin_m) / field.spacing_m;
    trilinear(field.cells, place, |cell| f64::from(field.at(cell)))
}

/// Trilinear between the centres of cells, at a place in cells from the corner; up to half a cell inside the border the border's.
pub(super) fn trilinear(cells: [u32; 3], place: DVec3, value: impl Fn([u32; 3]) -> f64) -> f64 {
    let last = (UVec3::from(cells) - 1).as_dvec3();
    let base = (place - 0.5).floor();
    let part = place - 0.5 - base;
    let corner = |i: u32| {
        let offset = UVec3::new(i & 1, i >> 1 & 1, i >> 2).as_dvec3();
        let weight = DVec3::ONE - offset + (2.0 * offset - 1.0) * part;
        let cell = (base + offset).clamp(DVec3::ZERO, last).as_uvec3();
        weight.element_product() * value(cell.to_array())
    };
    (0..8).map(corner).sum()
}

/// A_P in the middle of a homogeneous ball in empty space: 1 − exp(−σ min(radius, r_max)).
pub fn in_ball(sigma_per_m: f64, radius_m: f64, r_max_m: f64) -> f64 {
    1.0 - transmittance(sigma_per_m, radius_m.min(r_max_m))
}

/// A_P at a depth under the plane face of a homogeneous half-space: half the directions lead inwards, the others leave after
/// depth / cosine.
pub fn under_face(sigma_per_m: f64, depth_m: f64, r_max_m: f64) -> f64 {
    let inwards = 1.0 - transmittance(sigma_per_m, r_max_m);
    let outwards =
        mean_over_unit(|cosine| 1.0 - transmittance(sigma_per_m, r_max_m.min(depth_m / cosine)));
    0.5 * (inwards + outwards)
}

/// A of Eq. 3 where the attenuation coefficient is `sigma_per_m` at the point and falls by `fall_per_m2` for each metre along
/// the normal, down to 0: ∫₀¹ 2μ (1 − exp(−τ(μ))) dμ with τ the line integral of σ in closed form.
pub fn on_ramp(sigma_per_m: f64, fall_per_m2: f64, r_max_m: f64) -> f64 {
    mean_over_unit(|cosine| {
        let fall = fall_per_m2 * cosine;
        let length = r_max_m.min(sigma_per_m / fall);
        2.0 * cosine * (1.0 - (-(sigma_per_m - 0.5 * fall * length) * length).exp())
    })
}

fn mean_over_unit(f: impl Fn(f64) -> f64) -> f64 {
    let n = f64::from(INTERVALS);
    (0..INTERVALS).map(|i| f((f64::from(i) + 0.5) / n)).sum::<f64>() / n
}

#[cfg(test)]
pub(super) mod tests {
    use itertools::iproduct;

    use super::*;

    const VOXEL_M: f64 = 0.1;

    /// A cube of so many cells of 0.1 m a side about the origin.
    pub fn field(cells: u32, f: impl Fn(DVec3) -> f64) -> Volume {
        let half = f64::from(cells) * VOXEL_M / 2.0;
        let centre = |i: u32| (f64::from(i) + 0.5) * VOXEL_M - half;
        let places = iproduct!(0..cells, 0..cells, 0..cells);
        let values = places.map(|(z, y, x)| f(DVec3::new(centre(x), centre(y), centre(z))) as f32);
        Volume {
            name: "test".into(),
            cells: [cells; 3],
            origin_m: DVec3::splat(-half),
            spacing_m: DVec3::splat(VOXEL_M),
            data: values.collect(),
        }
    }

    fn marching(law: Law, r_max_m: f64) -> Marching {
        Marching { law, r_max_m, samples: 16, rejection: false, threshold: f64::INFINITY }
    }

    const OPACITY: Law = Law::Opacity { voxel_m: VOXEL_M };

    #[test]
    fn opacity_of_a_length_is_that_of_its_voxels_in_turn() {
        let ten = OPACITY.opacity(0.2, 10.0 * VOXEL_M);
        assert!((ten - (1.0 - 0.8f64.powi(10))).abs() < 1e-12);
        let part = OPACITY.opacity(0.2, 0.25 * VOXEL_M);
        assert!(((1.0 - part).powi(4) - 0.8).abs() < 1e-12);
    }

    #[test]
    fn interpolation_is_exact_for_linear_fields_and_empty_outside() {
        let linear = |p: DVec3| 0.5 + 0.1 * p.x - 0.2 * p.y + 0.3 * p.z;
        let field = field(12, linear);
        for p in [DVec3::new(0.113, -0.27, 0.31), DVec3::new(-0.4, 0.05, 0.0)] {
            assert!((interpolated(&field, p) - linear(p)).abs() < 1e-6);
        }
        assert_eq!(interpolated(&field, DVec3::new(0.61, 0.0, 0.0)), 0.0);
        let coarse = field.reduced(2);
        let p = DVec3::new(0.113, -0.27, 0.31);
        assert!((interpolated(&coarse, p) - linear(p)).abs() < 1e-6);
    }

    #[test]
    fn marching_a_homogeneous_block_gives_equations_5_and_7() {
        let block = field(32, |_| 0.1);
        for law in [OPACITY, Law::Beer { density_per_m: 7.0 }] {
            let measured = marching(law, 1.0).positional(&block, DVec3::ZERO, 256);
            assert!((measured - law.opacity(0.1, 1.0)).abs() < 1e-6, "{law:?}");
        }
    }

    #[test]
    fn transmittance_of_two_lengths_is_the_product() {
        let block = field(32, |_| 0.05);
        let clear = |r_max_m| 1.0 - marching(OPACITY, r_max_m).positional(&block, DVec3::ZERO, 64);
        assert!((clear(1.2) - clear(0.6).powi(2)).abs() < 1e-9);
    }

    #[test]
    fn rejection_never_adds_and_empties_a_falling_ray() {
        let ramp = field(24, |p| 0.4 + 0.3 * p.z);
        let without = marching(OPACITY, 0.8);
        let with = Marching { rejection: true, ..without.clone() };
        let directions = (0..64).map(|i| sphere_direction([halton(i)[0], halton(i)[1]]));
        for direction in directions {
            let at = |m: &Marching| m.obscurance(&ramp, DVec3::ZERO, direction, 0.5);
            assert!(at(&with) <= at(&without));
        }
        assert_eq!(with.obscurance(&ramp, DVec3::ZERO, DVec3::NEG_Z, 0.5), 0.0);
        assert!(with.obscurance(&ramp, DVec3::ZERO, DVec3::Z, 0.5) > 0.5);
    }

    #[test]
    fn closed_forms_agree_with_marching() {
        let beer = Law::Beer { density_per_m: 2.0 };
        let m = Marching { samples: 64, ..marching(beer, 1.0) };
        let face = field(32, |p| if p.z < 0.8 { 1.0 } else { 0.0 });
        let depth = DVec3::new(0.0, 0.0, 0.5);
        let marched = m.positional(&face, depth, 4096);
        assert!((marched - under_face(2.0, 0.3, 1.0)).abs() < 4e-3, "{marched}");
        let ramp = field(32, |p| 0.5 - 0.3 * p.z);
        let marched = m.hemispherical(&ramp, DVec3::ZERO, DVec3::Z, 4096);
        assert!((marched - on_ramp(1.0, 0.6, 1.0)).abs() < 2e-3, "{marched}");
    }

    #[test]
    fn a_view_ray_weighs_its_points_by_what_they_send() {
        let block = field(32, |_| 0.5);
        let ray = (DVec3::new(0.0, 0.0, -3.0), DVec3::Z, 6.0);
        // σ of 1 per metre over 3.2 m; the mean depth of what is seen is 1 − 3.2 e^−3.2 / (1 − e^−3.2).
        let beer = marching(Law::Beer { density_per_m: 2.0 }, 1.0);
        let depth = |p: DVec3| p.z + 1.6;
        let seen = beer.along_view(&block, ray, 0.002, depth).unwrap();
        let end = (-3.2f64).exp();
        assert!((seen - (1.0 - 3.2 * end / (1.0 - end))).abs() < 1e-3, "{seen}");
        let past = (DVec3::new(3.0, 0.0, -3.0), DVec3::Z, 6.0);
        assert_eq!(beer.along_view(&block, past, 0.01, depth), None);
    }

    #[test]
    fn limits_of_the_closed_forms() {
        assert_eq!(under_face(3.0, 0.0, 1.0), 0.5 * in_ball(3.0, 1.0, 1.0));
        assert!((under_face(3.0, 2.0, 1.0) - in_ball(3.0, 5.0, 1.0)).abs() < 1e-12);
        assert!((on_ramp(3.0, 1e-9, 1.0) - in_ball(3.0, 1.0, 1.0)).abs() < 1e-7);
        assert_eq!(in_ball(0.0, 1.0, 1.0), 0.0);
    }
}

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
const MIN_THROUGH: f64 = 1.0 / 256.0;

/// What the values of a field mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FieldLaw {
    /// Shares of this opacity of a voxel of this edge, metres.
    Opacity { full: f64, voxel_m: f64 },
    /// Shares of this attenuation coefficient, 1/m.
    Beer { density_per_m: f64 },
}

impl FieldLaw {
    /// Attenuation coefficient of a value, 1/m: σ̂ = −ln(1 − V) / v_s (VAO §5.2.3), or Beer's σ.
    pub fn attenuation(self, value: f64) -> f64 {
        match self {
            FieldLaw::Opacity { full, voxel_m } => -(1.0 - full * value).ln() / voxel_m,
            FieldLaw::Beer { density_per_m } => density_per_m * value,
        }
    }

    /// Opacity of a length of constant value. VAO Eq. 6.
    pub fn opacity(self, value: f64, length_m: f64) -> f64 {
        1.0 - transmittance(self.attenuation(value), length_m)
    }
}

/// Rays through a field, as VAO §5.2.2 marches them.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldMarch {
    pub law: FieldLaw,
    /// Values of the field between which V of the equations runs from 0 to 1.
    pub window: [f64; 2],
    pub r_max_m: f64,
    pub samples: u32,
    /// Whether samples of falling value count for nothing (Eq. 4).
    pub rejection: bool,
    /// V_thres: a counted sample of more than this value ends the ray; infinity: none does.
    pub threshold: f64,
}

impl FieldMarch {
    /// V of the equations for a value of the field.
    pub fn value_of(&self, value: f64) -> f64 {
        let [low, high] = self.window;
        ((value - low) / (high - low)).clamp(0.0, 1.0)
    }

    /// V of the equations at a point.
    pub fn value(&self, field: &Volume, position: DVec3) -> f64 {
        self.value_of(interpolated(field, position))
    }

    /// γ along a ray: Eq. 5, with Eq. 6 for opacities. `jitter` is the place of each sample in its stratum, 0 … 1. The march
    /// does not end where the obscurance comes near 1.
    pub fn obscurance(&self, field: &Volume, origin: DVec3, direction: DVec3, jitter: f64) -> f64 {
        let stratum_m = self.r_max_m / f64::from(self.samples);
        let mut before = self.value(field, origin);
        let mut depth = 0.0;
        for k in 0..self.samples {
            let distance_m = (f64::from(k) + jitter) * stratum_m;
            let position = origin + direction * distance_m;
            if !field.bounds().contains(position) {
                break;
            }
            let value = self.value(field, position);
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
            let weight = through * self.law.opacity(self.value(field, position), step_m);
            if weight > 0.0 {
                sum += weight * occlusion(position);
                through -= weight;
            }
            if through < MIN_THROUGH {
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
    let place = (position - field.origin_m) / field.spacing_m - 0.5;
    let (base, last) = (place.floor(), (UVec3::from(field.cells) - 1).as_dvec3());
    let corner = |i: u32| {
        let offset = UVec3::new(i & 1, i >> 1 & 1, i >> 2).as_dvec3();
        let weight = DVec3::ONE - offset + (2.0 * offset - 1.0) * (place - base);
        let cell = (base + offset).clamp(DVec3::ZERO, last).as_uvec3();
        weight.element_product() * f64::from(field.value(cell.to_array()))
    };
    (0..8).map(corner).sum()
}

/// A of Eq. 3 where the attenuation coefficient is `sigma_per_m` at the point and falls by `fall_per_m2` for each metre along
/// the normal, down to 0: ∫₀¹ 2μ (1 − exp(−τ(μ))) dμ with τ the line integral of σ in closed form.
pub fn occlusion_on_ramp(sigma_per_m: f64, fall_per_m2: f64, r_max_m: f64) -> f64 {
    let towards = |i: u32| {
        let cosine = (f64::from(i) + 0.5) / f64::from(INTERVALS);
        let fall = fall_per_m2 * cosine;
        let length = r_max_m.min(sigma_per_m / fall);
        2.0 * cosine * (1.0 - (-(sigma_per_m - 0.5 * fall * length) * length).exp())
    };
    (0..INTERVALS).map(towards).sum::<f64>() / f64::from(INTERVALS)
}

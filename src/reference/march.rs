//! Ray marching through a volume in f64, twin of the GPU's: the same directions, steps and rules. VAO §3 step 3, §5.1.

use std::cell::Cell;

use glam::{DVec3, UVec3};
use itertools::iproduct;

use super::filter::{pcg, unit};
use super::media::trilinear;
use super::occlusion::{Attenuation, cosine_direction, tangent_frame, uniform_direction};
use fathom_scene::Grid;

/// A volume on the host.
pub struct HostVolume {
    pub grid: Grid,
    /// 0 … 1, in the order of [`Grid::index`].
    pub values: Vec<f64>,
}

impl HostVolume {
    /// The voxels for whose centres `inside` holds are 1.
    pub fn filled(grid: &Grid, inside: impl Fn(DVec3) -> bool) -> HostVolume {
        let [nx, ny, nz] = grid.cells;
        let cells = iproduct!(0..nz, 0..ny, 0..nx).map(|(z, y, x)| [x, y, z]);
        let values = cells.map(|cell| f64::from(u8::from(inside(grid.center(cell)))));
        HostVolume { grid: *grid, values: values.collect() }
    }

    /// V at a place in voxels from the origin, trilinear between voxel centres; up to half a voxel inside the border the
    /// border's.
    pub fn density(&self, place: DVec3) -> f64 {
        let value = |cell| self.values[self.grid.index(cell) as usize];
        trilinear(self.grid.cells, place, value)
    }
}

/// Where the first sample of a ray lies, voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Guard {
    /// This far along the ray.
    Along(f64),
    /// This far above the surface's plane: VAO Eq. 2.
    Above(f64),
}

/// How rays are marched; lengths in voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct March {
    pub rays: u32,
    pub r_max: f64,
    pub step: f64,
    pub threshold: f64,
    pub offset: f64,
    pub guard: Guard,
    /// Each ray's samples are moved along it by a random share of a step.
    pub jitter: bool,
    pub attenuation: Attenuation,
    /// Mean of (n·r) ρ over uniform directions times this, in place of ρ over cosine-distributed ones: 1 in VAO §3 step 3c.
    pub uniform: Option<f64>,
    /// Look-ups of the volume are moved by this along each of its axes.
    pub shift: f64,
    /// Directions of their own for every ray, in place of a shifted lattice.
    pub random: bool,
    /// Samples are opacities: VAO Eq. 7.
    pub opacity: bool,
    /// Of Eq. 7: r_max / (v_s N_samples), the step in voxels.
    pub exponent: f64,
    /// Peaks above the threshold are looked for between samples that lie below it, and a hit lies between two of these.
    pub peak: bool,
}

/// What marching from a point gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marched {
    /// A(p).
    pub occlusion: f64,
    /// Samples taken within the volume.
    pub samples: u64,
}

/// 2³² / golden ratio.
const GOLDEN: u32 = 0x9E37_79B9;
/// Parts of a step that V is sampled at where it can exceed the threshold within the step.
/// A wall of one voxel along an axis exceeds the default's 0.9 over 2 (1 − 0.9) voxels: a fifth of the default's step.
const PARTS: u32 = 5;

impl March {
    /// Marches from a point with a unit normal in the world; `index` seeds the directions: that of the point in a query, or
    /// x + 65536 y of a pixel.
    pub fn from(&self, volume: &HostVolume, position: DVec3, normal: DVec3, index: u32) -> Marched {
        let origin = volume.grid.to_cells(position) + normal * self.offset + self.shift;
        let frame = tangent_frame(normal);
        let seed = pcg(index);
        // A ray's beginning is sampled once for all.
        let taken = Cell::new(u64::from(self.opacity));
        let sum: f64 = (0..self.rays)
            .map(|ray| {
                let point = self.point(ray, seed);
                let (local, weight) = match self.uniform {
                    Some(factor) => {
                        let local = uniform_direction(point);
                        (local, factor * local.z)
                    }
                    None => (cosine_direction(point), 1.0),
                };
                let first = self.first_sample(local.z, ray, seed);
                weight * self.obscurity(volume, (origin, frame * local), first, &taken)
            })
            .sum();
        Marched { occlusion: sum / f64::from(self.rays), samples: taken.get() }
    }

    /// Distance of a ray's first sample; `cosine` is that of the ray and the normal.
    fn first_sample(&self, cosine: f64, ray: u32, seed: u32) -> f64 {
        let guard = match self.guard {
            Guard::Along(d) => d,
            Guard::Above(h) => h / cosine,
        };
        let share = if self.jitter { unit(pcg(pcg(seed).wrapping_add(ray))) } else { 0.0 };
        guard + self.step * share
    }

    fn point(&self, ray: u32, seed: u32) -> [f64; 2] {
        if self.random {
            let first = pcg(seed.wrapping_add(ray));
            return [unit(first), unit(pcg(first))];
        }
        let along = (f64::from(ray) + unit(seed)) / f64::from(self.rays);
        [along, unit(ray.wrapping_mul(GOLDEN).wrapping_add(pcg(seed)))]
    }

    fn obscurity(
        &self,
        volume: &HostVolume,
        (origin, direction): (DVec3, DVec3),
        first: f64,
        taken: &Cell<u64>,
    ) -> f64 {
        let cells = UVec3::from(volume.grid.cells).as_dvec3();
        let inside = |p: DVec3| p.cmpge(DVec3::ZERO).all() && p.cmple(cells).all();
        let distances =
            (0..).map(|k| first + f64::from(k) * self.step).take_while(|d| *d < self.r_max);
        // Outside the volume V is 0, and no sample is needed to know it.
        let density = |d: f64| {
            let place = origin + direction * d;
            if !inside(place) {
                return 0.0;
            }
            taken.set(taken.get() + 1);
            volume.density(place)
        };
        if self.opacity {
            self.gathered(distances.map(density), volume.density(origin))
        } else {
            // Trilinear V changes by at most 1 a voxel along each axis.
            self.first_hit(distances, density, self.step * direction.abs().element_sum())
        }
    }

    /// γ of VAO Eq. 7 with the rejection of Eq. 4, V at the ray's beginning being the sample before the first.
    fn gathered(&self, samples: impl Iterator<Item = f64>, start: f64) -> f64 {
        let (mut open, mut previous) = (1.0, start);
        for v in samples {
            if v >= previous {
                open *= (1.0 - v).max(0.0);
                if v >= self.threshold {
                    break;
                }
            }
            previous = v;
        }
        1.0 - f64::powf(open, self.exponent)
    }

    /// ρ of the first sample above the threshold, or of a crossing before it. V changes by at most `most_change` from one sample to the next.
    fn first_hit(
        &self,
        distances: impl Iterator<Item = f64>,
        density: impl Fn(f64) -> f64,
        most_change: f64,
    ) -> f64 {
        let mut previous: Option<(f64, f64)> = None;
        for d in distances {
            let now = (d, density(d));
            let can_peak =
                |before: &(f64, f64)| before.1 + now.1 + most_change >= 2.0 * self.threshold;
            let peaked = previous.filter(|before| self.peak && can_peak(before));
            let within = peaked.and_then(|before| self.crossing_within(before, now, &density));
            if let Some(hit) = within.or_else(|| (now.1 >= self.threshold).then_some(d)) {
                return self.attenuation.at(hit / self.r_max);
            }
            previous = Some(now);
        }
        0.0
    }

    /// Where V, linear between two samples (distance, V), crosses the threshold.
    fn crossing(&self, low: (f64, f64), high: (f64, f64)) -> f64 {
        high.0 - (high.0 - low.0) * (high.1 - self.threshold) / (high.1 - low.1)
    }

    /// The first crossing between two neighbouring samples, sampled in parts of the step.
    fn crossing_within(
        &self,
        mut before: (f64, f64),
        now: (f64, f64),
        density: impl Fn(f64) -> f64,
    ) -> Option<f64> {
        for i in (0..PARTS).rev() {
            let d = now.0 - f64::from(i) / f64::from(PARTS) * self.step;
            let found = if i == 0 { now } else { (d, density(d)) };
            if found.1 >= self.threshold {
                return Some(self.crossing(before, found));
            }
            before = found;
        }
        None
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    fn march() -> March {
        March {
            rays: 256,
            r_max: 20.0,
            step: 0.5,
            threshold: 0.5,
            offset: 0.0,
            guard: Guard::Above(3f64.sqrt() / 2.0),
            attenuation: Attenuation::Hard,
            uniform: None,
            shift: 0.0,
            random: false,
            opacity: false,
            exponent: 0.5,
            peak: false,
            jitter: false,
        }
    }

    /// A cube of 64 voxels of 1 m, its centre at the origin; shells of two voxels around surfaces at integer coordinates.
    fn volume(inside: impl Fn(DVec3) -> bool) -> HostVolume {
        HostVolume::filled(&Grid::around(DVec3::ZERO, 64.0, 64).unwrap(), inside)
    }

    fn floor(p: DVec3) -> bool {
        p.y.abs() < 0.6
    }

    #[test]
    fn densities_are_trilinear_between_centres() {
        let one = volume(|p| p.distance(DVec3::splat(0.5)) < 0.1);
        let center = one.grid.to_cells(DVec3::splat(0.5));
        assert_eq!(one.density(center), 1.0);
        assert_eq!(one.density(center + DVec3::X), 0.0);
        let moved = center + DVec3::new(0.25, 0.5, -0.5);
        assert!((one.density(moved) - 0.75 * 0.25).abs() < 1e-12);
        assert_eq!(one.density(DVec3::splat(-3.0)), 0.0);
    }

    #[test]
    fn a_plane_is_open_and_a_wall_closes_its_share() {
        let march = March { threshold: 0.7, ..march() };
        let plane = volume(floor);
        assert_eq!(march.from(&plane, DVec3::ZERO, DVec3::Y, 3).occlusion, 0.0);
        let corner = volume(|p| floor(p) || p.x.abs() < 0.6);
        let a = march.from(&corner, DVec3::new(3.0, 0.0, 0.0), DVec3::Y, 3).occlusion;
        // The wall is met where cos φ > c sin θ, c = 3 m / r_max: A = (φ₀ − c² tan φ₀) / π with cos φ₀ = c.
        let c: f64 = 3.0 / 20.0;
        let expected = (c.acos() - c * c * c.acos().tan()) / std::f64::consts::PI;
        assert!((a - expected).abs() < 0.04, "{a} for {expected}");
    }

    #[test]
    fn without_a_guard_a_surface_occludes_itself() {
        let march = March { guard: Guard::Along(0.0), ..march() };
        let a = march.from(&volume(floor), DVec3::ZERO, DVec3::Y, 3).occlusion;
        assert_eq!(a, 1.0);
    }

    #[test]
    fn the_papers_sum_is_half_of_the_unbiased() {
        let ceiling = volume(|p| (p.y - 6.0).abs() < 0.6);
        let mut march = March { rays: 4096, ..march() };
        let unbiased = march.from(&ceiling, DVec3::ZERO, DVec3::Y, 3).occlusion;
        march.uniform = Some(1.0);
        let paper = march.from(&ceiling, DVec3::ZERO, DVec3::Y, 3).occlusion;
        assert!((2.0 * paper / unbiased - 1.0).abs() < 0.01, "{paper} {unbiased}");
        march.random = true;
        let random = march.from(&ceiling, DVec3::ZERO, DVec3::Y, 3).occlusion;
        assert!((random / paper - 1.0).abs() < 0.1, "{random} {paper}");
    }

    #[test]
    fn hits_between_samples_do_not_depend_on_the_step() {
        // Two layers of voxels with centres at 5.5 and 6.5 m: V crosses a half at 5 m.
        let ceiling = volume(|p| (p.y - 6.0).abs() < 0.6);
        let c: f64 = 5.0 / 20.0;
        for step in [0.25, 0.4] {
            let attenuation = Attenuation::Linear;
            let march = March { attenuation, peak: true, rays: 1024, step, ..march() };
            let a = march.from(&ceiling, DVec3::ZERO, DVec3::Y, 3).occlusion;
            assert!((a - (1.0 - c).powi(2)).abs() < 0.02, "{a}");
        }
    }

    /// Along (1, 1, 1) through a voxel alone V changes by up to √3 a voxel.
    #[test]
    fn looks_between_samples_leave_out_no_peak_of_a_fifth() {
        let one = volume(|p| p.distance(DVec3::splat(0.5)) < 0.1);
        let center = one.grid.to_cells(DVec3::splat(0.5));
        let v = |d: f64| one.density(center + DVec3::ONE.normalize() * (d - 4.0));
        let missed = |change: f64| {
            let cases = iproduct!([0.3, 0.5, 0.7, 0.9], [0.5, 1.0, 2.0], 0..64);
            let is_missed = |&(threshold, step, phase): &(f64, f64, i32)| {
                let march = March { threshold, step, peak: true, ..march() };
                let at = |i: i32| step * (f64::from(phase) / 64.0 + f64::from(i) / 5.0);
                let found = march.first_hit((0..20).map(|k| at(5 * k)), v, change * step);
                (0..95).any(|i| v(at(i)) > threshold + 1e-9) && found == 0.0
            };
            cases.filter(is_missed).count()
        };
        assert_eq!(missed(3f64.sqrt()), 0);
        assert!(missed(1.0) > 0);
    }

    #[test]
    fn opacity_gathers_rising_samples() {
        let march = March { opacity: true, threshold: 1.0, ..march() };
        let mut glass = volume(|p| (p.y - 6.0).abs() < 0.6);
        let opaque = march.from(&glass, DVec3::ZERO, DVec3::Y, 3).occlusion;
        glass.values.iter_mut().for_each(|v| *v *= 0.3);
        let clear = march.from(&glass, DVec3::ZERO, DVec3::Y, 3).occlusion;
        assert!(clear > 0.05 && clear < 0.6 * opaque, "{clear} {opaque}");
    }
}

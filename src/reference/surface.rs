//! Where a ray from above enters the water: the first root of y − h(x, z) along it.

use glam::DVec3;

use fathom_scene::{Water, WaterModel, shortest_wave_m};

/// Marching steps per smallest feature of the surface while a root is bracketed. At 64 steps a wave
/// bends by less than 0.1 rad within one, so that a pair of roots inside a step is a grazing touch.
const STEPS_PER_FEATURE: f64 = 64.0;
/// Lattice cells of the finest noise octave in one noise tile (two octaves over 8 cells).
const FINEST_NOISE_CELLS: f64 = 16.0;
/// Steps along one ray at most; a ray that grazes the surface over kilometres ends as a miss.
const MAX_STEPS: f64 = 1.0e6;

/// A point at which a ray enters the water.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    pub position: DVec3,
    /// Unit normal of the surface, upwards.
    pub normal: DVec3,
    /// Distance from the ray's origin, metres.
    pub distance_m: f64,
}

/// First crossing from air to water of a ray within the rectangle of the surface.
///
/// `direction` has unit length. The ray is followed for at most `max_distance_m`. Outside the
/// rectangle there is no water: crossings of its continuation are passed over.
pub fn enter(water: &Water, origin: DVec3, direction: DVec3, max_distance_m: f64) -> Option<Entry> {
    let above = |t: f64| {
        let p = origin + direction * t;
        p.y - water.height(p.x, p.z)
    };
    let (start, end) = slab(water, origin, direction, max_distance_m)?;
    let steps = ((end - start) / step_m(water, direction)).ceil().clamp(1.0, MAX_STEPS);
    let step = (end - start) / steps;
    let steepest = direction.y.abs() + direction.x.hypot(direction.z) * water.steepest();
    let (mut t0, mut f0, mut i) = (start, above(start), 0.0);
    while i < steps {
        // Nothing is met within steps that no slope is steep enough for.
        i = (i + (f0.abs() / (step * steepest)).floor().max(1.0)).min(steps);
        let t1 = start + step * i;
        let f1 = above(t1);
        if f0 > 0.0 && f1 <= 0.0 {
            let t = root(above, (t0, f0), (t1, f1));
            let p = origin + direction * t;
            if water.contains(p.x, p.z) {
                // Its height is taken from the surface, so that it lies on it to the last digit.
                let position = p.with_y(water.height(p.x, p.z));
                return Some(Entry { position, normal: water.normal(p.x, p.z), distance_m: t });
            }
        }
        (t0, f0) = (t1, f1);
    }
    None
}

/// Part of the ray, in metres from its origin, inside the slab that holds every wave.
fn slab(water: &Water, origin: DVec3, direction: DVec3, max_m: f64) -> Option<(f64, f64)> {
    // Noise is normalised to about ±1: half as much again leaves room for its peaks.
    let bound = 1.5 * water.bound_m() + 2e-7 * water.half_size_m[0];
    if direction.y == 0.0 {
        return (origin.y.abs() <= bound).then_some((0.0, max_m));
    }
    let (a, b) = ((bound - origin.y) / direction.y, (-bound - origin.y) / direction.y);
    let (near, far) = (a.min(b).max(0.0), a.max(b).min(max_m));
    (near <= far).then_some((near, far))
}

/// Length of a marching step, metres along the ray.
fn step_m(water: &Water, direction: DVec3) -> f64 {
    let feature = match water.model {
        WaterModel::Circular | WaterModel::Directional => {
            water.wavelength_m.min(water.noise_tile_m / FINEST_NOISE_CELLS)
        }
        WaterModel::Waves => shortest_wave_m(&water.waves),
    };
    let horizontal = direction.x.hypot(direction.z);
    feature / STEPS_PER_FEATURE / horizontal.max(1e-3)
}

/// Root of `f` in (low, high], `f(low) > 0 ≥ f(high)`, to the last representable distance. On a smooth surface the secant comes near it,
/// and twice the way that is left from there lies beyond it; halvings narrow what is not smooth.
fn root(f: impl Fn(f64) -> f64, mut low: (f64, f64), mut high: (f64, f64)) -> f64 {
    let mut last = high;
    for step in 0.. {
        let middle = 0.5 * (low.0 + high.0);
        if middle <= low.0 || middle >= high.0 {
            break;
        }
        let per_m = (high.1 - low.1) / (high.0 - low.0);
        let at = match step % 5 {
            4 => middle,
            1 | 3 => last.0 - 2.0 * last.1 / per_m,
            _ => high.0 - high.1 / per_m,
        };
        let at = at.clamp(low.0.next_up(), high.0.next_down());
        last = (at, f(at));
        *(if last.1 > 0.0 { &mut low } else { &mut high }) = last;
    }
    high.0
}

#[cfg(test)]
mod tests {
    use fathom_scene::Wave;
    use proptest::prelude::*;

    use super::*;

    fn rough(model: WaterModel, amplitude_m: f64, noise: f64) -> Water {
        let wave = |direction: [f64; 2], part: f64| Wave {
            direction,
            wavelength_m: 1.3 / part,
            amplitude_m: 0.5 * amplitude_m / part,
            phase_rad: 5.0 * noise,
        };
        let (time_s, half_size_m) = (0.7, [6.0, 6.0]);
        let waves = vec![wave([1.0, 0.3], 1.0), wave([-0.2, 1.0], 1.7)];
        let waves = if model == WaterModel::Waves { waves } else { Vec::new() };
        let wavelength_m = 1.3;
        Water {
            model,
            amplitude_m,
            wavelength_m,
            noise,
            time_s,
            half_size_m,
            waves,
            ..Water::default()
        }
    }

    fn ray(x: f64, z: f64, tilt: f64, phi: f64) -> (DVec3, DVec3) {
        let direction = DVec3::new(tilt.sin() * phi.cos(), -tilt.cos(), tilt.sin() * phi.sin());
        (DVec3::new(x, 0.0, z) - direction * 3.0, direction)
    }

    proptest! {
        #[test]
        fn entries_lie_on_the_surface_and_are_the_first(
            x in -4.0..4.0f64, z in -4.0..4.0f64, tilt in 0.0..1.2f64, phi in 0.0..std::f64::consts::TAU, amplitude_m in 0.0..0.4f64,
            noise in 0.0..1.0f64, model in 0..3usize,
        ) {
            let models = [WaterModel::Circular, WaterModel::Directional, WaterModel::Waves];
            let water = rough(models[model], amplitude_m, noise);
            let (origin, direction) = ray(x, z, tilt, phi);
            let entry = enter(&water, origin, direction, 100.0).expect("a ray into the middle enters");
            let p = origin + direction * entry.distance_m;
            prop_assert!((p - entry.position).length() < 1e-12);
            prop_assert!((p.y - water.height(p.x, p.z)).abs() < 1e-12);
            for i in 0..2000 {
                let q = origin + direction * (entry.distance_m - 1e-9) * f64::from(i) / 2000.0;
                prop_assert!(q.y > water.height(q.x, q.z), "under water before the entry");
            }
        }
    }

    #[test]
    fn flat_water_has_the_closed_form() {
        let water = Water { amplitude_m: 0.0, ..Water::default() };
        let (origin, direction) = ray(1.0, -2.0, 0.6, 1.0);
        let entry = enter(&water, origin, direction, 100.0).unwrap();
        assert!((entry.position - DVec3::new(1.0, 0.0, -2.0)).length() < 1e-12);
        assert!((entry.distance_m - 3.0).abs() < 1e-12);
        assert_eq!(entry.normal, DVec3::Y);
    }

    #[test]
    fn rays_beside_along_below_or_short_of_the_water_miss() {
        let water = Water { amplitude_m: 0.0, half_size_m: [1.0, 1.0], ..Water::default() };
        let down = |x: f64, y: f64, max| enter(&water, DVec3::new(x, y, 0.0), DVec3::NEG_Y, max);
        assert!(down(0.0, 2.0, 10.0).is_some());
        assert!(down(1.1, 2.0, 10.0).is_none());
        assert!(down(0.0, -1.0, 10.0).is_none());
        assert!(down(0.0, 2.0, 1.5).is_none());
        assert!(enter(&water, DVec3::new(0.0, 1.0, 0.0), DVec3::X, 10.0).is_none());
        assert!(enter(&water, DVec3::new(0.0, -1.0, 0.0), DVec3::Y, 10.0).is_none());
    }
}

//! The water: an animated height field about y = 0 and the medium below it.
//!
//! Two models are those of UW 4.1: a circular cosine with a little Perlin noise, and a cosine along
//! one world axis with much of it. The third is given: a list of waves.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::Bounds;
use super::check::within_ranges;
use super::noise::{TILE_NOISE_SLOPE, tile_noise};
use super::waves::{self, Wave};
use fathom_base::parameter::{ParamError, TableEntry};
use fathom_base::{choices, settings};

/// Drift of the noise along x, tiles per wave period. Chosen: slow against the waves.
pub const NOISE_DRIFT_TILES: f64 = 0.11;

/// What shapes the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, strum::Display)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum WaterModel {
    /// Rings about the centre.
    Circular,
    /// Crests parallel to the z axis, travelling along +x.
    Directional,
    /// The sum of [`Water::waves`], at rest.
    Waves,
}

choices!(WaterModel);

settings! {
    /// Surface and medium. With `amplitude_m = 0` the surface of the models `circular` and `directional` is flat, with `noise = 0` a pure
    /// cosine.
    pub struct Water {
        /// What shapes the surface: rings about the centre or crests along z (UW §4.1), or the list `waves`. Amplitude, wavelength, noise,
        /// seed, time and period are of the first two.
        model: WaterModel = WaterModel::Circular;
        /// Bound of the elevation's magnitude.
        amplitude_m: f64 = 0.08 => 0.0 ..= 100.0, "m";
        /// Length of the regular wave.
        wavelength_m: f64 = 1.6 => 1e-3 ..= 1e5, "m";
        /// Share of the noise in the elevation.
        noise: f64 = 0.2 => 0.0 ..= 1.0, "1";
        /// Period in space of the noise texture.
        noise_tile_m: f64 = 8.0 => 1e-3 ..= 1e5, "m";
        /// Seed of the noise.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
        /// Moment shown.
        time_s: f64 = 0.0 => -1e6 ..= 1e6, "s";
        /// Period in time of the regular wave.
        period_s: f64 = 2.0 => 1e-3 ..= 1e6, "s";
        /// Refractive index of water against air (UW: 1.33).
        refractive_index: f64 = 1.33 => 1.0 ..= 4.0, "1";
        /// Exponential attenuation γ (UW: 0.13).
        attenuation_per_m: f64 = 0.13 => 0.0 ..= 100.0, "1/m";
        /// Middle of the surface's rectangle and of the circular waves: x, z.
        center_m: [f64; 2] = [0.0; 2] => -1e5 ..= 1e5, "m";
        /// Half of the surface's extent in x and z.
        half_size_m: [f64; 2] = [5.0; 2] => 1e-3 ..= 1e5, "m";
        /// Whether a photon's energy is multiplied by the share of unpolarised light that the surface lets through (Fresnel).
        /// UW has none.
        fresnel: bool = false;
        /// The waves of the model `waves`, at most 1024.
        waves: Vec<Wave> = Vec::new();
    }
}

impl TableEntry for Wave {
    fn check(waves: &[Self]) -> Result<(), ParamError> {
        Ok(waves::validate(waves)?)
    }
}

impl Water {
    /// Elevation at (x, z), metres:
    /// `h = A [(1 − w) cos(k r − ω t) + w n(u, v)]`, r the distance from the centre (circular) or
    /// along x from it (directional), n the noise at u = x / tile + drift, v = z / tile. Waves that are
    /// given are summed as their type says.
    pub fn height(&self, x: f64, z: f64) -> f64 {
        if let Some(given) = self.given(x, z) {
            return given.x;
        }
        let (phase, _) = self.phase(x, z);
        let (n, _) = self.noise_at(x, z);
        self.amplitude_m * ((1.0 - self.noise) * phase.cos() + self.noise * n)
    }

    /// (∂h/∂x, ∂h/∂z). At the centre of circular waves, where it is not defined, the wave's part is 0.
    pub fn gradient(&self, x: f64, z: f64) -> DVec2 {
        if let Some(given) = self.given(x, z) {
            return DVec2::new(given.y, given.z);
        }
        let (phase, phase_gradient) = self.phase(x, z);
        let (_, dn) = self.noise_at(x, z);
        let wave = -phase.sin() * phase_gradient;
        self.amplitude_m * ((1.0 - self.noise) * wave + self.noise * dn / self.noise_tile_m)
    }

    /// Elevation and its derivatives where the surface is given.
    fn given(&self, x: f64, z: f64) -> Option<DVec3> {
        (self.model == WaterModel::Waves).then(|| waves::sum(&self.waves, DVec2::new(x, z)))
    }

    /// Bound of the elevation's magnitude, metres.
    pub fn bound_m(&self) -> f64 {
        match self.model {
            WaterModel::Circular | WaterModel::Directional => self.amplitude_m,
            WaterModel::Waves => waves::bound_m(&self.waves),
        }
    }

    /// The box that holds the surface.
    pub fn bounds(&self) -> Bounds {
        let ([x, z], [half_x, half_z], high) = (self.center_m, self.half_size_m, self.bound_m());
        let (middle, half) = (DVec3::new(x, 0.0, z), DVec3::new(half_x, high, half_z));
        Bounds { min: middle - half, max: middle + half }
    }

    /// Bound of the slope's magnitude.
    pub fn steepest(&self) -> f64 {
        match self.model {
            WaterModel::Circular | WaterModel::Directional => {
                let wave = (1.0 - self.noise) * self.wavenumber_per_m();
                self.amplitude_m * (wave + self.noise * TILE_NOISE_SLOPE / self.noise_tile_m)
            }
            WaterModel::Waves => waves::steepest(&self.waves),
        }
    }

    /// Unit normal of the surface, pointing up.
    pub fn normal(&self, x: f64, z: f64) -> DVec3 {
        let g = self.gradient(x, z);
        DVec3::new(-g.x, 1.0, -g.y).normalize()
    }

    /// Whether (x, z) lies in the surface's rectangle.
    pub fn contains(&self, x: f64, z: f64) -> bool {
        (x - self.center_m[0]).abs() <= self.half_size_m[0]
            && (z - self.center_m[1]).abs() <= self.half_size_m[1]
    }

    /// One tile of the noise as `size` × `size` texels (n, ∂n/∂u, ∂n/∂v, 0), u and v in tile units,
    /// texel centres at (i + 0.5) / size, one row per v.
    pub fn noise_texels(&self, size: u32) -> Vec<[f32; 4]> {
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(size);
        let texel = |(row, column): (u32, u32)| {
            let (n, d) = tile_noise(at(column), at(row), self.seed);
            [n as f32, d.x as f32, d.y as f32, 0.0]
        };
        (0..size).flat_map(|row| (0..size).map(move |column| (row, column))).map(texel).collect()
    }

    /// Whether the water can be used; the error names the parameter and its valid range.
    pub fn validate(&self) -> Result<(), String> {
        within_ranges("water", self)?;
        // Waves that are given are not left aside without a word.
        let (model, is_given) = (self.model, !self.waves.is_empty());
        match model {
            WaterModel::Waves if !is_given => {
                Err("water.model is waves, but water.waves lists none".into())
            }
            WaterModel::Circular | WaterModel::Directional if is_given => Err(format!(
                "water.waves are given, but water.model is {model}: set water.model to waves, or water.waves to []"
            )),
            _ => Ok(()),
        }
    }

    /// k = 2π / wavelength, 1/m.
    pub fn wavenumber_per_m(&self) -> f64 {
        std::f64::consts::TAU / self.wavelength_m
    }

    /// ω t: how far the regular wave has turned, radians.
    pub fn turned_rad(&self) -> f64 {
        std::f64::consts::TAU * self.time_s / self.period_s
    }

    /// How far the noise has drifted along x, in tiles.
    pub fn noise_drift_tiles(&self) -> f64 {
        NOISE_DRIFT_TILES * self.time_s / self.period_s
    }

    /// Phase k r − ω t of the regular wave and its gradient by (x, z).
    fn phase(&self, x: f64, z: f64) -> (f64, DVec2) {
        let k = self.wavenumber_per_m();
        let offset = DVec2::new(x - self.center_m[0], z - self.center_m[1]);
        let (r, outward) = match self.model {
            WaterModel::Circular => (offset.length(), offset.normalize_or_zero()),
            _ => (offset.x, DVec2::X),
        };
        (k * r - self.turned_rad(), k * outward)
    }

    fn noise_at(&self, x: f64, z: f64) -> (f64, DVec2) {
        let (u, v) = (x / self.noise_tile_m, z / self.noise_tile_m);
        tile_noise(u + self.noise_drift_tiles(), v, self.seed)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::check::{InvalidCase, assert_refused};
    use super::*;

    fn waters() -> [Water; 2] {
        [
            Water { time_s: 0.37, noise: 0.3, ..Water::default() },
            Water {
                model: WaterModel::Directional,
                noise: 0.7,
                time_s: 5.1,
                center_m: [0.4, -0.2],
                ..Water::default()
            },
        ]
    }

    /// Waves along x without noise.
    fn cosine() -> Water {
        Water { model: WaterModel::Directional, noise: 0.0, ..Water::default() }
    }

    fn places(count: u32) -> impl Iterator<Item = (f64, f64)> {
        (0..count).map(|i| (f64::from(i).sin() * 4.0, f64::from(i * 3).cos() * 4.0))
    }

    #[test]
    fn gradient_matches_differences() {
        let h = 1e-6;
        for water in waters() {
            for (x, z) in places(1000) {
                let dx = (water.height(x + h, z) - water.height(x - h, z)) / (2.0 * h);
                let dz = (water.height(x, z + h) - water.height(x, z - h)) / (2.0 * h);
                let g = water.gradient(x, z);
                assert!((g - DVec2::new(dx, dz)).length() < 1e-6, "{g} at {x}, {z}");
                assert!(water.normal(x, z).dot(DVec3::new(1.0, g.x, 0.0)).abs() < 1e-12);
                assert!(water.height(x, z).abs() <= water.amplitude_m);
                assert!(g.length() <= water.steepest());
            }
        }
    }

    #[test]
    fn without_noise_it_is_the_pure_cosine_and_flat_without_amplitude() {
        let water =
            Water { amplitude_m: 0.1, wavelength_m: 2.0, time_s: 0.5, period_s: 2.0, ..cosine() };
        let expected = 0.1 * (std::f64::consts::PI * 0.7 - std::f64::consts::FRAC_PI_2).cos();
        assert!((water.height(0.7, 9.0) - expected).abs() < 1e-12);
        let flat = Water { amplitude_m: 0.0, ..Water::default() };
        assert_eq!((flat.height(0.3, 1.0), flat.normal(0.3, 1.0)), (0.0, DVec3::Y));
    }

    #[test]
    fn a_wave_given_is_the_cosine_of_the_model() {
        let cosine = Water { time_s: 0.3, ..cosine() };
        let wave = Wave {
            direction: [1.0, 0.0],
            wavelength_m: cosine.wavelength_m,
            amplitude_m: cosine.amplitude_m,
            phase_rad: -cosine.turned_rad(),
        };
        let (model, waves) = (WaterModel::Waves, vec![wave]);
        let given = Water { model, waves, amplitude_m: 7.0, ..cosine.clone() };
        for (x, z) in places(100) {
            assert!((given.height(x, z) - cosine.height(x, z)).abs() < 1e-12);
            assert!((given.normal(x, z) - cosine.normal(x, z)).length() < 1e-12);
        }
        assert!((given.bound_m() - cosine.bound_m()).abs() < 1e-12);
    }

    #[test]
    fn what_the_model_does_not_use_is_refused() {
        let wave = json!({"direction": [1.0, 0.0], "wavelength_m": 2.0, "amplitude_m": 0.1});
        let judged = |water| serde_json::from_value::<Water>(water).unwrap().validate();
        assert_eq!(judged(json!({"model": "waves", "waves": [wave]})), Ok(()));
        for (water, expected) in [
            (json!({"waves": [wave]}), "water.model is circular"),
            (json!({"model": "waves"}), "lists none"),
        ] {
            let fault = judged(water).unwrap_err();
            assert!(fault.contains(expected), "{fault}");
        }
    }

    #[test]
    fn bad_values_are_named() {
        let cases: &[InvalidCase<Water>] = &[
            (|w| w.wavelength_m = 0.0, "water.wavelength_m is 0"),
            (|w| w.refractive_index = 0.9, "water.refractive_index"),
            (|w| w.noise = 1.5, "0 … 1"),
            (|w| w.amplitude_m = f64::NAN, "water.amplitude_m"),
            (|w| w.half_size_m[1] = -1.0, "water.half_size_m"),
        ];
        assert_refused(&Water::default(), Water::validate, cases);
    }
}

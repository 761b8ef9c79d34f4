//! The water: an animated height field about y = 0 and the medium below it.
//!
//! The two models are those of UW 4.1: a circular cosine with a little Perlin noise, and a cosine
//! along one world axis with much of it.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::{check, noise::tile_noise};

/// Drift of the noise along x, tiles per wave period. Chosen: slow against the waves.
pub const NOISE_DRIFT_TILES: f64 = 0.11;

/// Shape of the regular wave.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WaterModel {
    /// Rings about the centre.
    Circular,
    /// Crests parallel to the z axis, travelling along +x.
    Directional,
}

/// Surface and medium. With `amplitude_m = 0` the surface is flat, with `noise = 0` a pure cosine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Water {
    /// Shape of the regular wave.
    pub model: WaterModel,
    /// Bound of the elevation's magnitude, metres.
    pub amplitude_m: f64,
    /// Length of the regular wave, metres.
    pub wavelength_m: f64,
    /// Share of the noise in the elevation, 0 … 1.
    pub noise: f64,
    /// Period in space of the noise texture, metres.
    pub noise_tile_m: f64,
    /// Seed of the noise.
    pub seed: u32,
    /// Moment shown, seconds.
    pub time_s: f64,
    /// Period in time of the regular wave, seconds.
    pub period_s: f64,
    /// Refractive index of water against air (UW: 1.33).
    pub refractive_index: f64,
    /// Exponential attenuation γ, 1/m (UW: 0.13).
    pub attenuation_per_m: f64,
    /// Middle of the surface's rectangle and of the circular waves: x, z, metres.
    pub center_m: [f64; 2],
    /// Half of the surface's extent in x and z, metres.
    pub half_size_m: [f64; 2],
}

impl Default for Water {
    fn default() -> Self {
        Self {
            model: WaterModel::Circular,
            amplitude_m: 0.08,
            wavelength_m: 1.6,
            noise: 0.2,
            noise_tile_m: 8.0,
            seed: 1,
            time_s: 0.0,
            period_s: 2.0,
            refractive_index: 1.33,
            attenuation_per_m: 0.13,
            center_m: [0.0; 2],
            half_size_m: [5.0; 2],
        }
    }
}

impl Water {
    /// Elevation at (x, z), metres:
    /// `h = A [(1 − w) cos(k r − ω t) + w n(u, v)]`, r the distance from the centre (circular) or
    /// along x from it (directional), n the noise at u = x / tile + drift, v = z / tile.
    pub fn height(&self, x: f64, z: f64) -> f64 {
        let (phase, _) = self.phase(x, z);
        let (n, _) = self.noise_at(x, z);
        self.amplitude_m * ((1.0 - self.noise) * phase.cos() + self.noise * n)
    }

    /// (∂h/∂x, ∂h/∂z). At the very centre of circular waves, where the slope is not defined, the
    /// wave's part is zero.
    pub fn gradient(&self, x: f64, z: f64) -> DVec2 {
        let (phase, phase_gradient) = self.phase(x, z);
        let (_, dn) = self.noise_at(x, z);
        let wave = -phase.sin() * phase_gradient;
        self.amplitude_m * ((1.0 - self.noise) * wave + self.noise * dn / self.noise_tile_m)
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
        (0..size)
            .flat_map(|row| (0..size).map(move |column| (row, column)))
            .map(texel)
            .collect()
    }

    /// Whether the water can be used; the error names the parameter and its valid range.
    pub fn validate(&self) -> Result<(), String> {
        check::within("water.amplitude_m", self.amplitude_m, 0.0, 100.0)?;
        check::within("water.wavelength_m", self.wavelength_m, 1e-3, check::FAR_M)?;
        check::within("water.noise", self.noise, 0.0, 1.0)?;
        check::within("water.noise_tile_m", self.noise_tile_m, 1e-3, check::FAR_M)?;
        check::within("water.time_s", self.time_s, -1e6, 1e6)?;
        check::within("water.period_s", self.period_s, 1e-3, 1e6)?;
        check::within("water.refractive_index", self.refractive_index, 1.0, 4.0)?;
        check::within(
            "water.attenuation_per_m",
            self.attenuation_per_m,
            0.0,
            100.0,
        )?;
        check::point("water.center_m", &self.center_m)?;
        check::within(
            "water.half_size_m[0]",
            self.half_size_m[0],
            1e-3,
            check::FAR_M,
        )?;
        check::within(
            "water.half_size_m[1]",
            self.half_size_m[1],
            1e-3,
            check::FAR_M,
        )
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
            WaterModel::Directional => (offset.x, DVec2::X),
        };
        (k * r - self.turned_rad(), k * outward)
    }

    fn noise_at(&self, x: f64, z: f64) -> (f64, DVec2) {
        let drift = self.noise_drift_tiles();
        tile_noise(
            x / self.noise_tile_m + drift,
            z / self.noise_tile_m,
            self.seed,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waters() -> [Water; 2] {
        [
            Water {
                time_s: 0.37,
                noise: 0.3,
                ..Water::default()
            },
            Water {
                model: WaterModel::Directional,
                noise: 0.7,
                time_s: 5.1,
                center_m: [0.4, -0.2],
                ..Water::default()
            },
        ]
    }

    #[test]
    fn gradient_matches_differences() {
        let h = 1e-6;
        for water in waters() {
            for i in 0..1000 {
                let (x, z) = (f64::from(i).sin() * 4.0, f64::from(i * 3).cos() * 4.0);
                let dx = (water.height(x + h, z) - water.height(x - h, z)) / (2.0 * h);
                let dz = (water.height(x, z + h) - water.height(x, z - h)) / (2.0 * h);
                let g = water.gradient(x, z);
                assert!((g - DVec2::new(dx, dz)).length() < 1e-6, "{g} at {x}, {z}");
                assert!(water.normal(x, z).dot(DVec3::new(1.0, g.x, 0.0)).abs() < 1e-12);
                assert!(water.height(x, z).abs() <= water.amplitude_m);
            }
        }
    }

    #[test]
    fn flat_water_is_level() {
        let water = Water {
            amplitude_m: 0.0,
            ..Water::default()
        };
        assert_eq!(water.height(0.3, 1.0), 0.0);
        assert_eq!(water.normal(0.3, 1.0), DVec3::Y);
    }

    #[test]
    fn without_noise_it_is_the_pure_cosine() {
        let water = Water {
            model: WaterModel::Directional,
            noise: 0.0,
            amplitude_m: 0.1,
            wavelength_m: 2.0,
            time_s: 0.5,
            period_s: 2.0,
            ..Water::default()
        };
        let expected = 0.1 * (std::f64::consts::PI * 0.7 - std::f64::consts::FRAC_PI_2).cos();
        assert!((water.height(0.7, 9.0) - expected).abs() < 1e-12);
    }

    #[test]
    fn waves_repeat_after_their_length() {
        let water = Water {
            model: WaterModel::Directional,
            noise: 0.0,
            ..Water::default()
        };
        let shifted = water.height(0.3 + water.wavelength_m, 0.0);
        assert!((water.height(0.3, 0.0) - shifted).abs() < 1e-12);
        let noise = Water {
            noise: 1.0,
            ..water
        };
        let shifted = noise.height(0.3 + noise.noise_tile_m, -noise.noise_tile_m);
        assert!((noise.height(0.3, 0.0) - shifted).abs() < 1e-9);
    }

    #[test]
    fn texels_are_the_noise_at_their_centres() {
        let water = Water::default();
        let texels = water.noise_texels(16);
        assert_eq!(texels.len(), 256);
        let (n, d) = tile_noise(3.5 / 16.0, 5.5 / 16.0, water.seed);
        assert_eq!(texels[5 * 16 + 3], [n as f32, d.x as f32, d.y as f32, 0.0]);
    }

    #[test]
    fn bad_values_are_named() {
        let bad = |change: fn(&mut Water)| {
            let mut w = Water::default();
            change(&mut w);
            w.validate().unwrap_err()
        };
        assert!(Water::default().validate().is_ok());
        assert!(bad(|w| w.wavelength_m = 0.0).contains("water.wavelength_m = 0"));
        assert!(bad(|w| w.refractive_index = 0.9).contains("water.refractive_index"));
        assert!(bad(|w| w.noise = 1.5).contains("0 to 1"));
        assert!(bad(|w| w.amplitude_m = f64::NAN).contains("water.amplitude_m"));
        assert!(bad(|w| w.half_size_m[1] = -1.0).contains("water.half_size_m"));
    }
}

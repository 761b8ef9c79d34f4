//! Water given as a list of plane waves.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::check;
use fathom_base::settings;

/// Most waves of a list: each is summed for every photon and every vertex of the surface.
pub const MAX_WAVES: usize = 1024;

settings! {
    /// One plane wave, `a cos(k · (x, z) + φ)`.
    pub struct Wave required {
        /// Direction of the wave vector k: x, z, of any length.
        direction: [f64; 2] => -1e5 ..= 1e5, "1";
        /// 2π / |k|.
        wavelength_m: f64 => 1e-3 ..= 1e5, "m";
        /// a.
        amplitude_m: f64 => -100.0 ..= 100.0, "m";
        /// φ: where the crest lies.
        #[serde(default)]
        phase_rad: f64 => -1e6 ..= 1e6, "rad";
    }
}

impl Wave {
    /// k, radians per metre.
    pub fn vector(&self) -> DVec2 {
        DVec2::from(self.direction).normalize_or_zero() * (TAU / self.wavelength_m)
    }

    /// Elevation, metres, and its derivatives by x and z.
    pub fn elevation_m(&self, place: DVec2) -> DVec3 {
        let k = self.vector();
        let (sin, cos) = (k.dot(place) + self.phase_rad).sin_cos();
        self.amplitude_m * DVec3::new(cos, -sin * k.x, -sin * k.y)
    }

    /// `name` is the wave's, such as `water.waves[2]`.
    fn validate(&self, name: &str) -> Result<(), String> {
        check::within_ranges(name, self)?;
        if DVec2::from(self.direction).length() < 1e-6 {
            return Err(format!("{name}.direction = {:?} has no direction", self.direction));
        }
        Ok(())
    }
}

/// Sum of the waves: elevation, metres, and its derivatives by x and z.
pub fn sum(waves: &[Wave], place: DVec2) -> DVec3 {
    waves.iter().map(|wave| wave.elevation_m(place)).sum()
}

/// Bound of the sum's magnitude, metres.
pub fn bound_m(waves: &[Wave]) -> f64 {
    waves.iter().map(|wave| wave.amplitude_m.abs()).sum()
}

/// Bound of the slope of the sum.
pub fn steepest(waves: &[Wave]) -> f64 {
    waves.iter().map(|wave| wave.amplitude_m.abs() * wave.vector().length()).sum()
}

/// Length of the shortest wave, metres.
pub fn shortest_m(waves: &[Wave]) -> f64 {
    let lengths = waves.iter().map(|wave| TAU / wave.vector().length());
    lengths.fold(check::FAR_M, f64::min)
}

/// Whether the list can be used.
pub fn validate(waves: &[Wave]) -> Result<(), String> {
    if waves.len() > MAX_WAVES {
        let count = waves.len();
        return Err(format!("water.waves lists {count} waves; at most {MAX_WAVES} are taken"));
    }
    for (i, wave) in waves.iter().enumerate() {
        wave.validate(&format!("water.waves[{i}]"))?;
    }
    check::check_range("the sum of all |water.waves[…].amplitude_m|", bound_m(waves), 0.0, 100.0)
}

/// A texel for each wave: kx, kz, a, φ within ±π.
pub fn texels(waves: &[Wave]) -> Vec<[f32; 4]> {
    let texel = |wave: &Wave| {
        let k = wave.vector();
        let phase = wave.phase_rad - TAU * (wave.phase_rad / TAU).round();
        [k.x, k.y, wave.amplitude_m, phase].map(|v| v as f32)
    };
    waves.iter().map(texel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain() -> Wave {
        Wave { direction: [3.0, 4.0], wavelength_m: 2.0, amplitude_m: 0.1, phase_rad: 0.4 }
    }

    #[test]
    fn a_wave_is_a_cosine_along_its_direction() {
        let k = std::f64::consts::PI * DVec2::new(0.6, 0.8);
        let place = DVec2::new(0.3, -1.7);
        let expected = 0.1 * (k.dot(place) + 0.4).cos();
        assert!((plain().elevation_m(place).x - expected).abs() < 1e-12);
    }

    #[test]
    fn derivatives_match_differences() {
        let waves = [plain(), Wave { phase_rad: 2.0, direction: [-1.0, 0.2], ..plain() }];
        let (place, h) = (DVec2::new(1.1, 0.7), 1e-6);
        let slope =
            |step: DVec2| (sum(&waves, place + step).x - sum(&waves, place - step).x) / (2.0 * h);
        let at = sum(&waves, place);
        assert!((at.y - slope(DVec2::X * h)).abs() < 1e-8);
        assert!((at.z - slope(DVec2::Y * h)).abs() < 1e-8);
        assert!((bound_m(&waves) - 0.2).abs() < 1e-12);
        assert!((shortest_m(&waves) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn bad_waves_are_named() {
        let cases: &[check::InvalidCase<Wave>] = &[
            (|w| w.amplitude_m = f64::NAN, "water.waves[1].amplitude_m"),
            (|w| w.wavelength_m = 0.0, "water.waves[1].wavelength_m"),
            (|w| w.direction = [0.0, 0.0], "has no direction"),
        ];
        check::assert_refused(&plain(), |w| validate(&[plain(), w.clone()]), cases);
        assert!(validate(&vec![plain(); 2000]).unwrap_err().contains("at most 1024"));
        let high = Wave { amplitude_m: 60.0, ..plain() };
        assert!(validate(&[high.clone(), high]).unwrap_err().contains("sum of all"));
    }
}

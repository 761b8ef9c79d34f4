//! Water given as a list of plane waves.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::check;

/// Most waves of a list: each is summed for every photon and every vertex of the surface.
pub const MAX_WAVES: usize = 1024;

/// One plane wave, `a cos(k · (x, z) + φ)`. Its wave vector k is given as such, or as a direction and a wavelength.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wave {
    /// Direction of k: x, z, of any length.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f64; 2]>,
    /// 2π / |k|, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_m: Option<f64>,
    /// k: x, z, radians per metre.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vector_rad_m: Option<[f64; 2]>,
    /// a, metres.
    pub amplitude_m: f64,
    /// φ, radians: where the crest lies.
    #[serde(default)]
    pub phase_rad: f64,
}

impl Wave {
    /// k, radians per metre. Valid waves have one of its two forms.
    pub fn vector(&self) -> DVec2 {
        match (self.vector_rad_m, self.direction, self.wavelength_m) {
            (Some(vector), ..) => DVec2::from(vector),
            (None, Some(direction), Some(wavelength_m)) => {
                DVec2::from(direction).normalize_or_zero() * (TAU / wavelength_m)
            }
            _ => DVec2::ZERO,
        }
    }

    /// Elevation, metres, and its derivatives by x and z.
    pub fn at(&self, place: DVec2) -> DVec3 {
        let k = self.vector();
        let (sin, cos) = (k.dot(place) + self.phase_rad).sin_cos();
        self.amplitude_m * DVec3::new(cos, -sin * k.x, -sin * k.y)
    }

    /// `name` is the wave's, such as `water.waves[2]`.
    fn validate(&self, name: &str) -> Result<(), String> {
        check::within(&format!("{name}.amplitude_m"), self.amplitude_m, -100.0, 100.0)?;
        check::within(&format!("{name}.phase_rad"), self.phase_rad, -1e6, 1e6)?;
        match (self.vector_rad_m, self.direction, self.wavelength_m) {
            (Some(vector), None, None) => {
                let (name, length) =
                    (format!("|{name}.vector_rad_m|"), DVec2::from(vector).length());
                check::within(&name, length, TAU / check::FAR_M, TAU / SHORTEST_M)
            }
            (None, Some(direction), Some(wavelength_m)) => {
                let length = format!("{name}.wavelength_m");
                check::within(&length, wavelength_m, SHORTEST_M, check::FAR_M)?;
                check::point(&format!("{name}.direction"), &direction)?;
                if DVec2::from(direction).length() < 1e-6 {
                    return Err(format!("{name}.direction = {direction:?} has no direction"));
                }
                Ok(())
            }
            _ => Err(format!(
                "{name} needs either `direction` and `wavelength_m`, or `vector_rad_m`"
            )),
        }
    }
}

/// Shortest wave, metres.
const SHORTEST_M: f64 = 1e-3;

/// Sum of the waves: elevation, metres, and its derivatives by x and z.
pub fn sum(waves: &[Wave], place: DVec2) -> DVec3 {
    waves.iter().map(|wave| wave.at(place)).sum()
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
    check::within("the sum of all |water.waves[…].amplitude_m|", bound_m(waves), 0.0, 100.0)
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
        Wave {
            direction: Some([3.0, 4.0]),
            wavelength_m: Some(2.0),
            vector_rad_m: None,
            amplitude_m: 0.1,
            phase_rad: 0.4,
        }
    }

    #[test]
    fn both_forms_of_the_wave_vector_are_the_same_wave() {
        let k = std::f64::consts::PI * DVec2::new(0.6, 0.8);
        let vector =
            Wave { direction: None, wavelength_m: None, vector_rad_m: Some(k.into()), ..plain() };
        let place = DVec2::new(0.3, -1.7);
        assert!((plain().at(place) - vector.at(place)).length() < 1e-12);
        let expected = 0.1 * (k.dot(place) + 0.4).cos();
        assert!((vector.at(place).x - expected).abs() < 1e-15);
    }

    #[test]
    fn derivatives_match_differences() {
        let waves = [plain(), Wave { phase_rad: 2.0, direction: Some([-1.0, 0.2]), ..plain() }];
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
        let cases: &[check::Refusal<Wave>] = &[
            (|w| w.amplitude_m = f64::NAN, "water.waves[1].amplitude_m"),
            (|w| w.wavelength_m = Some(0.0), "water.waves[1].wavelength_m"),
            (|w| w.direction = Some([0.0, 0.0]), "has no direction"),
            (|w| w.wavelength_m = None, "`vector_rad_m`"),
            (|w| w.vector_rad_m = Some([1.0, 0.0]), "needs either"),
        ];
        check::assert_refused(&plain(), |w| validate(&[plain(), w.clone()]), cases);
        assert!(validate(&vec![plain(); 2000]).unwrap_err().contains("at most 1024"));
        let high = Wave { amplitude_m: 60.0, ..plain() };
        assert!(validate(&[high.clone(), high]).unwrap_err().contains("sum of all"));
    }
}

//! Refraction, reflectance, scattering and attenuation: exact formulae.

use std::f64::consts::PI;

use glam::DVec3;

/// Direction of a ray after refraction, unit length; `None` on total internal reflection.
///
/// Snell's law in vector form. `incident` is a unit travel direction, `normal` a unit normal of
/// either sign, `n1` and `n2` the refractive indices before and behind the surface. The sine is
/// taken from the cross product, which keeps its digits near normal incidence.
pub fn refract(incident: DVec3, normal: DVec3, n1: f64, n2: f64) -> Option<DVec3> {
    let facing = if incident.dot(normal) > 0.0 { -normal } else { normal };
    let eta = n1 / n2;
    let sin2_t = eta * eta * incident.cross(facing).length_squared();
    if sin2_t > 1.0 {
        return None;
    }
    let tangential = incident - facing * incident.dot(facing);
    Some((tangential * eta - facing * (1.0 - sin2_t).sqrt()).normalize())
}

/// Share of unpolarised light that a dielectric surface reflects, 0…1 (Fresnel).
///
/// `cos_i` is the cosine of the angle of incidence, 0…1.
pub fn fresnel_reflectance(cos_i: f64, n1: f64, n2: f64) -> f64 {
    let sin2_t = (n1 / n2).powi(2) * (1.0 - cos_i * cos_i);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let s = (n1 * cos_i - n2 * cos_t) / (n1 * cos_i + n2 * cos_t);
    let p = (n2 * cos_i - n1 * cos_t) / (n2 * cos_i + n1 * cos_t);
    0.5 * (s * s + p * p)
}

/// Share of unpolarised light that passes a dielectric surface, 0…1, from the amplitude
/// coefficients of transmission rather than as `1 − R`, so that the two check each other.
pub fn fresnel_transmittance(cos_i: f64, n1: f64, n2: f64) -> f64 {
    let sin2_t = (n1 / n2).powi(2) * (1.0 - cos_i * cos_i);
    if sin2_t >= 1.0 || cos_i <= 0.0 {
        return 0.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let s = 2.0 * n1 * cos_i / (n1 * cos_i + n2 * cos_t);
    let p = 2.0 * n1 * cos_i / (n2 * cos_i + n1 * cos_t);
    (n2 * cos_t) / (n1 * cos_i) * 0.5 * (s * s + p * p)
}

/// Schlick's simplification of the Henyey–Greenstein phase function, per steradian (UW §4.1).
///
/// `cos_alpha` is the cosine of the scattering angle: 1 = light keeps its direction. `k` in (−1, 1)
/// is positive for forward scattering.
pub fn phase_schlick(cos_alpha: f64, k: f64) -> f64 {
    (1.0 - k * k) / (4.0 * PI * (1.0 - k * cos_alpha).powi(2))
}

/// Share of light left after `distance_m` of a medium that attenuates by `gamma_per_m`
/// (Beer–Lambert; the exponentials of UW §3.3 and §3.4).
pub fn transmittance(gamma_per_m: f64, distance_m: f64) -> f64 {
    (-gamma_per_m * distance_m).exp()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn unit() -> impl Strategy<Value = DVec3> {
        (-1.0..1.0f64, 0.0..std::f64::consts::TAU).prop_map(|(y, phi)| {
            let r = (1.0 - y * y).sqrt();
            DVec3::new(r * phi.cos(), y, r * phi.sin())
        })
    }

    proptest! {
        #[test]
        fn snell_holds_and_rays_stay_coplanar(i in unit(), n in unit(), n2 in 1.0..2.5f64) {
            prop_assume!(i.dot(n).abs() > 1e-6);
            let t = refract(i, n, 1.0, n2).expect("a denser medium never reflects totally");
            prop_assert!((i.cross(n).length() - n2 * t.cross(n).length()).abs() < 1e-12);
            prop_assert!(t.dot(i.cross(n)).abs() < 1e-12);
            prop_assert!((t.length() - 1.0).abs() < 1e-12);
            prop_assert!(t.dot(n) * i.dot(n) > 0.0, "the ray passes through the surface");
        }

        #[test]
        fn beyond_the_critical_angle_nothing_passes(phi in 0.0..std::f64::consts::TAU, sin in 0.0..1.0f64) {
            let i = DVec3::new(sin * phi.cos(), (1.0 - sin * sin).sqrt(), sin * phi.sin());
            let critical = 1.0 / 1.33;
            prop_assume!((sin - critical).abs() > 1e-9);
            prop_assert_eq!(refract(i, DVec3::Y, 1.33, 1.0).is_none(), sin > critical);
        }

        #[test]
        fn reflected_and_transmitted_energy_sum_to_one(cos_i in 1e-6..1.0f64, n2 in 0.4..2.5f64) {
            let sum = fresnel_reflectance(cos_i, 1.0, n2) + fresnel_transmittance(cos_i, 1.0, n2);
            prop_assert!((sum - 1.0).abs() < 1e-9, "R + T = {}", sum);
        }

        #[test]
        fn the_phase_function_integrates_to_one(k in -0.95..0.95f64) {
            let steps = 20_000;
            let integral: f64 = (0..steps)
                .map(|i| phase_schlick(2.0 * (i as f64 + 0.5) / steps as f64 - 1.0, k))
                .sum::<f64>() * 2.0 / steps as f64 * 2.0 * PI;
            prop_assert!((integral - 1.0).abs() < 1e-4, "integral {}", integral);
        }

        #[test]
        fn transmittance_multiplies(gamma in 0.0..3.0f64, a in 0.0..50.0f64, b in 0.0..50.0f64) {
            let product = transmittance(gamma, a) * transmittance(gamma, b);
            prop_assert!((product - transmittance(gamma, a + b)).abs() <= 1e-12 * product.max(1e-300));
        }
    }

    #[test]
    fn known_angles_and_reflectances() {
        let i = DVec3::new(1.0, -1.0, 0.0).normalize();
        let t = refract(i, DVec3::Y, 1.0, 1.33).unwrap();
        assert!((t.x - (0.5f64).sqrt() / 1.33).abs() < 1e-15);
        assert_eq!(refract(DVec3::NEG_Y, DVec3::Y, 1.0, 1.33), Some(DVec3::NEG_Y));
        assert!((fresnel_reflectance(1.0, 1.0, 1.5) - 0.04).abs() < 1e-15);
        assert_eq!(fresnel_reflectance(0.2, 1.33, 1.0), 1.0);
    }

    #[test]
    fn water_lets_through_what_its_closed_forms_say() {
        let n = 1.33f64;
        let straight = 1.0 - ((n - 1.0) / (n + 1.0)).powi(2);
        assert!((fresnel_transmittance(1.0, 1.0, n) - straight).abs() < 1e-15);
        // Near grazing 4 (1 + n²) cos θ / (n √(n² − 1)) / 2 is left, which tends to 0.
        for cos_i in [1e-3, 1e-6] {
            let slope = 2.0 * (1.0 + n * n) / (n * n - 1.0).sqrt();
            let t = fresnel_transmittance(cos_i, 1.0, n);
            assert!((t / (slope * cos_i) - 1.0).abs() < 10.0 * cos_i, "{t}");
        }
        // At Brewster's angle the parallel part passes whole: T = 1 − R_s / 2.
        let cos_b = 1.0 / (1.0 + n * n).sqrt();
        let r_s = ((1.0 - n * n) / (1.0 + n * n)).powi(2);
        assert!((fresnel_transmittance(cos_b, 1.0, n) - (1.0 - r_s / 2.0)).abs() < 1e-12);
    }
}

use glam::DVec3;

use super::{Law, Mode, Scalar};
use fathom_scene::Volume;

const VOXEL_M: f64 = 0.1;

#[test]
fn steps_without_end_are_refused() {
    let spacing_m = DVec3::splat(VOXEL_M);
    let volume = Volume { cells: [1000, 1, 1], spacing_m, ..Volume::default() };
    let scalar = Scalar { view_step_voxels: 0.06, ..Scalar::default() };
    let message = scalar.check_volume(&volume, 100.0).unwrap_err().to_string();
    assert!(message.starts_with("scalar.view_step_voxels"), "{message}");
}

#[test]
fn thresholds_of_media_mean_opacity_of_a_voxel() {
    let ends_at = |scalar: &Scalar| scalar.uniforms([8, 8], VOXEL_M, 1.0).threshold;
    let mut scalar = Scalar { threshold: 0.5, ..Scalar::default() };
    assert_eq!(ends_at(&scalar), 0.5);
    scalar.mode = Mode::Direct;
    scalar.opacity = 0.8;
    assert_eq!(ends_at(&scalar), 0.625);
    scalar.opacity = 0.0;
    assert_eq!(ends_at(&scalar), 2.0);
    scalar.law = Law::Beer;
    scalar.density_per_m = 10.0;
    assert!((f64::from(ends_at(&scalar)) - 2f64.ln()).abs() < 1e-6);
    scalar.threshold = 1.0;
    assert_eq!(ends_at(&scalar), 2.0);
}

use glam::DVec3;
use serde_json::json;

use super::{Law, Mode, Params, Scalar};
use crate as pipelines;
use fathom_base::parameter;
use fathom_scene::{Scene, SceneFile, Volume};

const VOXEL_M: f64 = 0.1;

#[test]
fn steps_without_end_are_refused() {
    let volume = Volume {
        name: "test".into(),
        cells: [1000, 1, 1],
        origin_m: DVec3::ZERO,
        spacing_m: DVec3::splat(VOXEL_M),
        data: Vec::new(),
    };
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

#[test]
fn cells_follow_the_parameters() {
    let file = SceneFile::load("smoke").unwrap();
    let mut tree = parameter::tree(&Params::from(&file));
    assert_eq!(tree["volume"]["cells"], json!([200, 128, 200]));
    parameter::set(&mut tree, "volume.cells", json!([20, 12, 20])).unwrap();
    parameter::set(&mut tree, "volume.reduce", json!(2)).unwrap();
    let params: Params = pipelines::read(&tree).unwrap();
    let reduced = pipelines::apply(&params, &file).unwrap();
    assert_eq!(Scene::build(&reduced).unwrap().volume.unwrap().cells, [10, 6, 10]);
}

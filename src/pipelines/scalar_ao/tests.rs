//! Bad input is named, and a scene without a volume too. No GPU.

use glam::DVec3;
use serde_json::{Value, json};

use super::{Params, ScalarAo};
use crate as pipelines;
use crate::{Parameters, PipelineKind};
use fathom_base::parameter::{self, ParamError, Setting};
use fathom_gpu::{Demand, GpuError};
use fathom_scene::{Scene, SceneFile, Volume};

const VOXEL_M: f64 = 0.1;

fn scene() -> Scene {
    let mut scene = Scene::load("plane").unwrap();
    scene.objects.clear();
    scene.volume = Some(Volume {
        name: "test".into(),
        cells: [10; 3],
        origin_m: DVec3::ZERO,
        spacing_m: DVec3::splat(VOXEL_M),
        data: vec![0.5; 1000],
    });
    scene
}

fn tree(path: &str, value: Value) -> Value {
    let mut tree = parameter::tree(&Params::from(&SceneFile::load("plane").unwrap()));
    parameter::set(&mut tree, path, value).unwrap();
    tree
}

fn demand(tree: &Value, scene: &Scene) -> Result<Demand, GpuError> {
    Ok((PipelineKind::of::<ScalarAo>().configure)(tree)?.plan(scene)?.demand)
}

fn read(tree: &Value) -> Result<Params, ParamError> {
    pipelines::read(tree)
}

fn fault(path: &str, value: Value) -> String {
    demand(&tree(path, value), &scene()).unwrap_err().to_string()
}

#[test]
fn defaults_suit_a_volume() {
    let tree = tree("view.width", json!(32));
    assert!(demand(&tree, &scene()).is_ok());
    let scalar = read(&tree).unwrap().scalar;
    let march = scalar.uniforms([32, 24], VOXEL_M, 0.8);
    assert_eq!(march.stratum_m, 0.1);
    assert_eq!(march.level, 0.0);
    assert_eq!(scalar.uniforms([32, 24], VOXEL_M, 3.2).level, 2.0);
}

#[test]
fn values_out_of_range_are_named() {
    let cases = [
        ("scalar.iso", json!(1.5)),
        ("scalar.iso", json!(-0.1)),
        ("scalar.rays", json!(0)),
        ("scalar.samples", json!(0)),
        ("scalar.tolerance", json!(0.0)),
        ("scalar.threshold", json!(1.1)),
        ("scalar.opacity", json!(2.0)),
        ("scalar.window", json!([0.5, 0.5])),
        ("scalar.low_color", json!([0.0, 0.0, 1.5])),
        ("scalar.view_step_voxels", json!(0.0)),
        ("scalar.r_max_m", json!(0.01)),
        ("scalar.r_max_share", json!(0.05)),
        ("view.width", json!(0)),
    ];
    for (path, value) in cases {
        let message = fault(path, value.clone());
        assert!(message.starts_with(path), "{path} = {value}: {message}");
        assert!(!message.contains('\n'), "{message}");
    }
}

#[test]
fn what_is_no_number_is_refused() {
    let mut params = Params::from(&SceneFile::load("plane").unwrap());
    params.scalar.iso = f64::NAN;
    assert!(read(&tree("scalar.iso", json!(1.0))).is_ok());
    let error = params.check(parameter::Beside::default()).unwrap_err().to_string();
    assert!(error.contains("scalar.iso"));
}

#[test]
fn steps_without_end_are_refused() {
    let mut scene = scene();
    if let Some(volume) = &mut scene.volume {
        volume.cells = [1000, 1, 1];
    }
    let message =
        demand(&tree("scalar.view_step_voxels", json!(0.06)), &scene).unwrap_err().to_string();
    assert!(message.starts_with("scalar.view_step_voxels"), "{message}");
}

#[test]
fn a_scene_without_a_volume_is_told_so() {
    let scene = Scene::load("plane").unwrap();
    let message = demand(&tree("scalar.rays", json!(4)), &scene).unwrap_err().to_string();
    assert!(message.contains("scene `plane` has no volume"), "{message}");
}

#[test]
fn volumes_beyond_the_adapter_are_named() {
    let mut scene = scene();
    if let Some(volume) = &mut scene.volume {
        *volume = Volume { cells: [4000, 1, 1], data: vec![0.5; 4000], ..volume.clone() };
    }
    let demand = demand(&tree("scalar.rays", json!(4)), &scene).unwrap();
    let message = demand.check(&wgpu::Limits::default()).unwrap_err();
    assert!(message.starts_with("volume cells"), "{message}");
}

#[test]
fn thresholds_of_media_mean_opacity_of_a_voxel() {
    use super::{Law, Mode};
    let mut scalar = read(&tree("scalar.threshold", json!(0.5))).unwrap().scalar;
    let ends_at = |scalar: &super::Scalar| scalar.uniforms([8, 8], VOXEL_M, 1.0).threshold;
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
fn cells_follow_the_parameters_where_they_can() {
    let file = SceneFile::load("smoke").unwrap();
    let mut tree = parameter::tree(&Params::from(&file));
    assert_eq!(tree["volume"]["cells"], json!([200, 128, 200]));
    parameter::set(&mut tree, "volume.cells", json!([20, 12, 20])).unwrap();
    parameter::set(&mut tree, "volume.reduce", json!(2)).unwrap();
    let reduced = read(&tree).unwrap().staged(&file).unwrap();
    assert_eq!(Scene::build(&reduced).unwrap().volume.unwrap().cells, [10, 6, 10]);
    let mut scanned = file.clone();
    if let Some(volume) = &mut scanned.volume {
        volume.generator = None;
        volume.asset = Some("engine".into());
        volume.cells = [0; 3];
    }
    let message = read(&tree).unwrap().staged(&scanned).unwrap_err().to_string();
    assert!(message.starts_with("volume.cells"), "{message}");
}

#[test]
fn rays_of_an_isosurface_beyond_the_turns_of_loops_are_refused() {
    let check = |samples: u32| {
        let mut tree = tree("scalar.rays", json!(1024));
        parameter::set(&mut tree, "scalar.samples", json!(samples)).unwrap();
        let demand = demand(&tree, &scene()).unwrap();
        demand.check(&wgpu::Limits::default())
    };
    assert_eq!(check(32), Ok(()));
    let message = check(128).unwrap_err();
    assert!(message.starts_with("scalar.rays × scalar.samples: asks 134"), "{message}");
}

//! Which parameters are refused, and in which words. No GPU.

use serde_json::{Value, json};

use super::{KINDS, PipelinePlan, apply, even_step};
use fathom_base::parameter::{self, Allowed, ParamField};
use fathom_scene::{Scene, SceneFile};

/// Plans a pipeline and a scene, such as `hsao tank`, with parameters such as `hsao.rays=2 hsao.steps=3`, on the scene that they stage.
fn planned(of: &str, settings: &str) -> Result<PipelinePlan, String> {
    let (pipeline, scene) = of.split_once(' ').expect("two names");
    let kind = KINDS.iter().find(|kind| kind.name == pipeline).expect("a pipeline");
    let file = SceneFile::load(scene).expect("a scene");
    let mut tree = (kind.defaults)(&file);
    for (path, value) in settings.split(' ').filter_map(|setting| setting.split_once('=')) {
        let value = serde_json::from_str(value).unwrap_or_else(|_| value.into());
        parameter::set(&mut tree, path, value).map_err(|error| error.to_string())?;
    }
    let tree = (kind.checked)(&tree).map_err(|error| error.to_string())?;
    let file = apply(&tree, &file).map_err(|error| error.to_string())?;
    let scene = Scene::build(&file).map_err(|error| error.to_string())?;
    (kind.plan)(&tree, &scene).map_err(|error| error.to_string())
}

/// Whether an adapter of small volumes takes it.
fn judged(of: &str, settings: &str) -> Result<(), String> {
    let limits = wgpu::Limits { max_texture_dimension_3d: 256, ..wgpu::Limits::default() };
    planned(of, settings)?.demand.check(&limits.into())
}

/// A value below and one above what a parameter takes, in the form of its default.
fn beyond(allowed: Allowed, default: &Value) -> Vec<Value> {
    let like = |number: f64| match default {
        Value::Array(items) => json!(vec![number; items.len()]),
        _ => json!(number),
    };
    match allowed {
        Allowed::Numbers(range) => vec![like(range.low - 1.0), like(range.high.abs() * 2.0 + 1.0)],
        Allowed::Names(_) => vec![json!("nonsense")],
        Allowed::Flag => vec![json!(2)],
        Allowed::Free => Vec::new(),
    }
}

#[test]
fn values_that_a_parameter_does_not_take_are_refused_by_its_name() {
    let file = SceneFile::load("tank").unwrap();
    for kind in KINDS {
        let defaults = (kind.defaults)(&file);
        assert!((kind.checked)(&defaults).is_ok(), "{}", kind.name);
        for ParamField { path, allowed, .. } in (kind.fields)() {
            let default = parameter::get(&defaults, &path).unwrap();
            for value in beyond(allowed, default) {
                let mut tree = defaults.clone();
                let taken = parameter::set(&mut tree, &path, value.clone());
                let taken = taken.and_then(|()| (kind.checked)(&tree).map(drop));
                let fault = taken.expect_err(&path).to_string();
                assert!(fault.contains(&path) && !fault.contains('\n'), "{value}: {fault}");
            }
        }
    }
}

#[test]
fn parameters_that_do_not_fit_each_other_the_scene_or_the_adapter_are_named() {
    let by_hand = "voxel.origin_m=[-10,-4,-10] voxel.voxel_m=0.1";
    let opacities =
        format!("{by_hand} voxel.cells=[256,256,256] voxel.method=max_alpha view.width=9000");
    let far = format!("{by_hand} voxel.cells=[2000,2000,4000]");
    let tiny = "voxel.origin_m=[-1,-4,-1] voxel.voxel_m=1 voxel.cells=[3,3,3] ao.skipping=true";
    let tiles = "transfer.grid, specular.bounces and rays.rows give";
    let of_scene = [
        ("voxelize plane", "voxel.cells=[0,4,4]", "voxel.cells is 0"),
        ("voxelize plane", "voxel.update=once", "voxel.update is once"),
        ("voxelize plane", "voxel.resolution=512", "voxel.resolution: asks 512 of max_texture"),
        ("voxelize plane", &far, "voxel.cells"),
        ("voxelize plane", &opacities, "view.width"),
        ("volume_ao plane", "ao.r_max_m=0.01", "ao.r_max_m is 1.000e-2 m, less than a voxel"),
        ("volume_ao plane", "ao.r_max_share=0.001", "ao.r_max_share"),
        ("volume_ao plane", "ao.rays=65536", "ao.rays"),
        ("volume_ao plane", tiny, "ao.skipping"),
        ("hsao tank", "hsao.directions=1024 hsao.steps=64", "hsao.directions × hsao.steps"),
        ("gtao tank", "gtao.slices=1024 gtao.steps=64", "2 × gtao.slices × gtao.steps"),
        ("photon_tracing tank", "rays.rows=1", tiles),
        ("photon_tracing tank", "transfer.grid=[16384,16384]", tiles),
        ("photon_tracing tank", "sprites.max_hits=2", "sprites.max_hits above 1"),
        ("scalar_ao plane", "", "scene `plane` has no volume"),
        ("scalar_ao engine", "volume.cells=[9,9,9]", "volume.cells"),
        ("scalar_ao smoke", "volume.cells=[4000,1,1]", "volume cells"),
        ("scalar_ao smoke", "volume.cells=[9,9,9] scalar.window=[0.5,0.5]", "scalar.window"),
        ("scalar_ao smoke", "volume.cells=[9,9,9] scalar.r_max_m=0.01", "scalar.r_max_m"),
        ("scalar_ao smoke", "volume.cells=[9,9,9] scalar.r_max_share=0.05", "scalar.r_max_share"),
        (
            "scalar_ao smoke",
            "volume.cells=[9,9,9] scalar.rays=1024 scalar.samples=128",
            "scalar.rays × scalar.samples: asks 142",
        ),
    ];
    for (of, settings, told) in of_scene {
        let fault = judged(of, settings).expect_err(told);
        assert!(fault.starts_with(told) && !fault.contains('\n'), "{settings}: {fault}");
    }
    for (of, settings) in [
        ("volume_ao plane", ""),
        ("hsao tank", "hsao.directions=512 hsao.steps=64"),
        ("photon_tracing tank", "rays.rows=64"),
        ("photon_tracing tank", "rays.rows=1 rays.method=march"),
        ("scalar_ao smoke", "volume.cells=[9,9,9] view.width=32"),
        ("scalar_ao smoke", "volume.cells=[9,9,9] scalar.rays=1024 scalar.samples=32"),
    ] {
        assert_eq!(judged(of, settings), Ok(()), "{of} {settings}");
    }
}

#[test]
fn steps_are_odd_and_leave_few() {
    for count in [1, 9_999, 10_000, 160_000, 4_000_000] {
        let step = even_step(count, 10_000);
        assert!(step % 2 == 1 && count.div_ceil(step) <= 10_000);
    }
    assert_eq!(even_step(500, 10_000), 1);
}

#[test]
fn a_picture_of_more_pixels_than_can_be_counted_is_planned() {
    let far = "view.width=1000000 view.height=1000000 rays.method=march";
    // The room for rays is counted, and no adapter has it.
    assert!(planned("shadow_rays ball", far).unwrap().demand.allocated_bytes() > 1 << 36);
}

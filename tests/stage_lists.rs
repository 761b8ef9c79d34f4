//! Every stage is listed where it runs, declares its work and bears its shader's name. Each message says what to add.

use fathom::Catalog;
use fathom::embedded::{Folders, SHADERS};
use fathom::experiments::parse_set;
use fathom::gpu::{Gpu, Options, shader_paths};
use fathom::harness::subject::Subjects;
use fathom::record::Work;
use fathom::stages::REGISTRY;

/// Stages that no frame holds: a picture of the volume, and answers at given points.
const APART: [&str; 3] = ["voxel/view", "ao/query", "photons/query"];

#[test]
fn every_stage_is_registered_and_pushed_into_a_pipeline() {
    let catalog = Catalog::builtin();
    let mut listed = Vec::new();
    for kind in &catalog.kinds {
        let stages = catalog.stages_of(kind.name).unwrap();
        for stage in &stages {
            assert!(
                REGISTRY.contains(stage),
                "pipeline {} runs {}: add its INFO to stages::REGISTRY",
                kind.name,
                stage.name
            );
        }
        listed.extend(stages);
    }
    for stage in REGISTRY {
        assert!(
            listed.contains(&stage) || APART.contains(&stage.name),
            "no pipeline runs {}: push it in one, or name it in APART if no frame holds it",
            stage.name
        );
    }
}

#[test]
fn every_stage_with_a_shader_bears_its_stem() {
    for path in shader_paths(&Folders::of(SHADERS)) {
        // Stages that differ in a suffix share a shader.
        let bears = |name: &str| {
            let rest = name.strip_prefix(path.as_str());
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
        };
        let named = REGISTRY.iter().any(|stage| bears(stage.name));
        assert!(
            path.starts_with("audit/") || named,
            "no stage is named after shaders/{path}.wgsl: add the stage's INFO to stages::REGISTRY"
        );
    }
}

/// Pipelines with settings that together run every stage.
const RUNS: [(&str, &str, &[&str]); 8] = [
    ("underwater", "plane", &["shadow.size=32", "caustics.grid=8", "godrays.grid=8"]),
    ("volume_ao", "slab", &["voxel.method=slicemap", "animation.deform=spin"]),
    ("volume_ao", "slab", &["voxel.method=slice", "ao.skipping=true"]),
    ("voxelize", "slab", &["voxel.method=overlap"]),
    ("voxelize", "slab", &["voxel.method=max_alpha"]),
    ("hsao", "slab", &["shadow.size=32", "compose.meter=true"]),
    ("scalar_ao", "smoke", &["scalar.mode=isosurface"]),
    ("scalar_ao", "smoke", &["scalar.mode=direct"]),
];
const POSITIONAL: (&str, &str, &[&str]) = ("scalar_ao", "smoke", &["scalar.mode=positional"]);

#[test]
fn what_is_built_runs_what_was_planned_and_declares_its_work() {
    let gpu = Gpu::open(&Options::default()).expect("an adapter is there");
    let mut subjects = Subjects::default().silent();
    let mut run = Vec::new();
    for (pipeline, scene, settings) in RUNS.into_iter().chain([POSITIONAL]) {
        let small = ["view.width=16", "view.height=16"];
        let overrides: Vec<_> =
            small.iter().chain(settings).map(|text| parse_set(text).unwrap()).collect();
        let subject = subjects.subject(pipeline, scene, &overrides).unwrap();
        let built = subject.build(&gpu).unwrap();
        let stages: Vec<_> = built.stages().iter().map(|stage| stage.info()).collect();
        assert_eq!(stages, subject.plan().unwrap().stages, "{pipeline}");
        for stage in built.stages() {
            assert!(stage.work() != Work::default(), "{} declares no work", stage.name());
        }
        run.extend(stages);
    }
    let missing = REGISTRY.iter().filter(|stage| !run.contains(stage));
    let missing: Vec<&str> =
        missing.map(|stage| stage.name).filter(|name| !APART.contains(name)).collect();
    assert!(missing.is_empty(), "no line of RUNS runs {missing:?}");
}

//! What `fathom list stages --pipeline` says of a pipeline is what the pipeline runs, in that order.

use std::collections::BTreeSet;

use fathom::experiments::parse_set;
use fathom::gpu::{Gpu, Options};
use fathom::harness::subject::Subjects;
use fathom::pipelines::KINDS;
use fathom::record::Work;

/// Pipeline, scene and settings: together they run every stage of every pipeline.
const VARIANTS: [(&str, &str, &[&str]); 12] = [
    ("underwater", "plane", &["shadow.size=32", "caustics.grid=8", "godrays.grid=8"]),
    ("voxelize", "slab", &["voxel.method=slicemap", "animation.deform=spin"]),
    ("voxelize", "slab", &["voxel.method=slice", "pyramid=true"]),
    ("voxelize", "slab", &["voxel.method=overlap"]),
    ("voxelize", "slab", &["voxel.method=max_alpha"]),
    ("volume_ao", "slab", &["voxel.method=slicemap", "animation.deform=spin"]),
    ("volume_ao", "slab", &["voxel.method=slice", "ao.skipping=true"]),
    ("volume_ao", "slab", &["voxel.method=overlap"]),
    ("volume_ao", "slab", &["voxel.method=max_alpha"]),
    ("hsao", "slab", &["shadow.size=32"]),
    ("scalar_ao", "smoke", &["scalar.mode=isosurface"]),
    ("scalar_ao", "smoke", &["scalar.mode=direct"]),
];
const POSITIONAL: (&str, &str, &[&str]) = ("scalar_ao", "smoke", &["scalar.mode=positional"]);

#[test]
fn pipelines_run_the_stages_that_they_list() {
    let gpu = Gpu::open(&Options::default()).expect("an adapter is there");
    let mut subjects = Subjects::default().silent();
    let mut run: BTreeSet<(&str, &str)> = BTreeSet::new();
    for (pipeline, scene, settings) in VARIANTS.into_iter().chain([POSITIONAL]) {
        let small = ["view.width=16", "view.height=16"];
        let settings = small.iter().chain(settings);
        let overrides: Vec<_> = settings.map(|text| parse_set(text).unwrap()).collect();
        let subject = subjects.subject(pipeline, scene, &overrides).unwrap();
        let built = subject.build(&gpu).unwrap();
        let mut listed = subject.kind.stages().map(|stage| stage.name);
        for stage in built.stages() {
            let name = stage.name();
            assert!(stage.work() != Work::default(), "{name} declares no work");
            assert!(
                listed.any(|listed| listed == name),
                "{pipeline} lists {name} nowhere after the stages before it"
            );
            run.insert((pipeline, name));
        }
    }
    for kind in KINDS {
        for stage in kind.stages() {
            assert!(
                run.contains(&(kind.name, stage.name)),
                "{} lists {}, which no variant runs",
                kind.name,
                stage.name
            );
        }
    }
}

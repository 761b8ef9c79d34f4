//! Every stage is listed where it runs, declares its work and bears its shader's name. Each message says what to add.

use fathom::Catalog;
use fathom::compare::cells::Gates;
use fathom::embedded::{Folders, SHADERS};
use fathom::gpu::{Gpu, Options, Stage, shader_paths, stages_before};
use fathom::harness::subject::Subjects;
use fathom::record::Work;
use fathom::stages::REGISTRY;

/// Stages that no frame holds: a picture of the volume, and answers at given points.
const APART: [&str; 2] = ["voxel/view", "ao/query"];

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
    for path in shader_paths(&Folders::new(SHADERS)) {
        // Stages that differ in a suffix share a shader.
        let bears = |name: &str| {
            let rest = name.strip_prefix(path.as_str());
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
        };
        let named = REGISTRY.iter().any(|stage| bears(stage.name));
        assert!(
            ["audit/", "ceilings/"].iter().any(|kernels| path.starts_with(kernels)) || named,
            "no stage is named after shaders/{path}.wgsl: add the stage's INFO to stages::REGISTRY"
        );
    }
}

/// The gates' cells run every stage; here with a small picture.
#[test]
fn what_is_built_runs_what_was_planned_and_declares_its_work() {
    let mut gpu = Gpu::open(&Options::default()).expect("an adapter is there");
    let catalog = Catalog::builtin();
    let mut subjects = Subjects::new(&catalog).silent();
    let (mut spent, mut refused) = (Vec::new(), Vec::new());
    for cell in Gates::load(None, catalog.gates).unwrap().configurations {
        let small = ["view.width", "view.height"].map(|path| (path.to_owned(), 16.into()));
        let params: Vec<_> = cell.params.into_iter().chain(small).collect();
        let subject = subjects.subject(&cell.pipeline, &cell.scene, &params).unwrap();
        // An adapter whose fragment shaders write no storage builds what the plan does not refuse there.
        gpu.capacity.read_only_fragments = true;
        let reason = subject.limits_exceeded(&gpu.capacity).unwrap();
        gpu.capacity.read_only_fragments = reason.is_none();
        refused.extend(reason);
        let built = subject.build(&gpu).unwrap();
        let all = built.stages();
        let is_spent = |stage: &&&Stage| !stages_before(&all, stage).is_empty();
        spent.extend(
            all.iter().filter(is_spent).map(|stage| format!("{} {}", cell.id, stage.name())),
        );
        let stages: Vec<_> = all.iter().map(|stage| stage.info).collect();
        assert_eq!(stages, subject.plan().unwrap().stages, "{}", cell.id);
        for stage in built.stages() {
            assert!(stage.work != Work::default(), "{} declares no work", stage.name());
            let declared = stage.work.fields().into_iter().zip(stage.min_work.fields());
            for ((count, most), (_, least)) in declared {
                assert!(least <= most, "{}: at least {least} of {most} {count}", stage.name());
            }
        }
    }
    let writes =
        |of: &String| ["voxel/slicemap-", "rays/march"].iter().any(|by| of.starts_with(by));
    assert!(refused.len() > 1 && refused.iter().all(writes));
    // Behind a frame all photons have ended, and these stages would find nothing to do.
    assert_eq!(spent, ["photon-bounce rays/march", "photon-bounce transfer/bounce"]);
    let planned = Gpu::planner().unwrap().shader_variants();
    let linked = gpu.shader_variants();
    assert!(linked.is_subset(&planned), "{:?} are linked and not planned", &linked - &planned);
}

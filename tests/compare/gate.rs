//! Workers of this build on a software driver. The time gate between real workers is run in `examples/own_pipeline` and `examples/own_program`.

use std::path::Path;

use fathom::compare::protocol::{GateConfiguration, Reply, WorkerRequest};
use fathom::compare::worker_process::{
    Quiet, ReplyWait, WorkerProcess, WorkerStart, allowed_cores,
};
use fathom::record::comparison::CellSubject;
use serde_json::{Map, json};

use super::common::{Ends, sets};

fn fathom() -> WorkerStart {
    WorkerStart::new(Path::new(env!("CARGO_BIN_EXE_fathom")))
}

/// Small enough for an unoptimized build.
fn plane() -> GateConfiguration {
    let small = "view.width=48 view.height=48 shadow.size=64 surface.cells=8 caustics.grid=8 caustics.buffer=[32,32] \
        godrays.grid=8 godrays.buffer=[32,32]";
    GateConfiguration {
        id: "plane".to_owned(),
        pipeline: "underwater".to_owned(),
        scene: "plane".to_owned(),
        params: sets(small).into_iter().collect(),
        ..GateConfiguration::default()
    }
}

fn sample(config: &str, stage: &str, frames: u32) -> WorkerRequest {
    WorkerRequest::Sample { config: config.to_owned(), stage: stage.to_owned(), frames }
}

#[test]
fn a_worker_says_under_which_conditions_it_runs_and_answers_every_request() {
    let core = allowed_cores().last().copied();
    let mut start = fathom();
    start.quiet = Some(Quiet { core, padding: 100, keep_memory: true });
    let mut early = WorkerProcess::spawn(&start).unwrap();
    let fault = early.ask(&WorkerRequest::Clock, &ReplyWait::SILENT).unwrap_err();
    assert!(fault.is_alive() && fault.to_string().contains("`hello`"), "{fault}");
    let mut worker = WorkerProcess::start(&start).unwrap();
    let greeting = worker.greet(&ReplyWait::SILENT).unwrap();
    let mut ask = |request| worker.ask(&request, &ReplyWait::SILENT);
    assert_eq!(greeting.parts, ["exact", "checks", "time", "instructions"]);
    if cfg!(target_os = "linux") {
        assert_eq!(greeting.cores, core.map(|core| vec![core]));
        assert!(greeting.randomized.is_some());
    }
    let prepared = ask(WorkerRequest::Prepare { configuration: plane() }).unwrap();
    let Reply::Prepared { stages, .. } = prepared else { panic!("{prepared:?}") };
    let kinds: Vec<_> = stages.iter().map(|stage| (stage.name.as_str(), stage.kind)).collect();
    use fathom::record::PassKind::{Compute, Host, Render};
    assert_eq!(kinds[0], ("uniforms", Host));
    assert!(kinds.contains(&("caustics/trace", Compute)) && kinds.contains(&("compose", Render)));

    let Ok(Reply::Sample { ns, .. }) = ask(sample("plane", "caustics/splat", 3)) else {
        panic!("no sample")
    };
    assert!(ns.len() == 3 && ns.iter().all(|ns| *ns > 0.0), "{ns:?}");
    let prepare = |name: &str, value: u32| {
        let params = Map::from_iter([(name.to_owned(), json!(value))]);
        WorkerRequest::Prepare { configuration: GateConfiguration { params, ..plane() } }
    };
    for (request, reason, absent) in [
        (sample("plan", "compose", 1), "`plan` is not prepared", false),
        (sample("plane", "compos", 1), "has no stage `compos`; it has uniforms, ", true),
        (sample("plane", "encode:compos", 1), "has no stage `compos`; it has uniforms, ", true),
        (prepare("caustics.gird", 1), "did you mean `caustics.grid`", true),
        (prepare("view.width", 1_000_000), "", false),
    ] {
        let fault = ask(request).unwrap_err();
        assert!(fault.is_alive() && fault.to_string().contains(reason), "{fault}");
        assert_eq!(fault.is_absence(), absent, "{fault}");
    }

    let config = "plane".to_owned();
    let Ok(Reply::Exact(exact)) = ask(WorkerRequest::Exact { config: config.clone() }) else {
        panic!("no exact figures")
    };
    let hosts = stages.iter().filter(|stage| !CellSubject::parse(&stage.name).is_stage()).count();
    assert_eq!(hosts, exact.stages.len() + 1, "each stage can be encoded, and all be created");
    assert!(exact.allocated_bytes > 0 && exact.stages.len() + hosts == stages.len());
    assert!(exact.errors.contains_key("caustics_photon_error_median_m"));
    for error in exact.errors.keys() {
        let judged = exact.judged.iter().find(|judged| *judged.name == **error).unwrap();
        assert!(stages.iter().any(|stage| *judged.stage == *stage.name), "{judged:?}");
    }
    for stage in ["compose", "encode:compose", "create"] {
        let Ok(Reply::Sample { ns, .. }) = ask(sample("plane", stage, 2)) else {
            panic!("no sample of {stage}")
        };
        assert!(ns.len() == 2 && ns.iter().all(|ns| *ns > 0.0), "{stage}: {ns:?}");
        let (config, stage) = (config.clone(), stage.to_owned());
        let counted = ask(WorkerRequest::Instructions { config, stage, frames: 2 });
        assert_eq!(counted, Ok(Reply::Instructions { frames: 2 }));
    }
    worker.quit();
}

/// Two settings of one build are compared by its command.
#[test]
fn a_worker_sets_what_its_pipelines_have() {
    let worker = format!("exec '{}' worker --set caustics.grid", env!("CARGO_BIN_EXE_fathom"));
    let photons = |command: &str| {
        let start = WorkerStart::from_command(command);
        let (mut worker, _) = WorkerProcess::open(&start, &ReplyWait::SILENT).unwrap();
        let mut ask = |request| worker.ask(&request, &ReplyWait::SILENT).unwrap();
        ask(WorkerRequest::Prepare { configuration: plane() });
        let Reply::Exact(exact) = ask(WorkerRequest::Exact { config: "plane".to_owned() }) else {
            panic!("no exact figures")
        };
        exact.stages.iter().find(|stage| stage.name == "caustics/trace").unwrap().work.photons
    };
    assert_eq!([16, 32].map(|grid| photons(&format!("{worker}={grid}"))), [1024, 4096]);
    super::common::fathom("worker --set caustics.gird=1").refused("did you mean `caustics.grid`");
}

//! Invented records of whole runs, for tests: times follow a simple cost model with log-normal noise.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::{Value, json};

use crate::{CellPlan, Experiment, StageName, parse_axis};
use fathom_base::parameter::get;
use fathom_base::visits;
use fathom_record::{
    Adapter, AuditRow, Cell, Clock, Conditions, Definition, End, FrameRecord, Measured, Note,
    NoteKind, Outcome, PassKind, Profile, Record, Run, SCHEMA, SetUp, ShaderChecks, StageRecord,
    Surrounding, Work,
};

const SAMPLES: usize = 15;

/// A quick run of every built-in experiment on a software driver, with a skipped and a failed cell.
pub fn run() -> Vec<Record> {
    static RECORDS: OnceLock<Vec<Record>> = OnceLock::new();
    RECORDS.get_or_init(|| profile(Profile::Quick)).clone()
}

/// The same in any profile.
pub fn profile(profile: Profile) -> Vec<Record> {
    let mut records = vec![Record::Run(Box::new(header(profile)))];
    let mut random = Pcg64::seed_from_u64(7);
    for id in Experiment::builtin_ids() {
        let experiment = Experiment::load(&id).unwrap();
        let (id, toml) = (experiment.id.clone(), experiment.text.clone());
        records.push(Record::Experiment(Definition { id, toml }));
        for plan in experiment.cells(profile, &[], &[]).unwrap() {
            let outcome = Outcome::Measured(Box::new(measure(&experiment, &plan, &mut random)));
            records.push(cell(&plan, outcome));
        }
    }
    let large = "grid 5000×5000 needs 3,200,000,000 bytes, the adapter binds 134,217,728";
    let unmeasured = [
        Outcome::Skipped { reason: large.to_owned() },
        Outcome::Failed { reason: "device lost".to_owned() },
    ];
    let buffers = Experiment::load("uw-buffers").unwrap();
    let axis = [parse_axis("caustics.buffer=[4096,4096],[64,64]").unwrap()];
    let plans = buffers.cells(profile, &axis, &[]).unwrap();
    records.extend(plans.iter().zip(unmeasured).map(|(plan, outcome)| cell(plan, outcome)));
    records.push(Record::End(End {
        measuring_wall_s: 212.0,
        measured_gpu_s: 184.0,
        set_up_s: 21.0,
        set_up_parts_s: [(SetUp::Pipelines, 20.0), (SetUp::Audit, 1.0)].into(),
        peak_memory_bytes: Some(912 << 20),
        interrupted: false,
    }));
    records
}

/// What an experiment of a test's own begins with.
pub const OWN: &str = r#"
id = "own"
title = "Own"
source = "none"
pipeline = "underwater"
scene = "tank"
"#;

/// The experiment that begins with [`OWN`] and goes on so.
pub fn own(rest: &str) -> Experiment {
    Experiment::parse("own", &format!("{OWN}{rest}")).unwrap()
}

/// The cells of records, to change them.
pub fn cells(records: &mut [Record]) -> impl Iterator<Item = &mut Cell> {
    records.iter_mut().filter_map(|record| match record {
        Record::Cell(cell) => Some(cell.as_mut()),
        _ => None,
    })
}

/// A run in which no cell was measured.
pub fn all_skipped() -> Vec<Record> {
    let skip = |record| match record {
        Record::Cell(cell) => Record::Cell(Box::new(Cell {
            outcome: Outcome::Skipped { reason: "too large".to_owned() },
            ..*cell
        })),
        other => other,
    };
    run().into_iter().map(skip).collect()
}

pub fn header(profile: Profile) -> Run {
    let (agrees, late) =
        ("agrees with the fenced host clock", "begins late: reads a fraction of the host time");
    let row = |pass, context, ratio: f64, sound| AuditRow {
        pass,
        context,
        clock: Clock::Timestamp,
        clock_ns: 18.5e6 * ratio,
        host_ns: 18.5e6,
        ratio,
        doubling: if sound { 2.01 } else { 1.0 },
        sound,
        reason: if sound { agrees } else { late }.to_owned(),
    };
    Run {
        schema: SCHEMA,
        fathom_version: "0.1.0".to_owned(),
        started_at: "2026-01-02T03:04:05Z".to_owned(),
        profile,
        command: vec!["fathom".to_owned(), "run".to_owned()],
        adapter: Adapter {
            name: "llvmpipe (LLVM 15.0.6, 256 bits)".to_owned(),
            backend: "vulkan".to_owned(),
            device_type: "cpu".to_owned(),
            driver: "llvmpipe".to_owned(),
            driver_info: "Mesa 22.3.6".to_owned(),
            software: true,
            timestamp_period_ns: 1.0,
            host_threads: 2,
            ..Adapter::default()
        },
        shader_checks: ShaderChecks::Checked,
        clocks: [(PassKind::Compute, Clock::FencedHost), (PassKind::Render, Clock::Timestamp)]
            .into(),
        conditions: Conditions { cores: vec![1], ..Conditions::default() },
        audit: vec![
            row(PassKind::Compute, Surrounding::Alone, 1.002, true),
            row(PassKind::Compute, Surrounding::Mixed, 0.003, false),
            row(PassKind::Render, Surrounding::Mixed, 0.998, true),
        ],
        submit_cost_ns: [(PassKind::Compute, 41_000.0), (PassKind::Render, 52_000.0)].into(),
        notes: vec![Note::new(NoteKind::Adapter, "no SHADER_F16: not used")],
        ..Run::default()
    }
}

/// A record of a plan, its parameters those of the plan and a few defaults.
pub fn cell(plan: &CellPlan, outcome: Outcome) -> Record {
    Record::Cell(Box::new(Cell {
        experiment: plan.experiment.clone(),
        cell: plan.cell.clone(),
        axes: plan.axes.clone(),
        pipeline: plan.pipeline.clone(),
        scene: plan.scene.clone(),
        stand_ins: Vec::new(),
        sources: Default::default(),
        params: tree(plan).into(),
        outcome,
    }))
}

fn tree(plan: &CellPlan) -> Value {
    let mut tree = json!({
        "view": { "width": 800, "height": 800 },
        "caustics": { "grid": 200, "subdivision": 4, "subdivision_mode": "static", "buffer": [512, 512], "filter": true },
        "godrays": { "grid": 100, "subdivision": 4, "buffer": [128, 128], "line_width_px": 2.0 },
        "water": { "amplitude_m": 0.05 },
    });
    for (path, value) in &plan.overrides {
        let (head, leaf) = path.rsplit_once('.').unwrap_or(("", path));
        let mut node = &mut tree;
        for key in head.split('.') {
            node = node.as_object_mut().unwrap().entry(key).or_insert_with(|| json!({}));
        }
        node[leaf] = value.clone();
    }
    tree
}

/// Figures of a cell: of an underwater one by a cost model, of others invented.
pub fn measure(experiment: &Experiment, plan: &CellPlan, random: &mut Pcg64) -> Measured {
    let params = tree(plan);
    let number = |path: &str| get(&params, path).and_then(Value::as_f64).unwrap();
    let mut stages = match plan.pipeline.as_str() {
        "underwater" => underwater(&params, random),
        _ => vec![invented("scene/gbuffer", 1.0, random)],
    };
    for name in named(experiment, &stages) {
        stages.push(invented(&name, 3.0 * size(plan), random));
    }
    let total: f64 = stages.iter().map(|stage| stage.time.median).sum();
    let photons = number("caustics.grid").powi(2) * number("caustics.subdivision");
    Measured {
        frame: frame(total, random),
        stages,
        allocated_bytes: (number("view.width") * number("view.height") * 40.0) as u64,
        quantities: quantities(plan, experiment, photons, number("water.amplitude_m")),
        warm_up_frames: 3,
        ..Measured::default()
    }
}

/// `fixed + work × rate` per stage.
fn underwater(params: &Value, random: &mut Pcg64) -> Vec<StageRecord> {
    let number = |path: &str| get(params, path).and_then(Value::as_f64).unwrap();
    let area = |path: &str| -> f64 {
        let sides = get(params, path).unwrap().as_array().unwrap();
        let area: f64 = sides.iter().map(|side| side.as_f64().unwrap()).product();
        area.max(1.0)
    };
    let photons =
        |of: &str| number(&format!("{of}.grid")).powi(2) * number(&format!("{of}.subdivision"));
    let pixels = number("view.width") * number("view.height");
    let (caustic, godray) = (photons("caustics"), photons("godrays"));
    let dynamic = params["caustics"]["subdivision_mode"] == "dynamic";
    let line_px = area("godrays.buffer").sqrt() * 0.3 * number("godrays.line_width_px");
    let mut stages = Vec::new();
    let mut stage = |name: &str, clock, ms: f64, work| {
        stages.push(timed(name, clock, noisy(ms * 1e6, SAMPLES, random), work));
    };
    let work = |photons: f64, fragments: f64| Work {
        photons: photons as u64,
        fragments: fragments as u64,
        ..Work::default()
    };
    let slow = if dynamic { 1.4 } else { 1.0 };
    let (fenced, stamped) = (Clock::FencedHost, Clock::Timestamp);
    stage("uniforms", Clock::Host, 0.02, Work::default());
    stage("shadow/depth", stamped, 2.1, work(0.0, 262_144.0));
    stage("shadow/mask", stamped, 0.6, work(0.0, 262_144.0));
    stage("scene/gbuffer", stamped, 0.5 + pixels * 1.6e-5, work(0.0, pixels));
    stage("water/reflection", stamped, pixels * 4e-6, work(0.0, pixels));
    stage("water/refraction", stamped, pixels * 4e-6, work(0.0, pixels));
    stage("caustics/trace", fenced, 0.05 + slow * caustic / 6.0e3, work(caustic, 0.0));
    stage("caustics/splat", stamped, 0.4 + caustic * 36.0 / 4.5e4, work(caustic, caustic * 36.0));
    stage("caustics/filter", stamped, 0.3 + area("caustics.buffer") * 2e-5, Work::default());
    stage("godrays/trace", fenced, 0.05 + godray / 6.0e3, work(godray, 0.0));
    stage("godrays/lines", stamped, 0.2 + godray * line_px / 4.5e4, work(godray, godray * line_px));
    stage("godrays/filter", stamped, 0.1 + area("godrays.buffer") * 2e-5, Work::default());
    stage("compose", stamped, 0.2 + pixels * 2.4e-5, work(0.0, pixels));
    stages
}

/// Stages that the experiment's claims and plots speak of and the model lacks; of a family, one.
fn named(experiment: &Experiment, known: &[StageRecord]) -> Vec<String> {
    let mut names = Vec::new();
    for name in experiment.measures().into_iter().flat_map(|measure| measure.stages()) {
        let name = match name {
            StageName::One(name) => name.clone(),
            StageName::Family(beginning) => format!("{beginning}any"),
        };
        if !names.contains(&name) && !known.iter().any(|stage| *stage.stage == name) {
            names.push(name);
        }
    }
    names
}

fn invented(name: &str, ms: f64, random: &mut Pcg64) -> StageRecord {
    let (triangles, fragments) = ((1e4 * ms) as u64, (1e5 * ms) as u64);
    let work = Work { triangles, fragments, ..Work::default() };
    timed(name, Clock::Timestamp, noisy(ms * 1e6, SAMPLES, random), work)
}

pub fn timed(stage: &str, clock: Clock, samples_ns: Vec<f64>, work: Work) -> StageRecord {
    let visits = visits::numbers(&sampled_at_s(samples_ns.len()));
    StageRecord { work, ..StageRecord::new(stage, clock, samples_ns, &visits) }
}

/// Of visits of three samples, 15 s apart.
pub fn sampled_at_s(samples: usize) -> Vec<f64> {
    (0..samples).map(|number| 1.7e9 + (15 * (number / 3) + number % 3) as f64).collect()
}

/// Root of the product of the cell's numbers on its axes.
fn size(plan: &CellPlan) -> f64 {
    let numbers = plan.axes.values().filter_map(Value::as_f64);
    numbers.map(|number| number.max(0.01)).product::<f64>().sqrt()
}

fn frame(total_ns: f64, random: &mut Pcg64) -> FrameRecord {
    let mut samples = |median: f64| noisy(median, SAMPLES, random);
    let untimed_samples_ns = samples(total_ns * 1.01);
    let sampled_at_s = sampled_at_s(SAMPLES);
    let visits = visits::numbers(&sampled_at_s);
    FrameRecord {
        rounds: (0..SAMPLES as u32).collect(),
        machine: Vec::new(),
        pacer_ns: Vec::new(),
        sampled_at_s,
        envelope_samples_ns: samples(total_ns * 1.012),
        gap_samples_ns: samples(total_ns * 0.012),
        accounting_error: 0.003,
        untimed: visits::estimate_of_samples(&untimed_samples_ns, &visits),
        untimed_samples_ns,
        timing_cost: visits::estimate_of_samples(&samples(1.004), &visits),
        visits,
    }
}

fn quantities(
    plan: &CellPlan,
    experiment: &Experiment,
    photons: f64,
    amplitude_m: f64,
) -> BTreeMap<String, f64> {
    let measures = experiment.measures().into_iter();
    let named = measures.flat_map(|measure| measure.quantities());
    let mut all: BTreeMap<String, f64> =
        named.map(|name| (name.to_owned(), 0.1 / size(plan))).collect();
    let mut put = |name: &str, value| all.insert(name.to_owned(), value);
    if let Some(reference) = &plan.reference {
        let filtered = plan.axes.get("caustics.filter") == Some(&Value::Bool(true));
        let error = 20.0 / photons.sqrt() * if filtered { 1.6 } else { 2.0 };
        put(&reference.quantity, error);
    }
    put("caustics_unconverged_rate", 0.4 * amplitude_m * amplitude_m);
    put("caustics_photon_error_median_m", 0.001 + 0.01 * amplitude_m);
    put("caustics_photon_error_p99_m", 0.004 + 0.3 * amplitude_m);
    all
}

/// Samples with log-normal noise of about 3 %.
pub fn noisy(median: f64, samples: usize, random: &mut Pcg64) -> Vec<f64> {
    let mut noise = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    (0..samples).map(|_| median * (0.03 * noise()).exp()).collect()
}

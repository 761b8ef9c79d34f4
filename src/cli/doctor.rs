//! `fathom doctor`: whether a run on this machine would work, and what its times would be worth. It measures the default frame as
//! `fathom run` does, for some seconds and into a folder that goes again, and judges the records of that.

use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context;
use serde::Serialize;
use serde_json::json;
use strum::Display;

use super::commands::{
    ExitResult, INTERRUPT, SOMETHING_FAILED, gpu_options, print_json, watch_interrupts,
};
use super::{AdapterArgs, COULD_NOT_RUN};
use crate::experiments::Experiment;
use crate::gpu::{AdapterEntry, Gpu};
use crate::harness::assets::{self, AssetStatus};
use crate::harness::catalog::Catalog;
use crate::harness::plan::Request;
use crate::harness::run::{self, RunOptions};
use crate::judge::clocks::{self, ClockTrust};
use crate::judge::run::{Noise, RunVerdict};
use crate::record::output::OutputFolder;
use crate::record::{self, Cell, Measured, Record, Run};
use crate::report::{Report, facts};
use crate::report::{noise, trust};
use crate::scene::assets::AssetSource;
use crate::{print, process, quiet, text};

/// What is measured, where the catalogue has it.
const EXPERIMENT: &str = "uw-default";
const CELL: &str = "base";
/// For the whole of it: the audit takes some 5 s, and the default frame 8 samples or more in the rest.
const BUDGET_S: f64 = 15.0;
/// Debian's and Ubuntu's packages of the Vulkan loader and of a software driver.
const SOFTWARE_DRIVER: &str = "apt-get install libvulkan1 mesa-vulkan-drivers";

#[derive(Clone, Copy, Debug, Display, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[strum(serialize_all = "snake_case")]
#[serde(rename_all = "snake_case")]
enum Level {
    Ok,
    /// Nothing that makes a run's times doubtful.
    Note,
    /// A run works, and its times are not what they could be.
    Warning,
    /// No run is possible.
    Fault,
}

#[derive(Clone, Debug, Serialize)]
struct Finding {
    subject: String,
    level: Level,
    found: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    remedy: Option<String>,
}

impl Finding {
    fn new(subject: &str, level: Level, found: impl Into<String>) -> Self {
        Self { subject: subject.to_owned(), level, found: found.into(), remedy: None }
    }

    fn remedy(self, remedy: impl Into<String>) -> Self {
        Self { remedy: Some(remedy.into()), ..self }
    }

    fn row(&self) -> [String; 3] {
        let remedy = self.remedy.as_ref().map_or_else(String::new, |remedy| format!("; {remedy}"));
        [self.level.to_string(), self.subject.clone(), format!("{}{remedy}", self.found)]
    }
}

pub fn doctor(catalog: &Catalog, as_json: bool, args: &AdapterArgs) -> ExitResult {
    if Gpu::choose(&gpu_options(catalog, args)).is_ok_and(|adapter| adapter.software) {
        quiet::begin_again();
    }
    watch_interrupts()?;
    let mut findings = match measure_briefly(catalog, args) {
        Ok(records) => of_records(&records),
        Err(error) => vec![no_run(&error)],
    };
    let adapters = Gpu::list();
    findings.extend(adapters.iter().filter_map(unusable));
    findings.extend(assets::look_up().into_iter().map(of_asset));
    findings.extend(tools());
    let worst = findings.iter().map(|finding| finding.level).max().unwrap_or(Level::Ok);
    if as_json {
        print_json(&json!({ "worst": worst, "adapters": adapters, "findings": findings }))?;
    } else {
        let rows: Vec<_> = findings.iter().map(Finding::row).collect();
        text::columns(&rows).into_iter().for_each(|row| print::answer(text::line(&row)));
        print::answer(conclusion(worst));
    }
    Ok(status(worst))
}

fn status(worst: Level) -> ExitCode {
    ExitCode::from(match worst {
        Level::Ok | Level::Note => 0,
        Level::Warning => SOMETHING_FAILED,
        Level::Fault => COULD_NOT_RUN,
    })
}

fn conclusion(worst: Level) -> &'static str {
    match worst {
        Level::Ok | Level::Note => "\nNothing stands in the way of a run.",
        Level::Warning => "\nA run works. See the warnings before you trust its times.",
        Level::Fault => "\nNothing can be run here before that is put right.",
    }
}

fn measure_briefly(catalog: &Catalog, args: &AdapterArgs) -> anyhow::Result<Vec<Record>> {
    let folder = tempfile::tempdir().context("cannot make a folder for a short run")?;
    let experiment_ids = Experiment::ids(&catalog.experiments);
    let default = experiment_ids.iter().find(|id| *id == EXPERIMENT).or(experiment_ids.first());
    let options = RunOptions {
        catalog: catalog.clone(),
        gpu: gpu_options(catalog, args),
        request: Request {
            experiments: default.into_iter().cloned().collect(),
            cells: default
                .filter(|id| *id == EXPERIMENT)
                .map(|_| CELL.to_owned())
                .into_iter()
                .collect(),
            ..Request::default()
        },
        budget_s: Some(BUDGET_S),
        out: Some(folder.path().join("run")),
        no_ceilings: true,
        ..RunOptions::default()
    };
    let summary = run::run(&options, Instant::now(), &mut |_, _, _| {}, &INTERRUPT)?;
    Ok(record::read(&OutputFolder { folder: summary.out }.records())?.records)
}

fn no_run(error: &anyhow::Error) -> Finding {
    let finding = Finding::new("run", Level::Fault, format!("{error:#}"));
    if Gpu::list().is_empty() {
        let hardware = "install the driver of your GPU";
        return finding
            .remedy(format!("{hardware}, or on Debian a software driver: {SOFTWARE_DRIVER}"));
    }
    finding
}

fn of_records(records: &[Record]) -> Vec<Finding> {
    let view = Report::new(records, None);
    let Some(run) = view.run() else { return Vec::new() };
    let mut findings = vec![adapter(run)];
    let notes = run.notes.iter().filter(|note| note.kind == record::NoteKind::Adapter);
    findings.extend(notes.map(|note| Finding::new("adapter", Level::Note, &*note.text)));
    findings.extend(machine(run));
    findings.push(clock(run));
    findings.extend(view.verdict.as_ref().map(load));
    let cells = records.iter().filter_map(Record::try_as_cell_ref);
    findings.extend(cells.map(|cell| precision(cell, run)));
    findings
}

fn adapter(run: &Run) -> Finding {
    let record::Adapter { backend, driver_info, software, .. } = &run.adapter;
    let found = format!("{}, {backend}, {driver_info}", run.adapter.title());
    if *software {
        let worth =
            "a software driver: use ratios, slopes and shares, as its times say little about a GPU";
        return Finding::new("adapter", Level::Note, format!("{found}; {worth}"));
    }
    Finding::new("adapter", Level::Ok, found)
}

/// An adapter on which nothing runs.
fn unusable(AdapterEntry { adapter, lacks }: &AdapterEntry) -> Option<Finding> {
    let found = format!("{}, {}, cannot be used", adapter.name, adapter.backend);
    let missing = lacks.as_ref()?;
    Some(Finding::new("adapter", Level::Note, format!("{found}: it lacks {missing}")))
}

fn machine(run: &Run) -> Option<Finding> {
    let machine = run.conditions.machine.as_ref()?;
    Some(Finding::new("machine", Level::Ok, facts::machine(machine)))
}

fn clock(run: &Run) -> Finding {
    let found = format!("{} ({})", trust::verdict(run), trust::conditions(run));
    match clocks::clocks(run).map(|(.., trust)| trust).max() {
        Some(ClockTrust::NotAudited | ClockTrust::Unsound) => {
            Finding::new("clock", Level::Warning, found).remedy("`fathom audit` has the figures")
        }
        _ => Finding::new("clock", Level::Ok, found),
    }
}

fn load(verdict: &RunVerdict) -> Finding {
    let found = format!("{} machine: {}", verdict.noise, noise::figures(verdict));
    match verdict.noise {
        Noise::Quiet => Finding::new("load", Level::Ok, found),
        Noise::Drifting | Noise::Noisy => Finding::new("load", Level::Warning, found)
            .remedy("end other work on this machine, or use one that others do not share"),
    }
}

/// The half width that was reached, and the time in which it would be what a run asks for.
fn precision(cell: &Cell, run: &Run) -> Finding {
    let name = format!("{} {}", cell.experiment, cell.cell);
    let Some(measured) = cell.measured() else {
        return Finding::new("precision", Level::Fault, format!("{name} could not be measured"));
    };
    let (median_ms, reached) =
        (measured.frame.untimed.median * 1e-6, measured.frame.untimed.relative_half_width());
    let spent_s = spent_s(measured);
    let asked = run.asked_precision();
    let needed_s = spent_s * (reached / asked).powi(2);
    if !needed_s.is_finite() || measured.frame.untimed.n == 0 {
        let found = format!("{name}: too few samples for an interval after {spent_s:.1} s");
        return Finding::new("precision", Level::Warning, found);
    }
    let found = format!("{name}: {median_ms:.1} ms ±{:.1} % after {spent_s:.1} s", 100.0 * reached);
    Finding::new(
        "precision",
        Level::Ok,
        format!("{found}; ±{:.0} % takes about {needed_s:.0} s", 100.0 * asked),
    )
}

/// That the pairs of frames took.
fn spent_s(measured: &Measured) -> f64 {
    let frame = &measured.frame;
    frame.envelope_samples_ns.iter().chain(&frame.untimed_samples_ns).sum::<f64>() * 1e-9
}

/// An asset that `fathom fetch` could get makes a scene's times those of a stand-in.
fn of_asset(status: Result<AssetStatus, String>) -> Finding {
    match status {
        Ok(AssetStatus { asset, path, origin }) => {
            let level = match (path, &asset.source) {
                (Some(_), _) => Level::Ok,
                (None, AssetSource::ByHand) => Level::Note,
                (None, _) => Level::Warning,
            };
            let licence = format!("licence: {}", asset.licence);
            Finding::new("asset", level, format!("{}: {origin}; {licence}", asset.name))
        }
        Err(fault) => Finding::new("asset", Level::Warning, fault),
    }
}

/// What `compare` needs.
fn tools() -> Vec<Finding> {
    let found = |program: &str| {
        let version =
            process::run_for_stdout(std::process::Command::new(program).arg("--version")).ok()?;
        version.lines().next().map(str::to_owned)
    };
    let tool = |program: &str, without: &str, remedy: &str| match found(program) {
        Some(version) => Finding::new(program, Level::Ok, version),
        None => Finding::new(program, Level::Note, format!("absent: {without}")).remedy(remedy),
    };
    vec![
        tool("valgrind", "`fathom compare` counts no instructions", "apt-get install valgrind"),
        tool("git", "`fathom compare --base REV` cannot build", "apt-get install git"),
        tool("cargo", "`fathom compare --base REV` cannot build", "install Rust from rustup.rs"),
    ]
}

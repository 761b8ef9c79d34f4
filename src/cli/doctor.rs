//! `fathom doctor`: whether a run works on this machine: its adapters, their clocks, assets, tools. How far its times can be trusted, each
//! run says itself.

use std::process::ExitCode;

use serde::Serialize;
use serde_json::json;
use strum::Display;

use super::commands::{ExitResult, SOMETHING_FAILED, gpu_options, print_json};
use super::{AdapterArgs, AnswerArgs, COULD_NOT_RUN};
use crate::gpu::{self, AdapterEntry, Gpu};
use crate::harness::assets::{self, AssetStatus};
use crate::harness::catalog::Catalog;
use crate::judge::clocks::{self, ClockTrust};
use crate::record::{self, Conditions, PassKind, Run};
use crate::report::{facts, trust};
use crate::scene::assets::AssetSource;
use crate::{print, process, quiet, text};

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

pub fn doctor(catalog: &Catalog, args: &AnswerArgs) -> ExitResult {
    if Gpu::choose(&gpu_options(catalog, &args.adapter)).is_ok_and(|adapter| adapter.software) {
        quiet::begin_again();
    }
    let mut findings = audited(catalog, &args.adapter).unwrap_or_else(|error| vec![no_run(&error)]);
    let adapters = Gpu::list();
    findings.extend(adapters.iter().filter_map(unusable));
    findings.extend(assets::look_up().into_iter().map(of_asset));
    findings.extend(tools());
    let worst = findings.iter().map(|finding| finding.level).max().unwrap_or(Level::Ok);
    if args.json {
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

/// What the adapter is, and its clocks by the audit that each run begins with.
fn audited(catalog: &Catalog, args: &AdapterArgs) -> anyhow::Result<Vec<Finding>> {
    let gpu = Gpu::open(&gpu_options(catalog, args))?;
    let audit = gpu::audit_all(&gpu)?;
    let run = Run {
        adapter: gpu.adapter.clone(),
        clocks: PassKind::TIMED.map(|kind| (kind, audit.plan.clock(kind))).into(),
        audit: audit.rows,
        conditions: Conditions::detect(),
        ..Run::default()
    };
    let notes = gpu.notes.iter().map(|note| Finding::new("adapter", Level::Note, note));
    Ok([adapter(&run)].into_iter().chain(notes).chain(machine(&run)).chain([clock(&run)]).collect())
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

//! The trials: which are missing, how each is built and measured, and where its findings go.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use anyhow::{anyhow, bail};
use fathom::compare::build;
use fathom::compare::flow::{self, CompareOptions, Program};
use fathom::compare::launch::WorkerStart;
use fathom::compare::store::StoredComparison;
use fathom::harness::output::RECORDS;
use fathom::{gpu, tell};

use crate::INTERRUPT;
use crate::findings::findings;
use crate::injections::{Changes, Injection, every, unrelated};
use crate::load::Load;
use crate::report;
use crate::trials::{Plan, Trial, Variant, trials};
use crate::workshop::{Compilation, Workshop};
use fathom::record::comparison::GateSettings;

/// Names of the results in the self-test's folder.
pub const RESULTS: [&str; 2] = ["self-test.json", "self-test.md"];

#[derive(Clone, Debug)]
pub struct SelfTest {
    /// A folder of the repository whose HEAD is tried.
    pub repository: PathBuf,
    /// Trials go to folders in here.
    pub out: PathBuf,
    pub gpu: gpu::Options,
    pub plan: Plan,
    /// Of every trial, but for what the trial says itself.
    pub settings: GateSettings,
    /// Only trials whose names contain this.
    pub filter: String,
}

/// An edit that does not fit.
fn unfit(reason: String) -> anyhow::Error {
    anyhow!("injections do not fit these sources: {reason}")
}

/// Makes the missing trials until it is interrupted or one fails, and writes what all of them show.
pub fn run(test: &SelfTest) -> anyhow::Result<()> {
    let out = test.out.display();
    std::fs::create_dir_all(&test.out)
        .map_err(|error| anyhow!("cannot write to {out}: {error}"))?;
    let injections = Injection::all().map_err(unfit)?;
    let mut missing = Vec::new();
    for trial in trials(test.plan, &injections) {
        if trial.id.contains(&test.filter) && !is_made(test, &trial)? {
            missing.push(trial);
        }
    }
    let ended = make(test, &missing, &injections);
    write(test, &injections)?;
    ended
}

fn make(test: &SelfTest, missing: &[Trial], injections: &[Injection]) -> anyhow::Result<()> {
    let mut builds = TrialBuilds::new(test)?;
    for (number, trial) in (1..).zip(missing) {
        if INTERRUPT.load(Ordering::Relaxed) {
            break;
        }
        tell::note(format!("trial {number} of {}: {}", missing.len(), trial.id));
        match builds.make(trial, injections) {
            // Whoever interrupts needs no reason.
            Err(_) if INTERRUPT.load(Ordering::Relaxed) => break,
            made => made?,
        }
    }
    Ok(())
}

/// Findings from the stored trials alone, written beside them.
fn write(test: &SelfTest, injections: &[Injection]) -> anyhow::Result<()> {
    let mut made = Vec::new();
    for trial in trials(test.plan, injections) {
        let folder = test.out.join(&trial.id);
        if folder.join(RECORDS).is_file() {
            let comparison = StoredComparison::read(&folder)?;
            if comparison.came_to_its_end() {
                made.push((trial, comparison));
            }
        }
    }
    let found = findings(injections, &made);
    let json = serde_json::to_string(&found).unwrap_or_default() + "\n";
    let texts = [json, report::markdown(&found)];
    for (name, text) in RESULTS.iter().zip(texts) {
        let path = test.out.join(name);
        let written = std::fs::write(&path, text);
        written.map_err(|error| anyhow!("cannot write {}: {error}", path.display()))?;
    }
    Ok(())
}

/// Trials of other settings are no part of the same findings. Of its gates a trial may have had fewer, where one could not be run.
fn is_made(test: &SelfTest, trial: &Trial) -> anyhow::Result<bool> {
    let folder = test.out.join(&trial.id);
    let Ok(stored) = StoredComparison::read(&folder) else {
        return Ok(false);
    };
    let wanted = test.settings_of(trial);
    let found = GateSettings { gates: wanted.gates.clone(), ..stored.header.settings.clone() };
    if found != wanted {
        let folder = folder.display();
        bail!("{folder} was measured with other settings: choose another folder with --out");
    }
    Ok(stored.came_to_its_end())
}

impl SelfTest {
    fn settings_of(&self, trial: &Trial) -> GateSettings {
        GateSettings {
            gates: trial.gates.clone(),
            launches: trial.launches.unwrap_or(self.settings.launches),
            seed: trial.seed,
            ..self.settings.clone()
        }
    }
}

/// Builds variants and compares them with their base.
struct TrialBuilds<'a> {
    test: &'a SelfTest,
    workshop: Workshop,
    programs: PathBuf,
    /// The injected build that is at hand.
    at_hand: Option<(Variant, PathBuf)>,
}

impl<'a> TrialBuilds<'a> {
    fn new(test: &'a SelfTest) -> anyhow::Result<Self> {
        let repository = build::repository(&test.repository)?;
        let commit = build::commit(&repository, "HEAD")?;
        let short = commit.get(..12).unwrap_or(&commit);
        Ok(Self {
            test,
            workshop: Workshop::open(&repository, &commit)?,
            programs: repository.join(build::CACHE).join(format!("self-test-{short}")),
            at_hand: None,
        })
    }

    fn make(&mut self, trial: &Trial, injections: &[Injection]) -> anyhow::Result<()> {
        let compilation = match trial.variant {
            Variant::Again | Variant::Unrelated => Compilation::Whole,
            Variant::Injected(..) | Variant::Every(_) => Compilation::Incremental,
        };
        let base = self.base(compilation)?;
        let head = self.head(&trial.variant, compilation, injections)?;
        let program = |path: &Path| Program {
            label: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            start: WorkerStart { gpu: self.test.gpu.clone(), ..WorkerStart::new(path) },
        };
        let folder = self.test.out.join(&trial.id);
        let options = CompareOptions {
            catalog: fathom::Catalog::builtin(),
            programs: [program(&base), program(&head)],
            cells_file: None,
            filter: trial.filter.clone(),
            env_values: false,
            settings: self.test.settings_of(trial),
            resume: folder.join(RECORDS).metadata().is_ok_and(|lines| lines.len() > 0),
            out: Some(folder),
        };
        let load = trial.loaded.then(|| Load::start(&base));
        let measured = flow::measure(&options, &INTERRUPT, &|text| tell::note(text));
        drop(load);
        measured.map(drop).map_err(|error| anyhow!("trial {}: {error}", trial.id))
    }

    fn base(&self, compilation: Compilation) -> anyhow::Result<PathBuf> {
        let name = match compilation {
            Compilation::Whole => "base",
            Compilation::Incremental => "base-of-injections",
        };
        let program = self.programs.join(name);
        self.build(&Changes::new(), compilation, &program)?;
        Ok(program)
    }

    /// The variant's program. Of injected builds only the last is kept.
    fn head(
        &mut self,
        variant: &Variant,
        compilation: Compilation,
        injections: &[Injection],
    ) -> anyhow::Result<PathBuf> {
        if let Some((known, program)) = &self.at_hand {
            if known == variant {
                return Ok(program.clone());
            }
            // What is left behind only takes room.
            let _ = std::fs::remove_file(program);
            self.at_hand = None;
        }
        let read = |file: &str| self.workshop.read(file);
        let changes = match variant {
            Variant::Again => Ok(Changes::new()),
            Variant::Unrelated => unrelated(&read),
            Variant::Injected(id, size) => injections
                .iter()
                .find(|injection| injection.id == *id)
                .ok_or_else(|| format!("no injection is called {id}"))
                .and_then(|injection| injection.changes(*size, &read)),
            Variant::Every(size) => every(injections, *size, &read),
        };
        let changes = changes.map_err(unfit)?;
        let program = self.programs.join(variant.to_string());
        self.build(&changes, compilation, &program)?;
        if compilation == Compilation::Incremental {
            self.at_hand = Some((variant.clone(), program.clone()));
        }
        Ok(program)
    }

    fn build(
        &self,
        changes: &Changes,
        compilation: Compilation,
        program: &Path,
    ) -> anyhow::Result<()> {
        if program.is_file() {
            return Ok(());
        }
        tell::note(format!("building {}", program.display()));
        self.workshop.build(changes, compilation, program)
    }
}

#[cfg(test)]
mod tests {

    use fathom::compare::store;
    use fathom::harness::output::{FolderKind, Taken};
    use fathom::record::comparison::{Compared, ComparisonEnd, ComparisonHeader, Gate};

    use super::*;

    fn self_test(out: &Path, pairs: u32) -> SelfTest {
        SelfTest {
            repository: PathBuf::new(),
            out: out.to_owned(),
            gpu: gpu::Options::default(),
            plan: Plan { no_ops: 1, slow5: 1 },
            settings: GateSettings { pairs, ..GateSettings::default() },
            filter: String::new(),
        }
    }

    #[test]
    fn a_stored_trial_counts_if_it_ended_and_is_refused_if_its_settings_differ() {
        let folder = tempfile::tempdir().unwrap();
        let test = self_test(folder.path(), 16);
        let injections = Injection::all().unwrap();
        let trial = trials(test.plan, &injections).pop().unwrap();
        assert!(!is_made(&test, &trial).unwrap());

        // A gate that could not be run.
        let settings = GateSettings { gates: vec![Gate::Exact], ..test.settings_of(&trial) };
        let header = ComparisonHeader { settings, ..ComparisonHeader::default() };
        let taken = Taken::free(&folder.path().join(&trial.id)).unwrap();
        let mut held = taken.open(FolderKind::Comparison).unwrap();
        store::write(&mut held, vec![Compared::Header(Box::new(header))]).unwrap();
        assert!(!is_made(&test, &trial).unwrap());
        let end = ComparisonEnd { wall_s: 1.0, interrupted: false };
        store::write(&mut held, vec![Compared::End(end)]).unwrap();
        assert!(is_made(&test, &trial).unwrap());

        let other = self_test(folder.path(), 12);
        let error = is_made(&other, &trial).unwrap_err().to_string();
        assert!(error.contains("measured with other settings"), "{error}");
    }
}

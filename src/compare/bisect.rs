//! `fathom bisect`: the first of many revisions in which a stage became slower or costlier.
//!
//! The ends are compared first, by all gates that are asked for: without a regression there is nothing to find. Then revisions between them are
//! built and compared with the good one, in the one cell that regressed most, in the order of [`Search`]. Each comparison is a folder of records;
//! what is concluded is a function of these, so a search that was killed goes on where it was.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;

use anyhow::{Result, anyhow, bail};
use serde_json::{Value, json};

use super::build::{self, SetAside};
use super::cells::Gates;
use super::flow::{self, CompareOptions, Program};
use super::launch::{Waiting, WorkerStart};
use fathom_base::process;
use fathom_gates::bisect::{ENOUGH, Found, Scatter, Search};
use fathom_gates::counts::{self, Change};
use fathom_gates::store::StoredComparison;
use fathom_gates::time::{self, TimeVerdict};
use fathom_gates::verdict::{Status, Verdicts};
use fathom_gpu as gpu;
use fathom_harness::catalog::Catalog;
use fathom_record::comparison::{CellId, Gate, GateSettings};
use fathom_record::output::RECORDS;

/// Digits of a commit in names.
const SHORT: usize = 12;
/// Folder of the comparison of the ends.
const ENDS: &str = "ends";

#[derive(Clone, Debug)]
pub struct BisectOptions {
    pub catalog: Catalog,
    /// In the repository.
    pub folder: PathBuf,
    pub good: String,
    pub bad: String,
    pub cells_file: Option<PathBuf>,
    /// Only cells whose names contain this.
    pub filter: Option<String>,
    pub gpu: gpu::Options,
    /// Of the comparison of the ends.
    pub settings: GateSettings,
    /// Launches of a revision each time it is measured.
    pub batch: u32,
    /// Launches between the ends after which the search gives up.
    pub most_launches: u32,
    pub out: PathBuf,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Revision {
    pub commit: String,
    /// First line of its message.
    pub subject: String,
}

impl Revision {
    fn short(&self) -> &str {
        self.commit.get(..SHORT).unwrap_or(&self.commit)
    }
}

/// What is searched for: the figure of a cell that became worse.
#[derive(Clone, Debug, PartialEq)]
struct Regressed {
    cell: CellId,
    gate: Gate,
    /// ln(bad / good) of each launch.
    launches: Vec<f64>,
}

/// What a search came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Bisected {
    pub revisions: Vec<Revision>,
    pub good: String,
    /// None where the ends do not differ.
    pub answer: Option<Answer>,
    /// How the comparison of the ends ended.
    pub ends: Status,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    pub cell: CellId,
    pub gate: Gate,
    pub found: Found,
    /// Other cells that regressed between the ends.
    pub others: Vec<CellId>,
    /// Revisions without a figure, by number, and why.
    pub skipped: Vec<(usize, String)>,
    pub launches: usize,
}

impl Answer {
    pub fn is_certain(&self) -> bool {
        self.found.probability >= ENOUGH
    }
}

impl Bisected {
    /// As text, the answer first.
    pub fn text(&self) -> String {
        let Some(answer) = &self.answer else {
            return match self.ends {
                Status::NoRegression => {
                    format!("nothing to find: no cell is worse than in {}", self.good)
                }
                Status::Inconclusive => format!(
                    "no cell is shown to be worse than in {}, but some are too noisy to rule it out: give more --launches",
                    self.good
                ),
                other => format!("nothing was searched for: the comparison of the ends: {other}"),
            };
        };
        let named = |number: usize| {
            let revision = &self.revisions[number - 1];
            format!("{} {}", revision.short(), revision.subject)
        };
        let Found { first, probability, candidates, step, interval } = &answer.found;
        let mut lines = vec![if answer.is_certain() {
            format!("first revision: {} (probability {probability:.3})", named(*first))
        } else {
            "these revisions could not be told apart:".to_owned()
        }];
        if !answer.is_certain() {
            let told = candidates.iter().map(|(number, p)| format!("  {p:.2}  {}", named(*number)));
            lines.extend(told);
        }
        let percent = |log: f64| 100.0 * log.exp_m1();
        let what = if answer.gate == Gate::Time { "time" } else { "instructions" };
        lines.push(format!(
            "{}: {what} {:+.2} % (95 % {:+.2} to {:+.2}) from there on",
            answer.cell,
            percent(*step),
            percent(interval.low),
            percent(interval.high)
        ));
        let count = self.revisions.len();
        lines.push(format!("{count} revisions, {} launches", answer.launches));
        lines.extend(answer.skipped.iter().map(|(number, why)| {
            format!("skipped {}: {}", named(*number), why.lines().next().unwrap_or_default())
        }));
        if !answer.others.is_empty() {
            let others: Vec<&str> = answer.others.iter().map(CellId::as_str).collect();
            lines.push(format!("not searched for, worse too: {}", others.join(", ")));
        }
        lines.join("\n")
    }

    pub fn json(&self) -> Value {
        let named = |number: usize| &self.revisions[number - 1].commit;
        let answer = self.answer.as_ref().map(|answer| {
            let Found { first, probability, candidates, step, interval } = &answer.found;
            let candidates = candidates.iter();
            json!({
                "commit": named(*first),
                "probability": probability,
                "is_certain": answer.is_certain(),
                "candidates": candidates.map(|(n, p)| json!({"commit": named(*n), "probability": p})).collect::<Vec<_>>(),
                "cell": answer.cell.as_str(),
                "gate": answer.gate.to_string(),
                "change": step.exp_m1(),
                "change_low": interval.low.exp_m1(),
                "change_high": interval.high.exp_m1(),
                "launches": answer.launches,
                "others": answer.others.iter().map(CellId::as_str).collect::<Vec<_>>(),
                "skipped": answer.skipped.iter().map(|(n, why)| json!({"commit": named(*n), "reason": why})).collect::<Vec<_>>(),
            })
        });
        json!({ "good": self.good, "revisions": self.revisions.len(), "ends": self.ends.to_string(), "answer": answer })
    }
}

/// Searches; a folder of an earlier search of the same ends is gone on with.
pub fn bisect(
    options: &BisectOptions,
    interrupted: &AtomicBool,
    tell: &dyn Fn(&str),
) -> Result<Bisected> {
    let repository = build::repository(&options.folder)?;
    let [good, bad] = [&options.good, &options.bad];
    let [good, bad] = [build::commit(&repository, good)?, build::commit(&repository, bad)?];
    let revisions = between(&repository, &good, &bad)?;
    let flags = [interrupted];
    let waiting = Waiting { interrupted: &flags, tell };
    let good = Revision { commit: good, subject: String::new() };
    let base = built(options, &good, waiting)?;
    let run = Bisection { options, revisions: &revisions, base, good, waiting };
    let (ends, regressed, others) = run.ends()?;
    let answer = regressed.map(|regressed| run.search(regressed, others)).transpose()?;
    Ok(Bisected { good: run.good.short().to_owned(), answer, ends, revisions })
}

/// The revisions after the good one up to the bad one, along first parents.
fn between(repository: &Path, good: &str, bad: &str) -> Result<Vec<Revision>> {
    let range = format!("{good}..{bad}");
    let mut log = Command::new("git");
    log.arg("-C").arg(repository);
    log.args(["log", "--reverse", "--first-parent", "--format=%H %s", &range]);
    let lines = process::printed(&mut log).map_err(|reason| anyhow!("git log: {reason}"))?;
    let revision = |line: &str| {
        let (commit, subject) = line.split_once(' ').unwrap_or((line, ""));
        Revision { commit: commit.to_owned(), subject: subject.to_owned() }
    };
    let revisions: Vec<Revision> = lines.lines().map(revision).collect();
    let mut ancestor = Command::new("git");
    ancestor.arg("-C").arg(repository).args(["merge-base", "--is-ancestor", good, bad]);
    let precedes = process::printed(&mut ancestor).is_ok();
    if revisions.is_empty() || !precedes {
        bail!("the good revision must come before the bad one: there is nothing between them");
    }
    Ok(revisions)
}

/// A revision's program, out of reach of later builds.
fn built(options: &BisectOptions, revision: &Revision, waiting: Waiting<'_>) -> Result<SetAside> {
    (waiting.tell)(&format!("building {}", revision.short()));
    let [interrupted] = waiting.interrupted else { bail!("no flag") };
    let (target, commit) = (options.catalog.program, &revision.commit);
    let program = build::revision(&options.folder, target, commit, interrupted, &mut |line| {
        (waiting.tell)(line)
    })?;
    build::set_aside(&program)
}

struct Bisection<'a> {
    options: &'a BisectOptions,
    revisions: &'a [Revision],
    good: Revision,
    base: SetAside,
    waiting: Waiting<'a>,
}

impl Bisection<'_> {
    /// A comparison of a revision with the good one, from its folder if it is there.
    fn compared(
        &self,
        name: &str,
        revision: &Revision,
        filter: Option<String>,
        settings: GateSettings,
    ) -> Result<StoredComparison> {
        let folder = self.options.out.join(name);
        let begun = fathom_base::folder::is_there(&folder.join(RECORDS));
        if begun {
            let stored = StoredComparison::read(&folder)?;
            let header = &stored.header;
            let sides = [&header.base.label, &header.head.label];
            if sides != [self.good.short(), revision.short()]
                || header.cells != self.cells(&filter)?
            {
                bail!(
                    "{} is of other revisions or cells: resume with the same, or choose another folder with --out",
                    folder.display()
                );
            }
            if stored.came_to_its_end() {
                return Ok(stored);
            }
        }
        let head = built(self.options, revision, self.waiting)?;
        let program = |revision: &Revision, aside: &SetAside| Program {
            label: revision.short().to_owned(),
            start: WorkerStart { gpu: self.options.gpu.clone(), ..WorkerStart::new(&aside.path) },
        };
        let options = CompareOptions {
            catalog: self.options.catalog.clone(),
            programs: [program(&self.good, &self.base), program(revision, &head)],
            cells_file: self.options.cells_file.clone(),
            filter,
            env_values: false,
            settings,
            out: Some(folder.clone()),
            resume: begun,
        };
        let [interrupted] = self.waiting.interrupted else { bail!("no flag") };
        flow::measure(&options, interrupted, self.waiting.tell)?;
        if self.waiting.is_interrupted() {
            bail!("interrupted; `--resume` goes on");
        }
        StoredComparison::read(&folder)
    }

    /// What a comparison with this filter measures.
    fn cells(&self, filter: &Option<String>) -> Result<Vec<CellId>> {
        let options = self.options;
        let gates = Gates::load(options.cells_file.as_deref(), options.catalog.gates)?;
        Ok(match filter {
            Some(filter) => gates.filtered(filter)?.cells(),
            None => gates.cells(),
        })
    }

    /// What regressed most between the ends, if anything did, and what else.
    fn ends(&self) -> Result<(Status, Option<Regressed>, Vec<CellId>)> {
        let Some(bad) = self.revisions.last() else { bail!("there are no revisions") };
        let filter = self.options.filter.clone();
        let stored = self.compared(ENDS, bad, filter, self.options.settings.clone())?;
        let verdicts = Verdicts::of(&stored);
        let mut regressed: Vec<Regressed> = verdicts
            .cells
            .iter()
            .filter_map(|judged| {
                // Counts have no noise to speak of: they are searched for first.
                let more = judged.instructions.as_ref().filter(|i| i.change == Change::More);
                let slower = judged.time.as_ref().filter(|t| t.verdict == TimeVerdict::Slower);
                let (gate, launches) = match (more, slower) {
                    (Some(counted), _) => (Gate::Instructions, vec![counted.ratio.ln()]),
                    (None, Some(time)) => (Gate::Time, time.launches.clone()),
                    (None, None) => return None,
                };
                Some(Regressed { cell: judged.cell.clone(), gate, launches })
            })
            .collect();
        let size = |of: &Regressed| fathom_base::statistics::median(&of.launches);
        regressed.sort_by(|a, b| {
            (a.gate == Gate::Time).cmp(&(b.gate == Gate::Time)).then(size(b).total_cmp(&size(a)))
        });
        let mut regressed = regressed.into_iter();
        let first = regressed.next();
        Ok((verdicts.status, first, regressed.map(|of| of.cell).collect()))
    }

    fn search(
        &self,
        Regressed { cell, gate, launches }: Regressed,
        others: Vec<CellId>,
    ) -> Result<Answer> {
        let scatter = if gate == Gate::Time { Scatter::TIMES } else { Scatter::COUNTS };
        let batch = if gate == Gate::Time { self.options.batch } else { 1 };
        let mut search = Search::new(self.revisions.len(), scatter);
        let ends = launches.len();
        search.add(self.revisions.len(), &launches);
        let mut skipped = Vec::new();
        let mut visits = vec![0u64; self.revisions.len() + 1];
        while let Some(number) = search.next(batch as usize) {
            if search.launches() - ends >= self.options.most_launches as usize {
                break;
            }
            visits[number] += 1;
            let revision = &self.revisions[number - 1];
            let name = format!("{}-{}", revision.short(), visits[number]);
            let settings = GateSettings {
                launches: batch,
                gates: vec![gate],
                // No two comparisons have the same order of samples.
                seed: self
                    .options
                    .settings
                    .seed
                    .wrapping_add(1000 * number as u64 + visits[number]),
                ..self.options.settings.clone()
            };
            let figures = self.compared(&name, revision, Some(cell.to_string()), settings);
            let figures = figures.and_then(|stored| figures_of(&stored, &cell, gate));
            if self.waiting.is_interrupted() {
                bail!("interrupted; `--resume` goes on");
            }
            match figures {
                Ok(launches) => search.add(number, &launches),
                Err(error) => {
                    (self.waiting.tell)(&format!("skipping {}: {error}", revision.short()));
                    search.skip(number);
                    skipped.push((number, error.to_string()));
                }
            }
            let Found { first, probability, .. } = search.found();
            let named = self.revisions[first - 1].short();
            (self.waiting.tell)(&format!("most probable: {named} ({probability:.2})"));
        }
        let (found, launches) = (search.found(), search.launches());
        Ok(Answer { cell, gate, found, others, skipped, launches })
    }
}

/// ln(revision / good) of each launch of a cell.
fn figures_of(stored: &StoredComparison, cell: &CellId, gate: Gate) -> Result<Vec<f64>> {
    let none = || {
        let fault = stored.faults.first().map(|fault| fault.reason.clone());
        anyhow!(fault.unwrap_or_else(|| format!("{cell} was not measured")))
    };
    if gate == Gate::Instructions {
        return Ok(vec![counts::judge(stored).get(cell).ok_or_else(none)?.ratio.ln()]);
    }
    let cells = std::slice::from_ref(cell);
    let judged = time::judge(cells, &stored.pairs, &stored.header.settings).cells;
    judged.into_iter().next().map(|cell| cell.launches).ok_or_else(none)
}

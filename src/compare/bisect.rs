//! `fathom bisect`: the first of many candidates in which a stage became slower, costlier or less accurate.
//!
//! The ends are compared first, by all gates that are asked for: without a regression there is nothing to find. Then candidates between them are
//! built and compared with the good one, in the one cell that regressed most, in the order of [`Search`]. Each comparison is a folder of records;
//! what is concluded is a function of these, so a search that was killed goes on where it was.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, anyhow, ensure};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::candidates::{Candidate, CandidateBuilder, SearchSpace};
use super::cells::Gates;
use super::flow::{self, CompareOptions, Program};
use super::settings;
use fathom_base::text;
use fathom_gpu as gpu;
use fathom_harness::catalog::Catalog;
use fathom_judge::adapters::AdapterRelation;
use fathom_judge::bisect::{MIN_CERTAINTY, Scatter, Search, StepEstimate};
use fathom_judge::counts::{self, Change};
use fathom_judge::exact::{self, Difference, DifferenceScope, FigureKind};
use fathom_judge::store::Comparison;
use fathom_judge::time::{self, TimeVerdict};
use fathom_judge::verdict::{Status, Verdicts};
use fathom_record::comparison::{CellId, Gate, GateSettings};
use fathom_record::output::{LockedFolder, RECORDS};

/// Folder of the comparison of the ends.
const ENDS: &str = "ends";

#[derive(Clone, Debug)]
pub struct BisectOptions {
    pub catalog: Catalog,
    /// In the repository, if there is one.
    pub folder: PathBuf,
    pub searched: SearchSpace,
    pub cells_file: Option<PathBuf>,
    /// Only cells whose names contain this.
    pub filter: Option<String>,
    pub gpu: gpu::Options,
    /// Of the comparison of the ends.
    pub settings: GateSettings,
    /// Launches of a candidate each time it is measured.
    pub batch: u32,
    /// Launches between the ends after which the search gives up.
    pub max_launches: u32,
    /// Go on with the search in the folder.
    pub resume: bool,
}

impl BisectOptions {
    /// All that defines what is measured. How long the search may go on is no part of it.
    fn to_settings(&self, candidates: &[Candidate]) -> Result<Value> {
        let gates = Gates::load(self.cells_file.as_deref(), self.catalog.gates)?;
        let gates = gates.filtered(self.filter.as_deref())?;
        // The commands themselves may hold secrets.
        let commands = hex::encode(Sha256::digest(serde_json::to_vec(self.searched.building())?));
        let names: Vec<&String> = candidates.iter().map(|candidate| &candidate.name).collect();
        let more = json!({
            "good": names.first(),
            "bad": names.last(),
            "candidates": names,
            "commands_sha256": commands,
            "batch": self.batch,
            "options": self.gpu.to_args(),
        });
        Ok(settings::collect(&self.settings, &gates, more))
    }
}

/// What is searched for: the figure of a cell that became worse.
#[derive(Clone, Debug, PartialEq)]
struct RegressedCell {
    cell: CellId,
    figure: Metric,
    /// ln(bad / good) of each launch.
    launches: Vec<f64>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Metric {
    /// As it differs between the ends.
    Exact(Difference),
    Instructions,
    Time,
}

impl Metric {
    pub fn gate(&self) -> Gate {
        match self {
            Self::Exact(_) => Gate::Exact,
            Self::Instructions => Gate::Instructions,
            Self::Time => Gate::Time,
        }
    }

    fn scatter(&self) -> Scatter {
        match self {
            Self::Exact(_) => Scatter::EXACT,
            Self::Instructions => Scatter::COUNTS,
            Self::Time => Scatter::TIMES,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct BisectSummary {
    /// The good one is not among them.
    pub candidates: Vec<Candidate>,
    pub noun: &'static str,
    pub good: String,
    /// None where the ends do not differ.
    pub answer: Option<BisectResult>,
    /// How the comparison of the ends ended.
    pub ends: Status,
}

#[derive(Clone, Debug, PartialEq)]
pub struct BisectResult {
    pub cell: CellId,
    /// An exact one: as it differs from the good candidate in the first one that has it, where that was measured; else in the bad one.
    pub figure: Metric,
    pub estimate: StepEstimate,
    /// Other cells that regressed between the ends.
    pub others: Vec<CellId>,
    /// Candidates without a figure, by number, and why.
    pub skipped: Vec<(usize, String)>,
    pub launches: usize,
}

impl BisectResult {
    pub fn is_certain(&self) -> bool {
        self.estimate.probability >= MIN_CERTAINTY
    }
}

impl BisectSummary {
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
            let Candidate { label, subject, .. } = &self.candidates[number - 1];
            format!("{label} {subject}").trim_end().to_owned()
        };
        let StepEstimate { first, probability, candidates, step, interval } = &answer.estimate;
        let mut lines = vec![if answer.is_certain() {
            format!("first {}: {} (probability {probability:.3})", self.noun, named(*first))
        } else {
            format!("these {}s could not be told apart:", self.noun)
        }];
        if !answer.is_certain() {
            let told = candidates.iter().map(|(number, p)| format!("  {p:.2}  {}", named(*number)));
            lines.extend(told);
        }
        let percent = |log: f64| 100.0 * log.exp_m1();
        let [change, low, high] = [*step, interval.low, interval.high].map(percent);
        let change = match &answer.figure {
            Metric::Exact(Difference { figure, base, head, .. }) => {
                format!("{figure} {base} → {head}")
            }
            other => format!("{} {change:+.2} % (95 % {low:+.2} to {high:+.2})", other.gate()),
        };
        lines.push(format!("{}: {change} from there on", answer.cell));
        let count = self.candidates.len();
        lines.push(format!("{count} {}s, {} launches", self.noun, answer.launches));
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
        let named = |number: usize| &self.candidates[number - 1].name;
        let answer = self.answer.as_ref().map(|answer| {
            let StepEstimate { first, probability, candidates, step, interval } = &answer.estimate;
            let candidates = candidates.iter();
            let mut told = json!({
                "first": named(*first),
                "probability": probability,
                "is_certain": answer.is_certain(),
                "candidates": candidates.map(|(n, p)| json!({"name": named(*n), "probability": p})).collect::<Vec<_>>(),
                "cell": answer.cell.as_str(),
                "gate": answer.figure.gate().to_string(),
                "launches": answer.launches,
                "others": answer.others.iter().map(CellId::as_str).collect::<Vec<_>>(),
                "skipped": answer.skipped.iter().map(|(n, why)| json!({"name": named(*n), "reason": why})).collect::<Vec<_>>(),
            });
            let change = match &answer.figure {
                Metric::Exact(Difference { figure, base, head, .. }) => {
                    json!({ "figure": figure, "base": base, "head": head })
                }
                _ => json!({
                    "change": step.exp_m1(),
                    "change_low": interval.low.exp_m1(),
                    "change_high": interval.high.exp_m1(),
                }),
            };
            if let (Some(told), Value::Object(change)) = (told.as_object_mut(), change) {
                told.extend(change);
            }
            told
        });
        json!({
            "searched": self.noun,
            "good": self.good,
            "count": self.candidates.len(),
            "ends": self.ends.to_string(),
            "answer": answer,
        })
    }
}

/// Searches; a folder of an earlier search of the same ends is gone on with.
pub fn bisect(
    options: &BisectOptions,
    out: &LockedFolder,
    interrupted: &AtomicBool,
    report: &dyn Fn(&str),
) -> Result<BisectSummary> {
    let BisectOptions { searched, folder, gpu, .. } = options;
    let out = out.folder();
    let mut candidates = searched.candidates(folder)?;
    let settings = options.to_settings(&candidates)?;
    if options.resume {
        settings::check(out, &settings)?;
    } else {
        let begun = out.join(settings::SETTINGS).exists();
        let shown = out.display();
        let rule = "go on with it by --resume, or choose another folder";
        ensure!(!begun, "a search was begun in {shown} already: {rule}");
        settings::store(out, &settings)?;
    }
    let good = candidates.remove(0);
    if !good.subject.is_empty() {
        report(&good.subject);
    }
    let target = options.catalog.program;
    let checkouts = searched.checkouts(folder, out)?;
    let maker = CandidateBuilder {
        searched,
        folder,
        target,
        gpu: gpu.clone(),
        checkouts,
        interrupted,
        report,
        built: RefCell::default(),
        programs: RefCell::default(),
    };
    let base = maker.make(&good)?;
    let run = Bisection { options, out, candidates: &candidates, base, maker };
    let (ends, regressed, others) = run.ends()?;
    let answer = regressed.map(|regressed| run.search(regressed, others)).transpose()?;
    Ok(BisectSummary { good: good.label, noun: searched.noun(), answer, ends, candidates })
}

struct Bisection<'a> {
    options: &'a BisectOptions,
    out: &'a Path,
    /// Without the good one.
    candidates: &'a [Candidate],
    base: Program,
    maker: CandidateBuilder<'a>,
}

impl Bisection<'_> {
    /// A comparison of a candidate with the good one, from its folder if it is there.
    fn compare(
        &self,
        name: &str,
        candidate: &Candidate,
        filter: Option<String>,
        settings: GateSettings,
    ) -> Result<Comparison> {
        let folder = self.out.join(name);
        let begun = fathom_base::folder::is_there(&folder.join(RECORDS));
        if begun {
            let stored = Comparison::read(&folder)?;
            if stored.is_complete() {
                return Ok(stored);
            }
        }
        let head = self.maker.make(candidate)?;
        let options = CompareOptions {
            catalog: self.options.catalog.clone(),
            programs: [self.base.clone(), head],
            cells_file: self.options.cells_file.clone(),
            base_cells: None,
            filter,
            env_values: false,
            settings,
            resume: begun,
            checkout: None,
        };
        let locked = flow::lock_output(Some(&folder), "", begun)?;
        flow::measure(&options, locked, self.maker.interrupted, self.maker.report)?;
        self.check_interrupt()?;
        Comparison::read(&folder)
    }

    fn check_interrupt(&self) -> Result<()> {
        let interrupted = self.maker.interrupted.load(Ordering::Relaxed);
        ensure!(!interrupted, "interrupted; `--resume` goes on");
        Ok(())
    }

    /// What regressed most between the ends, if anything did, and what else.
    fn ends(&self) -> Result<(Status, Option<RegressedCell>, Vec<CellId>)> {
        let bad = self.candidates.last().context("there are no candidates")?;
        let filter = self.options.filter.clone();
        let stored = self.compare(ENDS, bad, filter, self.options.settings.clone())?;
        let verdicts = Verdicts::judge(&stored);
        let (mut status, mut regressed) = (verdicts.status, regressed(&verdicts));
        if regressed.is_empty() && status == Status::Inconclusive {
            (status, regressed) = self.open_ends(bad, &verdicts)?;
        }
        let size = |of: &RegressedCell| fathom_base::statistics::median(&of.launches);
        // Figures without noise are searched for first.
        regressed.sort_by(|a, b| {
            let gates = a.figure.gate().cmp(&b.figure.gate());
            gates.then(size(b).total_cmp(&size(a)))
        });
        let mut regressed = regressed.into_iter();
        let first = regressed.next();
        let mut others: Vec<CellId> = regressed.map(|of| of.cell).collect();
        others.dedup();
        others.retain(|cell| first.as_ref().is_none_or(|first| first.cell != *cell));
        Ok((status, first, others))
    }

    /// Measures each cell alone that noise leaves open between the ends, the one that seems slowest first, until one is slower.
    /// Together these cells raise a false alarm as seldom as the comparison before.
    fn open_ends(
        &self,
        bad: &Candidate,
        verdicts: &Verdicts<'_>,
    ) -> Result<(Status, Vec<RegressedCell>)> {
        let settings = &self.options.settings;
        let of_cells = verdicts.cells.iter().filter(|cell| cell.may_be_slower(settings.threshold));
        let mut open: Vec<_> = of_cells.filter_map(|cell| cell.time.as_ref()).collect();
        open.sort_by(|a, b| b.change.median.total_cmp(&a.change.median));
        let alpha = settings.alpha / open.len().max(1) as f64;
        let mut worst = Status::NoRegression;
        for cell in open.iter().map(|time| &time.cell) {
            (self.maker.report)(&format!("open between the ends: {cell}, measured alone"));
            let settings = GateSettings { gates: vec![Gate::Time], alpha, ..settings.clone() };
            let name = format!("{ENDS}-{}", text::file_stem(cell.as_str()));
            let stored = self.compare(&name, bad, Some(cell.to_string()), settings)?;
            let verdicts = Verdicts::judge(&stored);
            let found = regressed(&verdicts);
            if !found.is_empty() {
                return Ok((verdicts.status, found));
            }
            if verdicts.status != Status::NoRegression {
                worst = verdicts.status;
            }
        }
        Ok((worst, Vec::new()))
    }

    fn search(&self, of: RegressedCell, others: Vec<CellId>) -> Result<BisectResult> {
        let RegressedCell { cell, mut figure, launches } = of;
        let batch = if figure == Metric::Time { self.options.batch } else { 1 };
        let mut search = Search::new(self.candidates.len(), figure.scatter());
        let is_exact = figure.gate() == Gate::Exact;
        let ends = if is_exact { vec![WORSE] } else { launches };
        search.add(self.candidates.len(), &ends);
        let mut skipped = Vec::new();
        let mut visits = vec![0u64; self.candidates.len() + 1];
        let mut differences = BTreeMap::new();
        while let Some(number) = search.next(batch as usize) {
            if search.launches() - ends.len() >= self.options.max_launches as usize {
                break;
            }
            visits[number] += 1;
            let candidate = &self.candidates[number - 1];
            let measured = self.visit(number, visits[number], batch, &cell, &figure);
            self.check_interrupt()?;
            match measured {
                Ok(Evidence { launches, difference }) => {
                    search.add(number, &launches);
                    differences.extend(difference.map(|difference| (number, difference)));
                }
                Err(error) => {
                    (self.maker.report)(&format!("skipping {}: {error}", candidate.label));
                    search.skip(number);
                    skipped.push((number, error.to_string()));
                }
            }
            let StepEstimate { first, probability, .. } = search.estimate();
            let named = &self.candidates[first - 1].label;
            (self.maker.report)(&format!("most probable: {named} ({probability:.2})"));
        }
        let (estimate, launches) = (search.estimate(), search.launches());
        if let Some(difference) = differences.remove(&estimate.first) {
            figure = Metric::Exact(difference);
        }
        Ok(BisectResult { cell, figure, estimate, others, skipped, launches })
    }

    /// Measures a candidate once more.
    fn visit(
        &self,
        number: usize,
        visit: u64,
        batch: u32,
        cell: &CellId,
        figure: &Metric,
    ) -> Result<Evidence> {
        let candidate = &self.candidates[number - 1];
        let label = text::file_stem(&candidate.label);
        let settings = GateSettings {
            launches: batch,
            gates: vec![figure.gate()],
            // No two comparisons have the same order of samples.
            seed: self.options.settings.seed.wrapping_add(1000 * number as u64 + visit),
            ..self.options.settings.clone()
        };
        let name = format!("{number}-{label}-{visit}");
        let stored = self.compare(&name, candidate, Some(cell.to_string()), settings)?;
        read_result(&stored, cell, figure)
    }
}

/// Each figure that is worse at the bad end.
fn regressed(verdicts: &Verdicts<'_>) -> Vec<RegressedCell> {
    let exact = |cell: &CellId, difference: &Difference| RegressedCell {
        cell: cell.clone(),
        launches: vec![(difference.head.abs() / difference.base.abs()).ln()],
        figure: Metric::Exact(difference.clone()),
    };
    let mut found = Vec::new();
    for judged in &verdicts.cells {
        let cell = &judged.cell;
        let worse = judged.differences.iter().filter(|difference| difference.worse);
        found.extend(worse.map(|difference| exact(cell, difference)));
        if let Some(more) = judged.instructions.as_ref().filter(|i| i.change == Change::More) {
            let launches = vec![more.ratio.ln()];
            found.push(RegressedCell {
                cell: cell.clone(),
                figure: Metric::Instructions,
                launches,
            });
        }
        if let Some(slower) = judged.time.as_ref().filter(|t| t.verdict == TimeVerdict::Slower) {
            let launches = slower.launches.clone();
            found.push(RegressedCell { cell: cell.clone(), figure: Metric::Time, launches });
        }
    }
    for difference in verdicts.configurations.iter().filter(|difference| difference.worse) {
        // Any cell of the configuration has its figures measured.
        let mut cells = verdicts.cells.iter().map(|judged| &judged.cell);
        if let DifferenceScope::Configuration(id) = &difference.scope {
            let cell = cells.find(|cell| cell.configuration() == id);
            found.extend(cell.map(|cell| exact(cell, difference)));
        }
    }
    found
}

/// The figure of [`Search`] where an exact figure is worse; 0 where it is not.
const WORSE: f64 = 1.0;

struct Evidence {
    /// ln(candidate / good) of each launch.
    launches: Vec<f64>,
    /// Of an exact figure, if it is worse.
    difference: Option<Difference>,
}

fn read_result(stored: &Comparison, cell: &CellId, figure: &Metric) -> Result<Evidence> {
    let none = || {
        let fault = stored.faults.first().map(|fault| fault.reason.clone());
        anyhow!(fault.unwrap_or_else(|| format!("{cell} was not measured")))
    };
    if let Metric::Exact(wanted) = figure {
        let is_whole = stored.has_exact(cell) && stored.faults.is_empty();
        ensure!(is_whole && exact::missing(stored).is_empty(), none());
        let difference = exact::judge(stored);
        let difference = difference.into_iter().find(|own| own.worse && is_same(own, wanted));
        let launches = vec![if difference.is_some() { WORSE } else { 0.0 }];
        return Ok(Evidence { launches, difference });
    }
    let judged = AdapterRelation::from_header(&stored.header).is_judged();
    ensure!(judged, "its adapter is another than the good one's, so its times are not judged");
    let launches = if *figure == Metric::Instructions {
        vec![counts::judge(stored).get(cell).ok_or_else(none)?.ratio.ln()]
    } else {
        let judged = time::judge(stored).cells.into_iter();
        judged.map(|time| time.launches).next().ok_or_else(none)?
    };
    Ok(Evidence { launches, difference: None })
}

/// One figure of one configuration or stage. An error may be charged to another stage of the configuration where others moved with it.
fn is_same(one: &Difference, other: &Difference) -> bool {
    let place = |of: &Difference| match &of.scope {
        DifferenceScope::Cell(cell) => (Some(cell.configuration().to_owned()), None),
        DifferenceScope::Configuration(id) => (Some(id.clone()), None),
        DifferenceScope::Stage(stage) => (None, Some(stage.clone())),
    };
    // Work and invocations are each stage's own.
    let is_own = matches!(one.kind, FigureKind::Work | FigureKind::Counter);
    let is_one = if is_own { one.scope == other.scope } else { place(one) == place(other) };
    is_one && (one.kind, &one.figure) == (other.kind, &other.figure)
}

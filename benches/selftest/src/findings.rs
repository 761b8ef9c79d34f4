//! What the trials of a self-test show: a function of their stored comparisons alone.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use derive_more::{Add, AddAssign};
use serde::Serialize;

use fathom::Catalog;
use fathom::compare::cells::Gates;
use fathom::compare::protocol::GateConfiguration;
use fathom::compare::store::StoredComparison;
use fathom::compare::verdict::{CellVerdict, GateState, Status, Verdicts};
use fathom::harness::subject::Subjects;
use fathom::record::comparison::{CellId, CellSubject, Gate};
use fathom::statistics::Interval;

use crate::injections::{Injection, Size};
use crate::slowed::{Composed, Coverage, Slowed, holds};
use crate::trials::{Aim, Trial, Variant};

/// A count and what it is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Add, AddAssign, Serialize)]
pub struct Share {
    pub count: usize,
    pub of: usize,
}

impl Share {
    pub fn add(&mut self, hit: bool) {
        self.count += usize::from(hit);
        self.of += 1;
    }

    pub fn ratio(self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
    }

    /// The interval of 95 % of the share. Wilson, *J. Am. Stat. Assoc.* 22 (1927).
    pub fn interval(self) -> Interval {
        const Z: f64 = 1.96;
        let n = self.of.max(1) as f64;
        let share = self.ratio();
        let middle = share + Z * Z / (2.0 * n);
        let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
        let scale = 1.0 + Z * Z / n;
        Interval { low: (middle - half) / scale, high: (middle + half) / scale }
    }
}

/// What one trial showed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialResult {
    pub id: String,
    /// The injected stage; none for a no-op.
    pub stage: Option<String>,
    pub kind: String,
    pub loaded: bool,
    pub gates: Vec<Gate>,
    pub status: String,
    pub exit_code: u8,
    /// The stage of the regression that is named first.
    pub named_first: Option<String>,
    /// Cells by verdict.
    pub verdicts: BTreeMap<String, usize>,
    pub wall_s: Option<f64>,
    pub cells: Vec<CellResult>,
}

/// A cell of a trial.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellResult {
    pub cell: CellId,
    pub verdict: String,
    /// Head over base less one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub change: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interval: Option<(f64, f64)>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detectable: Option<f64>,
    /// Head's instructions over the base's less one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instructions: Option<f64>,
    /// What the time's change is known to be.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
}

/// The stages of a frame of each configuration of the gates, listed there or not.
static FRAMES: LazyLock<BTreeMap<String, BTreeSet<&str>>> = LazyLock::new(|| {
    let catalog = Catalog::builtin();
    let gates = Gates::load(None, catalog.gates).expect("gates that are built in");
    let mut subjects = Subjects::of(&catalog).silent();
    let mut frame = |cell: GateConfiguration| {
        let params: Vec<_> = cell.params.into_iter().collect();
        let subject = subjects.subject(&cell.pipeline, &cell.scene, &params);
        let plan = subject.and_then(|subject| subject.plan()).expect("a gate that can be planned");
        (cell.id, plan.stages.iter().map(|stage| stage.name).collect())
    };
    gates.configurations.into_iter().map(&mut frame).collect()
});

/// How often a stage that was changed was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Add, AddAssign, Serialize)]
pub struct Found {
    pub caught: Share,
    /// Of those caught.
    pub named_first: Share,
    /// Verdicts that are regressions, on cells that neither are the stage's nor create a pipeline that runs it.
    pub others_blamed: Share,
}

impl Found {
    /// In one gate.
    pub fn of(verdicts: &Verdicts<'_>, stage: &str) -> Self {
        use CellVerdict::{Failed, New, NotMeasured};
        let mut found = Self::default();
        let is_own = |cell: &CellId| cell.stage() == stage;
        // What the host does with a longer shader takes longer.
        let is_affected = |cell: &CellId| match cell.subject() {
            CellSubject::Stage(own) | CellSubject::Encode(own) => own == stage,
            CellSubject::Create => {
                FRAMES.get(cell.configuration()).is_some_and(|frame| frame.contains(stage))
            }
        };
        let regressions = verdicts.regressions();
        let caught = regressions.iter().any(|cell| is_own(&cell.cell));
        found.caught.add(caught);
        if caught {
            found.named_first.add(is_own(&regressions[0].cell));
        }
        let judged = |verdict| !matches!(verdict, Failed | New | NotMeasured);
        for cell in verdicts.cells.iter().filter(|cell| !is_affected(&cell.cell)) {
            if judged(cell.verdict) {
                found.others_blamed.add(cell.verdict.is_regression());
            }
        }
        found
    }
}

/// How often injections of one size were found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Detection {
    pub found: Found,
    /// Least and greatest change that the trials measured of the injected stage in the configuration in which its sizes are
    /// tuned, in its time or its instructions.
    pub smallest: Option<f64>,
    pub largest: Option<f64>,
}

/// How often the slowdown of 5 % of one stage was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StageDetection {
    /// What all comparisons with every stage slowed down make of it, in the configuration in which it is tuned.
    pub truth: Option<f64>,
    pub caught: Share,
    /// What each trial made of it there, and the least slowdown that it could have found.
    pub changes: Vec<f64>,
    pub detectable: Vec<f64>,
}

/// Everything together.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Findings {
    pub adapter: String,
    pub cells: usize,
    /// Time gates of no-op builds that raised an alarm, and those on a loaded machine among them.
    pub false_alarms: Share,
    pub false_alarms_loaded: Share,
    /// Cells of those gates by verdict.
    pub no_op_verdicts: BTreeMap<String, usize>,
    /// Exact and instruction gates of no-op builds that raised an alarm.
    pub counted_alarms: Share,
    /// By the size's name.
    pub detection: BTreeMap<String, Detection>,
    /// Of the slowdowns of 5 %: by the injected stage.
    pub stages: BTreeMap<String, StageDetection>,
    /// The same in gates of equal builds with one stage of a gate in which all were slowed down.
    pub composed: Composed,
    /// Changes of other kinds: kind → verdict on the injected stage's cells, and whether they were caught.
    pub kinds: BTreeMap<String, KindResult>,
    /// Intervals that contain the truth where it is 0.
    pub covered_zero: Share,
    /// Intervals of comparisons with every stage slowed down that contain the truth from the others.
    pub covered_slowed: Coverage,
    /// Intervals of single injections that contain the truth from those comparisons.
    pub covered_injected: Share,
    /// Cells whose interval in such a trial lies apart from that of the truth.
    pub sensitive_to_context: BTreeSet<CellId>,
    /// Time gates that could not be judged because their control moved.
    pub void: Share,
    /// Median wall time of a time gate of all cells, seconds.
    pub time_gate_s: Option<f64>,
    pub trials: Vec<TrialResult>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct KindResult {
    pub stage: String,
    pub found: Found,
    pub verdicts: Vec<String>,
}

/// What comes of the trials that were made.
pub fn findings(injections: &[Injection], made: &[(Trial, StoredComparison)]) -> Findings {
    let slowed = Slowed::of(Size::Slow5, made);
    let mut all = Findings {
        covered_slowed: slowed.coverage(),
        composed: slowed.composed(&equal_gates(made)),
        ..Findings::default()
    };
    let mut gate_times = Vec::new();
    for (trial, comparison) in made {
        let injection = injections.iter().find(|injection| trial.variant.injects(injection));
        let injection = injection.filter(|_| trial.aim == Aim::Detection);
        let verdicts = Verdicts::of(comparison);
        let result = result(trial, injection, &verdicts, &slowed);
        all.adapter = comparison.header.adapter.name.clone();
        all.cells = all.cells.max(comparison.header.cells.len());
        if trial.gates.contains(&Gate::Time) {
            let time = verdicts.gates.iter().find(|(gate, _)| *gate == Gate::Time);
            all.void.add(matches!(time, Some((_, GateState::Void(_)))));
        }
        if trial.gates == [Gate::Time] {
            gate_times.extend(result.wall_s);
            if trial.aim != Aim::Coverage {
                all.cover(&result, &slowed);
            }
        }
        match (trial.aim, injection) {
            (Aim::NoAlarm, _) => all.no_op(trial, &verdicts, &result),
            (Aim::Detection, Some(injection)) => {
                all.detected(trial, injection, &verdicts, &result);
            }
            (Aim::Detection, None) | (Aim::Coverage, _) => {}
        }
        all.trials.push(result);
    }
    if !gate_times.is_empty() {
        all.time_gate_s = Some(fathom::statistics::median(&gate_times));
    }
    all
}

/// Time gates of equal builds on a calm machine.
fn equal_gates(made: &[(Trial, StoredComparison)]) -> Vec<&StoredComparison> {
    let is_equal =
        |trial: &Trial| trial.aim == Aim::NoAlarm && trial.gates == [Gate::Time] && !trial.loaded;
    made.iter().filter(|(trial, _)| is_equal(trial)).map(|(_, stored)| stored).collect()
}

fn result(
    trial: &Trial,
    injection: Option<&Injection>,
    verdicts: &Verdicts<'_>,
    slowed: &Slowed<'_>,
) -> TrialResult {
    let stage = injection.map(|injection| injection.stage.clone());
    let cells = verdicts.cells.iter().map(|cell| {
        let time = cell.time.as_ref();
        let injected = stage.as_deref() == Some(cell.cell.stage());
        let truth = match trial.variant {
            Variant::Every(Size::Slow5) => slowed.truth(&cell.cell, Some(&trial.id)),
            Variant::Injected(_, Some(Size::Slow5)) if injected => slowed.truth(&cell.cell, None),
            _ => None,
        };
        let is_equal = trial.aim != Aim::Coverage && !injected;
        let truth = if is_equal { Some(0.0) } else { truth.map(|truth| truth.median) };
        CellResult {
            cell: cell.cell.clone(),
            verdict: cell.verdict.to_string(),
            change: time.map(|time| short(time.change.median)),
            interval: time
                .and_then(|time| time.change.interval)
                .map(|interval| (short(interval.low), short(interval.high))),
            detectable: time.and_then(|time| time.detectable).map(short),
            instructions: cell.instructions.as_ref().map(|counted| short(counted.ratio - 1.0)),
            truth: time.and(truth).map(short),
        }
    });
    let by_verdict = verdicts.counts().into_iter();
    TrialResult {
        id: trial.id.clone(),
        stage: stage.clone(),
        kind: match (injection, &trial.variant) {
            (Some(injection), Variant::Injected(_, Some(size))) => {
                format!("{}, {}", injection.kind, size.label())
            }
            (Some(injection), _) => injection.kind.clone(),
            (None, Variant::Unrelated) => "unrelated host change".to_owned(),
            (None, Variant::Every(size)) => format!("every injection, {}", size.label()),
            (None, _) => "same source".to_owned(),
        },
        loaded: trial.loaded,
        gates: trial.gates.clone(),
        status: verdicts.status.to_string(),
        exit_code: verdicts.status as u8,
        named_first: verdicts.regressions().first().map(|cell| cell.cell.stage().to_owned()),
        verdicts: by_verdict.map(|(verdict, count)| (verdict.to_string(), count)).collect(),
        wall_s: verdicts.comparison.end.as_ref().map(|end| end.wall_s.round()),
        cells: cells.collect(),
    }
}

/// Six digits after the point: a share to a ten-thousandth of a per cent.
fn short(share: f64) -> f64 {
    (share * 1e6).round() / 1e6
}

impl Findings {
    fn no_op(&mut self, trial: &Trial, verdicts: &Verdicts<'_>, result: &TrialResult) {
        let alarm = verdicts.status == Status::Regression;
        if trial.gates != [Gate::Time] {
            self.counted_alarms.add(alarm);
            return;
        }
        self.false_alarms.add(alarm);
        if trial.loaded {
            self.false_alarms_loaded.add(alarm);
        }
        for (verdict, count) in &result.verdicts {
            *self.no_op_verdicts.entry(verdict.clone()).or_default() += count;
        }
    }

    fn detected(
        &mut self,
        trial: &Trial,
        injection: &Injection,
        verdicts: &Verdicts<'_>,
        result: &TrialResult,
    ) {
        let found = Found::of(verdicts, &injection.stage);
        let Variant::Injected(_, Some(size)) = &trial.variant else {
            let own = verdicts.cells.iter().filter(|cell| cell.cell.stage() == injection.stage);
            let verdicts = own.map(|cell| format!("{}: {}", cell.cell, cell.verdict)).collect();
            let of_kind = KindResult { stage: injection.stage.clone(), found, verdicts };
            self.kinds.insert(injection.kind.clone(), of_kind);
            return;
        };
        let detection = self.detection.entry(size.label().to_owned()).or_default();
        detection.found += found;
        let tuned = CellId::new(&injection.configuration, &injection.stage);
        let measured = result.cells.iter().find(|cell| cell.cell == tuned);
        if *size == Size::Slow5 {
            let stage = self.stages.entry(injection.stage.clone()).or_default();
            stage.caught += found.caught;
            stage.truth = measured.and_then(|cell| cell.truth);
            stage.changes.extend(measured.and_then(|cell| cell.change));
            stage.detectable.extend(measured.and_then(|cell| cell.detectable));
        }
        let change = measured.and_then(|cell| match size {
            Size::Instructions => cell.instructions,
            _ => cell.change,
        });
        if let Some(change) = change {
            detection.smallest = Some(detection.smallest.map_or(change, |known| known.min(change)));
            detection.largest = Some(detection.largest.map_or(change, |known| known.max(change)));
        }
    }

    /// Counts the intervals of a gate that hold the truth.
    fn cover(&mut self, result: &TrialResult, slowed: &Slowed<'_>) {
        for cell in &result.cells {
            let (Some((low, high)), Some(truth)) = (cell.interval, cell.truth) else {
                continue;
            };
            let covered = holds(Interval { low, high }, truth);
            if result.stage.as_deref() != Some(cell.cell.stage()) {
                self.covered_zero.add(covered);
                continue;
            }
            self.covered_injected.add(covered);
            let among_all = slowed.truth(&cell.cell, None).and_then(|truth| truth.interval);
            if among_all.is_some_and(|all| all.high < low || high < all.low) {
                self.sensitive_to_context.insert(cell.cell.clone());
            }
        }
    }

    /// How often a cell is called slower or faster where nothing changed.
    pub fn no_op_changes(&self) -> Share {
        let changed = [CellVerdict::Slower, CellVerdict::Faster];
        let counts = changed.iter().filter_map(|it| self.no_op_verdicts.get(&it.to_string()));
        Share { count: counts.sum(), of: self.no_op_verdicts.values().sum() }
    }
}

#[cfg(test)]
mod tests {
    use fathom::record::comparison::{
        ComparisonEnd, ComparisonHeader, GateSettings, Launch, Pair, Side,
    };

    use super::*;

    const LAUNCHES: u32 = 10;
    /// How far apart the ratios of the launches lie.
    const SPREAD: f64 = 0.004;

    /// A time gate of two stages whose times change by these factors.
    fn timed(trace: f64, compose: f64) -> StoredComparison {
        let cells = ["caustics/trace", "compose"].map(|stage| CellId::new("pool", stage));
        let settings = GateSettings { gates: vec![Gate::Time], ..GateSettings::default() };
        let header =
            ComparisonHeader { settings, cells: cells.to_vec(), ..ComparisonHeader::default() };
        let mut comparison = StoredComparison::new(header);
        let measured = [(0, true, 1.0), (0, false, trace), (1, false, compose)];
        for launch in 0..LAUNCHES {
            comparison.launches.push(Launch { launch, ..Launch::default() });
            let place = f64::from(launch) / f64::from(LAUNCHES - 1) - 0.5;
            for (cell, control, ratio) in measured {
                comparison.pairs.extend([Side::Base, Side::Head].map(|first| Pair {
                    launch,
                    round: 0,
                    cell: cells[cell].clone(),
                    control,
                    second: false,
                    first,
                    base_ns: 2e6,
                    head_ns: 2e6 * ratio * (1.0 + 2.0 * SPREAD * place),
                    machine: Default::default(),
                }));
            }
        }
        comparison.end = Some(ComparisonEnd { wall_s: 60.0, interrupted: false });
        comparison
    }

    #[test]
    fn findings_count_what_the_trials_show() {
        let injections = Injection::all().unwrap();
        let calm = Trial::time("again", Variant::Again, Aim::NoAlarm);
        let loaded = Trial { loaded: true, ..Trial::time("loaded", Variant::Again, Aim::NoAlarm) };
        let slowed = |id: &str| Trial::time(id, Variant::Every(Size::Slow5), Aim::Coverage);
        let injected = |size: Size| {
            let variant = Variant::Injected("caustics-trace-fetches".to_owned(), Some(size));
            Trial::time(&variant.to_string(), variant.clone(), Aim::Detection)
        };
        let made = [
            (calm, timed(1.001, 1.0005)),
            (loaded, timed(1.05, 1.0005)),
            (slowed("a"), timed(1.0501, 1.05)),
            (slowed("b"), timed(1.0502, 1.07)),
            (injected(Size::Slow5), timed(1.05, 1.0005)),
            (injected(Size::Slow10), timed(1.045, 1.1)),
        ];
        let found = findings(&injections, &made);
        let share = |count, of| Share { count, of };
        assert_eq!(found.false_alarms, share(1, 2));
        assert_eq!(found.false_alarms_loaded.count, 1);
        assert_eq!(found.no_op_changes(), share(1, 4));
        let five = &found.detection["+5 % time"];
        let one =
            Found { caught: share(1, 1), named_first: share(1, 1), others_blamed: share(0, 1) };
        assert_eq!(five.found, one);
        assert!((five.largest.unwrap() - 0.05).abs() < 1e-4);
        let of_stage = &found.stages["caustics/trace"];
        assert_eq!((of_stage.caught.count, of_stage.changes.len()), (1, 1));
        assert!((of_stage.truth.unwrap() - 0.0501).abs() < 1e-4);
        let ten =
            Found { caught: share(1, 1), named_first: share(0, 1), others_blamed: share(1, 1) };
        assert_eq!(found.detection["+10 % time"].found, ten);
        // The loaded no-op's trace, which is none, and the last trial's compose lie outside their intervals.
        assert_eq!(found.covered_zero, share(4, 6));
        assert_eq!(found.covered_injected, share(1, 1));
        // Of `compose` neither of the two holds the other.
        assert_eq!(found.covered_slowed.plain, share(2, 4));
        // Each stage of the one calm gate of equal builds.
        let composed =
            Found { caught: share(2, 2), named_first: share(2, 2), others_blamed: share(0, 2) };
        assert_eq!((found.composed.found, found.composed.without_second), (composed, 0));
        assert!(found.sensitive_to_context.is_empty());
    }

    /// `shadow-rays` peels layers and lists no cell of that stage; the pool's photons need none.
    #[test]
    fn frames_hold_stages_that_no_cell_lists() {
        assert!(FRAMES["shadow-rays"].contains("ldi/peel"));
        assert!(!FRAMES["pool"].contains("ldi/peel"));
        assert!(FRAMES["pool"].contains("caustics/trace"));
    }

    #[test]
    fn a_share_has_wilsons_interval() {
        // Newcombe, *Statistics in Medicine* 17 (1998), Table I: 81 of 263.
        let Interval { low, high } = Share { count: 81, of: 263 }.interval();
        assert!((low - 0.2553).abs() < 5e-5 && (high - 0.3662).abs() < 5e-5, "{low} {high}");
    }
}

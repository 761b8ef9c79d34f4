//! What the trials of a self-test show: a function of their stored comparisons alone.

use std::collections::BTreeMap;

use derive_more::{Add, AddAssign};
use serde::Serialize;

use fathom::compare::store::StoredComparison;
use fathom::compare::verdict::{CellVerdict, GateState, Status, Verdicts};

use crate::injections::{Injection, Size};
use crate::trials::{Aim, Trial, Variant};
use fathom::record::comparison::{CellId, Gate};

/// A count and what it is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Add, AddAssign, Serialize)]
pub struct Share {
    pub count: usize,
    pub of: usize,
}

impl Share {
    fn add(&mut self, hit: bool) {
        self.count += usize::from(hit);
        self.of += 1;
    }

    pub fn ratio(self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
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

/// How often injections of one size were found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Detection {
    pub caught: Share,
    /// Of those caught.
    pub named_first: Share,
    /// Verdicts on cells of other stages that are regressions.
    pub others_blamed: Share,
    /// Least and greatest change that the trials measured of the injected stage in the configuration in which its sizes are
    /// tuned, in its time or its instructions.
    pub smallest: Option<f64>,
    pub largest: Option<f64>,
}

/// How often the slowdown of 5 % of one stage was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StageDetection {
    /// What a long measurement makes of it, in the configuration in which it is tuned.
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
    /// Changes of other kinds: kind → verdict on the injected stage's cells, and whether they were caught.
    pub kinds: BTreeMap<String, KindResult>,
    /// Intervals that contain the truth where it is 0.
    pub covered_zero: Share,
    /// Intervals that contain the truth of an injection.
    pub covered_injected: Share,
    /// Time gates that could not be judged because their control moved.
    pub void: Share,
    /// Median wall time of a time gate of all cells, seconds.
    pub time_gate_s: Option<f64>,
    pub trials: Vec<TrialResult>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct KindResult {
    pub stage: String,
    pub caught: bool,
    pub named_first: bool,
    pub others_blamed: Share,
    pub verdicts: Vec<String>,
}

/// What comes of the trials that were made.
pub fn findings(injections: &[Injection], made: &[(Trial, StoredComparison)]) -> Findings {
    let truths = truths(made);
    let mut all = Findings::default();
    let mut gate_times = Vec::new();
    for (trial, comparison) in made {
        let injection = injections.iter().find(|injection| trial.variant.injects(injection));
        let verdicts = Verdicts::of(comparison);
        let result = result(trial, injection, &verdicts, &truths);
        all.adapter = comparison.header.adapter.name.clone();
        all.cells = all.cells.max(comparison.header.cells.len());
        if trial.gates.contains(&Gate::Time) {
            let time = verdicts.gates.iter().find(|(gate, _)| *gate == Gate::Time);
            all.void.add(matches!(time, Some((_, GateState::Void(_)))));
        }
        if trial.gates == [Gate::Time] && trial.aim != Aim::Truth {
            gate_times.extend(result.wall_s);
            all.cover(&result);
        }
        match (trial.aim, injection) {
            (Aim::NoAlarm, _) => all.no_op(trial, &verdicts, &result),
            (Aim::Detection, Some(injection)) => {
                all.detected(trial, injection, &verdicts, &result);
            }
            (Aim::Detection, None) | (Aim::Truth, _) => {}
        }
        all.trials.push(result);
    }
    if !gate_times.is_empty() {
        all.time_gate_s = Some(fathom::statistics::median(&gate_times));
    }
    all
}

/// What a long measurement says of all injections of a size: (size, cell) → change.
type Truths = BTreeMap<(Size, CellId), f64>;

fn truths(made: &[(Trial, StoredComparison)]) -> Truths {
    let long = made.iter().filter_map(|(trial, comparison)| {
        let Variant::Every(size) = trial.variant else {
            return None;
        };
        let cells = Verdicts::of(comparison).cells.into_iter();
        Some(cells.filter_map(move |cell| Some(((size, cell.cell), cell.time?.change.median))))
    });
    long.flatten().collect()
}

fn result(
    trial: &Trial,
    injection: Option<&Injection>,
    verdicts: &Verdicts<'_>,
    truths: &Truths,
) -> TrialResult {
    let stage = injection.map(|injection| injection.stage.clone());
    let cells = verdicts.cells.iter().map(|cell| {
        let time = cell.time.as_ref();
        let injected = stage.as_deref() == Some(cell.cell.stage());
        let truth = match trial.variant {
            _ if !injected => Some(0.0),
            Variant::Injected(_, Some(size)) => truths.get(&(size, cell.cell.clone())).copied(),
            _ => None,
        };
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
        use CellVerdict::{Failed, New, NotMeasured};
        let (own, others): (Vec<_>, Vec<_>) =
            verdicts.cells.iter().partition(|cell| cell.cell.stage() == injection.stage);
        let caught = own.iter().any(|cell| cell.verdict.is_regression());
        let named_first = result.named_first == result.stage;
        let mut others_blamed = Share::default();
        for cell in others {
            if !matches!(cell.verdict, Failed | New | NotMeasured) {
                others_blamed.add(cell.verdict.is_regression());
            }
        }
        let Variant::Injected(_, Some(size)) = &trial.variant else {
            let verdicts = own.iter().map(|cell| format!("{}: {}", cell.cell, cell.verdict));
            let (stage, verdicts) = (injection.stage.clone(), verdicts.collect());
            let found = KindResult { stage, caught, named_first, others_blamed, verdicts };
            self.kinds.insert(injection.kind.clone(), found);
            return;
        };
        let detection = self.detection.entry(size.label().to_owned()).or_default();
        detection.caught.add(caught);
        if caught {
            detection.named_first.add(named_first);
        }
        detection.others_blamed += others_blamed;
        let tuned = CellId::new(&injection.configuration, &injection.stage);
        let measured = result.cells.iter().find(|cell| cell.cell == tuned);
        if *size == Size::Slow5 {
            let stage = self.stages.entry(injection.stage.clone()).or_default();
            stage.caught.add(caught);
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
    fn cover(&mut self, result: &TrialResult) {
        for cell in &result.cells {
            let (Some((low, high)), Some(truth)) = (cell.interval, cell.truth) else {
                continue;
            };
            let covered = low <= truth && truth <= high;
            let injected = result.stage.as_deref() == Some(cell.cell.stage());
            let share = if injected { &mut self.covered_injected } else { &mut self.covered_zero };
            share.add(covered);
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
pub mod tests {

    use fathom::record::comparison::{
        ComparisonEnd, ComparisonHeader, GateSettings, Launch, Pair, Side,
    };

    use super::*;
    use crate::trials::{Plan, trials};

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
        let all = trials(Plan { no_ops: 3, slow5: 12 }, &injections);
        let trial = |id: &str| {
            let found = all.iter().find(|trial| trial.id == id);
            found.unwrap_or_else(|| panic!("{id}")).clone()
        };
        let made = [
            (trial("no-op-000-again"), timed(1.001, 1.0005)),
            (trial("no-op-002-again-loaded"), timed(1.05, 1.0005)),
            (trial("every-slow5-truth"), timed(1.0501, 1.0005)),
            (trial("caustics-trace-fetches-slow5-0"), timed(1.05, 1.0005)),
            (trial("caustics-trace-fetches-slow10-0"), timed(1.045, 1.1)),
        ];
        let found = findings(&injections, &made);
        let share = |count, of| Share { count, of };
        assert_eq!(found.false_alarms, share(1, 2));
        assert_eq!(found.false_alarms_loaded.count, 1);
        assert_eq!(found.no_op_changes(), share(1, 4));
        let five = &found.detection["+5 % time"];
        assert_eq!((five.caught, five.named_first), (share(1, 1), share(1, 1)));
        assert_eq!(five.others_blamed.count, 0);
        assert!((five.largest.unwrap() - 0.05).abs() < 1e-4);
        let of_stage = &found.stages["caustics/trace"];
        assert_eq!((of_stage.caught.count, of_stage.changes.len()), (1, 1));
        assert!((of_stage.truth.unwrap() - 0.0501).abs() < 1e-4);
        let ten = &found.detection["+10 % time"];
        assert_eq!((ten.caught.count, ten.named_first.count), (1, 0));
        assert_eq!(ten.others_blamed, share(1, 1));
        // The loaded no-op's trace, which is none, and the last trial's compose lie outside their intervals.
        assert_eq!(found.covered_zero, share(4, 6));
        assert_eq!(found.covered_injected, share(1, 1));
    }
}

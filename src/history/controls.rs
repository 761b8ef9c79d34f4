//! Separates a machine's drift from changes of the program by controls: figures that no commit changes. They are the adapter's own
//! limits, which each run measures with fixed kernels, or series that the user names.
//!
//! The speed of a machine in a run is the median over its controls of ln(time), each less its own median over the runs. At a change
//! of a series the same runs of the speed are compared, those next to the change: a step of the machine at another night is
//! then no explanation.

use std::collections::{BTreeMap, HashMap};

use fathom_base::statistics::{Estimate, median};

use super::stored::{FigureSeries, SeriesKey, StoredRuns};
use fathom_judge::shift::{excludes_zero, shift};

/// Runs of a side that count: those nearest to the change. It bounds the time of a history in which everything changed.
pub const MAX_SIDE: usize = 60;
/// Runs next to a change, on either side, by which the machine is judged. Ten on each side have an interval of a quarter of their scatter.
const NEAR: usize = 10;
/// Share of a change that the machine must account for to be its cause.
const EXPLAINED: f64 = 0.5;

/// What the controls say of a change. Shifts are of ln(time).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum MachineShift {
    /// Too few of the runs have a control.
    #[default]
    Unknown,
    /// The controls stayed, or their shift does not explain the change.
    Still,
    /// The controls shifted too, and the series by more or less than they. The second is what is left of the change without it.
    Partly { machine: Estimate, left: Estimate },
    /// The controls shifted in the same runs, in the same direction, and the interval of what is left contains zero.
    Whole(Estimate),
}

/// What one machine's runs have in common: branch, machine, adapter, driver.
type MachineKey = [String; 4];

fn place(key: &SeriesKey) -> MachineKey {
    let SeriesKey { branch, machine, figure } = key;
    [branch.as_str(), machine, &figure.adapter, &figure.driver].map(str::to_owned)
}

/// ln(time) of each machine by run.
#[derive(Default)]
pub struct Controls(HashMap<MachineKey, BTreeMap<usize, f64>>);

impl Controls {
    pub fn from_runs(stored: &StoredRuns) -> Self {
        let mut speeds = HashMap::<MachineKey, BTreeMap<usize, Vec<f64>>>::new();
        for control in &stored.controls {
            // A limit is a rate, which falls where times rise.
            let sign = if control.key.is_time() { 1.0 } else { -1.0 };
            let log = |value: f64| sign * value.ln();
            let logs = control.points.iter().map(|point| (point.run, log(point.value.median)));
            let logs: Vec<(usize, f64)> = logs.filter(|(_, log)| log.is_finite()).collect();
            let middle = median(&logs.iter().map(|(_, log)| *log).collect::<Vec<_>>());
            let of_place = speeds.entry(place(&control.key)).or_default();
            for (run, log) in logs {
                of_place.entry(run).or_default().push(log - middle);
            }
        }
        let middles = |runs: BTreeMap<usize, Vec<f64>>| {
            runs.into_iter().map(|(run, logs)| (run, median(&logs))).collect()
        };
        Self(speeds.into_iter().map(|(place, runs)| (place, middles(runs))).collect())
    }

    /// What the machine did at the change of a time from the points `from..at` to `at..to`.
    pub fn judge(&self, series: &FigureSeries, [from, at, to]: [usize; 3]) -> MachineShift {
        let Some(speed) = self.0.get(&place(&series.key)).filter(|_| series.key.is_time()) else {
            return MachineShift::Unknown;
        };
        let sides = |reach: usize| {
            let sides = [at.saturating_sub(reach).max(from)..at, at..(at + reach).min(to)];
            sides.map(|side| PairedSeries::from_points(&series.points[side], speed))
        };
        let near = sides(NEAR);
        let [machine, whole, left] =
            [PairedSeries::machine, PairedSeries::time, PairedSeries::residuals].map(|of| {
                let [before, after] = near.each_ref().map(of);
                shift(&before, &after)
            });
        let Some((moved, rest)) = machine.interval.zip(left.interval) else {
            return MachineShift::Unknown;
        };
        if !excludes_zero(moved) {
            return MachineShift::Still;
        }
        let [before, after] = sides(MAX_SIDE).each_ref().map(PairedSeries::residuals);
        let left = shift(&before, &after);
        let is_left = [Some(rest), left.interval].into_iter().flatten().all(excludes_zero);
        if is_left {
            MachineShift::Partly { machine, left }
        } else if machine.median / whole.median >= EXPLAINED {
            MachineShift::Whole(machine)
        } else {
            MachineShift::Still
        }
    }
}

/// ln(time) of a series and of its machine, in the runs that have both.
struct PairedSeries(Vec<[f64; 2]>);

impl PairedSeries {
    fn from_points(points: &[super::RunValue], speed: &BTreeMap<usize, f64>) -> Self {
        let both =
            |point: &super::RunValue| Some([point.value.median.ln(), *speed.get(&point.run)?]);
        Self(points.iter().filter_map(both).collect())
    }

    fn time(&self) -> Vec<f64> {
        self.0.iter().map(|[time, _]| *time).collect()
    }

    fn machine(&self) -> Vec<f64> {
        self.0.iter().map(|[_, machine]| *machine).collect()
    }

    fn residuals(&self) -> Vec<f64> {
        self.0.iter().map(|[time, machine]| time - machine).collect()
    }
}

//! How noisy the times of a comparison are, and what that lets it see.

use itertools::Itertools;

use crate::run::Noise;
use crate::time::{CellTime, TimeVerdict};
use crate::verdict::{GateState, Verdicts};
use fathom_base::statistics::median;
use fathom_record::comparison::Gate;

/// Beyond so many times the threshold, the scatter hides more than the threshold lets through.
const NOISY: f64 = 2.0;

pub enum TimeNoise<'v> {
    /// Why the times cannot be used.
    Void(&'v str),
    /// In half of the cells there are too few launches to see a slowdown.
    TooFewLaunches { scatter: f64 },
    /// Of the median cell: by how much its launches scatter, and the least slowdown that would be found.
    Judged { noise: Noise, scatter: f64, visible: f64 },
}

impl<'v> TimeNoise<'v> {
    /// None where no times were to be judged.
    pub fn from_verdicts(verdicts: &'v Verdicts<'_>) -> Option<Self> {
        let (_, state) = verdicts.gates.iter().find(|(gate, _)| *gate == Gate::Time)?;
        match state {
            GateState::Skipped(_) => None,
            GateState::Void(reason) => Some(Self::Void(reason)),
            GateState::Ran => Self::from_cells(verdicts),
        }
    }

    fn from_cells(verdicts: &Verdicts<'_>) -> Option<Self> {
        let times = verdicts.cells.iter().filter_map(|cell| cell.time.as_ref());
        let judged = times.filter(|time| time.verdict != TimeVerdict::NotJudged).collect_vec();
        let middle = |figure: &dyn Fn(&CellTime) -> f64| {
            median(&judged.iter().map(|time| figure(time)).collect_vec())
        };
        let scatter = middle(&CellTime::scatter);
        let visible = middle(&|time| time.detectable.unwrap_or(f64::INFINITY));
        let is_noisy = visible > NOISY * verdicts.comparison.header.settings.threshold;
        let noise = if is_noisy { Noise::Noisy } else { Noise::Quiet };
        let told = if visible.is_infinite() {
            Self::TooFewLaunches { scatter }
        } else {
            Self::Judged { noise, scatter, visible }
        };
        (!judged.is_empty()).then_some(told)
    }
}

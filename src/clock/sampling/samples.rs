//! What was sampled of one cell.

use std::collections::BTreeMap;

use itertools::Itertools;

use crate::{Fault, FrameSample};
use fathom_base::statistics;
use fathom_record::{
    Addition, FaultKind, FramePair, MachineState, RejectedFrames, Rejection, StageTime,
};

/// Timed frames before a cell is judged by how many of them were rejected.
pub const MIN_JUDGED_FRAMES: usize = 6;
/// Share of rejected frames above which a cell fails.
pub const MAX_REJECTED_SHARE: f64 = 0.5;

/// Why a cell's sampling ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stopped {
    Precise,
    /// Its times are not asked for.
    UntimedOnly,
    #[default]
    OutOfTime,
    EnoughPairs,
    Interrupted,
}

/// Everything sampled of one cell. Durations in nanoseconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Timed frames, each with an untimed one beside it. All have the same stages on the same clocks.
    pub taken: Vec<FramePair>,
    pub warm_up_frames: u32,
    /// The frame time still fell when warm-up was given up.
    pub unsteady: bool,
    /// Timed frames never used, counted by reason.
    pub rejected: BTreeMap<Rejection, u32>,
    /// So many of the pairs, the first, are of an earlier run.
    pub earlier_pairs: usize,
    pub stopped: Stopped,
}

impl Samples {
    /// What an earlier run kept. Where stages or clocks changed, what came before does not count.
    pub fn of(additions: &[Addition]) -> Self {
        let mut samples = Self::default();
        for added in additions {
            let other_stages = |pair: &FramePair| !samples.has_stages(&pair.stages);
            if added.pair.as_ref().is_some_and(other_stages) {
                samples = Self::default();
            }
            samples.add(added);
        }
        samples.earlier_pairs = samples.pairs();
        samples
    }

    pub fn pairs(&self) -> usize {
        self.taken.len()
    }

    /// Stages of the first pair: the names and clocks are those of all pairs. Empty where there is none.
    pub fn stages(&self) -> &[StageTime] {
        self.taken.first().map_or(&[], |pair| &pair.stages)
    }

    /// A figure of each pair.
    pub fn each<T>(&self, of: impl Fn(&FramePair) -> T) -> Vec<T> {
        self.taken.iter().map(of).collect()
    }

    /// States of the machine, where its driver told.
    pub(super) fn machine(&self) -> Vec<MachineState> {
        self.taken.iter().filter_map(|pair| pair.machine.clone()).collect()
    }

    /// Adds what one visit to the cell gave.
    pub fn add(&mut self, added: &Addition) {
        if added.afresh {
            *self = Self::default();
        }
        self.warm_up_frames += added.warm_up_frames;
        self.unsteady |= added.unsteady;
        self.taken.extend(added.pair.clone());
        if let Some(reason) = &added.rejected {
            *self.rejected.entry(reason.clone()).or_default() += 1;
        }
    }

    /// These stages, on the same clocks, were sampled before, or none were.
    pub fn has_stages(&self, stages: &[StageTime]) -> bool {
        let known = self.stages().iter().map(|stage| (&stage.stage, stage.clock));
        self.taken.is_empty() || known.eq(stages.iter().map(|stage| (&stage.stage, stage.clock)))
    }

    /// Why the cell cannot be trusted, if too many of its frames were rejected.
    pub fn verdict_on_rejections(&self) -> Option<String> {
        let rejected = self.rejected.values().sum::<u32>() as usize;
        let judged = rejected + self.pairs();
        let too_many = rejected as f64 > MAX_REJECTED_SHARE * judged as f64;
        (judged >= MIN_JUDGED_FRAMES && too_many).then(|| {
            let mut reasons =
                self.rejected.iter().map(|(reason, count)| format!("{reason} ({count} times)"));
            format!("{rejected} of {judged} timed frames rejected: {}", reasons.join(", "))
        })
    }

    /// Of the frame time, the wider of timed and untimed frames: half of its interval over its median.
    pub fn relative_half_width(&self) -> f64 {
        let of = |samples: Vec<f64>| statistics::estimate(&samples).relative_half_width();
        of(self.each(|pair| pair.envelope_ns)).max(of(self.each(|pair| pair.untimed_ns)))
    }

    /// As a record has them.
    pub fn rejected_frames(&self) -> Vec<RejectedFrames> {
        let frames = |(rejection, frames): (&Rejection, &u32)| RejectedFrames {
            rejection: rejection.clone(),
            frames: *frames,
        };
        self.rejected.iter().map(frames).collect()
    }
}

/// A timed frame and an untimed one that was run beside it, in this round and at this second of Unix time.
pub fn frame_pair(
    frame: &FrameSample,
    untimed_ns: f64,
    (round, sampled_at_s): (u32, f64),
) -> FramePair {
    FramePair {
        round,
        sampled_at_s,
        machine: None,
        stages: frame.stages.clone(),
        envelope_ns: frame.envelope_ns,
        gaps_ns: frame.gaps_ns,
        untimed_ns,
    }
}

/// Why a pair of frames cannot be used: the timer's own reason first, then what no duration may be. A frame with several faults
/// is one rejected frame.
pub fn fault(frame: &FrameSample, untimed_ns: f64, before: &[StageTime]) -> Option<Rejection> {
    if let Some(Fault { stage, kind, .. }) = frame.faults.first() {
        return Some(Rejection { stage: Some((*stage).to_owned()), fault: *kind });
    }
    let positive = |ns: f64| ns.is_finite() && ns > 0.0;
    // Less than nothing is left only where a cost was taken off, which scatters. What was read is more than nothing.
    let read = |stage: &StageTime| stage.ns + stage.submit_cost_ns;
    let names = |stages: &[StageTime]| stages.iter().map(|stage| stage.stage.clone()).collect_vec();
    let same = names(&frame.stages) == names(before);
    let faults = [
        (FaultKind::FrameNotPositive, !positive(frame.envelope_ns)),
        (FaultKind::UntimedNotPositive, !positive(untimed_ns)),
        (FaultKind::StageNotPositive, !frame.stages.iter().all(|stage| positive(read(stage)))),
        (FaultKind::OtherStages, !before.is_empty() && !same),
    ];
    faults.into_iter().find(|(_, found)| *found).map(|(fault, _)| fault.into())
}

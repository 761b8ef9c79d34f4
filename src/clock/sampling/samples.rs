//! What was sampled of one cell.

use std::collections::BTreeMap;

use itertools::Itertools;

use crate::{Fault, FrameSample, StageSample};
use fathom_base::statistics;
use fathom_record::{
    Addition, Clock, FaultKind, FramePair, MachineState, RejectedFrames, Rejection, StageTime,
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

/// One stage's durations, in the order of the frames; each entry is a [`StageTime`].
#[derive(Clone, Debug, PartialEq)]
pub struct StageSamples {
    pub name: String,
    pub clock: Clock,
    pub ns: Vec<f64>,
    pub submit_cost_ns: Vec<f64>,
    pub resolution_ns: Vec<f64>,
}

impl StageSamples {
    /// Of a stage that was not timed.
    pub fn none(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            clock: Clock::Host,
            ns: Vec::new(),
            submit_cost_ns: Vec::new(),
            resolution_ns: Vec::new(),
        }
    }
}

/// Everything sampled of one cell. Durations in nanoseconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    pub stages: Vec<StageSamples>,
    /// Of each pair; see [`FrameRecord::rounds`](fathom_record::FrameRecord::rounds).
    pub rounds: Vec<u32>,
    pub sampled_at_s: Vec<f64>,
    pub machine: Vec<MachineState>,
    pub envelope_ns: Vec<f64>,
    pub gaps_ns: Vec<f64>,
    pub untimed_ns: Vec<f64>,
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

    /// Timed frames, each with an untimed one beside it.
    pub fn pairs(&self) -> usize {
        self.untimed_ns.len()
    }

    /// Adds what one visit to the cell gave.
    pub fn add(&mut self, added: &Addition) {
        if added.afresh {
            *self = Self::default();
        }
        self.warm_up_frames += added.warm_up_frames;
        self.unsteady |= added.unsteady;
        if let Some(pair) = &added.pair {
            self.add_pair(pair);
        }
        if let Some(reason) = &added.rejected {
            *self.rejected.entry(reason.clone()).or_default() += 1;
        }
    }

    fn add_pair(&mut self, pair: &FramePair) {
        if self.stages.is_empty() {
            let empty = |stage: &StageTime| StageSamples {
                clock: stage.clock,
                ..StageSamples::none(&stage.stage)
            };
            self.stages = pair.stages.iter().map(empty).collect();
        }
        for (samples, stage) in self.stages.iter_mut().zip(&pair.stages) {
            samples.ns.push(stage.ns);
            samples.submit_cost_ns.push(stage.submit_cost_ns);
            samples.resolution_ns.push(stage.resolution_ns);
        }
        self.rounds.push(pair.round);
        self.sampled_at_s.push(pair.sampled_at_s);
        self.machine.extend(pair.machine.clone());
        self.envelope_ns.push(pair.envelope_ns);
        self.gaps_ns.push(pair.gaps_ns);
        self.untimed_ns.push(pair.untimed_ns);
    }

    /// These stages, on the same clocks, were sampled before, or none were.
    pub fn has_stages(&self, stages: &[StageTime]) -> bool {
        let same = |(known, stage): (&StageSamples, &StageTime)| {
            known.name == stage.stage && known.clock == stage.clock
        };
        self.stages.is_empty()
            || self.stages.len() == stages.len() && self.stages.iter().zip(stages).all(same)
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
        let of = |samples: &[f64]| statistics::estimate(samples).relative_half_width();
        of(&self.envelope_ns).max(of(&self.untimed_ns))
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
    let stages = frame.stages.iter().map(|stage| StageTime {
        stage: stage.name.to_owned(),
        clock: stage.clock,
        ns: stage.ns,
        submit_cost_ns: stage.submit_cost_ns,
        resolution_ns: stage.resolution_ns,
    });
    FramePair {
        round,
        sampled_at_s,
        machine: None,
        stages: stages.collect(),
        envelope_ns: frame.envelope_ns,
        gaps_ns: frame.gaps_ns,
        untimed_ns,
    }
}

/// Why a pair of frames cannot be used: the timer's own reason first, then what no duration may be. A frame with several faults
/// is one rejected frame.
pub fn fault(frame: &FrameSample, untimed_ns: f64, before: &[StageSamples]) -> Option<Rejection> {
    if let Some(Fault { stage, kind, .. }) = frame.faults.first() {
        return Some(Rejection { stage: Some((*stage).to_owned()), fault: *kind });
    }
    let positive = |ns: f64| ns.is_finite() && ns > 0.0;
    // Less than nothing is left only where a cost was taken off, which scatters. What was read is more than nothing.
    let read = |stage: &StageSample| stage.ns + stage.submit_cost_ns;
    let same = frame.stages.len() == before.len()
        && frame.stages.iter().zip(before).all(|(now, before)| now.name == before.name);
    let faults = [
        (FaultKind::FrameNotPositive, !positive(frame.envelope_ns)),
        (FaultKind::UntimedNotPositive, !positive(untimed_ns)),
        (FaultKind::StageNotPositive, !frame.stages.iter().all(|stage| positive(read(stage)))),
        (FaultKind::OtherStages, !before.is_empty() && !same),
    ];
    faults.into_iter().find(|(_, found)| *found).map(|(fault, _)| fault.into())
}

//! What was sampled of one cell.

use std::collections::BTreeMap;

use itertools::Itertools;

use crate::{FrameSample, RejectedTime, StageTime};
use fathom_base::visits;
use fathom_record::{
    FaultKind, Fenced, MachineState, Measured, NoteKind, RejectedFrames, Rejection, StageRecord,
};

/// Timed frames before a cell is judged by how many of them were rejected.
pub const MIN_JUDGED_FRAMES: usize = 6;
/// Share of rejected frames above which a cell fails.
pub const MAX_REJECTED_SHARE: f64 = 0.5;

/// A timed frame and an untimed one, nanoseconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FramePair {
    /// The round of sampling: samples of one round were taken next to each other.
    pub round: u32,
    /// When it was sampled, seconds of Unix time.
    pub sampled_at_s: f64,
    /// The adapter at that moment, where its driver tells.
    pub machine: Option<MachineState>,
    /// Of two fixed kernels just before, where they were run, nanoseconds.
    pub pacer_ns: Option<[f64; 2]>,
    /// In frame order.
    pub stages: Vec<StageTime>,
    /// From the first stage's begin to the last stage's end, nanoseconds.
    pub envelope_ns: f64,
    /// Time between stages, nanoseconds.
    pub gaps_ns: f64,
    /// Frame time without per-stage timing, nanoseconds.
    pub frame_ns: f64,
}

/// Everything sampled of one cell. Durations in nanoseconds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Timed frames, each with an untimed one beside it. All have the same stages on the same clocks.
    pub pairs: Vec<FramePair>,
    pub warm_up_frames: u32,
    /// The frame time still fell when warm-up was given up.
    pub unsteady: bool,
    /// Timed frames never used, counted by reason.
    pub rejected: BTreeMap<Rejection, u32>,
    /// So many of the pairs, the first, are of an earlier run.
    pub earlier_pairs: usize,
}

impl Samples {
    /// Those that an earlier run left in a record.
    pub fn recorded(measured: &Measured) -> Self {
        let frame = &measured.frame;
        let pair = |number: usize| {
            let stages = measured.stages.iter().map(|stage| recorded_stage(stage, number));
            Some(FramePair {
                round: *frame.rounds.get(number)?,
                sampled_at_s: *frame.sampled_at_s.get(number)?,
                machine: frame.machine.get(number).cloned(),
                pacer_ns: frame.pacer_ns.get(number).copied(),
                stages: stages.collect::<Option<_>>()?,
                envelope_ns: *frame.envelope_samples_ns.get(number)?,
                gaps_ns: *frame.gap_samples_ns.get(number)?,
                frame_ns: *frame.untimed_samples_ns.get(number)?,
            })
        };
        let pairs = (0..).map_while(pair).collect_vec();
        let rejected = measured.rejected.iter().map(|of| (of.rejection.clone(), of.frames));
        Self {
            earlier_pairs: pairs.len(),
            pairs,
            warm_up_frames: measured.warm_up_frames,
            unsteady: measured.notes.iter().any(|note| note.kind == NoteKind::Unsteady),
            rejected: rejected.collect(),
        }
    }

    pub fn pairs(&self) -> usize {
        self.pairs.len()
    }

    /// Stages of the first pair: the names and clocks are those of all pairs. Empty where there is none.
    pub fn stages(&self) -> &[StageTime] {
        self.pairs.first().map_or(&[], |pair| &pair.stages)
    }

    /// A figure of each pair.
    pub fn each<T>(&self, of: impl Fn(&FramePair) -> T) -> Vec<T> {
        self.pairs.iter().map(of).collect()
    }

    /// States of the machine, where its driver told.
    pub(super) fn machine(&self) -> Vec<MachineState> {
        self.pairs.iter().filter_map(|pair| pair.machine.clone()).collect()
    }

    /// Adds a timed frame and the untimed one that was run beside it, in this round and at this second of Unix time, or why they cannot be
    /// used.
    pub fn add(
        &mut self,
        frame: FrameSample,
        frame_ns: f64,
        round: u32,
        sampled_at_s: f64,
        machine: Option<MachineState>,
        pacer_ns: Option<[f64; 2]>,
    ) {
        if let Some(reason) = fault(&frame, frame_ns, self.stages()) {
            *self.rejected.entry(reason).or_default() += 1;
            return;
        }
        let FrameSample { stages, gaps_ns, envelope_ns, .. } = frame;
        self.pairs.push(FramePair {
            round,
            sampled_at_s,
            machine,
            pacer_ns,
            stages,
            envelope_ns,
            gaps_ns,
            frame_ns,
        });
    }

    /// These stages, on the same clocks, were sampled before, or none were.
    pub fn has_stages(&self, stages: &[StageTime]) -> bool {
        let known = self.stages().iter().map(|stage| (&stage.stage, stage.clock));
        self.pairs.is_empty() || known.eq(stages.iter().map(|stage| (&stage.stage, stage.clock)))
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

    /// The number of each pair's visit.
    pub fn visits(&self) -> Vec<u32> {
        visits::numbers(&self.each(|pair| pair.sampled_at_s))
    }

    pub fn count_visits(&self) -> usize {
        self.visits().last().map_or(0, |last| *last as usize + 1)
    }

    /// Of the frame time, the wider of timed and untimed frames: half of its interval over its middle.
    pub fn relative_half_width(&self) -> f64 {
        let numbers = self.visits();
        let of = |samples: Vec<f64>| {
            visits::estimate_of_samples(&samples, &numbers).relative_half_width()
        };
        of(self.each(|pair| pair.envelope_ns)).max(of(self.each(|pair| pair.frame_ns)))
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

/// The time of a stage in the frame of this number of a record, whose resolution is that of all its frames.
fn recorded_stage(record: &StageRecord, number: usize) -> Option<StageTime> {
    let StageRecord { stage, clock, samples_ns, fenced, .. } = record;
    let (ns, submit_cost_ns, resolution_ns) = match fenced {
        None => (*samples_ns.get(number)?, 0.0, 0.0),
        Some(Fenced { wall_samples_ns, submit_cost_samples_ns, resolution_ns }) => {
            let cost_ns = *submit_cost_samples_ns.get(number)?;
            (wall_samples_ns.get(number)? - cost_ns, cost_ns, *resolution_ns)
        }
    };
    Some(StageTime { stage: stage.clone(), clock: *clock, ns, submit_cost_ns, resolution_ns })
}

/// Why a pair of frames cannot be used: the timer's own reason first, then what no duration may be. A frame with several faults
/// is one rejected frame.
fn fault(frame: &FrameSample, frame_ns: f64, before: &[StageTime]) -> Option<Rejection> {
    if let Some(RejectedTime { stage, kind, .. }) = frame.faults.first() {
        return Some(Rejection { stage: Some((*stage).to_owned()), fault: *kind });
    }
    let positive = |ns: f64| ns.is_finite() && ns > 0.0;
    // Less than nothing is left only where a cost was taken off, which scatters. What was read is more than nothing.
    let read = |stage: &StageTime| stage.ns + stage.submit_cost_ns;
    let names = |stages: &[StageTime]| stages.iter().map(|stage| stage.stage.clone()).collect_vec();
    let same = names(&frame.stages) == names(before);
    let faults = [
        (FaultKind::FrameNotPositive, !positive(frame.envelope_ns)),
        (FaultKind::UntimedNotPositive, !positive(frame_ns)),
        (FaultKind::StageNotPositive, !frame.stages.iter().all(|stage| positive(read(stage)))),
        (FaultKind::OtherStages, !before.is_empty() && !same),
    ];
    faults.into_iter().find(|(_, found)| *found).map(|(fault, _)| fault.into())
}

//! What was sampled of a cell, and which frame is next.

use std::time::{SystemTime, UNIX_EPOCH};

use crate::{FrameSample, Samples, StopReason, WarmUp};
use fathom_record::MachineState;

/// Pairs of frames at the first look at their precision, and at the last: as in fathom's own runs.
pub(super) const MIN_PAIRS: usize = 12;
const MAX_PAIRS: usize = 192;

/// When a cell has enough samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleTarget {
    /// Half the width of the frame time's 95 % interval over its median.
    pub precision: f64,
    /// Seconds after which no more frames are asked for, once there are 12 pairs.
    pub budget_s: f64,
}

impl Default for SampleTarget {
    /// 2 %, 30 s.
    fn default() -> Self {
        Self { precision: 0.02, budget_s: 30.0 }
    }
}

/// A frame that was run: with per-pass timing, or without, and how long it took.
pub(super) enum Sample {
    Timed(FrameSample),
    Untimed(f64),
}

pub(super) struct CellSampling {
    pub(super) samples: Samples,
    warm_up: WarmUp,
    /// Of the pair that has begun.
    timed: Option<FrameSample>,
    frame_ns: Option<f64>,
    /// Pairs at which the precision is looked at next.
    target: usize,
    /// Number of the next pair of the run.
    pub(super) round: u32,
}

impl CellSampling {
    pub(super) fn begin(round: u32) -> Self {
        Self {
            samples: Samples { stopped: StopReason::Interrupted, ..Samples::default() },
            warm_up: WarmUp::default(),
            timed: None,
            frame_ns: None,
            target: MIN_PAIRS,
            round,
        }
    }

    /// Another frame is needed for this precision. When it is late, there must be enough for an interval only.
    pub(super) fn wants_frame(&mut self, precision: f64, late: bool) -> bool {
        let pairs = self.samples.pairs();
        if self.samples.verdict_on_rejections().is_some() {
            return false;
        }
        if pairs < MIN_PAIRS || !late && pairs < self.target {
            return true;
        }
        let precise = self.samples.relative_half_width() <= precision;
        self.samples.stopped = match (precise, late) {
            (true, _) => StopReason::Precise,
            (_, true) => StopReason::OutOfTime,
            _ if pairs >= MAX_PAIRS => StopReason::EnoughPairs,
            _ => {
                self.target *= 2;
                return true;
            }
        };
        false
    }

    /// The next frame is one with per-pass timing. The kind that a pair begins with follows the Thue–Morse sequence, so that a
    /// steady drift favours neither.
    pub(super) fn times_next(&self) -> bool {
        match (&self.timed, self.frame_ns) {
            _ if !self.warm_up.is_over() => self.warm_up.is_timed(),
            (None, None) => self.round.count_ones().is_multiple_of(2),
            (timed, _) => timed.is_none(),
        }
    }

    /// A frame was run. `state` tells of the machine. Gives the frame's time.
    pub(super) fn add(&mut self, ran: Sample, state: impl FnOnce() -> Option<MachineState>) -> f64 {
        let wall_ns = match &ran {
            Sample::Timed(frame) => frame.envelope_ns,
            Sample::Untimed(wall_ns) => *wall_ns,
        };
        if !self.warm_up.is_over() {
            self.warm_up.add(wall_ns);
            self.samples.warm_up_frames = self.warm_up.frames;
            self.samples.unsteady = self.warm_up.is_over() && !self.warm_up.steady;
            return wall_ns;
        }
        match ran {
            Sample::Timed(frame) => self.timed = Some(frame),
            Sample::Untimed(wall_ns) => self.frame_ns = Some(wall_ns),
        }
        if let Some(frame_ns) = self.frame_ns
            && let Some(frame) = self.timed.take()
        {
            self.samples.add(frame, frame_ns, self.round, unix_s(), state());
            self.frame_ns = None;
            self.round += 1;
        }
        wall_ns
    }
}

/// Seconds of Unix time.
fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MAX_WARM_UP_FRAMES, RejectedTime, StageTime};
    use fathom_record::{Clock, FaultKind};

    fn frame(ns: f64) -> FrameSample {
        let stage = StageTime { clock: Clock::Timestamp, ns, ..StageTime::zero("blur") };
        FrameSample { stages: vec![stage], gaps_ns: 0.0, envelope_ns: ns, faults: Vec::new() }
    }

    /// Runs a frame of the kind that is due, whose time is `ns`; whether it was timed.
    fn run(sampled: &mut CellSampling, frame: FrameSample) -> bool {
        let timed = sampled.times_next();
        let ran = if timed { Sample::Timed(frame) } else { Sample::Untimed(frame.envelope_ns) };
        sampled.add(ran, || None);
        timed
    }

    /// Warm, with no pair yet.
    fn warm() -> CellSampling {
        let mut sampled = CellSampling::begin(0);
        for _ in 0..2 {
            run(&mut sampled, frame(1e6));
        }
        sampled
    }

    #[test]
    fn frames_that_become_faster_are_not_sampled() {
        let mut sampled = CellSampling::begin(0);
        for n in 0..MAX_WARM_UP_FRAMES {
            assert_eq!(run(&mut sampled, frame(1e9 / f64::from(1 << n))), n % 2 == 0);
        }
        let Samples { warm_up_frames, unsteady, .. } = &sampled.samples;
        assert_eq!((*warm_up_frames, *unsteady), (MAX_WARM_UP_FRAMES, true));
        assert_eq!((warm().samples.warm_up_frames, warm().samples.unsteady), (2, false));
        assert_eq!(sampled.samples.pairs() + warm().samples.pairs(), 0);
    }

    #[test]
    fn each_pair_has_a_frame_of_either_kind_and_each_kind_begins_half_of_them() {
        let mut sampled = warm();
        let order: Vec<bool> = (0..128).map(|_| run(&mut sampled, frame(1e6))).collect();
        assert!(order.chunks(2).all(|pair| pair[0] != pair[1]));
        assert_eq!(order.chunks(2).filter(|pair| pair[0]).count(), 32);
        assert_eq!(sampled.samples.each(|pair| pair.round), (0..64).collect::<Vec<_>>());
    }

    /// Pairs when no frame is wanted any more, of frames whose times vary by so much, and why.
    fn stopped(variation: f64, late: bool) -> (usize, StopReason) {
        let mut sampled = warm();
        let mut n = 0u32;
        while sampled.wants_frame(0.02, late) {
            n += 1;
            run(&mut sampled, frame(1e6 * (1.0 + variation * f64::from(n * 7 % 11))));
        }
        (sampled.samples.pairs(), sampled.samples.stopped)
    }

    #[test]
    fn sampling_ends_when_it_is_precise_or_late_or_has_the_most_pairs() {
        assert_eq!(stopped(1e-4, false), (MIN_PAIRS, StopReason::Precise));
        assert_eq!(stopped(1.0, true), (MIN_PAIRS, StopReason::OutOfTime));
        assert_eq!(stopped(1.0, false), (MAX_PAIRS, StopReason::EnoughPairs));
    }

    #[test]
    fn impossible_durations_are_rejected_and_end_the_sampling() {
        let mut sampled = warm();
        let mut frames = 0;
        while sampled.wants_frame(0.02, false) {
            let fault = RejectedTime { stage: "blur", kind: FaultKind::Zero, ns: 0.0 };
            run(&mut sampled, FrameSample { faults: vec![fault], ..frame(1e6) });
            frames += 1;
        }
        assert_eq!((frames, sampled.samples.pairs()), (12, 0));
        let reason = sampled.samples.verdict_on_rejections().unwrap();
        assert_eq!(reason, "6 of 6 timed frames rejected: blur: zero duration (6 times)");
    }
}

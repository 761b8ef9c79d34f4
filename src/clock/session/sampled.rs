//! What was sampled of a cell, and which frame is next.

use std::time::{SystemTime, UNIX_EPOCH};

use crate::{FrameSample, Samples, WarmUp};
use fathom_base::visits::VISIT_S;
use fathom_record::MachineState;

/// Pairs of frames of a visit: more of them show the same state of the machine again.
pub(super) const VISIT_PAIRS: usize = 12;

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
    /// Number of the next pair of the run.
    pub(super) round: u32,
    /// When the first pair of the visit was sampled, seconds of Unix time, and how many there are.
    visit: (f64, usize),
    /// The frame that is run is of a pair, or of the warm-up.
    counts: bool,
}

impl CellSampling {
    pub(super) fn begin(round: u32) -> Self {
        Self {
            samples: Samples::default(),
            warm_up: WarmUp::default(),
            timed: None,
            frame_ns: None,
            round,
            visit: (f64::NEG_INFINITY, 0),
            counts: false,
        }
    }

    /// Another frame is needed: there is time, or nothing was sampled yet.
    pub(super) fn wants_frame(&self, late: bool) -> bool {
        let has_failed = self.samples.verdict_on_rejections().is_some();
        !has_failed && (!late || self.samples.pairs() == 0)
    }

    /// A frame begins at this second of Unix time: whether with per-pass timing. The kind that a pair begins with follows the Thue–Morse
    /// sequence, so that a steady drift favours neither. Beyond the pairs of a visit frames are run without and not sampled.
    pub(super) fn times_next(&mut self, now_s: f64) -> bool {
        let is_due = now_s - self.visit.0 >= VISIT_S || self.visit.1 < VISIT_PAIRS;
        let has_begun = self.timed.is_some() || self.frame_ns.is_some();
        self.counts = !self.warm_up.is_over() || has_begun || is_due;
        match (&self.timed, self.frame_ns) {
            _ if !self.warm_up.is_over() => self.warm_up.is_timed(),
            (None, None) => is_due && self.round.count_ones().is_multiple_of(2),
            (timed, _) => timed.is_none(),
        }
    }

    /// A frame was run up to this second of Unix time. `state` tells of the machine. Gives the frame's time.
    pub(super) fn add(
        &mut self,
        ran: Sample,
        now_s: f64,
        state: impl FnOnce() -> Option<MachineState>,
    ) -> f64 {
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
        if !self.counts {
            return wall_ns;
        }
        match ran {
            Sample::Timed(frame) => self.timed = Some(frame),
            Sample::Untimed(wall_ns) => self.frame_ns = Some(wall_ns),
        }
        if let Some(frame_ns) = self.frame_ns
            && let Some(frame) = self.timed.take()
        {
            self.samples.add(frame, frame_ns, self.round, now_s, state(), None);
            let (first_s, pairs) = self.visit;
            self.visit = if now_s - first_s >= VISIT_S { (now_s, 1) } else { (first_s, pairs + 1) };
            self.frame_ns = None;
            self.round += 1;
        }
        wall_ns
    }
}

/// Seconds of Unix time.
pub(super) fn unix_s() -> f64 {
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

    /// Runs a frame of the kind that is due at this second; whether it was timed.
    fn run(sampled: &mut CellSampling, frame: FrameSample, now_s: f64) -> bool {
        let timed = sampled.times_next(now_s);
        let ran = if timed { Sample::Timed(frame) } else { Sample::Untimed(frame.envelope_ns) };
        sampled.add(ran, now_s, || None);
        timed
    }

    /// Warm, with no pair yet.
    fn warm() -> CellSampling {
        let mut sampled = CellSampling::begin(0);
        for _ in 0..2 {
            run(&mut sampled, frame(1e6), 0.0);
        }
        sampled
    }

    #[test]
    fn frames_that_become_faster_are_not_sampled() {
        let mut sampled = CellSampling::begin(0);
        for n in 0..MAX_WARM_UP_FRAMES {
            assert_eq!(run(&mut sampled, frame(1e9 / f64::from(1 << n)), 0.0), n % 2 == 0);
        }
        let Samples { warm_up_frames, unsteady, .. } = &sampled.samples;
        assert_eq!((*warm_up_frames, *unsteady), (MAX_WARM_UP_FRAMES, true));
        assert_eq!((warm().samples.warm_up_frames, warm().samples.unsteady), (2, false));
        assert_eq!(sampled.samples.pairs() + warm().samples.pairs(), 0);
    }

    #[test]
    fn each_pair_has_a_frame_of_either_kind_and_each_kind_begins_half_of_them() {
        let mut sampled = warm();
        let mut run = |n: u32| run(&mut sampled, frame(1e6), f64::from(n));
        let order: Vec<bool> = (0..128).map(&mut run).collect();
        assert!(order.chunks(2).all(|pair| pair[0] != pair[1]));
        assert_eq!(order.chunks(2).filter(|pair| pair[0]).count(), 32);
        assert_eq!(sampled.samples.each(|pair| pair.round), (0..64).collect::<Vec<_>>());
    }

    /// A frame takes a tenth of a second; samples of the same ten seconds are one visit.
    #[test]
    fn a_visit_has_so_many_pairs_however_many_frames_are_rendered() {
        let mut sampled = warm();
        let mut frames = 0;
        while sampled.wants_frame(frames >= 900) {
            run(&mut sampled, frame(1e8), 0.1 * f64::from(frames));
            frames += 1;
        }
        let visits = sampled.samples.visits();
        let of = |number| visits.iter().filter(|visit| **visit == number).count();
        assert_eq!(frames, 900);
        let whole = visits[visits.len() - 1];
        assert!((0..whole).all(|number| of(number) == VISIT_PAIRS) && whole >= 7, "{visits:?}");
    }

    #[test]
    fn impossible_durations_are_rejected_and_end_the_sampling() {
        let mut sampled = warm();
        let mut frames = 0;
        while sampled.wants_frame(false) {
            let fault = RejectedTime { stage: "blur", kind: FaultKind::Zero, ns: 0.0 };
            run(&mut sampled, FrameSample { faults: vec![fault], ..frame(1e6) }, 0.0);
            frames += 1;
        }
        assert_eq!((frames, sampled.samples.pairs()), (12, 0));
        let reason = sampled.samples.verdict_on_rejections().unwrap();
        assert_eq!(reason, "6 of 6 timed frames rejected: blur: zero duration (6 times)");
    }
}

//! Frames on a modelled GPU, whose true times are known, by clocks of all kinds.

use super::*;
use crate::frame::clock_fault::ClockFault;
use crate::frame::scope::EncodedPass;
use fathom_record::SubmitCost;

/// What the host takes before the first pass and after the last one, ns.
const SUBMISSION_NS: f64 = 30e3;

/// A GPU whose timestamps have these faults. It runs frames of one command buffer.
pub(crate) struct ModelledGpu {
    timer: FrameTimer,
    faults: Vec<ClockFault>,
    now_ns: f64,
}

impl ModelledGpu {
    pub(crate) fn with(faults: &[ClockFault]) -> Self {
        let period = faults.iter().find_map(|fault| match fault {
            ClockFault::Period(ns) => Some(*ns),
            _ => None,
        });
        let fenced = ClockPlan::fenced(SubmitCost::default());
        let timer = FrameTimer {
            plan: PassKind::TIMED
                .into_iter()
                .fold(fenced, |plan, kind| plan.with(kind, Clock::Timestamp)),
            period_ns: period.unwrap_or(1.0),
            max_passes: 0,
            queries: None,
            recorder: Recorder::default(),
            metering: SubmissionMeter::default(),
            spans: Vec::new(),
            ticks: Vec::new(),
            previous: Vec::new(),
            step: 0,
            refused: None,
        };
        Self { timer, faults: faults.to_vec(), now_ns: 3e14 }
    }

    /// Runs a pass of each of these times, ns, with so much between two of them.
    pub(crate) fn frame(&mut self, passes_ns: &[f64], gap_ns: f64) -> FrameSample {
        let timer = &mut self.timer;
        let submit_ns = self.now_ns;
        self.now_ns += SUBMISSION_NS;
        timer.recorder.reset();
        std::mem::swap(&mut timer.ticks, &mut timer.previous);
        timer.ticks.clear();
        for (stage, ns) in passes_ns.iter().enumerate() {
            let (begin, end) = (self.now_ns, self.now_ns + ns);
            let query = Some(stage as u32);
            timer.recorder.passes.push(EncodedPass {
                stage,
                kind: PassKind::Compute,
                query,
                targets: vec![],
            });
            timer.ticks.push([begin, end].map(|ns| ns.round() as u64));
            self.now_ns = end + gap_ns;
        }
        self.now_ns += SUBMISSION_NS - gap_ns;
        // The first fault is the period, if that is one.
        let mut period_ns = 1.0;
        for fault in &self.faults {
            fault.distort(&mut timer.ticks, period_ns);
            period_ns = timer.period_ns;
        }
        timer.note_step();
        let passes = 0..passes_ns.len();
        let fence_ns = self.now_ns;
        timer.spans =
            vec![PassSpan { metered_ns: submit_ns, submit_ns, fence_ns, passes, fenced: false }];
        timer.evaluate(&["a", "b", "c"][..passes_ns.len()])
    }

    pub(crate) fn step_ns(&self) -> f64 {
        self.timer.step_ns()
    }
}

#[test]
fn times_are_right_whatever_the_period_and_where_the_counter_begins_again() {
    for period_ns in [1.0, 10.0, 13.02, 52.08, 83.33] {
        for bits in [36, 40, 63] {
            let faults = [ClockFault::Period(period_ns), ClockFault::Bits(bits)];
            let mut gpu = ModelledGpu::with(&faults);
            for length in [1.0, 1.317, 2.473, 7.731] {
                let passes_ns = [0.217e6 * length, 1.003e6 * length, 51_977.0];
                let frame = gpu.frame(&passes_ns, 2e3);
                assert_eq!(frame.faults, [], "{faults:?}");
                for (stage, ns) in frame.stages.iter().zip(passes_ns) {
                    assert!(
                        (stage.ns - ns).abs() <= 2.0 * period_ns,
                        "{faults:?}: {stage:?}, {ns}"
                    );
                }
                assert!((frame.gaps_ns - 4e3).abs() <= 4.0 * period_ns, "{}", frame.gaps_ns);
            }
            assert!(gpu.step_ns() < 2.0 * period_ns, "{}", gpu.step_ns());
        }
    }
}

#[test]
fn a_frame_with_impossible_timestamps_has_a_fault() {
    for (fault, kind) in [
        (ClockFault::Zero, FaultKind::Zero),
        (ClockFault::Equal, FaultKind::Zero),
        (ClockFault::Backwards, FaultKind::Negative),
        (ClockFault::Period(0.5), FaultKind::LongerThanWall),
    ] {
        let mut gpu = ModelledGpu::with(&[fault]);
        if fault == ClockFault::Period(0.5) {
            // A driver that counts half nanoseconds and says that it counts whole ones.
            gpu.timer.period_ns = 1.0;
        }
        let frame = gpu.frame(&[1e6], 0.0);
        assert_eq!(frame.faults.iter().map(|fault| fault.kind).collect::<Vec<_>>(), [kind]);
        assert!(frame.stages[0].ns.is_nan(), "{fault:?}");
    }
}

#[test]
fn the_shorter_way_around_counts_between_timestamps_of_few_bits() {
    let last = (1u64 << 36) - 1;
    assert_eq!(signed_ticks(last, 4), 5.0);
    assert_eq!(signed_ticks(4, last), -5.0);
    assert_eq!(signed_ticks((1 << 40) - 3, 7), 10.0);
    // More than 36 bits: nothing begins again here.
    assert_eq!(signed_ticks(last, last + 10), 10.0);
    assert_eq!(signed_ticks(1 << 50, (1 << 50) - 3), -3.0);
    assert_eq!(signed_ticks(u64::MAX, 1), 2.0);
}

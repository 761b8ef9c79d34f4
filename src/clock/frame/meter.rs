//! The current cost of a submission, and the shortest pass that is distinguishable from none.
//!
//! A pass on the fenced host clock is timed from its submission to its fence. Its own time is that less the cost of a
//! submission. The cost depends on what else runs on the machine, so it is measured in the frame itself: before some of the
//! frame's segments the smallest pass of the same kind is submitted, outside the frame's envelope. The median of the latest such
//! times is subtracted.
//!
//! The costs scatter, so a difference smaller than that scatter says nothing; it can even be negative. The scatter of the latest
//! costs therefore gives the *resolution*. A time that is not longer is recorded as "below the resolution". No sample is dropped, and
//! a median above the resolution does not depend on what replaces the samples below it.

use std::collections::{BTreeMap, VecDeque};

use super::host_clock::HostClock;
use super::probe::Probe;
use crate::{Device, DeviceError};
use fathom_base::statistics::{median, outliers};
use fathom_record::PassKind;

/// Number of latest costs. Their median is subtracted, their scatter gives the resolution. They come from some six frames, so
/// that a machine that becomes busy is noticed soon. Nine were too few: on a busy machine, bursts in which the process waits for a core
/// made their median 40 times too large.
const WINDOW: usize = 24;
/// Standard deviations of the smallest difference that is distinguishable from zero, with 5 % of errors either way. Currie, *Limits for
/// Qualitative Detection and Quantitative Determination*, Anal. Chem. 40 (1968).
const DETECTION: f64 = 3.29;
/// Variance of a median of n normal values: π / 2n times that of one.
const MEDIAN_VARIANCE: f64 = std::f64::consts::FRAC_PI_2 / WINDOW as f64;
/// The scatter counts as at least this share of the cost: even if the latest costs are all equal, the next one may differ.
const MIN_SIGMA_SHARE: f64 = 0.02;
/// Smallest passes that are timed before the first segment of a kind, to know the scatter.
const FIRST_PROBES: usize = 16;
/// Segments of each kind in a frame before which the cost is measured.
const PROBES_PER_FRAME: usize = 4;

/// Submissions of each kind that a stage consists of.
pub(crate) type SubmissionCounts = BTreeMap<PassKind, u32>;

/// The latest costs of a submission, by kind of pass.
#[derive(Clone, Debug, Default)]
pub struct CostMeter {
    latest: BTreeMap<PassKind, VecDeque<f64>>,
}

impl CostMeter {
    /// Adds the host time of a smallest pass, ns.
    pub fn push(&mut self, kind: PassKind, ns: f64) {
        let latest = self.latest.entry(kind).or_default();
        if latest.len() == WINDOW {
            latest.pop_front();
        }
        latest.push_back(ns);
    }

    fn len(&self, kind: PassKind) -> usize {
        self.latest.get(&kind).map_or(0, VecDeque::len)
    }

    /// What a submission of this kind costs now, ns; none where it was never measured.
    pub fn cost_ns(&self, kind: PassKind) -> Option<f64> {
        let latest = self.latest.get(&kind)?;
        Some(median(&Vec::from_iter(latest.iter().copied())))
    }

    /// Standard deviation of one submission's cost, from the median absolute deviation of the latest.
    fn sigma_ns(&self, kind: PassKind) -> f64 {
        let Some(latest) = self.latest.get(&kind) else {
            return 0.0;
        };
        let latest = Vec::from_iter(latest.iter().copied());
        outliers(&latest).sigma.max(MIN_SIGMA_SHARE * median(&latest))
    }

    /// The duration below which a stage of so many submissions is indistinguishable from one that takes no time, ns. Each submission
    /// scatters independently; the error of the subtracted cost is common to all of a kind.
    pub fn resolution_ns(&self, submissions: &SubmissionCounts) -> f64 {
        let variance = |(kind, count): (&PassKind, &u32)| {
            let count = f64::from(*count);
            self.sigma_ns(*kind).powi(2) * (count + count.powi(2) * MEDIAN_VARIANCE)
        };
        DETECTION * submissions.iter().map(variance).sum::<f64>().sqrt()
    }
}

#[derive(Default)]
pub(super) struct SubmissionMeter {
    clock: HostClock,
    pub(super) meter: CostMeter,
    probe: Option<Probe>,
    frame: usize,
    /// Of the frame that runs: segments of each kind, and how many of them have been submitted.
    segments: BTreeMap<PassKind, (usize, usize)>,
}

impl SubmissionMeter {
    pub(super) fn new(clock: HostClock) -> Self {
        Self { clock, ..Self::default() }
    }

    /// A frame begins whose segments begin with passes of these kinds, `Host` where a segment has none. A frame without a fenced
    /// segment needs no costs.
    pub(super) fn begin(&mut self, kinds: &[PassKind], fenced: bool) {
        self.frame = self.frame.wrapping_add(1);
        self.segments.clear();
        for kind in kinds.iter().filter(|kind| fenced && **kind != PassKind::Host) {
            self.segments.entry(*kind).or_default().0 += 1;
        }
    }

    /// Called before a segment that begins with a pass of this kind is submitted.
    pub(super) fn before(&mut self, gpu: &Device, kind: PassKind) -> Result<(), DeviceError> {
        let Some((count, done)) = self.segments.get_mut(&kind) else {
            return Ok(());
        };
        let due = is_due(*done, *count, self.frame);
        *done += 1;
        if due || self.meter.len(kind) < FIRST_PROBES { self.probe(gpu, kind) } else { Ok(()) }
    }

    /// Measures the cost now: once, or as often as its scatter needs where it was never measured.
    pub(super) fn probe(&mut self, gpu: &Device, kind: PassKind) -> Result<(), DeviceError> {
        if self.meter.len(kind) >= FIRST_PROBES {
            return self.measure(gpu, kind);
        }
        // The first one includes the compilation of its shader.
        self.time(gpu, kind)?;
        (0..FIRST_PROBES).try_for_each(|_| self.measure(gpu, kind))
    }

    fn measure(&mut self, gpu: &Device, kind: PassKind) -> Result<(), DeviceError> {
        let ns = self.time(gpu, kind)?;
        self.meter.push(kind, ns);
        Ok(())
    }

    fn time(&mut self, gpu: &Device, kind: PassKind) -> Result<f64, DeviceError> {
        if self.probe.is_none() {
            self.probe = Some(Probe::new(gpu)?);
        }
        self.probe.as_ref().map_or(Ok(0.0), |probe| probe.time(gpu, kind, self.clock))
    }
}

/// Whether the cost is measured before this segment: [`PROBES_PER_FRAME`] times a frame, before other segments in the next frame.
fn is_due(number: usize, count: usize, frame: usize) -> bool {
    (number + frame).is_multiple_of(count.div_ceil(PROBES_PER_FRAME).max(1))
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    const KIND: PassKind = PassKind::Compute;

    /// A cost of some 60 µs, as on a quiet machine; on a busy one every third waits for a core for up to 4 ms.
    fn cost_ns(random: &mut Pcg64, busy: bool) -> f64 {
        let wait_ns =
            if busy && random.random_bool(1.0 / 3.0) { random.random_range(0.0..4e6) } else { 0.0 };
        60e3 * random.random_range(0.8..1.25) + wait_ns
    }

    /// The differences that 200 passes of this length leave, one probe before each, and the median resolution.
    fn measured(pass_ns: f64, busy: bool) -> (Vec<f64>, f64) {
        let mut random = Pcg64::seed_from_u64(5);
        let mut meter = CostMeter::default();
        for _ in 0..FIRST_PROBES {
            meter.push(KIND, cost_ns(&mut random, busy));
        }
        let one = SubmissionCounts::from([(KIND, 1)]);
        let (mut differences, mut resolutions) = (Vec::new(), Vec::new());
        for _ in 0..200 {
            meter.push(KIND, cost_ns(&mut random, busy));
            let wall_ns = pass_ns + cost_ns(&mut random, busy);
            differences.push(wall_ns - meter.cost_ns(KIND).unwrap());
            resolutions.push(meter.resolution_ns(&one));
        }
        (differences, median(&resolutions))
    }

    #[test]
    fn a_pass_without_work_is_below_the_resolution_on_a_quiet_and_on_a_busy_machine() {
        for busy in [false, true] {
            let (differences, resolution_ns) = measured(0.0, busy);
            let below = differences.iter().filter(|ns| **ns <= resolution_ns).count();
            assert!(differences.iter().any(|ns| *ns < 0.0), "busy {busy}: the noise is none");
            assert!(below > differences.len() / 2, "busy {busy}: {below} of {}", differences.len());
        }
    }

    #[test]
    fn a_pass_above_the_resolution_keeps_its_time() {
        for busy in [false, true] {
            let (differences, resolution_ns) = measured(0.4e6, busy);
            let middle = median(&differences);
            assert!(resolution_ns < 0.4e6, "busy {busy}: {resolution_ns}");
            assert!((middle - 0.4e6).abs() < 0.1 * 0.4e6, "busy {busy}: {middle}");
        }
    }

    #[test]
    fn the_cost_follows_a_machine_that_becomes_busy() {
        let mut meter = CostMeter::default();
        (0..WINDOW).for_each(|_| meter.push(KIND, 60e3));
        (0..=WINDOW / 2).for_each(|_| meter.push(KIND, 900e3));
        assert_eq!(meter.cost_ns(KIND), Some(900e3));
        assert_eq!(meter.cost_ns(PassKind::Copy), None);
    }

    #[test]
    fn costs_that_are_all_alike_have_a_resolution_and_more_submissions_a_coarser_one() {
        let mut meter = CostMeter::default();
        (0..WINDOW).for_each(|_| meter.push(KIND, 60e3));
        let of = |count| meter.resolution_ns(&SubmissionCounts::from([(KIND, count)]));
        assert!(of(1) > 0.0);
        assert!(of(4) > 2.0 * of(1) && of(4) < 4.0 * of(1));
        assert_eq!(meter.resolution_ns(&SubmissionCounts::new()), 0.0);
    }

    #[test]
    fn the_cost_is_measured_before_each_segment_in_turn() {
        for count in [1, 2, 5, 12] {
            let of_frame = |frame| (0..count).filter(|n| is_due(*n, count, frame)).count();
            assert!((0..count).all(|frame| (1..=PROBES_PER_FRAME).contains(&of_frame(frame))));
            let ever = |n: &usize| (0..count).any(|frame| is_due(*n, count, frame));
            assert!((0..count).filter(ever).count() == count);
        }
    }
}

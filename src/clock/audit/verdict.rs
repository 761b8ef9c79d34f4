//! The audit's verdict on each clock, from its measurements.

use super::LEVELS;
use fathom_base::statistics;
use fathom_record::{AuditRow, Clock, PassKind, Surrounding};

/// Timestamp over host time at which a clock is sound: within this factor of 1 either way. Drivers known
/// to be wrong report 0 or a half. What a submission with work costs beyond an empty one is left in the host's
/// time: 0.1 to 0.3 ms of some 4 ms on lavapipe.
const ALONE_TOLERANCE: f64 = 1.15;
/// The shares of two frames are compared here, not one submission with itself.
const MIXED_TOLERANCE: f64 = 1.25;
/// A ratio whose distance from 1, as a share of the tolerance's on a logarithmic scale, is in this range
/// calls for more rounds.
const CLOSE: std::ops::Range<f64> = 0.6..2.0;
/// A kernel alone must double by the host clock within this factor of 2, or there is nothing to hold
/// timestamps against. Wide, as a busy machine or a changing clock rate moves it.
const HOST_DOUBLING_TOLERANCE: f64 = 1.35;
/// Of the rounds' ratios alone: a thread that is woken late lengthens the host's side of a submission and
/// never shortens it, so the undisturbed rounds are those of high ratio.
const ALONE_QUANTILE: f64 = 0.75;
/// Of the process's CPU time the round of the highest ratio counts: other processes lengthen the wall's side where the machine is
/// busy, and no side is ever shortened. Threads that work at the same time raise every round.
const CPU_QUANTILE: f64 = 1.0;
/// The least such ratio: of a core that others share, all rounds may have to wait. Where the work were done elsewhere, hardly
/// any CPU time would be left, and it would not double.
const MIN_CPU_RATIO: f64 = 0.25;
/// Share of durations that may be impossible (zero, negative, stale, longer than the wall).
const FAULTY_SHARE: f64 = 0.1;

/// Step of timestamps beyond which the fenced host clock is finer: on a quiet machine the costs of submissions scatter by about as much.
const COARSEST_STEP_NS: f64 = 10_000.0;

/// Times of one kind of pass in one surrounding, round by round, at N and at 2 N.
pub(super) struct Series {
    /// The audited clock: timestamps or the CPU time of the process. It is compared with the fenced host clock.
    clock: Clock,
    clock_ns: [Vec<f64>; LEVELS],
    host_ns: [Vec<f64>; LEVELS],
    faults: usize,
    /// All timestamps are multiples of this.
    pub(super) step_ns: f64,
}

impl Series {
    pub(super) fn new(clock: Clock) -> Self {
        Self {
            clock,
            clock_ns: Default::default(),
            host_ns: Default::default(),
            faults: 0,
            step_ns: 0.0,
        }
    }

    pub(super) fn push(&mut self, level: usize, clock_ns: f64, host_ns: f64, faults: usize) {
        self.clock_ns[level].push(clock_ns);
        self.host_ns[level].push(host_ns);
        self.faults += faults;
    }

    /// Timestamp over host time at N (level 0) or 2 N (level 1), this quantile of the rounds'.
    fn ratio(&self, level: usize, at: f64) -> f64 {
        let pairs = self.clock_ns[level].iter().zip(&self.host_ns[level]);
        let ratios: Vec<f64> = pairs.map(|(clock, host)| clock / host).collect();
        quantile(&ratios, at)
    }
}

/// Time at 2 N over that at N: the median over the rounds.
fn doubling(levels: &[Vec<f64>; LEVELS]) -> f64 {
    let pairs = levels[0].iter().zip(&levels[1]).filter(|(single, _)| **single > 0.0);
    let ratios: Vec<f64> = pairs.map(|(single, double)| double / single).collect();
    median(&ratios)
}

/// Distance of a ratio from 1 as a factor of at least 1; infinite where it is not positive.
pub(super) fn factor(ratio: f64) -> f64 {
    if ratio > 0.0 { ratio.max(1.0 / ratio) } else { f64::INFINITY }
}

fn is_close(factor: f64, tolerance: f64) -> bool {
    CLOSE.contains(&(factor.ln() / tolerance.ln()))
}

/// The row for one kind of pass, and whether its verdict is close. `apart` is given for mixed frames: which
/// kinds were not among the mixed.
pub(super) fn judge(kind: PassKind, apart: Option<&str>, series: &Series) -> (AuditRow, bool) {
    let mixed = apart.is_some();
    let at = match series.clock {
        _ if mixed => 0.5,
        Clock::ProcessCpu => CPU_QUANTILE,
        _ => ALONE_QUANTILE,
    };
    let mut row = AuditRow {
        clock: series.clock,
        pass: kind,
        context: if mixed { Surrounding::Mixed } else { Surrounding::Alone },
        clock_ns: median(&series.clock_ns[0]),
        host_ns: median(&series.host_ns[0]),
        ratio: series.ratio(0, at),
        doubling: doubling(&series.clock_ns),
        sound: false,
        reason: String::new(),
    };
    let (verdict, close) = verdict(series, mixed, [row.ratio, series.ratio(1, at)]);
    row.sound = verdict.is_ok();
    row.reason = verdict.unwrap_or_else(|reason| reason) + apart.unwrap_or_default();
    (row, close)
}

/// Why the clock is sound or why not, by its ratios at N and 2 N, and whether more rounds may change that.
fn verdict(series: &Series, mixed: bool, ratios: [f64; LEVELS]) -> (Result<String, String>, bool) {
    let durations = series.clock_ns.iter().flatten().count();
    if series.faults as f64 > FAULTY_SHARE * durations as f64 {
        let reason = format!("{} of {durations} durations cannot be true", series.faults);
        return (Err(reason), false);
    }
    if series.step_ns > COARSEST_STEP_NS {
        let reason = format!("timestamps are multiples of {:.1} µs", series.step_ns * 1e-3);
        return (Err(reason), false);
    }
    let tolerance = if mixed { MIXED_TOLERANCE } else { ALONE_TOLERANCE };
    let by_cpu = series.clock == Clock::ProcessCpu;
    let waited = |ratio: f64| by_cpu && (MIN_CPU_RATIO..1.0).contains(&ratio);
    let [single, double] = ratios.map(|ratio| if waited(ratio) { 1.0 } else { factor(ratio) });
    // A busy machine spoils the wall's doubling, and not that of the CPU time.
    let host_doubling = doubling(if by_cpu { &series.clock_ns } else { &series.host_ns });
    let subject = if by_cpu { "the process's CPU time is" } else { "timestamps read" };
    let disturbed = !mixed && factor(host_doubling / 2.0) > HOST_DOUBLING_TOLERANCE;
    let close = disturbed || is_close(single, tolerance) || is_close(double, tolerance);
    let verdict = if single > tolerance {
        Err(format!("{subject} {:.2} of the host time", ratios[0]))
    } else if double > tolerance {
        Err(format!("{subject} {:.2} of the host time of double work", ratios[1]))
    } else if disturbed {
        Err(format!("double work took {host_doubling:.2} times as long: nothing to judge by"))
    } else {
        Ok(format!("agrees with the host clock; double work took {host_doubling:.2}"))
    };
    (verdict, close)
}

/// The median; 0 of nothing.
pub(super) fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// 0 of nothing.
fn quantile(values: &[f64], at: f64) -> f64 {
    if values.is_empty() { 0.0 } else { statistics::quantile(values, at) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A series of rounds with these times at N, doubled at 2 N, a little noise on each.
    fn series(timestamp_ns: f64, host_ns: f64) -> Series {
        let mut series = Series::new(Clock::Timestamp);
        for round in 0..9 {
            let noise = 1.0 + 0.02 * f64::from(round % 3 - 1);
            series.push(0, timestamp_ns * noise, host_ns, 0);
            series.push(1, 2.0 * timestamp_ns * noise, 2.0 * host_ns, 0);
        }
        series
    }

    fn verdict(series: &Series) -> (bool, bool) {
        let (row, close) = judge(PassKind::Compute, None, series);
        (row.sound, close)
    }

    #[test]
    fn timestamps_are_sound_that_agree_and_close_near_the_tolerance() {
        assert_eq!(verdict(&series(5e6, 5.05e6)), (true, false));
        for ns in [2.5e6, 5e3, 0.0] {
            assert_eq!(verdict(&series(ns, 5e6)), (false, false), "{ns}");
        }
        assert_eq!(verdict(&series(5e6, 6.2e6)), (false, true));
        assert_eq!(verdict(&series(5e6, 5.6e6)), (true, true));
    }

    #[test]
    fn a_fixed_reading_and_impossible_durations_are_unsound_whatever_their_median() {
        let mut fixed = series(5e6, 5e6);
        fixed.clock_ns[1] = fixed.clock_ns[0].clone();
        assert!(!verdict(&fixed).0, "it does not double");
        let mut faulty = series(5e6, 5e6);
        faulty.faults = 4;
        assert_eq!(verdict(&faulty), (false, false));
    }

    /// CPU time of this share of the wall time of an undisturbed round; three of four rounds wait for the core.
    fn by_cpu(share: f64) -> (bool, bool) {
        let mut series = Series::new(Clock::ProcessCpu);
        for round in 0..8 {
            let waited = if round % 4 == 0 { 1.5 } else { 2.2 };
            for level in 0..LEVELS {
                let work_ns = 5e6 * (1 << level) as f64;
                series.push(level, share * work_ns, waited * work_ns, 0);
            }
        }
        let (row, close) = judge(PassKind::Compute, None, &series);
        (row.sound, close)
    }

    #[test]
    fn cpu_time_is_sound_on_a_busy_machine_and_not_with_several_threads() {
        assert_eq!(by_cpu(1.0), (true, false));
        assert_eq!(by_cpu(2.9), (false, false), "two threads");
        assert!(!by_cpu(0.1).0, "the work is done elsewhere");
    }

    #[test]
    fn a_disturbed_host_clock_decides_nothing() {
        let mut disturbed = series(5e6, 5e6);
        disturbed.host_ns[1].iter_mut().for_each(|ns| *ns *= 1.4);
        disturbed.clock_ns[1].iter_mut().for_each(|ns| *ns *= 1.4);
        assert_eq!(verdict(&disturbed), (false, true));
    }
}

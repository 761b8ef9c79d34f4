//! The scheduler on a machine whose submissions cost more at times than a stage lasts.

use super::*;
use fathom_clock::{CostMeter, accounting_error, stage_record};
use fathom_record::PassKind;

/// A frame with a stage of no length and one of 4 ms, both fenced, timed by a meter whose submissions cost 60 µs, and every
/// third time up to 4 ms more.
pub struct BusyMachine {
    meter: CostMeter,
    random: Pcg64,
}

impl BusyMachine {
    fn submission_ns(&mut self) -> f64 {
        let waits = self.random.random_bool(1.0 / 3.0);
        let wait_ns = self.random.random_range(0.0..4e6);
        60e3 * self.random.random_range(0.8..1.25) + if waits { wait_ns } else { 0.0 }
    }

    fn stage(&mut self, name: &'static str, length_ns: f64) -> StageTime {
        let probe_ns = self.submission_ns();
        self.meter.push(PassKind::Compute, probe_ns);
        let submit_cost_ns = self.meter.cost_ns(PassKind::Compute).expect("one was taken");
        StageTime {
            stage: name.into(),
            clock: Clock::FencedHost,
            ns: length_ns + self.submission_ns() - submit_cost_ns,
            submit_cost_ns,
            resolution_ns: self.meter.resolution_ns(&[(PassKind::Compute, 1)].into()),
        }
    }

    pub fn timed(&mut self) -> FrameSample {
        let stages = vec![self.stage("none", 0.0), self.stage("long", 4e6)];
        let cost_ns: f64 = stages.iter().map(|stage| stage.submit_cost_ns).sum();
        let ns: f64 = stages.iter().map(|stage| stage.ns).sum();
        FrameSample { stages, gaps_ns: cost_ns, envelope_ns: ns + cost_ns, faults: Vec::new() }
    }

    pub fn untimed_ns(&mut self) -> f64 {
        4e6 + self.submission_ns()
    }
}

#[test]
fn costs_that_scatter_fail_no_cell_and_leave_no_time_of_zero_or_less() {
    let busy = BusyMachine { meter: CostMeter::default(), random: Pcg64::seed_from_u64(11) };
    let mock = Mock { busy: Some(busy), ..Mock::new(vec![STEADY]) };
    let mock = mock.run(&SETTINGS);
    let samples = mock.samples(0);
    assert!(samples.rejected.is_empty(), "{:?}", samples.rejected);
    assert!(samples.pairs.iter().any(|pair| pair.stages[0].ns < 0.0), "the noise is none");
    let [none, long] = [(0, "none"), (1, "long")]
        .map(|stage| stage_record(samples, stage, Default::default(), <_>::default()));
    for stage in [&none, &long] {
        assert!(stage.samples_ns.iter().all(|ns| *ns > 0.0));
        assert!(stage.time.ends()[0] > 0.0);
    }
    assert!(!none.is_resolved(), "{:?} of {}", none.time, none.resolution_ns());
    assert!(long.is_resolved(), "{:?} of {}", long.time, long.resolution_ns());
    assert!((long.time.median / 4e6 - 1.0).abs() < 0.1, "{:?}", long.time);
    assert!(accounting_error(samples) < 1e-9);
}

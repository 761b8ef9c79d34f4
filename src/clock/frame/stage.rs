//! What a frame is made of.

use super::StageScope;
use fathom_record::Clock;

/// A unit of a frame that is timed.
pub trait TimedStage {
    /// The name under which the time is recorded.
    fn name(&self) -> &'static str;
    /// Opens the stage's passes. Called once per frame, or once for each of its [iterations](Self::iterations).
    fn encode(&self, scope: &mut StageScope<'_>);
    /// How often the stage is encoded in a frame. Neighbours with the same number of iterations, more than one, are encoded iteration by iteration.
    fn iterations(&self) -> u32 {
        1
    }
}

/// Time of a stage in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct StageTime {
    /// The stage's name: `FAMILY/STEM`.
    pub stage: String,
    pub clock: Clock,
    /// Nanoseconds, less the submission's cost, if one is taken off; noise of that cost can then leave less than nothing.
    pub ns: f64,
    /// What was taken off, nanoseconds.
    pub submit_cost_ns: f64,
    /// A shorter time cannot be distinguished from 0, nanoseconds.
    pub resolution_ns: f64,
}

impl StageTime {
    /// Of a stage that did nothing.
    pub fn zero(stage: &str) -> Self {
        let (stage, clock) = (stage.into(), Clock::Host);
        Self { stage, clock, ns: 0.0, submit_cost_ns: 0.0, resolution_ns: 0.0 }
    }

    /// Whether the time is more than the clock's uncertainty.
    pub fn is_resolved(&self) -> bool {
        self.ns > self.resolution_ns
    }

    /// The time, or the resolution where that is longer.
    pub fn ns_or_resolution(&self) -> f64 {
        self.ns.max(self.resolution_ns)
    }
}

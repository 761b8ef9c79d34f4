//! Which clock times which kind of pass.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Clock, PassKind};

/// The clock for each kind of pass, as the audit found it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ClockPlan {
    /// Of compute passes.
    pub compute: Clock,
    /// Of render passes.
    pub render: Clock,
    /// Of copies.
    pub copy: Clock,
    pub submit_cost: SubmitCost,
}

/// Host time in ns from submission to fence of a command buffer with the smallest pass of a kind. An empty command buffer would
/// be too fast: a driver need not wake its threads for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SubmitCost {
    /// Of a compute pass.
    pub compute_ns: f64,
    /// Of a render pass.
    pub render_ns: f64,
    /// Of a copy.
    pub copy_ns: f64,
}

impl SubmitCost {
    pub fn ns(&self, kind: PassKind) -> f64 {
        match kind {
            PassKind::Compute => self.compute_ns,
            PassKind::Render => self.render_ns,
            PassKind::Copy => self.copy_ns,
            PassKind::Host => 0.0,
        }
    }
}

impl ClockPlan {
    /// Every pass on the fenced host clock.
    pub fn fenced(submit_cost: SubmitCost) -> Self {
        let clock = Clock::FencedHost;
        Self { compute: clock, render: clock, copy: clock, submit_cost }
    }

    /// Both time every kind of pass by the same clock.
    pub fn has_same_clocks(&self, other: &Self) -> bool {
        let clocks = |plan: &Self| [plan.compute, plan.render, plan.copy];
        clocks(self) == clocks(other)
    }

    pub fn clock(&self, kind: PassKind) -> Clock {
        match kind {
            PassKind::Compute => self.compute,
            PassKind::Render => self.render,
            PassKind::Copy => self.copy,
            PassKind::Host => Clock::Host,
        }
    }

    /// A pass of this kind is alone in a submission.
    pub fn fences(&self, kind: PassKind) -> bool {
        self.clock(kind) != Clock::Timestamp
    }

    /// Every pass fenced, by the CPU time of the process.
    pub fn process_cpu(submit_cost: SubmitCost) -> Self {
        let clock = Clock::ProcessCpu;
        Self { compute: clock, render: clock, copy: clock, submit_cost }
    }

    /// The same plan with another clock for one kind of pass.
    pub fn with(mut self, kind: PassKind, clock: Clock) -> Self {
        match kind {
            PassKind::Compute => self.compute = clock,
            PassKind::Render => self.render = clock,
            PassKind::Copy => self.copy = clock,
            PassKind::Host => {}
        }
        self
    }
}

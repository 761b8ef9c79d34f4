//! The adapter's limits in a run: measured once, and every stage's share of the one that binds it. `fathom ceilings` on its own.

use std::fmt;

use serde::Serialize;

use fathom_gpu as gpu;
use fathom_gpu::{ClockPlan, Gpu, GpuError};
use fathom_record::ceilings::{Bounded, Ceiling, CeilingShare, Limit};
use fathom_record::{Measured, Record, Run, StageRecord};

/// The ceilings of a run: those of the latest run that this one goes on with, if it had the same adapter, conditions and clocks,
/// else measured.
/// A result that is not the CPU's is an error.
pub fn of_run(
    gpu: &Gpu,
    plan: ClockPlan,
    header: &Run,
    before: &[Record],
) -> Result<Vec<Ceiling>, GpuError> {
    let alike = |run: &Run| {
        let conditions = (&run.adapter, &run.conditions, &run.clocks, run.shader_checks);
        let here = (&header.adapter, &header.conditions, &header.clocks, header.shader_checks);
        conditions == here && !run.ceilings.is_empty()
    };
    let mut runs = before.iter().rev().filter_map(Record::try_as_run_ref);
    match runs.find(|run| alike(run)) {
        Some(run) => Ok(run.ceilings.clone()),
        None => gpu::ceilings(gpu, plan),
    }
}

/// Puts each stage's share of its ceiling into the record. Where a stage is beyond its ceiling, the limits on that kind of work are
/// measured once more: the machine may have been busy at the first time.
/// A stage that did more than the adapter can is an error of one line.
pub fn add_shares(
    measured: &mut Measured,
    ceilings: &mut [Ceiling],
    mut again: impl FnMut(Limit) -> Result<Ceiling, GpuError>,
) -> Result<(), String> {
    for stage in &mut measured.stages {
        stage.ceiling = stage.share_of(ceilings);
        if let Some(share) = impossible(stage) {
            raise(ceilings, share.work, &mut again).map_err(|error| error.to_string())?;
            stage.ceiling = stage.share_of(ceilings);
        }
        if let Some(share) = impossible(stage) {
            return Err(beyond(stage, share));
        }
    }
    Ok(())
}

fn impossible(stage: &StageRecord) -> Option<&CeilingShare> {
    stage.ceiling.as_ref().filter(|share| share.is_impossible())
}

/// Replaces the limits on a kind of work where a new measurement is higher, or sound where the old one is not.
fn raise(
    ceilings: &mut [Ceiling],
    work: Bounded,
    again: &mut impl FnMut(Limit) -> Result<Ceiling, GpuError>,
) -> Result<(), GpuError> {
    for held in ceilings.iter_mut().filter(|held| held.limit.bounds(work)) {
        let fresh = again(held.limit)?;
        let better = !held.is_sound() || fresh.rate.median > held.rate.median;
        if fresh.is_sound() && better {
            *held = fresh;
        }
    }
    Ok(())
}

/// What is said of a stage beyond its ceiling.
fn beyond(stage: &StageRecord, share: &CeilingShare) -> String {
    format!(
        "{}: {} {} in {:.3} ms are {:.0} % of what the adapter can do ({}); the count or the clock is wrong: see fathom audit and \
         docs/ceilings.md",
        stage.stage,
        share.amount,
        share.work.name(),
        stage.time.median * 1e-6,
        100.0 * share.share,
        share.limit.name()
    )
}

/// What `fathom ceilings` answers.
#[derive(Debug, Serialize)]
pub struct Answer {
    pub adapter: String,
    pub ceilings: Vec<Ceiling>,
    /// What bounds nothing: limits for which twice the work did not take twice the time.
    pub unsound: Vec<String>,
}

/// Measures all limits of an adapter.
pub fn answer(gpu: &Gpu, plan: ClockPlan) -> Result<Answer, GpuError> {
    let ceilings = gpu::ceilings(gpu, plan)?;
    let unsound = ceilings.iter().filter(|ceiling| !ceiling.is_sound());
    let unsound = unsound.map(|ceiling| ceiling.limit.name()).collect();
    let adapter = format!("{} ({})", gpu.adapter.title(), gpu.adapter.driver_info);
    Ok(Answer { adapter, ceilings, unsound })
}

impl fmt::Display for Answer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "limit                              per second  95 % interval              n  doubling"
        )?;
        for ceiling in &self.ceilings {
            writeln!(f, "{}", row(ceiling))?;
        }
        if !self.unsound.is_empty() {
            writeln!(f, "\nunsound: {}", self.unsound.join("; "))?;
        }
        Ok(())
    }
}

fn row(ceiling: &Ceiling) -> String {
    let Ceiling { limit, rate, doubling } = ceiling;
    let [low, high] = rate.ends();
    let verdict = if ceiling.is_sound() { "" } else { "  unsound" };
    let each = match limit {
        Limit::EmptyPass { .. } => format!("  {:.2} µs each", 1e6 / rate.median),
        _ => String::new(),
    };
    format!(
        "{:<32} {:>12.4e}  {low:.3e} to {high:.3e}  {:>3}  {doubling:>8.2}  {}{each}{verdict}",
        limit.name(),
        rate.median,
        rate.n,
        limit.unit()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_record::ceilings::{Basis, TexelFormat};
    use fathom_record::{Clock, Estimate, Interval, Work};

    const LIMIT: Limit = Limit::Load2d { format: TexelFormat::R32Float };

    fn estimate(median: f64) -> Estimate {
        let interval = Interval { low: 0.95 * median, high: 1.05 * median };
        Estimate { median, interval: Some(interval), n: 8 }
    }

    fn ceiling(rate: f64) -> Ceiling {
        Ceiling { limit: LIMIT, rate: estimate(rate), doubling: 2.0 }
    }

    /// A stage of 1 ms.
    fn measured(texel_fetches: u64) -> Measured {
        let work = Work { texel_fetches, ..Work::default() };
        let stage = StageRecord {
            time: estimate(1e6),
            work,
            ..StageRecord::of("caustics/trace", Clock::Timestamp, vec![1e6; 8])
        };
        Measured { stages: vec![stage], ..Measured::default() }
    }

    #[test]
    fn a_stage_has_its_share() {
        let mut measured = measured(250_000);
        let never = |_| panic!("it is below its ceiling");
        add_shares(&mut measured, &mut [ceiling(1e9)], never).unwrap();
        let share = measured.stages[0].ceiling.clone().unwrap();
        assert!((share.share - 0.25).abs() < 1e-9);
        assert_eq!((share.limit, share.basis), (LIMIT, Basis::Declared));
    }

    #[test]
    fn a_stage_beyond_its_ceiling_is_an_error_of_one_line() {
        let same = |_| Ok(ceiling(1e9));
        let error = add_shares(&mut measured(2_000_000), &mut [ceiling(1e9)], same).unwrap_err();
        assert!(error.starts_with("caustics/trace: 2000000 texel fetches in 1.000 ms are 200 %"));
        assert!(!error.contains('\n'), "{error}");
    }

    #[test]
    fn a_ceiling_that_was_measured_too_low_is_raised() {
        let mut ceilings = [ceiling(1e9)];
        let mut measured = measured(2_000_000);
        add_shares(&mut measured, &mut ceilings, |_| Ok(ceiling(4e9))).unwrap();
        assert!((measured.stages[0].ceiling.as_ref().unwrap().share - 0.5).abs() < 1e-9);
        assert_eq!(ceilings[0].rate.median, 4e9);
    }
}

//! The adapter's limits in a run: measured once, and every stage's share of the one that binds it. `fathom ceilings` on its own.

use std::fmt;

use serde::Serialize;

use fathom_base::text;
use fathom_gpu as gpu;
use fathom_gpu::{ClockPlan, Gpu, GpuError};
use fathom_record::ceilings::{Ceiling, CeilingShare, Limit};
use fathom_record::{Measured, Record, Run, StageRecord};

/// The ceilings of a run: those of the latest run that this one goes on with, if it had the same adapter, driver, build, conditions and
/// clocks, else measured. A result that is not the CPU's is an error.
pub fn load_or_measure(
    gpu: &Gpu,
    plan: ClockPlan,
    header: &Run,
    before: &[Record],
) -> Result<Vec<Ceiling>, GpuError> {
    let alike = |run: &Run| {
        let of = |run: &Run| {
            let Run { adapter, build, conditions, clocks, shader_checks, .. } = run.clone();
            (adapter, build, conditions, clocks, shader_checks)
        };
        of(run) == of(header) && !run.ceilings.is_empty()
    };
    let mut runs = before.iter().rev().filter_map(Record::try_as_run_ref);
    match runs.find(|run| alike(run)) {
        Some(run) => Ok(run.ceilings.clone()),
        None => gpu::ceilings(gpu, plan),
    }
}

/// Puts each stage's share of its ceiling into the record. The ceiling of a stage beyond it is measured once more: the machine may have
/// been busy at the first time. A stage that did more than the adapter can is an error of one line.
pub fn add_shares(
    measured: &mut Measured,
    ceilings: &mut [Ceiling],
    mut again: impl FnMut(Limit) -> Result<Ceiling, GpuError>,
) -> Result<(), String> {
    for stage in &mut measured.stages {
        stage.ceiling = stage.share_of(ceilings);
        let Some(limit) = exceeded_share(stage).map(|share| share.limit.clone()) else { continue };
        let fresh = again(limit.clone()).map_err(|error| error.to_string())?;
        let held = ceilings.iter_mut().find(|held| held.limit == limit);
        if let Some(held) = held
            && fresh.is_sound()
            && fresh.rate.median > held.rate.median
        {
            *held = fresh;
        }
        stage.ceiling = stage.share_of(ceilings);
        if let Some(share) = exceeded_share(stage) {
            return Err(describe_excess(stage, share));
        }
    }
    Ok(())
}

fn exceeded_share(stage: &StageRecord) -> Option<&CeilingShare> {
    stage.ceiling.as_ref().filter(|share| share.is_impossible())
}

fn describe_excess(stage: &StageRecord, share: &CeilingShare) -> String {
    format!(
        "{}: {} {} in {:.3} ms are {:.0} % of what the adapter can do ({}); the count or the clock is wrong: see fathom audit and \
         docs/ceilings.md",
        stage.stage,
        share.amount,
        share.work.name(),
        stage.time.median * 1e-6,
        100.0 * share.share,
        share.limit_name()
    )
}

#[derive(Debug, Serialize)]
pub struct CeilingsResult {
    pub adapter: String,
    pub ceilings: Vec<Ceiling>,
    /// What bounds nothing: limits for which twice the work did not take twice the time.
    pub unsound: Vec<String>,
}

pub fn measure_all(gpu: &Gpu, plan: ClockPlan) -> Result<CeilingsResult, GpuError> {
    let ceilings = gpu::ceilings(gpu, plan)?;
    let unsound = ceilings.iter().filter(|ceiling| !ceiling.is_sound());
    let unsound = unsound.map(|ceiling| ceiling.limit.name()).collect();
    let adapter = format!("{} ({})", gpu.adapter.title(), gpu.adapter.driver_info);
    Ok(CeilingsResult { adapter, ceilings, unsound })
}

impl fmt::Display for CeilingsResult {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let heads = ["limit", "per second", "95 % interval", "n", "doubling", "unit"];
        let rows = self.ceilings.iter().map(row);
        let rows: Vec<_> = std::iter::once(heads.map(str::to_owned)).chain(rows).collect();
        writeln!(f, "{}", text::columns(&rows).join("\n"))?;
        if !self.unsound.is_empty() {
            writeln!(f, "\nunsound: {}", self.unsound.join("; "))?;
        }
        Ok(())
    }
}

fn row(ceiling: &Ceiling) -> [String; 6] {
    let Ceiling { limit, rate, doubling, .. } = ceiling;
    let [low, high] = rate.ends();
    let verdict = if ceiling.is_sound() { "" } else { ", unsound" };
    [
        limit.name(),
        format!("{:.4e}", rate.median),
        format!("{low:.3e} to {high:.3e}"),
        rate.n.to_string(),
        format!("{doubling:.2}{verdict}"),
        limit.unit().to_owned(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_record::{Clock, Estimate, Interval, PassKind, Work};

    fn estimate(median: f64) -> Estimate {
        let interval = Interval { low: 0.95 * median, high: 1.05 * median };
        Estimate { median, interval: Some(interval), n: 8 }
    }

    fn ceiling(rate: f64) -> Ceiling {
        Ceiling::new(Limit::Loads2d(PassKind::Compute), estimate(rate), 2.0)
    }

    /// The share of a stage of 1 ms, or the error, where the ceiling is measured as `rates` one after the other.
    fn added(texel_fetches: u64, rates: [f64; 2]) -> Result<f64, String> {
        let work = Work { texel_fetches, ..Work::default() };
        let stage = StageRecord::new("caustics/trace", Clock::Timestamp, vec![1e6; 8], &[]);
        let stage = StageRecord { time: estimate(1e6), work, ..stage };
        let mut measured = Measured { stages: vec![stage], ..Measured::default() };
        add_shares(&mut measured, &mut [ceiling(rates[0])], |_| Ok(ceiling(rates[1])))?;
        Ok((100.0 * measured.stages[0].ceiling.as_ref().unwrap().share).round())
    }

    #[test]
    fn a_stage_beyond_its_ceiling_has_it_measured_again_before_it_is_an_error() {
        assert_eq!(added(250_000, [1e9, 4e9]), Ok(25.0), "no need");
        assert_eq!(added(2_000_000, [1e9, 4e9]), Ok(50.0));
        for second in [1e9, 0.5e9, f64::NAN] {
            let error = added(2_000_000, [1e9, second]).unwrap_err();
            assert!(
                error.starts_with("caustics/trace: 2000000 texel fetches in 1.000 ms are 200 %")
            );
            assert!(!error.contains('\n'), "{error}");
        }
    }
}

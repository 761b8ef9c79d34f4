//! The clock's audit: which kinds of pass have timestamps that can be believed on this adapter.
//!
//! For each kind of pass a kernel of known ratio (N and 2 N work) is run through the same
//! [`FrameTimer`] that measures stages, and its timestamps are compared with the fenced host clock:
//!
//! - *alone*: a command buffer with one pass, its timestamps against the host time of the very same
//!   submission, less the cost of an empty one;
//! - *mixed*: a command buffer with passes of every kind. What the host saw of that submission is shared out
//!   among the kinds as they share a frame in which each pass is fenced, and that is run next to it. So the
//!   whole is held to one submission's host time and only the shares to another frame's, which a busy
//!   machine slows alike.
//!
//! Frames alternate and ratios are taken between neighbours, so that a machine that drifts drifts through
//! both sides. Where a verdict is close, more rounds are run before it is given.
//!
//! A software adapter whose driver has one core can be timed by the CPU time of the process ([`audit_cpu_time`]): it is as long as
//! the host clock's where nothing else runs, and does not count what other processes take from the core, so it scatters far less
//! than any wall clock. Where the driver has several threads at work their times add up, and the ratio shows it.
//!
//! A kind of pass whose timestamps are unsound in either surrounding is timed by the fenced host clock, in
//! command buffers of its own. It may have spoilt its neighbours' timestamps, too: the worst kind is set apart
//! first, and the others are then audited without it, which is how frames are measured.

pub(crate) mod kernels;
mod verdict;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::{Duration, Instant};

use itertools::Itertools;

use self::kernels::{Kernel, Kernels};
use self::verdict::{Series, factor, judge, median};
use super::frame::{FrameSample, FrameTimer, HostClock, Probe};
use super::session::FEATURES;
use super::{Device, DeviceError, StageTime, TimedStage as _};
use fathom_base::statistics;
use fathom_record::{AuditRow, Clock, ClockPlan, Conditions, PassKind, SubmitCost, Surrounding};

const KINDS: [PassKind; 3] = [PassKind::Render, PassKind::Compute, PassKind::Copy];
/// Length of a pass at N work: on a software adapter, and on a GPU. Long compared with the jitter of a submission (tens of µs), and
/// short enough for an audit of seconds.
const SOFTWARE_PASS_NS: f64 = 4e6;
const GPU_PASS_NS: f64 = 1e6;
/// Rounds before the first verdict; doubled while a verdict is close.
const ROUNDS: usize = 7;
const MAX_ROUNDS: usize = 56;
/// No rounds are added after this time in one surrounding.
const CALM_TIMEOUT: Duration = Duration::from_secs(6);
/// N and 2 N work.
const LEVELS: usize = 2;
/// Times each kind of pass occurs in a mixed frame.
const OCCURRENCES: usize = 2;
/// Submissions of the least pass of each kind before the first round, and in each round.
const SUBMISSIONS: usize = 32;
const SUBMISSIONS_PER_ROUND: usize = 4;
/// Dispatches, draws or copies in a pass at N work; twice as many at 2 N, which doubles fixed costs per
/// thread too. Few, so that a driver that leaves out the first is found out.
const CALLS: u32 = 2;
/// Work per call at which calibration begins: loop iterations, or units of copying.
const FIRST_WORK: u32 = 4;
const CALIBRATION_STEPS: usize = 24;
const CALIBRATION_FRAMES: usize = 3;

/// What the audit found, and the clock for each kind of pass.
#[derive(Clone, Debug, PartialEq)]
pub struct Audit {
    pub rows: Vec<AuditRow>,
    pub plan: ClockPlan,
}

/// Audits this adapter's timestamps. Takes some seconds on a software adapter.
pub fn audit(gpu: &Device) -> Result<Audit, DeviceError> {
    let kernels = Kernels::new(gpu)?;
    let mut submissions = SubmissionCosts::new(gpu, HostClock::Wall)?;
    submissions.time(gpu, SUBMISSIONS)?;
    let fenced = ClockPlan::fenced(submissions.cost());
    let work = calibrate(gpu, &kernels, fenced)?;
    let mut bench = TimedKernels::new(gpu, &kernels, work, fenced, submissions)?;
    let alone = bench.measure(gpu, Surrounding::Alone, &KINDS)?;
    let alone: Vec<AuditRow> = alone.into_iter().map(|row| check_row(gpu, row)).collect();
    let mut rows = alone.clone();
    let kinds = KINDS.into_iter().filter(|kind| has_timestamps(gpu, *kind)).collect();
    rows.extend(mixed(kinds, &alone, |kinds| bench.measure(gpu, Surrounding::Mixed, kinds))?);
    rows.sort_by_key(|row| KINDS.iter().position(|kind| *kind == row.pass));
    let plan = plan_clocks(&rows, bench.submissions.cost());
    Ok(Audit { rows, plan })
}

/// Audits all clocks. Chosen is the CPU time of the process where it has one core and that clock is sound; else timestamps and the
/// host clock.
///
/// # Errors
/// A fault of the device.
pub fn audit_all(gpu: &Device) -> Result<Audit, DeviceError> {
    let one_core = Conditions::detect().cores.len() == 1;
    let (by_cpu, plan) = if one_core { audit_cpu_time(gpu)? } else { (Vec::new(), None) };
    if let Some(plan) = plan {
        return Ok(Audit { rows: by_cpu, plan });
    }
    let mut audit = audit(gpu)?;
    audit.rows.extend(by_cpu);
    Ok(audit)
}

/// Timestamps for the kinds of pass of which all rows are sound.
fn plan_clocks(rows: &[AuditRow], cost: SubmitCost) -> ClockPlan {
    let sound = |kind: &PassKind| rows.iter().filter(|row| row.pass == *kind).all(|row| row.sound);
    let sound_kinds = KINDS.into_iter().filter(sound);
    sound_kinds.fold(ClockPlan::fenced(cost), |plan, kind| plan.with(kind, Clock::Timestamp))
}

/// Audits the CPU time of a process whose driver has one core: a row for each kind of pass, and the plan where all are sound. On a
/// hardware adapter, and where the system has no such clock, there is nothing to audit.
pub fn audit_cpu_time(gpu: &Device) -> Result<(Vec<AuditRow>, Option<ClockPlan>), DeviceError> {
    if !gpu.adapter.software || !HostClock::ProcessCpu.is_there() {
        return Ok((Vec::new(), None));
    }
    let kernels = Kernels::new(gpu)?;
    let mut submissions = SubmissionCosts::new(gpu, HostClock::ProcessCpu)?;
    submissions.time(gpu, SUBMISSIONS)?;
    let plan = ClockPlan::process_cpu(submissions.cost());
    let work = calibrate(gpu, &kernels, plan)?;
    let rows = process_cpu(gpu, &kernels, work, plan)?;
    let sound = rows.iter().all(|row| row.sound);
    Ok((rows, sound.then_some(plan)))
}

/// A row for each kind of pass: the CPU time of the process against the wall clock, both of the same submissions.
fn process_cpu(
    gpu: &Device,
    kernels: &Kernels,
    work: [u32; 3],
    plan: ClockPlan,
) -> Result<Vec<AuditRow>, DeviceError> {
    let mut timer = FrameTimer::new(gpu, plan, 0)?;
    let mut row = |index: usize| {
        let mut series = Series::new(Clock::ProcessCpu);
        let start = Instant::now();
        for round in 1.. {
            for level in 0..LEVELS {
                let calls = CALLS << level;
                let kernel = kernels.kernel(gpu, KINDS[index], work[index], calls);
                let time = timer.on_host(gpu, &[&kernel])?;
                let cpu_ns = time.process_ns.unwrap_or(0.0);
                series.push(level, cpu_ns, time.wall_ns, usize::from(cpu_ns <= 0.0));
            }
            let (row, close) = judge(KINDS[index], None, &series);
            let tired = round >= MAX_ROUNDS || start.elapsed() > CALM_TIMEOUT;
            if round >= ROUNDS && (tired || !close) {
                return Ok(row);
            }
        }
        unreachable!("the rounds end")
    };
    (0..KINDS.len()).map(&mut row).collect()
}

/// A row for each kind mixed with the others. Kinds that read wrong alone are set apart after the first measurement: they
/// will never share a command buffer, and the time they lose lands in their neighbours. Then the worst is set apart until
/// the rest are sound.
fn mixed(
    mut kinds: Vec<PassKind>,
    alone: &[AuditRow],
    mut measure: impl FnMut(&[PassKind]) -> Result<Vec<AuditRow>, DeviceError>,
) -> Result<Vec<AuditRow>, DeviceError> {
    let without = alone.iter().filter(|row| !kinds.contains(&row.pass));
    let mut done: Vec<AuditRow> =
        without.map(|row| AuditRow { context: Surrounding::Mixed, ..row.clone() }).collect();
    while !kinds.is_empty() {
        let rows = measure(&kinds)?;
        let apart = set_apart(&rows, alone);
        kinds.retain(|kind| !apart.contains(kind));
        let (leaving, staying): (Vec<_>, Vec<_>) =
            rows.into_iter().partition(|row| apart.contains(&row.pass));
        done.extend(leaving);
        if apart.is_empty() {
            done.extend(staying);
            break;
        }
    }
    Ok(done)
}

/// The kinds to take out of the mixture: all that are unsound alone, else the worst that is unsound here.
fn set_apart(rows: &[AuditRow], alone: &[AuditRow]) -> Vec<PassKind> {
    let unsound_alone = |pass: PassKind| alone.iter().any(|row| row.pass == pass && !row.sound);
    let wrong: Vec<PassKind> =
        rows.iter().map(|row| row.pass).filter(|pass| unsound_alone(*pass)).collect();
    if !wrong.is_empty() {
        return wrong;
    }
    let unsound = rows.iter().filter(|row| !row.sound);
    let worst = unsound.max_by(|a, b| factor(a.ratio).total_cmp(&factor(b.ratio)));
    worst.map(|row| row.pass).into_iter().collect()
}

/// Times in ns of submissions that hold the least pass of each kind.
struct SubmissionCosts {
    clock: HostClock,
    probe: Probe,
    costs: BTreeMap<PassKind, Vec<f64>>,
}

impl SubmissionCosts {
    fn new(gpu: &Device, clock: HostClock) -> Result<Self, DeviceError> {
        Ok(Self { clock, probe: Probe::new(gpu)?, costs: BTreeMap::new() })
    }

    fn time(&mut self, gpu: &Device, count: usize) -> Result<(), DeviceError> {
        for kind in KINDS {
            for _ in 0..count {
                let ns = gpu.catch(|| self.probe.time(gpu, kind, self.clock))?;
                self.costs.entry(kind).or_default().push(ns);
            }
        }
        Ok(())
    }

    fn cost(&self) -> SubmitCost {
        let of = |kind| self.costs.get(&kind).map_or(0.0, |costs| median(costs));
        let [compute_ns, render_ns, copy_ns] = PassKind::TIMED.map(of);
        SubmitCost { compute_ns, render_ns, copy_ns }
    }
}

/// Whether the adapter has timestamps for this kind of pass at all.
fn has_timestamps(gpu: &Device, kind: PassKind) -> bool {
    let of_passes = wgpu::Features::TIMESTAMP_QUERY;
    gpu.features.contains(if kind == PassKind::Copy { FEATURES } else { of_passes })
}

/// The row, or why there can be none: it was then timed by the host clock on both sides.
fn check_row(gpu: &Device, row: AuditRow) -> AuditRow {
    if has_timestamps(gpu, row.pass) {
        return row;
    }
    AuditRow {
        clock_ns: 0.0,
        ratio: 0.0,
        doubling: 0.0,
        sound: false,
        reason: "the adapter has no timestamps for this kind of pass".to_owned(),
        ..row
    }
}

/// N for each kind: the work at which a pass alone takes about as long as is wanted, by the host clock of this plan.
fn calibrate(gpu: &Device, kernels: &Kernels, plan: ClockPlan) -> Result<[u32; 3], DeviceError> {
    let goal_ns = if gpu.adapter.software { SOFTWARE_PASS_NS } else { GPU_PASS_NS };
    let mut timer = FrameTimer::new(gpu, plan, 0)?;
    let mut work = [FIRST_WORK; 3];
    for (kind, work) in KINDS.into_iter().zip(&mut work) {
        for _ in 0..CALIBRATION_STEPS {
            let kernel = kernels.kernel(gpu, kind, *work, CALLS);
            // The first frame compiles, and touches fresh memory.
            timer.run_stages(gpu, &[&kernel])?;
            let mut ns = f64::INFINITY;
            for _ in 0..CALIBRATION_FRAMES {
                // The shortest is the least disturbed.
                ns = ns.min(timer.run_stages(gpu, &[&kernel])? - plan.submit_cost.ns(kind));
            }
            let short_by = goal_ns / ns.max(goal_ns / 1024.0);
            if (0.6..1.6).contains(&short_by) {
                break;
            }
            // A step of eight at most: short times are mostly fixed cost.
            *work = (f64::from(*work) * short_by.clamp(0.125, 8.0)).ceil() as u32;
        }
    }
    Ok(work)
}

/// The kernels of the three kinds at N and at 2 N, and both clocks.
struct TimedKernels<'a> {
    /// By level (N, 2 N), then in the order of [`KINDS`].
    kernels: [[Kernel<'a>; 3]; LEVELS],
    timestamps: FrameTimer,
    fenced: FrameTimer,
    submissions: SubmissionCosts,
}

impl<'a> TimedKernels<'a> {
    fn new(
        gpu: &Device,
        kernels: &'a Kernels,
        work: [u32; 3],
        fenced: ClockPlan,
        submissions: SubmissionCosts,
    ) -> Result<Self, DeviceError> {
        let level = |factor: u32| {
            [0, 1, 2].map(|i: usize| kernels.kernel(gpu, KINDS[i], work[i], CALLS * factor))
        };
        let timed = KINDS.into_iter().filter(|kind| has_timestamps(gpu, *kind));
        let plan = timed.fold(fenced, |plan, kind| plan.with(kind, Clock::Timestamp));
        let passes = (KINDS.len() * OCCURRENCES) as u32;
        Ok(Self {
            kernels: [level(1), level(2)],
            timestamps: FrameTimer::new(gpu, plan, passes)?,
            fenced: FrameTimer::new(gpu, fenced, 0)?,
            submissions,
        })
    }

    /// A row for each of `kinds`. Rounds are added until no verdict is close or [`CALM_TIMEOUT`] is over.
    fn measure(
        &mut self,
        gpu: &Device,
        surrounding: Surrounding,
        kinds: &[PassKind],
    ) -> Result<Vec<AuditRow>, DeviceError> {
        let mut series: Vec<Series> = kinds.iter().map(|_| Series::new(Clock::Timestamp)).collect();
        let start = Instant::now();
        let mut rounds = 0;
        loop {
            for _ in 0..ROUNDS.max(rounds) {
                for level in 0..LEVELS {
                    match surrounding {
                        Surrounding::Alone => self.alone(gpu, level, kinds, &mut series)?,
                        Surrounding::Mixed => self.mixed(gpu, level, kinds, &mut series)?,
                    }
                }
                self.submissions.time(gpu, SUBMISSIONS_PER_ROUND)?;
                rounds += 1;
            }
            let step_ns = self.timestamps.step_ns();
            series.iter_mut().for_each(|series| series.step_ns = step_ns);
            let judged = kinds.iter().zip(&series).map(|(kind, series)| {
                let apart = (surrounding == Surrounding::Mixed).then(|| passes_apart(gpu, kinds));
                judge(*kind, apart.as_deref(), series)
            });
            let (rows, close): (Vec<_>, Vec<_>) = judged.unzip();
            let tired = rounds >= MAX_ROUNDS || start.elapsed() > CALM_TIMEOUT;
            if tired || !close.contains(&true) {
                return Ok(rows);
            }
        }
    }

    /// Each kernel once alone: both clocks on the same submission.
    fn alone(
        &mut self,
        gpu: &Device,
        level: usize,
        kinds: &[PassKind],
        series: &mut [Series],
    ) -> Result<(), DeviceError> {
        for (kind, series) in kinds.iter().zip(series) {
            let kernel = kernel(&self.kernels[level], *kind);
            let sample = self.timestamps.time_stages(gpu, &[kernel])?;
            let host_ns = sample.envelope_ns - self.fenced.plan().submit_cost.ns(*kind);
            series.push(level, stage_ns(&sample, 0, 1), host_ns, sample.faults.len());
        }
        Ok(())
    }

    /// The kernels in one command buffer, and then each in its own.
    fn mixed(
        &mut self,
        gpu: &Device,
        level: usize,
        kinds: &[PassKind],
        series: &mut [Series],
    ) -> Result<(), DeviceError> {
        let once = kinds.iter().map(|kind| kernel(&self.kernels[level], *kind));
        let frame = once.collect::<Vec<_>>().repeat(OCCURRENCES);
        let mixed = self.timestamps.time_stages(gpu, &frame)?;
        let apart = self.fenced.time_stages(gpu, &frame)?;
        let mixed_ns = mixed.envelope_ns - self.fenced.plan().submit_cost.ns(kinds[0]);
        let apart_ns: f64 = apart.stages.iter().map(|stage| stage.ns).sum();
        for (index, series) in series.iter_mut().enumerate() {
            let name = frame[index].name();
            let faults = usize::from(mixed.faults.iter().any(|fault| fault.stage == name));
            let host_ns = mixed_ns * stage_ns(&apart, index, kinds.len()) / apart_ns;
            series.push(level, stage_ns(&mixed, index, kinds.len()), host_ns, faults);
        }
        Ok(())
    }
}

fn kernel<'k, 'a>(kernels: &'k [Kernel<'a>; 3], kind: PassKind) -> &'k Kernel<'a> {
    kernels.iter().find(|kernel| kernel.kind == kind).unwrap_or(&kernels[0])
}

/// Which kinds of pass with timestamps had command buffers of their own; empty if none had.
fn passes_apart(gpu: &Device, kinds: &[PassKind]) -> String {
    let mut apart =
        KINDS.into_iter().filter(|kind| has_timestamps(gpu, *kind) && !kinds.contains(kind));
    let names = apart.join(" and ");
    if names.is_empty() { names } else { format!(" ({names} apart)") }
}

/// Mean time of the stages `first`, `first + stride`, … A duration that was not accepted counts as it was
/// read.
fn stage_ns(sample: &FrameSample, first: usize, stride: usize) -> f64 {
    let stages = sample.stages.iter().skip(first).step_by(stride);
    let read = |stage: &StageTime| {
        let fault = sample.faults.iter().find(|fault| stage.stage == *fault.stage);
        if stage.ns.is_nan() { fault.map_or(0.0, |fault| fault.ns) } else { stage.ns }
    };
    statistics::mean(stages.map(read))
}

/// The audit as a table for the terminal, and the clocks that follow from it.
pub fn audit_table(audit: &Audit) -> String {
    let mut table = String::from(
        "clock        pass     context     clock ms    host ms   ratio  doubling  verdict\n",
    );
    for row in &audit.rows {
        let verdict = if row.sound { "sound" } else { "unsound" };
        // Writing to a String does not fail.
        let _ = writeln!(
            table,
            "{:<12} {:<8} {:<8} {:>11.3} {:>10.3} {:>7.3} {:>9.2}  {verdict}: {}",
            row.clock.name(),
            row.pass,
            row.context,
            row.clock_ns * 1e-6,
            row.host_ns * 1e-6,
            row.ratio,
            row.doubling,
            row.reason
        );
    }
    for kind in KINDS {
        let clock = match audit.plan.clock(kind) {
            Clock::Timestamp => "timestamps",
            Clock::ProcessCpu => "the process's CPU time",
            Clock::FencedHost | Clock::Host => "fenced host clock",
        };
        let _ = writeln!(table, "{kind} passes are timed by {clock}");
    }
    let cost = audit.plan.submit_cost;
    let _ = writeln!(
        table,
        "a submission costs {:.1} µs with the least compute pass, {:.1} µs with a render pass, {:.1} µs with a copy",
        cost.compute_ns * 1e-3,
        cost.render_ns * 1e-3,
        cost.copy_ns * 1e-3
    );
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::clock_fault::ClockFault;
    use crate::frame::timer::tests::ModelledGpu;

    /// What [`judge`] makes of a clock that reads this share of 5 ms, round by round.
    fn judged(kind: PassKind, mixed: bool, share: f64) -> AuditRow {
        let mut series = Series::new(Clock::Timestamp);
        for round in 0..ROUNDS {
            for level in 0..LEVELS {
                let host_ns = (5 << level) as f64 * (1e6 + 2e4 * (round % 3) as f64);
                series.push(level, share * host_ns, host_ns, 0);
            }
        }
        judge(kind, mixed.then_some(""), &series).0
    }

    /// The clocks of a modelled driver whose timestamps read these shares of the truth: alone, and in one command buffer with others.
    fn clocks(
        alone: impl Fn(PassKind) -> f64,
        beside: impl Fn(PassKind, &[PassKind]) -> f64,
    ) -> [Clock; 3] {
        let mut rows: Vec<AuditRow> =
            KINDS.iter().map(|kind| judged(*kind, false, alone(*kind))).collect();
        let measure = |kinds: &[PassKind]| {
            let row = |kind: &PassKind| judged(*kind, true, beside(*kind, kinds));
            Ok(kinds.iter().map(row).collect())
        };
        rows.extend(mixed(KINDS.to_vec(), &rows, measure).unwrap());
        assert_eq!(rows.len(), 2 * KINDS.len());
        let plan = plan_clocks(&rows, SubmitCost::default());
        KINDS.map(|kind| plan.clock(kind))
    }

    #[test]
    fn right_clocks_are_used_and_wrong_ones_are_not() {
        use PassKind::{Compute, Copy, Render};
        const USED: Clock = Clock::Timestamp;
        const FENCED: Clock = Clock::FencedHost;
        assert_eq!(clocks(|_| 1.0, |_, _| 1.02), [USED; 3]);
        assert_eq!(clocks(|_| 0.5, |_, _| 0.5), [FENCED; 3]);
        // Mesa 22.3: compute passes beside render passes read as nearly nothing, and the render passes get their time.
        let mesa = |kind, kinds: &[PassKind]| match kind {
            Compute if kinds.contains(&Render) => 0.01,
            Render if kinds.contains(&Compute) => 1.4,
            _ => 1.0,
        };
        assert_eq!(clocks(|_| 1.0, mesa), [USED, FENCED, USED]);
        let alone = |kind| if kind == Compute { 0.6 } else { 1.0 };
        assert_eq!(clocks(alone, mesa), [USED, FENCED, USED]);
        // Kinds that are wrong alone leave before a neighbour, in which their time lands and which then reads worst.
        let alone = |kind| if kind == Render { 1.0 } else { 0.5 };
        let beside = |kind, kinds: &[PassKind]| match kind {
            Render if kinds.contains(&Compute) => 1.6,
            Compute => 0.7,
            Copy => 0.9,
            _ => 1.0,
        };
        assert_eq!(clocks(alone, beside), [USED, FENCED, FENCED]);
    }

    /// The verdict on a modelled GPU's timestamps, and the reason.
    fn of_modelled(faults: &[ClockFault]) -> (bool, String) {
        let mut gpu = ModelledGpu::with(faults);
        let mut series = Series::new(Clock::Timestamp);
        for round in 0..ROUNDS {
            for level in 0..LEVELS {
                let pass_ns = (1 << level) as f64 * (GPU_PASS_NS + 2e4 * (round % 3) as f64 + 7.0);
                let sample = gpu.frame(&[pass_ns], 0.0);
                series.push(level, stage_ns(&sample, 0, 1), pass_ns, sample.faults.len());
            }
        }
        series.step_ns = gpu.step_ns();
        let row = judge(PassKind::Compute, None, &series).0;
        (row.sound, row.reason)
    }

    #[test]
    fn clocks_of_all_kinds_of_hardware_are_used_and_faulty_ones_refused() {
        use ClockFault::{Backwards, Bits, Equal, Period, Step, Zero};
        for period_ns in [1.0, 10.0, 41.67, 83.33] {
            for faults in [[Period(period_ns), Bits(36)], [Period(period_ns), Bits(40)]] {
                assert!(of_modelled(&faults).0, "{faults:?}");
            }
            // NVIDIA's counters move in steps of 32 ns, others in steps of 1 µs.
            assert!(of_modelled(&[Period(period_ns), Step(1_024.0)]).0, "{period_ns}");
            for fault in [Zero, Equal, Backwards] {
                let (sound, reason) = of_modelled(&[Period(period_ns), fault]);
                assert!(!sound && reason == "14 of 14 durations cannot be true", "{reason}");
            }
        }
        let (sound, reason) = of_modelled(&[Step(65_536.0)]);
        assert!(!sound && reason == "timestamps are multiples of 65.5 µs", "{reason}");
    }
}

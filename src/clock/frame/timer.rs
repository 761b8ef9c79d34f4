//! Runs frames, reads their timestamps, and sums the time by stage and gap.

use std::fmt;

use super::encoder::SUBMISSION;
use super::host_clock::{HostClock, thread_ns};
use super::meter::{CostMeter, SubmissionCounts, SubmissionMeter};
use super::scope::{FrameMode, HostTime, PassSpan, QUERIES_PER_PASS, QUERIES_PER_SET, Recorder};
use crate::queries::{QueryResults, RESULT_BYTES};
use crate::{Device, DeviceError, StageTime, TimedStage};
use fathom_record::{Clock, ClockPlan, FaultKind, PassKind};

/// Vulkan's least number of valid bits of a timestamp. The others are zero.
const MIN_VALID_BITS: u32 = 36;
/// A timestamp duration may exceed its segment's wall time by this factor: two clocks differ by about as much.
const WALL_TOLERANCE: f64 = 1.01;

/// One timed frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSample {
    /// In frame order, each the sum over its passes. The clock is the fenced one where passes differ. The time is NaN when a pass has
    /// a fault, and can be zero or negative where the cost of submissions was subtracted.
    pub stages: Vec<StageTime>,
    pub gaps_ns: f64,
    /// Time by the plan's host clock from the first submission to the last fence, plus the host stages, minus the time spent on measuring the cost of
    /// submissions.
    pub envelope_ns: f64,
    /// Impossible durations. Discard a frame that has any.
    pub faults: Vec<RejectedTime>,
}

/// What the thread that encodes takes for one frame, ns.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodeCost {
    /// To encode each stage alone, up to the finished command buffer, in frame order.
    pub stages_ns: Vec<f64>,
    /// To encode the whole frame into one command buffer.
    pub frame_ns: f64,
}

/// A stage's duration that was not accepted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RejectedTime {
    pub stage: &'static str,
    pub kind: FaultKind,
    /// The duration as read.
    pub ns: f64,
}

impl fmt::Display for RejectedTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} ({} ns)", self.stage, self.kind.reason(), self.ns)
    }
}

/// Begin and end of a pass, in ticks.
pub(crate) type Ticks = [u64; 2];

/// Runs frames, timed and untimed.
pub struct FrameTimer {
    pub(super) plan: ClockPlan,
    period_ns: f64,
    pub(super) max_passes: u32,
    pub(super) queries: Option<Queries>,
    pub(super) recorder: Recorder,
    pub(super) metering: SubmissionMeter,
    spans: Vec<PassSpan>,
    /// Of the frame's timestamped passes, in order.
    ticks: Vec<Ticks>,
    /// Those of the frame before.
    previous: Vec<Ticks>,
    /// The greatest common divisor of all distances between timestamps of a frame.
    step: u64,
    /// Why a command buffer of a caller's encoder was refused.
    pub(super) refused: Option<DeviceError>,
}

/// Timestamp queries.
pub(super) struct Queries {
    pub(super) sets: Vec<wgpu::QuerySet>,
    results: QueryResults,
}

impl FrameTimer {
    /// A timer for frames of at most `max_passes` passes on the timestamp clock.
    pub fn new(gpu: &Device, plan: ClockPlan, max_passes: u32) -> Result<Self, DeviceError> {
        let timestamps = PassKind::TIMED.map(|kind| plan.clock(kind)).contains(&Clock::Timestamp);
        let queries =
            if timestamps && max_passes > 0 { Some(Queries::new(gpu, max_passes)?) } else { None };
        Ok(Self {
            plan,
            period_ns: f64::from(gpu.adapter.timestamp_period_ns),
            max_passes,
            queries,
            recorder: Recorder::new(HostClock::from_plan(&plan)),
            metering: SubmissionMeter::new(HostClock::from_plan(&plan)),
            spans: Vec::new(),
            ticks: Vec::new(),
            previous: Vec::new(),
            step: 0,
            refused: None,
        })
    }

    pub fn plan(&self) -> ClockPlan {
        self.plan
    }

    /// Runs one frame with every stage timed.
    pub fn time_stages<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        stages: &[&S],
    ) -> Result<FrameSample, DeviceError> {
        gpu.catch(|| {
            let sets = self.queries.as_ref().map_or(&[][..], |queries| &queries.sets);
            let mode = FrameMode::Timed { plan: &self.plan, sets, max_passes: self.max_passes };
            self.recorder.record(gpu, mode, stages)?;
            self.run_segments(gpu)
        })?;
        Ok(self.evaluate(&names(stages)))
    }

    /// Runs one frame in one submission with nothing timed within. Returns the time from the submission to the fence and the
    /// host stages, in ns by the plan's host clock.
    pub fn run_stages<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        stages: &[&S],
    ) -> Result<f64, DeviceError> {
        Ok(self.on_host(gpu, stages)?.time_ns(HostClock::from_plan(&self.plan)))
    }

    /// Runs one frame as [`Self::run_stages`] does and also reads the CPU time of the process, and of this thread for the submission.
    pub fn on_host<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        stages: &[&S],
    ) -> Result<HostTime, DeviceError> {
        gpu.catch(|| {
            self.recorder.record(gpu, FrameMode::Untimed, stages)?;
            self.recorder.run(gpu)
        })
    }

    /// Kind of each stage's first pass; `Host` for a stage that opens none. Encodes a frame and drops it.
    pub fn kinds<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        stages: &[&S],
    ) -> Result<Vec<PassKind>, DeviceError> {
        gpu.catch(|| self.recorder.record(gpu, FrameMode::Untimed, stages))?;
        let passes = &self.recorder.passes;
        let first = |stage: usize| passes.iter().find(|pass| pass.stage == stage);
        let kinds = (0..stages.len())
            .map(|stage| first(stage).map_or(PassKind::Host, |pass| pass.kind))
            .collect();
        self.recorder.reset();
        Ok(kinds)
    }

    /// Encodes each stage alone, then the whole frame, and drops them. Times are of this thread. Each stage is encoded once before, as
    /// the first ones find the caches cold after a frame of a software driver (twice their time).
    pub fn encode_cost<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        stages: &[&S],
    ) -> Result<EncodeCost, DeviceError> {
        let mut encode_ns = |stages: &[&S]| {
            let start_ns = thread_ns();
            let recorded = gpu.catch(|| self.recorder.record(gpu, FrameMode::Untimed, stages));
            recorded.map(|()| thread_ns() - start_ns)
        };
        stages.iter().try_for_each(|stage| encode_ns(&[stage]).map(drop))?;
        let stages_ns = stages.iter().map(|stage| encode_ns(&[stage])).collect::<Result<_, _>>()?;
        let frame_ns = encode_ns(stages)?;
        self.recorder.reset();
        Ok(EncodeCost { stages_ns, frame_ns })
    }

    /// Encodes a frame up to its finished command buffer, and drops it.
    pub fn encode<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        stages: &[&S],
    ) -> Result<(), DeviceError> {
        gpu.catch(|| self.recorder.record(gpu, FrameMode::Untimed, stages))?;
        self.recorder.reset();
        Ok(())
    }

    /// Runs the frame that was recorded, and reads its timestamps.
    pub(super) fn run_segments(&mut self, gpu: &Device) -> Result<(), DeviceError> {
        self.recorder.run_segments(gpu, &mut self.metering, &mut self.spans)?;
        self.read_ticks(gpu)
    }

    /// Reads the frame's timestamps, in a submission after the frame's own.
    fn read_ticks(&mut self, gpu: &Device) -> Result<(), DeviceError> {
        std::mem::swap(&mut self.ticks, &mut self.previous);
        self.ticks.clear();
        match &self.queries {
            Some(queries) if self.recorder.queries > 0 => {
                let ticks = queries.read(gpu, self.recorder.queries)?;
                self.ticks.extend(ticks.as_chunks::<2>().0);
                self.note_step();
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Notes in which steps the frame's timestamps come.
    fn note_step(&mut self) {
        let ticks = self.ticks.as_flattened();
        let distances = ticks.iter().map(|tick| tick.abs_diff(ticks[0]));
        self.step = distances.fold(self.step, gcd);
    }

    /// All timestamps up to now were multiples of this, ns; 0 where they were all equal.
    pub(crate) fn step_ns(&self) -> f64 {
        self.step as f64 * self.period_ns
    }

    /// The sample of the frame that ran, whose stages have these names.
    pub(super) fn evaluate(&self, names: &[&'static str]) -> FrameSample {
        let mut account = FrameSums::new(names);
        for work in &self.recorder.host {
            if work.submits {
                account.gaps_ns += self.submit_cost_ns(SUBMISSION);
                let is_cpu = HostClock::from_plan(&self.plan) == HostClock::ProcessCpu;
                let clock = if is_cpu { Clock::ProcessCpu } else { Clock::FencedHost };
                self.add_fenced(&mut account, work.stage, SUBMISSION, clock, work.ns);
            } else {
                account.add(work.stage, Clock::Host, Ok(work.ns));
            }
        }
        let mut metering_ns = 0.0;
        for (index, span) in self.spans.iter().enumerate() {
            if let Some(before) = index.checked_sub(1).map(|before| &self.spans[before]) {
                account.gaps_ns += span.metered_ns - before.fence_ns;
                metering_ns += span.metering_ns();
            }
            let passes = &self.recorder.passes[span.passes.clone()];
            account.gaps_ns += passes.first().map_or(0.0, |pass| self.submit_cost_ns(pass.kind));
            if span.passes.is_empty() {
                // Commands of a caller's encoder between passes that are alone.
                account.gaps_ns += span.wall_ns();
            } else if span.fenced {
                for pass in passes {
                    let clock = self.plan.clock(pass.kind);
                    self.add_fenced(&mut account, pass.stage, pass.kind, clock, span.wall_ns());
                }
            } else {
                self.add_timestamped(&mut account, span)
            }
        }
        let gpu_ns = match (self.spans.first(), self.spans.last()) {
            (Some(first), Some(last)) => last.fence_ns - first.submit_ns - metering_ns,
            _ => 0.0,
        };
        let envelope_ns = gpu_ns + self.recorder.host_ns();
        account.finish(envelope_ns, &self.metering.meter)
    }

    /// The cost of a submission, from the latest measurements, or from the audit where nothing of the frame is fenced.
    fn submit_cost_ns(&self, kind: PassKind) -> f64 {
        self.metering.meter.cost_ns(kind).unwrap_or_else(|| self.plan.submit_cost.ns(kind))
    }

    /// Adds what took so long alone on the device.
    fn add_fenced(
        &self,
        account: &mut FrameSums<'_>,
        stage: usize,
        kind: PassKind,
        clock: Clock,
        wall_ns: f64,
    ) {
        let cost_ns = self.submit_cost_ns(kind);
        account.add(stage, clock, positive(wall_ns).map(|wall_ns| wall_ns - cost_ns));
        account.stages[stage].submit_cost_ns += cost_ns;
        *account.submissions[stage].entry(kind).or_default() += 1;
    }

    fn add_timestamped(&self, account: &mut FrameSums<'_>, span: &PassSpan) {
        let wall_ns = span.wall_ns();
        let mut last_end = None;
        for pass in &self.recorder.passes[span.passes.clone()] {
            let Some(query) = pass.query.map(|query| query as usize) else {
                continue;
            };
            let ticks = self.ticks[query];
            let ns = check(ticks, self.previous.get(query), self.period_ns, wall_ns);
            account.add(pass.stage, Clock::Timestamp, ns);
            if let Some(end) = last_end {
                account.gaps_ns += signed_ticks(end, ticks[0]) * self.period_ns;
            }
            last_end = Some(ticks[1]);
        }
    }
}

fn names<S: TimedStage + ?Sized>(stages: &[&S]) -> Vec<&'static str> {
    stages.iter().map(|stage| stage.name()).collect()
}

/// Ticks from `begin` to `end`, negative where they are out of order. A counter with few valid bits may begin again at zero between
/// the two: the shorter way around counts.
fn signed_ticks(begin: u64, end: u64) -> f64 {
    let unused = (begin | end).leading_zeros().min(u64::BITS - MIN_VALID_BITS);
    ((end.wrapping_sub(begin) << unused) as i64 >> unused) as f64
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The duration if it is above zero.
fn positive(ns: f64) -> Result<f64, (FaultKind, f64)> {
    match ns {
        ns if ns > 0.0 => Ok(ns),
        ns if ns < 0.0 => Err((FaultKind::Negative, ns)),
        ns => Err((FaultKind::Zero, ns)),
    }
}

/// The duration between two timestamps in ns, or why it is impossible.
fn check(
    ticks: Ticks,
    previous: Option<&Ticks>,
    period_ns: f64,
    wall_ns: f64,
) -> Result<f64, (FaultKind, f64)> {
    let ns = positive(signed_ticks(ticks[0], ticks[1]) * period_ns)?;
    if previous == Some(&ticks) {
        return Err((FaultKind::Stale, ns));
    }
    if ns > wall_ns * WALL_TOLERANCE {
        return Err((FaultKind::LongerThanWall, ns));
    }
    Ok(ns)
}

/// Sums of a frame's durations, being filled.
struct FrameSums<'a> {
    names: &'a [&'static str],
    stages: Vec<StageTime>,
    passes: Vec<u32>,
    /// Fenced submissions of each stage.
    submissions: Vec<SubmissionCounts>,
    gaps_ns: f64,
    faults: Vec<RejectedTime>,
}

impl<'a> FrameSums<'a> {
    fn new(names: &'a [&'static str]) -> Self {
        Self {
            names,
            stages: names.iter().map(|name| StageTime::zero(name)).collect(),
            passes: vec![0; names.len()],
            submissions: vec![SubmissionCounts::new(); names.len()],
            gaps_ns: 0.0,
            faults: Vec::new(),
        }
    }

    fn add(&mut self, stage: usize, clock: Clock, duration: Result<f64, (FaultKind, f64)>) {
        let sample = &mut self.stages[stage];
        sample.clock = match (self.passes[stage], sample.clock, clock) {
            (0, _, clock) => clock,
            (_, Clock::Host, clock) | (_, clock, Clock::Host) => clock,
            (_, before, clock) if before == clock => clock,
            _ => Clock::FencedHost,
        };
        self.passes[stage] += 1;
        match duration {
            Ok(ns) => sample.ns += ns,
            Err((kind, ns)) => {
                sample.ns = f64::NAN;
                self.faults.push(RejectedTime { stage: self.names[stage], kind, ns });
            }
        }
    }

    fn finish(mut self, envelope_ns: f64, meter: &CostMeter) -> FrameSample {
        for (stage, sample) in self.stages.iter_mut().enumerate() {
            sample.resolution_ns = meter.resolution_ns(&self.submissions[stage]);
            if self.passes[stage] == 0 {
                sample.ns = f64::NAN;
                let (stage, kind) = (self.names[stage], FaultKind::NoPass);
                self.faults.push(RejectedTime { stage, kind, ns: 0.0 });
            }
        }
        FrameSample { stages: self.stages, gaps_ns: self.gaps_ns, envelope_ns, faults: self.faults }
    }
}

impl Queries {
    fn new(gpu: &Device, max_passes: u32) -> Result<Self, DeviceError> {
        let count = max_passes * QUERIES_PER_PASS;
        let set = |first: u32| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: (count - first).min(QUERIES_PER_SET),
            })
        };
        gpu.catch(|| {
            let room = count.next_multiple_of(QUERIES_PER_SET).into();
            Ok(Self {
                sets: (0..count).step_by(QUERIES_PER_SET as usize).map(set).collect(),
                results: QueryResults::new(gpu, "ticks", room),
            })
        })
    }

    /// The ticks of the first `passes` passes, two of each.
    fn read(&self, gpu: &Device, passes: u32) -> Result<Vec<u64>, DeviceError> {
        let count = passes * QUERIES_PER_PASS;
        self.results.read(gpu, count.into(), |encoder, resolved| {
            for (first, set) in (0..count).step_by(QUERIES_PER_SET as usize).zip(&self.sets) {
                let here = (count - first).min(QUERIES_PER_SET);
                encoder.resolve_query_set(set, 0..here, resolved, u64::from(first) * RESULT_BYTES);
            }
        })
    }
}

#[cfg(test)]
pub(crate) mod tests;

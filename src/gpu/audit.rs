//! The clock's audit: which kinds of pass have timestamps that can be believed on this adapter.
//!
//! For each kind of pass a kernel of known ratio (N and 2 N work) is run through the same
//! [`FrameTimer`] that measures stages, alone in its command buffer and mixed with the other kinds in
//! one, and its timestamps are held against the fenced host clock:
//!
//! - *alone*: timestamp and host time of the very same submission;
//! - *mixed*: timestamps of one frame against the fenced host times of the same frame's passes, run next to
//!   it, as a frame in one command buffer has no host time per pass.
//!
//! Frames alternate, ratios are taken between neighbours, and the medians count, so that a machine that
//! drifts drifts through both sides alike. Where a verdict is close, more rounds are run before it is
//! given.
//!
//! A kind of pass whose timestamps are unsound in either surrounding is timed by the fenced host clock, in
//! command buffers of its own. It may have spoilt those of its neighbours, too: the worst kind is set
//! apart first, and the others are then audited without it, which is how frames are measured.

use std::fmt::Write as _;
use std::time::Instant;

use super::frame::{ClockPlan, ColorTarget, Encode, FrameSample, FrameTimer, StageScope, Targets};
use super::shader::compilation_options;
use super::{Gpu, GpuError};
use crate::record::{AuditRow, Clock, PassKind};

const KINDS: [PassKind; 3] = [PassKind::Render, PassKind::Compute, PassKind::Copy];
/// Length of a pass at N work: on a software adapter, and on a GPU. Long beside the jitter of a
/// submission (tens of µs), short beside patience.
const SOFTWARE_PASS_NS: f64 = 4e6;
const GPU_PASS_NS: f64 = 1e6;
/// Rounds before the first verdict; doubled while a verdict is close.
const ROUNDS: usize = 7;
const MAX_ROUNDS: usize = 28;
/// N and 2 N work.
const LEVELS: usize = 2;
/// At least the passes of a mixed frame.
const MAX_PASSES: u32 = 16;
/// Timestamp over host time at which a clock is sound: within this factor of 1 either way. The lies
/// known of drivers read 0 or a half.
const ALONE_TOLERANCE: f64 = 1.10;
/// Two frames are compared here, not one with itself.
const MIXED_TOLERANCE: f64 = 1.18;
/// A ratio whose distance from the tolerance is within this factor either way calls for more rounds.
const CLOSE: f64 = 1.15;
/// The kernel's own doubling by the host clock must be within this factor of 2.
const HOST_DOUBLING_TOLERANCE: f64 = 1.2;
/// Share of durations that may be impossible (zero, negative, stale, longer than the wall).
const FAULTY_SHARE: f64 = 0.1;
/// Times each kind of pass occurs in a mixed frame.
const OCCURRENCES: usize = 2;
/// Empty submissions before the first round, and in each round.
const EMPTY_SUBMISSIONS: usize = 32;
const EMPTY_SUBMISSIONS_PER_ROUND: usize = 4;

/// Edge of the render kernel's target in pixels, and invocations of the compute kernel.
const TARGET_EDGE: u32 = 256;
const INVOCATIONS: u32 = 65_536;
const GROUP_SIZE: u32 = 64;
/// Dispatches and draws in a pass at N work; twice as many at 2 N, which doubles fixed costs per thread
/// too. More than one, as some drivers time only the last.
const CALLS: u32 = 2;
const COPY_BYTES: u64 = 1 << 20;
/// Work per call at which calibration begins: loop iterations, and copies of [`COPY_BYTES`].
const FIRST_WORK: u32 = 4;
const CALIBRATION_STEPS: usize = 24;

/// What the audit found, and the clock for each kind of pass.
#[derive(Clone, Debug, PartialEq)]
pub struct Audit {
    pub rows: Vec<AuditRow>,
    pub plan: ClockPlan,
}

/// Audits this adapter's timestamps. Takes some seconds on a software adapter.
pub fn audit(gpu: &Gpu) -> Result<Audit, GpuError> {
    let mut submit_costs = Vec::new();
    time_empty_submissions(gpu, EMPTY_SUBMISSIONS, &mut submit_costs)?;
    let fenced = ClockPlan::fenced(median(&submit_costs));
    let kernels = Kernels::new(gpu)?;
    let work = calibrate(gpu, &kernels, fenced)?;
    let mut bench = Bench::new(gpu, &kernels, work, fenced, submit_costs)?;
    let available = KINDS.into_iter().filter(|kind| has_timestamps(gpu, *kind));
    let mut plan = available.fold(fenced, |plan, kind| plan.with(kind, Clock::Timestamp));
    let alone = bench.measure(gpu, plan, Surrounding::Alone)?;
    let mut mixed = KINDS.map(|kind| without_timestamps(kind, "mixed", &alone));
    while let Some(rows) = bench.mixed(gpu, plan)? {
        let unsound = rows.iter().filter(|row| !row.sound);
        let worst = unsound.max_by(|a, b| factor(a.ratio).total_cmp(&factor(b.ratio)));
        let worst = worst.map(|row| row.pass);
        for row in rows {
            let index = KINDS.iter().position(|kind| *kind == row.pass);
            index
                .into_iter()
                .for_each(|index| mixed[index] = row.clone());
        }
        match worst {
            Some(kind) => plan = plan.with(kind, Clock::FencedHost),
            None => break,
        }
    }
    let believed = |plan: ClockPlan, row: &AuditRow| match row.sound {
        true => plan,
        false => plan.with(row.pass, Clock::FencedHost),
    };
    let mut plan = alone.iter().fold(plan, believed);
    plan.submit_cost_ns = median(&bench.submit_costs);
    let rows = alone
        .into_iter()
        .zip(mixed)
        .flat_map(<[AuditRow; 2]>::from)
        .collect();
    Ok(Audit { rows, plan })
}

/// Host times in ns from submission to fence of empty command buffers.
fn time_empty_submissions(gpu: &Gpu, count: usize, costs: &mut Vec<f64>) -> Result<(), GpuError> {
    for _ in 0..count {
        let encoder = gpu.device.create_command_encoder(&Default::default());
        let commands = encoder.finish();
        let start = Instant::now();
        let index = gpu.queue.submit([commands]);
        gpu.wait_for(Some(index))?;
        costs.push(start.elapsed().as_secs_f64() * 1e9);
    }
    Ok(())
}

/// Whether the adapter has timestamps for this kind of pass at all.
fn has_timestamps(gpu: &Gpu, kind: PassKind) -> bool {
    let needed = match kind {
        PassKind::Copy => {
            wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS
        }
        _ => wgpu::Features::TIMESTAMP_QUERY,
    };
    gpu.features.contains(needed)
}

/// Pipelines and resources of the kernels.
struct Kernels {
    compute: wgpu::ComputePipeline,
    render: wgpu::RenderPipeline,
    results: wgpu::Buffer,
    target: wgpu::TextureView,
    copied: [wgpu::Buffer; 2],
}

impl Kernels {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        use wgpu::BufferUsages as Usage;
        let compute = gpu.shader("audit/compute", &[("GROUP_SIZE", GROUP_SIZE as i32)])?;
        let render = gpu.shader("audit/render", &[])?;
        gpu.scoped(|| {
            Ok(Self {
                compute: compute_pipeline(gpu, &compute),
                render: render_pipeline(gpu, &render),
                results: buffer(gpu, u64::from(INVOCATIONS) * 4, Usage::STORAGE),
                target: target(gpu),
                copied: [
                    buffer(gpu, COPY_BYTES, Usage::COPY_SRC),
                    buffer(gpu, COPY_BYTES, Usage::COPY_DST),
                ],
            })
        })
    }

    /// A kernel of this kind with so much work per call.
    fn kernel(&self, gpu: &Gpu, kind: PassKind, work: u32, calls: u32) -> Kernel<'_> {
        let layout = match kind {
            PassKind::Compute => Some(self.compute.get_bind_group_layout(0)),
            PassKind::Render => Some(self.render.get_bind_group_layout(0)),
            PassKind::Copy | PassKind::Host => None,
        };
        let bindings = layout.map(|layout| {
            let uniform = buffer(
                gpu,
                16,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            );
            gpu.queue.write_buffer(&uniform, 0, &work.to_le_bytes());
            let resources = [&uniform, &self.results].map(wgpu::Buffer::as_entire_binding);
            let entry = |(binding, resource)| wgpu::BindGroupEntry { binding, resource };
            let entries = [0, 1].map(|i| entry((i as u32, resources[i].clone())));
            let used = if kind == PassKind::Compute { 2 } else { 1 };
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("audit"),
                layout: &layout,
                entries: &entries[..used],
            })
        });
        Kernel {
            kernels: self,
            kind,
            bindings,
            work,
            calls,
        }
    }
}

fn buffer(gpu: &Gpu, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let label = Some("audit");
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label,
        size,
        usage,
        mapped_at_creation: false,
    })
}

fn target(gpu: &Gpu) -> wgpu::TextureView {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("audit"),
        size: wgpu::Extent3d {
            width: TARGET_EDGE,
            height: TARGET_EDGE,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

fn compute_pipeline(gpu: &Gpu, module: &wgpu::ShaderModule) -> wgpu::ComputePipeline {
    gpu.device
        .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("audit/compute"),
            layout: None,
            module,
            entry_point: Some("main"),
            compilation_options: compilation_options(),
            cache: None,
        })
}

fn render_pipeline(gpu: &Gpu, module: &wgpu::ShaderModule) -> wgpu::RenderPipeline {
    gpu.device
        .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("audit/render"),
            layout: None,
            vertex: wgpu::VertexState {
                module,
                entry_point: Some("vertex"),
                compilation_options: compilation_options(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module,
                entry_point: Some("fragment"),
                compilation_options: compilation_options(),
                targets: &[Some(wgpu::TextureFormat::Rgba8Unorm.into())],
            }),
            multiview_mask: None,
            cache: None,
        })
}

/// One kind of pass with a set amount of work.
struct Kernel<'a> {
    kernels: &'a Kernels,
    kind: PassKind,
    bindings: Option<wgpu::BindGroup>,
    /// Loop iterations, or copies, per call.
    work: u32,
    calls: u32,
}

impl Encode for Kernel<'_> {
    fn name(&self) -> &'static str {
        match self.kind {
            PassKind::Compute => "audit/compute",
            PassKind::Render => "audit/render",
            PassKind::Copy => "audit/copy",
            PassKind::Host => "audit/host",
        }
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        match self.kind {
            PassKind::Compute => scope.compute(|pass| {
                pass.set_pipeline(&self.kernels.compute);
                pass.set_bind_group(0, &self.bindings, &[]);
                for _ in 0..self.calls {
                    pass.dispatch_workgroups(INVOCATIONS / GROUP_SIZE, 1, 1);
                }
            }),
            PassKind::Render => {
                let color = [ColorTarget {
                    view: &self.kernels.target,
                    clear: Some(wgpu::Color::BLACK),
                }];
                scope.render(
                    &Targets {
                        color: &color,
                        depth: None,
                    },
                    |pass| {
                        pass.set_pipeline(&self.kernels.render);
                        pass.set_bind_group(0, &self.bindings, &[]);
                        for _ in 0..self.calls {
                            pass.draw(0..3, 0..1);
                        }
                    },
                );
            }
            PassKind::Copy => scope.copy(|encoder| {
                let [from, to] = &self.kernels.copied;
                for _ in 0..self.work * self.calls {
                    encoder.copy_buffer_to_buffer(from, 0, to, 0, COPY_BYTES);
                }
            }),
            PassKind::Host => {}
        }
    }
}

/// N for each kind: the work at which a pass alone takes about as long as is wanted.
fn calibrate(gpu: &Gpu, kernels: &Kernels, fenced: ClockPlan) -> Result<[u32; 3], GpuError> {
    let goal_ns = if gpu.adapter.software {
        SOFTWARE_PASS_NS
    } else {
        GPU_PASS_NS
    };
    let mut timer = FrameTimer::new(gpu, fenced, 0)?;
    let mut work = [FIRST_WORK; 3];
    for (kind, work) in KINDS.into_iter().zip(&mut work) {
        for _ in 0..CALIBRATION_STEPS {
            let kernel = kernels.kernel(gpu, kind, *work, CALLS);
            // The first frame compiles, and touches fresh memory.
            timer.timed(gpu, &[&kernel])?;
            let ns = (0..3)
                .map(|_| Ok(timer.timed(gpu, &[&kernel])?.wall_ns - fenced.submit_cost_ns))
                .collect::<Result<Vec<_>, GpuError>>()?;
            let short_by = goal_ns / median(&ns).max(goal_ns / 1024.0);
            if (0.6..1.6).contains(&short_by) {
                break;
            }
            // A step of eight at most: short times are mostly fixed cost.
            *work = (f64::from(*work) * short_by.clamp(0.125, 8.0)).ceil() as u32;
        }
    }
    Ok(work)
}

/// What a pass shares its command buffer with.
#[derive(Clone, Copy, PartialEq)]
enum Surrounding {
    Alone,
    Mixed,
}

/// The kernels of the three kinds at N and at 2 N, and the fenced host clock.
struct Bench<'a> {
    /// By level (N, 2 N), then in the order of [`KINDS`].
    kernels: [[Kernel<'a>; 3]; 2],
    fenced: FrameTimer,
    submit_costs: Vec<f64>,
    submit_cost_ns: f64,
}

impl<'a> Bench<'a> {
    fn new(
        gpu: &Gpu,
        kernels: &'a Kernels,
        work: [u32; 3],
        fenced: ClockPlan,
        submit_costs: Vec<f64>,
    ) -> Result<Self, GpuError> {
        let level = |factor: u32| {
            [0, 1, 2].map(|i: usize| kernels.kernel(gpu, KINDS[i], work[i], CALLS * factor))
        };
        Ok(Self {
            kernels: [level(1), level(2)],
            fenced: FrameTimer::new(gpu, fenced, 0)?,
            submit_costs,
            submit_cost_ns: fenced.submit_cost_ns,
        })
    }

    /// Rows of the kinds that `plan` leaves on timestamps, mixed with one another; `None` if it leaves none.
    fn mixed(&mut self, gpu: &Gpu, plan: ClockPlan) -> Result<Option<Vec<AuditRow>>, GpuError> {
        let left = KINDS
            .iter()
            .any(|kind| plan.clock(*kind) == Clock::Timestamp);
        let rows = left
            .then(|| self.measure(gpu, plan, Surrounding::Mixed))
            .transpose()?;
        let on_timestamps = |row: &AuditRow| plan.clock(row.pass) == Clock::Timestamp;
        Ok(rows.map(|rows| rows.into_iter().filter(on_timestamps).collect()))
    }

    /// Rounds until no verdict is close, or patience ends. A row for each kind.
    fn measure(
        &mut self,
        gpu: &Gpu,
        plan: ClockPlan,
        surrounding: Surrounding,
    ) -> Result<[AuditRow; 3], GpuError> {
        let mut timer = FrameTimer::new(gpu, plan, MAX_PASSES)?;
        let mut series: [Series; 3] = Default::default();
        let mut rounds = 0;
        loop {
            for _ in 0..ROUNDS.max(rounds) {
                match surrounding {
                    Surrounding::Alone => self.alone_round(gpu, &mut timer, &mut series)?,
                    Surrounding::Mixed => self.mixed_round(gpu, &mut timer, &mut series)?,
                }
                time_empty_submissions(gpu, EMPTY_SUBMISSIONS_PER_ROUND, &mut self.submit_costs)?;
                rounds += 1;
            }
            let judged = [0, 1, 2].map(|i| judge(KINDS[i], surrounding, plan, &series[i]));
            if rounds >= MAX_ROUNDS || judged.iter().all(|(_, close)| !close) {
                return Ok(judged.map(|(row, _)| row));
            }
        }
    }

    /// Every kernel once alone, at N and at 2 N: both clocks on the same submission.
    fn alone_round(
        &self,
        gpu: &Gpu,
        timer: &mut FrameTimer,
        series: &mut [Series; 3],
    ) -> Result<(), GpuError> {
        for (index, series) in series.iter_mut().enumerate() {
            for level in 0..LEVELS {
                let sample = timer.timed(gpu, &[&self.kernels[level][index]])?;
                let host_ns = sample.wall_ns - self.submit_cost_ns;
                series.push(level, stage_ns(&sample, 0, 1), host_ns, sample.faults.len());
            }
        }
        Ok(())
    }

    /// All kernels in one frame, on timestamps and then on the fenced host clock, at N and at 2 N.
    fn mixed_round(
        &mut self,
        gpu: &Gpu,
        timer: &mut FrameTimer,
        series: &mut [Series; 3],
    ) -> Result<(), GpuError> {
        for level in 0..LEVELS {
            let [a, b, c] = &self.kernels[level];
            let frame: [&dyn Encode; 3 * OCCURRENCES] = [a, b, c, a, b, c];
            let timestamps = timer.timed(gpu, &frame)?;
            let host = self.fenced.timed(gpu, &frame)?;
            for (index, series) in series.iter_mut().enumerate() {
                let name = self.kernels[level][index].name();
                let faults = timestamps
                    .faults
                    .iter()
                    .filter(|fault| fault.stage == name)
                    .count();
                let timestamp_ns = stage_ns(&timestamps, index, OCCURRENCES);
                series.push(
                    level,
                    timestamp_ns,
                    stage_ns(&host, index, OCCURRENCES),
                    faults,
                );
            }
        }
        Ok(())
    }
}

/// Mean time of a kind over its occurrences in a frame. A duration that was not accepted counts as it
/// was read.
fn stage_ns(sample: &FrameSample, index: usize, occurrences: usize) -> f64 {
    let occurrence = |nth: usize| {
        let stage = &sample.stages[index + nth * KINDS.len()];
        match stage.ns.is_nan() {
            true => {
                let mut faults = sample
                    .faults
                    .iter()
                    .filter(|fault| fault.stage == stage.name);
                faults.next().map_or(0.0, |fault| fault.ns)
            }
            false => stage.ns,
        }
    };
    (0..occurrences).map(occurrence).sum::<f64>() / occurrences as f64
}

/// Times of one kind of pass in one surrounding, round by round, at N and at 2 N.
#[derive(Default)]
struct Series {
    timestamp_ns: [Vec<f64>; 2],
    host_ns: [Vec<f64>; 2],
    faults: usize,
}

impl Series {
    fn push(&mut self, level: usize, timestamp_ns: f64, host_ns: f64, faults: usize) {
        self.timestamp_ns[level].push(timestamp_ns);
        self.host_ns[level].push(host_ns);
        self.faults += faults;
    }

    /// Timestamp over host time at N: the median over the rounds.
    fn ratio(&self) -> f64 {
        let pairs = self.timestamp_ns[0].iter().zip(&self.host_ns[0]);
        median(
            &pairs
                .map(|(timestamp, host)| timestamp / host)
                .collect::<Vec<_>>(),
        )
    }
}

/// Time at 2 N over that at N: the median over the rounds.
fn doubling(levels: &[Vec<f64>; 2]) -> f64 {
    let pairs = levels[0]
        .iter()
        .zip(&levels[1])
        .filter(|(single, _)| **single > 0.0);
    let ratios: Vec<f64> = pairs.map(|(single, double)| double / single).collect();
    if ratios.is_empty() {
        0.0
    } else {
        median(&ratios)
    }
}

/// The row of a kind of pass that was not on timestamps; the host time is that of its other row.
fn without_timestamps(kind: PassKind, context: &str, rows: &[AuditRow]) -> AuditRow {
    AuditRow {
        pass: kind,
        context: context.to_owned(),
        timestamp_ns: 0.0,
        host_ns: rows
            .iter()
            .find(|row| row.pass == kind)
            .map_or(0.0, |row| row.host_ns),
        ratio: 0.0,
        doubling: 0.0,
        sound: false,
        reason: "the adapter has no timestamps for this kind of pass".to_owned(),
    }
}

/// Distance of a ratio from 1 as a factor of at least 1; infinite where it is not positive.
fn factor(ratio: f64) -> f64 {
    if ratio > 0.0 {
        ratio.max(1.0 / ratio)
    } else {
        f64::INFINITY
    }
}

fn is_close(factor: f64, tolerance: f64) -> bool {
    (tolerance / CLOSE.sqrt()..tolerance * CLOSE).contains(&factor)
}

/// The row for one kind in one surrounding, and whether its verdict is close.
fn judge(
    kind: PassKind,
    surrounding: Surrounding,
    plan: ClockPlan,
    series: &Series,
) -> (AuditRow, bool) {
    let (context, tolerance) = match surrounding {
        Surrounding::Alone => ("alone", ALONE_TOLERANCE),
        Surrounding::Mixed => ("mixed", MIXED_TOLERANCE),
    };
    let row = AuditRow {
        pass: kind,
        context: context.to_owned(),
        timestamp_ns: median(&series.timestamp_ns[0]),
        host_ns: median(&series.host_ns[0]),
        ratio: series.ratio(),
        doubling: doubling(&series.timestamp_ns),
        sound: false,
        reason: String::new(),
    };
    if plan.clock(kind) != Clock::Timestamp {
        return (without_timestamps(kind, context, &[row]), false);
    }
    let (verdict, close) = verdict(&row, series, tolerance);
    let sound = verdict.is_ok();
    let apart = match surrounding {
        Surrounding::Alone => String::new(),
        Surrounding::Mixed => passes_apart(plan),
    };
    let reason = verdict.unwrap_or_else(|reason| reason) + &apart;
    (
        AuditRow {
            sound,
            reason,
            ..row
        },
        close,
    )
}

/// Why the row is sound or why not, and whether more rounds may change that.
fn verdict(row: &AuditRow, series: &Series, tolerance: f64) -> (Result<String, String>, bool) {
    let host_doubling = doubling(&series.host_ns);
    let relative = factor(row.doubling / host_doubling);
    let durations = series.timestamp_ns.iter().flatten().count();
    if series.faults as f64 > FAULTY_SHARE * durations as f64 {
        let reason = format!("{} of {durations} durations cannot be true", series.faults);
        return (Err(reason), false);
    }
    let linear = factor(host_doubling / 2.0) <= HOST_DOUBLING_TOLERANCE;
    let close = is_close(factor(row.ratio), tolerance) || is_close(relative, tolerance) || !linear;
    let verdict = if factor(row.ratio) > tolerance {
        Err(format!("timestamps read {:.2} of the host time", row.ratio))
    } else if relative > tolerance {
        Err(format!(
            "double work reads {:.2}, took {host_doubling:.2} the time",
            row.doubling
        ))
    } else if !linear {
        Err(format!(
            "double work took {host_doubling:.2} the time: too disturbed to tell"
        ))
    } else {
        Ok(format!(
            "agrees with the host clock, which doubles by {host_doubling:.2}"
        ))
    };
    (verdict, close)
}

/// Which kinds of pass had command buffers of their own, in brackets; empty if none had.
fn passes_apart(plan: ClockPlan) -> String {
    let apart = KINDS
        .into_iter()
        .filter(|kind| plan.clock(*kind) != Clock::Timestamp);
    let names = apart.map(pass_name).collect::<Vec<_>>().join(" and ");
    if names.is_empty() {
        names
    } else {
        format!(" ({names} apart)")
    }
}

/// The median; 0 of nothing.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        odd if odd % 2 == 1 => sorted[odd / 2],
        even => (sorted[even / 2 - 1] + sorted[even / 2]) / 2.0,
    }
}

/// The audit as a table for the terminal, and the clocks that follow from it.
pub fn audit_table(audit: &Audit) -> String {
    let mut table =
        String::from("pass     context  timestamp ms    host ms   ratio  doubling  verdict\n");
    for row in &audit.rows {
        let verdict = if row.sound { "sound" } else { "unsound" };
        // Writing to a String does not fail.
        let _ = writeln!(
            table,
            "{:<8} {:<8} {:>12.3} {:>10.3} {:>7.3} {:>9.2}  {verdict}: {}",
            pass_name(row.pass),
            row.context,
            row.timestamp_ns * 1e-6,
            row.host_ns * 1e-6,
            row.ratio,
            row.doubling,
            row.reason
        );
    }
    for kind in KINDS {
        let clock = match audit.plan.clock(kind) {
            Clock::Timestamp => "timestamps",
            Clock::FencedHost | Clock::Host => "fenced host clock",
        };
        let _ = writeln!(table, "{} passes are timed by {clock}", pass_name(kind));
    }
    let _ = writeln!(
        table,
        "one submission costs {:.1} µs",
        audit.plan.submit_cost_ns * 1e-3
    );
    table
}

fn pass_name(kind: PassKind) -> &'static str {
    match kind {
        PassKind::Compute => "compute",
        PassKind::Render => "render",
        PassKind::Copy => "copy",
        PassKind::Host => "host",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A series of rounds with these times at N, doubled at 2 N, a little noise on each.
    fn series(timestamp_ns: f64, host_ns: f64) -> Series {
        let mut series = Series::default();
        for round in 0..9 {
            let noise = 1.0 + 0.02 * f64::from(round % 3 - 1);
            series.push(0, timestamp_ns * noise, host_ns, 0);
            series.push(1, 2.0 * timestamp_ns * noise, 2.0 * host_ns, 0);
        }
        series
    }

    fn verdict(series: &Series) -> (bool, bool) {
        let plan = ClockPlan::fenced(0.0).with(PassKind::Compute, Clock::Timestamp);
        let (row, close) = judge(PassKind::Compute, Surrounding::Alone, plan, series);
        (row.sound, close)
    }

    #[test]
    fn timestamps_that_agree_are_sound() {
        assert_eq!(verdict(&series(5e6, 5.05e6)), (true, false));
    }

    #[test]
    fn half_and_next_to_nothing_are_unsound() {
        assert_eq!(verdict(&series(2.5e6, 5e6)), (false, false));
        assert_eq!(verdict(&series(5e3, 5e6)), (false, false));
        assert_eq!(verdict(&series(0.0, 5e6)), (false, false));
    }

    #[test]
    fn a_fixed_reading_does_not_double() {
        let mut fixed = series(5e6, 5e6);
        fixed.timestamp_ns[1] = fixed.timestamp_ns[0].clone();
        assert!(!verdict(&fixed).0);
    }

    #[test]
    fn impossible_durations_are_unsound_whatever_their_median() {
        let mut faulty = series(5e6, 5e6);
        faulty.faults = 4;
        assert_eq!(verdict(&faulty), (false, false));
    }

    #[test]
    fn a_ratio_near_the_tolerance_is_close() {
        assert_eq!(verdict(&series(5e6, 5.6e6)), (false, true));
        assert_eq!(verdict(&series(5e6, 5.4e6)), (true, true));
    }

    #[test]
    fn a_disturbed_host_clock_decides_nothing() {
        let mut disturbed = series(5e6, 5e6);
        disturbed.host_ns[1].iter_mut().for_each(|ns| *ns *= 1.4);
        disturbed.timestamp_ns[1]
            .iter_mut()
            .for_each(|ns| *ns *= 1.4);
        assert_eq!(verdict(&disturbed), (false, true));
    }

    #[test]
    fn the_median_is_the_middle() {
        assert_eq!(median(&[]), 0.0);
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
    }
}

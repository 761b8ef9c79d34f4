//! The GPU layer on whatever adapter is there: errors instead of panics, read-back, counters, timed frames
//! and their accounting.

use fathom::clock::{Samples, accounting_error};
use fathom::embedded::{Folder, Folders};
use fathom::gpu::kit::{Bindings, Buffer, Dispatch, DrawPass, RenderSpec, Resources, opaque};
use fathom::gpu::{
    ClockPlan, ColorTarget, DeviceError, Drawing, FrameTimer, Gpu, GpuError, Options, StageScope,
    SubmitCost, Targets, TimedStage, count, read_buffer, read_texture,
};
use fathom::record::{Clock, FaultKind, PassKind};

/// Edge of the render stage's target in pixels, and invocations of the compute stage.
const EDGE: u32 = 128;
const INVOCATIONS: u32 = 65_536;

fn open() -> Gpu {
    let shaders = Some(Folders::new(Folder::from_path("src/clock/audit")));
    Gpu::open(&Options { shaders, ..Options::default() }).expect("an adapter is there")
}

/// A compute and a render stage of some milliseconds on a software adapter.
struct BusyWork {
    dispatch: Dispatch,
    render: DrawPass,
    uniform: Buffer,
    scratch: [wgpu::Buffer; 2],
}

fn buffer(gpu: &Gpu, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let (label, mapped_at_creation) = (Some("test"), false);
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation })
}

fn texture(gpu: &Gpu, width: u32, height: u32, format: wgpu::TextureFormat) -> wgpu::Texture {
    Resources::new(gpu).target("test", [width, height], format)
}

impl BusyWork {
    fn new(gpu: &Gpu) -> Self {
        use wgpu::BufferUsages as Usage;
        let (resources, shader) = (Resources::new(gpu), "kernels");
        let uniform = resources.filled("test", &[0; 16], Usage::UNIFORM | Usage::COPY_DST);
        let results = resources.storage("test", u64::from(INVOCATIONS) * 4);
        let computed = Bindings::new(&[&uniform, &results]);
        let drawn = Bindings::new(&[&uniform]);
        let format = [opaque(wgpu::TextureFormat::Rgba8Unorm)];
        let groups = [&drawn];
        let spec = RenderSpec::new(shader, &groups, &format);
        let render = DrawPass::new(&resources, &spec, [EDGE; 2], wgpu::Color::BLACK);
        let dispatch = Dispatch::new(&resources, shader, &[&computed], [INVOCATIONS / 64, 1, 1]);
        Self {
            dispatch: dispatch.expect("it links"),
            render: render.expect("it links"),
            scratch: [Usage::COPY_SRC, Usage::COPY_DST].map(|usage| buffer(gpu, 1 << 22, usage)),
            uniform,
        }
    }

    fn stage(&self, kind: PassKind) -> Encoded<'_> {
        match kind {
            PassKind::Compute => encoded(|scope| scope.compute(|pass| self.dispatch.run(pass))),
            PassKind::Render => {
                encoded(|scope| self.render.render(scope, |pass| pass.draw(0..6 * 32 * 32, 0..1)))
            }
            PassKind::Copy => encoded(|scope| self.copy(scope, self.scratch[0].size())),
            PassKind::Host => encoded(|scope| {
                scope.host(|queue| queue.write_buffer(&self.uniform, 0, &200u32.to_le_bytes()));
            }),
        }
    }

    fn copy(&self, scope: &mut StageScope<'_>, bytes: u64) {
        let [from, to] = &self.scratch;
        scope.copy(|encoder| encoder.copy_buffer_to_buffer(from, 0, to, 0, bytes));
    }
}

/// A stage that is a function.
struct Encoded<'a>(Box<dyn Fn(&mut StageScope<'_>) + 'a>);

fn encoded<'a>(encode: impl Fn(&mut StageScope<'_>) + 'a) -> Encoded<'a> {
    Encoded(Box::new(encode))
}

impl TimedStage for Encoded<'_> {
    fn name(&self) -> &'static str {
        "test"
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        (self.0)(scope);
    }
}

/// Render passes on timestamps, where the adapter has them, and the rest on the fenced host clock;
/// submissions at 50 µs.
fn plan(gpu: &Gpu) -> ClockPlan {
    let plan = ClockPlan::fenced(SubmitCost { compute_ns: 5e4, render_ns: 5e4, copy_ns: 5e4 });
    if gpu.features.contains(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS) {
        plan.with(PassKind::Render, Clock::Timestamp)
    } else {
        plan
    }
}

fn timer(gpu: &Gpu, most_passes: u32) -> FrameTimer {
    FrameTimer::new(gpu, plan(gpu), most_passes).expect("it is made")
}

/// Whatever the machine does meanwhile: on one clock, stages and gaps are the whole of the frame.
#[test]
fn stages_and_gaps_make_up_the_envelope() {
    let gpu = open();
    let work = BusyWork::new(&gpu);
    let kinds = [PassKind::Host, PassKind::Compute, PassKind::Render, PassKind::Copy];
    let stages: Vec<_> = kinds.into_iter().chain(kinds).map(|kind| work.stage(kind)).collect();
    let frame: Vec<_> = stages.iter().collect();
    let costs = SubmitCost { compute_ns: 5e4, render_ns: 5e4, copy_ns: 5e4 };
    for plan in [ClockPlan::fenced(costs), ClockPlan::process_cpu(costs)] {
        let mut timer = FrameTimer::new(&gpu, plan, 16).expect("it is made");
        for _ in 0..5 {
            let sample = timer.time_stages(&gpu, &frame).expect("the frame runs");
            assert_eq!(sample.faults, [], "{sample:?}");
            let clocks: Vec<Clock> = sample.stages.iter().map(|stage| stage.clock).collect();
            assert_eq!(clocks, kinds.map(|kind| plan.clock(kind)).repeat(2));
            // Readings are whole nanoseconds since a start, and differences are taken of them.
            let mut samples = Samples::default();
            samples.add(sample, 1.0, 0, 0.0, None, None);
            assert!(accounting_error(&samples) < 1e-6, "{samples:?}");
            assert!(timer.run_stages(&gpu, &frame).expect("the frame runs") > 0.0);
        }
    }
    let mut timer = timer(&gpu, 16);
    let sample = timer.time_stages(&gpu, &frame).expect("the frame runs");
    let clocks: Vec<Clock> = sample.stages.iter().map(|stage| stage.clock).collect();
    assert_eq!(clocks, kinds.map(|kind| plan(&gpu).clock(kind)).repeat(2));
}

#[test]
fn a_stage_without_passes_is_a_fault() {
    let gpu = open();
    let mut timer = timer(&gpu, 4);
    let idle = encoded(|_| {});
    let sample = timer.time_stages(&gpu, &[&idle]).expect("the frame runs");
    assert!(sample.stages[0].ns.is_nan());
    assert_eq!(sample.faults[0].kind, FaultKind::NoPass);
}

#[test]
fn more_passes_than_queries_is_an_error() {
    let gpu = open();
    let work = BusyWork::new(&gpu);
    let (host, render) = (work.stage(PassKind::Host), work.stage(PassKind::Render));
    let timed = plan(&gpu).clock(PassKind::Render) == Clock::Timestamp;
    let mut timer = timer(&gpu, 1);
    timer.time_stages(&gpu, &[&host, &render]).expect("one pass fits");
    let outcome = timer.time_stages(&gpu, &[&host, &render, &render]);
    assert_eq!(matches!(outcome, Err(DeviceError::TooManyPasses(1))), timed);
    timer.time_stages(&gpu, &[&host, &render]).expect("the timer is usable afterwards");
}

#[test]
fn many_passes_span_several_query_sets() {
    let gpu = open();
    let work = BusyWork::new(&gpu);
    let copy = work.stage(PassKind::Copy);
    let passes = 2100;
    // Copies are on timestamps, too, if renders are.
    let plan = plan(&gpu).with(PassKind::Copy, plan(&gpu).render);
    let mut timer = FrameTimer::new(&gpu, plan, passes).expect("it is made");
    let many = encoded(|scope| (1..passes).for_each(|_| work.copy(scope, 65_536)));
    let sample = timer.time_stages(&gpu, &[&many, &copy]).expect("the frame runs");
    // Copies this small may read as nothing. The last pass, whose query is in another set than the first, copies 4 MiB.
    assert!(sample.faults.iter().all(|fault| fault.kind == FaultKind::Zero), "{:?}", sample.faults);
    assert!(sample.stages[1].ns > 0.0, "{:?}", sample.stages);
}

#[test]
fn invocations_are_counted_exactly() {
    let gpu = open();
    let work = BusyWork::new(&gpu);
    let (host, compute, render) =
        (work.stage(PassKind::Host), work.stage(PassKind::Compute), work.stage(PassKind::Render));
    let frame = [&host, &compute, &render, &compute];
    let counted = count(&gpu, &frame, 8).expect("the frame runs");
    assert_eq!(counted[2].passes, [PassKind::Render].into());
    assert_eq!(counted[2].targets.first().map(|target| target.format.as_str()), Some("rgba8unorm"));
    assert!(counted[0].counters.is_empty() && counted[0].passes.is_empty());
    if counted.iter().all(|stage| stage.counters.is_empty()) {
        println!("skipped: {} does not count invocations", gpu.adapter.name);
        return;
    }
    for stage in [&counted[1], &counted[3]] {
        assert_eq!(stage.counters["compute_invocations"], u64::from(INVOCATIONS));
    }
    assert_eq!(counted[2].counters["vertex_invocations"], 6 * 32 * 32);
    assert!(counted[2].counters["fragment_invocations"] >= u64::from(EDGE * EDGE));
}

#[test]
fn every_format_is_read_back_whatever_its_row_length() {
    use wgpu::TextureFormat as Format;
    let gpu = open();
    let mut timer = timer(&gpu, 4);
    let formats = [
        (Format::R32Float, 1, 1e-7),
        (Format::Rgba32Float, 4, 1e-7),
        (Format::R16Float, 1, 1e-3),
        (Format::Rgba16Float, 4, 1e-3),
        (Format::R8Unorm, 1, 4e-3),
        (Format::Rgba8Unorm, 4, 4e-3),
    ];
    for (format, channels, tolerance) in formats {
        let usages = format.guaranteed_format_features(gpu.features).allowed_usages;
        if !usages.contains(wgpu::TextureUsages::RENDER_ATTACHMENT) {
            println!("skipped: {} does not render to {format:?}", gpu.adapter.name);
            continue;
        }
        let texture = texture(&gpu, 37, 5, format);
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let clear = encoded(|scope| {
            let clear = Some(wgpu::Color { r: 0.2, g: 0.4, b: 0.6, a: 1.0 });
            let color = [ColorTarget { view: &view, clear, slice: None, drawing: Drawing::Opaque }];
            scope.render(&Targets { color: &color, depth: None }, |_| {});
        });
        timer.run_stages(&gpu, &[&clear]).expect("the frame runs");
        let pixels = read_texture(&gpu, &texture).expect("it is read");
        assert_eq!(pixels.data.len(), 37 * 5 * channels);
        for (value, cleared) in pixels.texel(36, 4).iter().zip([0.2, 0.4, 0.6, 1.0]) {
            assert!((value - cleared).abs() < tolerance, "{format:?}: {value} is not {cleared}");
        }
    }
    let texture = texture(&gpu, 4, 4, Format::Rg16Float);
    let of_texture = read_texture(&gpu, &texture).err();
    assert!(matches!(of_texture, Some(GpuError::Device(DeviceError::ReadBack(_)))));
    let unreadable = buffer(&gpu, 12, wgpu::BufferUsages::STORAGE);
    let of_buffer = read_buffer(&gpu, &unreadable);
    assert!(matches!(of_buffer, Err(GpuError::Device(DeviceError::Validation(_)))));
}

#[test]
fn a_refused_call_is_an_error_of_its_scope_and_no_other() {
    let gpu = open();
    let map = |width| gpu.catch(|| Ok(texture(&gpu, width, 4, wgpu::TextureFormat::R8Unorm)));
    let too_wide = gpu.limits.max_texture_dimension_2d + 1;
    let is_refused = |error| matches!(error, Some(GpuError::Device(DeviceError::Validation(_))));
    assert!(is_refused(map(too_wide).err()));
    map(4).expect("it is sound again");
    assert!(is_refused(gpu.catch(|| map(too_wide).map(drop)).err()));
}

#[test]
fn an_error_outside_any_scope_comes_with_the_next_call_and_once() {
    let gpu = open();
    texture(&gpu, gpu.limits.max_texture_dimension_2d + 1, 4, wgpu::TextureFormat::R8Unorm);
    assert!(matches!(gpu.wait(), Err(DeviceError::Validation(_))));
    gpu.wait().expect("it was told once");
}

#[test]
fn a_lost_device_is_an_error_and_not_a_panic() {
    let gpu = open();
    let work = BusyWork::new(&gpu);
    let mut timer = timer(&gpu, 4);
    gpu.device.destroy();
    let render = work.stage(PassKind::Render);
    assert!(timer.time_stages(&gpu, &[&render]).is_err());
    assert!(matches!(timer.run_stages(&gpu, &[&render]), Err(DeviceError::Lost(_))));
    assert!(matches!(gpu.shader("kernels", &[]), Err(GpuError::Device(DeviceError::Lost(_)))));
}

#[test]
fn an_unknown_adapter_lists_those_that_are_there() {
    let adapter = Some("no such adapter".to_owned());
    let options = Options { adapter, unchecked: false, ..Options::default() };
    let message = Gpu::open(&options).err().expect("there is none").to_string();
    assert!(message.contains(&Gpu::list()[0].adapter.name), "{message}");
    let first = Options { adapter: Some("0".to_owned()), unchecked: true, ..Options::default() };
    let gpu = Gpu::open(&first).expect("the first is there");
    assert_eq!(gpu.adapter.name, Gpu::list()[0].adapter.name);
    gpu.shader("audit/loops", &[]).expect("it links without checks, too");
}

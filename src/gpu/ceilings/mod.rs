//! The adapter's own limits, measured with kernels whose work and results are known, on the clock that times stages.
//!
//! Each kernel is run with N and with 2 N work. The second must take twice as long, and the result is read back and compared
//! with the CPU's: a driver that leaves out work looks fast and is found out. `docs/ceilings.md` tells what is measured and how it is
//! used.

mod compute;
mod kernel;
mod pacer;
mod raster;
#[cfg(test)]
mod tests;
mod waker;

pub use pacer::Pacer;
pub use waker::Waker;

use self::kernel::{BenchKernel, KernelRun};
use super::{ClockPlan, FrameTimer, Gpu, GpuError};
use fathom_base::statistics::{estimate, median};
use fathom_record::PassKind;
use fathom_record::ceilings::{CACHED_SET_BYTES, Ceiling, FillFormat, Limit, MEMORY_SET_BYTES};

/// Length of a pass with N work: on a software adapter, and on a GPU. Long beside the jitter of a submission.
const SOFTWARE_PASS_NS: f64 = 3e6;
const GPU_PASS_NS: f64 = 0.5e6;
/// Samples with N work, and as many with 2 N: enough for an interval of the rates.
const ROUNDS: usize = 7;
/// The difference between 2 N and N work counts as at least this share of the time for N, so that rates are finite.
const MIN_SHARE: f64 = 0.01;
/// On a busy machine the cost of a submission, which is subtracted, can exceed a pass's time: the difference is at least this, ns.
const MIN_NS: f64 = 1.0;
/// A measurement whose law does not hold is repeated so many times: something else may have run.
const ATTEMPTS: usize = 3;
/// N is raised so many times before that where a pass costs too much whatever its work. A driver that leaves out work stays fast.
const RAISED: u32 = 4;

/// Every limit that this adapter can be measured against.
pub fn limits(gpu: &Gpu) -> Vec<Limit> {
    let can = |limit: &Limit| match limit {
        // Shaders on a CPU are slower than its memory: half a second a turn, and the clear binds.
        Limit::ReadMemory => {
            !gpu.adapter.software && gpu.limits.max_storage_buffer_binding_size >= MEMORY_SET_BYTES
        }
        Limit::WriteMemory => gpu.limits.max_buffer_size >= MEMORY_SET_BYTES,
        Limit::Blend(FillFormat::R32Float | FillFormat::Rgba32Float) => {
            gpu.features.contains(wgpu::Features::FLOAT32_BLENDABLE)
        }
        _ => true,
    };
    Limit::all().into_iter().filter(can).collect()
}

/// Measures all of an adapter's [limits]. Takes some seconds on a software adapter.
///
/// # Errors
/// A fault of the device, or a result that is not the CPU's.
pub fn ceilings(gpu: &Gpu, plan: ClockPlan) -> Result<Vec<Ceiling>, GpuError> {
    let mut waker = Waker::default();
    let measured = |limit| {
        waker.wake(gpu)?;
        measure(gpu, plan, limit)
    };
    limits(gpu).into_iter().map(measured).collect()
}

/// Measures one limit by the plan's clocks. It is measured again where twice the work does not take twice the time.
///
/// # Errors
/// As of [`ceilings`].
pub fn measure(gpu: &Gpu, plan: ClockPlan, limit: Limit) -> Result<Ceiling, GpuError> {
    let kernel = kernel_of(gpu, &limit)?;
    let mut bench = TestBench::new(gpu, plan, &kernel)?;
    let max = kernel.max_iterations / 2;
    let iterations = bench.calibrate(max)?;
    let (iterations, ceiling) =
        retry_until_sound(iterations, max, |iterations| bench.ceiling(&limit, iterations))?;
    let wrong = |reason| GpuError::Unusable(format!("the ceiling `{}`: {reason}", limit.name()));
    kernel.check(gpu, 2 * iterations)?.map_err(wrong)?;
    Ok(ceiling)
}

/// The kernel of a limit.
fn kernel_of(gpu: &Gpu, limit: &Limit) -> Result<BenchKernel, GpuError> {
    use PassKind::{Compute, Render};
    use compute::{CHAINED, EDGE, KernelCode, OPERATIONS, clear, compute, read, texels};
    const LOADED: (u32, u32) = (OPERATIONS, OPERATIONS / 2);
    let run = |entry, (work, result), reads| {
        compute(gpu, KernelCode { reads, ..KernelCode::new(entry, work, result) })
    };
    gpu.catch(|| match limit {
        Limit::ReadCached => read(gpu, CACHED_SET_BYTES),
        Limit::ReadMemory => read(gpu, MEMORY_SET_BYTES),
        Limit::WriteCached => Ok(clear(gpu, CACHED_SET_BYTES)),
        Limit::WriteMemory => Ok(clear(gpu, MEMORY_SET_BYTES)),
        Limit::Fill(format) => raster::fill(gpu, texture_format(*format), false),
        Limit::Blend(format) => raster::fill(gpu, texture_format(*format), true),
        Limit::SmallTriangles => raster::small_triangles(gpu, false),
        Limit::DrawnTriangles => raster::small_triangles(gpu, true),
        Limit::Loads2d(Compute) => run("load_2d", LOADED, texels(gpu, 1)),
        Limit::Loads3d(Compute) => run("load_3d", LOADED, texels(gpu, EDGE)),
        Limit::MultiplyAdds(Compute) => run("multiply_add", (CHAINED, CHAINED), vec![]),
        Limit::Loads2d(Render) => raster::shade(gpu, "load_2d", LOADED, &texels(gpu, 1)),
        Limit::Loads3d(Render) => raster::shade(gpu, "load_3d", LOADED, &texels(gpu, EDGE)),
        Limit::MultiplyAdds(Render) => raster::shade(gpu, "multiply_add", (CHAINED, CHAINED), &[]),
        Limit::Loads2d(_) | Limit::Loads3d(_) | Limit::MultiplyAdds(_) | Limit::Former(_) => {
            Err(GpuError::Unusable(format!("nothing measures `{}`", limit.name())))
        }
    })
}

fn texture_format(format: FillFormat) -> wgpu::TextureFormat {
    use wgpu::TextureFormat::{R8Unorm, R16Float, R32Float, Rgba8Unorm, Rgba16Float, Rgba32Float};
    let all = [R8Unorm, Rgba8Unorm, R16Float, Rgba16Float, R32Float, Rgba32Float];
    all[format as usize]
}

/// A sound measurement or the last of some, and its turns.
fn retry_until_sound(
    mut turns: u32,
    max: u32,
    mut measured: impl FnMut(u32) -> Result<Ceiling, GpuError>,
) -> Result<(u32, Ceiling), GpuError> {
    let mut ceiling = measured(turns)?;
    for _ in 1..ATTEMPTS {
        if ceiling.is_sound() {
            break;
        }
        if ceiling.is_short() {
            turns = turns.saturating_mul(RAISED).min(max).max(turns);
        }
        ceiling = measured(turns)?;
    }
    Ok((turns, ceiling))
}

/// A kernel and the clock that times it.
struct TestBench<'a> {
    gpu: &'a Gpu,
    kernel: &'a BenchKernel,
    timer: FrameTimer,
}

impl<'a> TestBench<'a> {
    fn new(gpu: &'a Gpu, plan: ClockPlan, kernel: &'a BenchKernel) -> Result<Self, GpuError> {
        Ok(Self { gpu, kernel, timer: FrameTimer::new(gpu, plan, 1)? })
    }

    /// Time of so many turns, ns; not above zero where it is shorter than the clock can tell. A frame with a fault is taken again.
    fn time_ns(&mut self, iterations: u32) -> Result<f64, GpuError> {
        const TRIES: usize = 8;
        let Self { gpu, kernel, timer } = self;
        for _ in 0..TRIES {
            kernel.prepare(gpu, iterations);
            // What was queued must not be part of the pass.
            gpu.queue.submit([]);
            gpu.wait()?;
            let stage = &KernelRun { kernel, iterations };
            let ns = timer.time_stages(gpu, &[stage])?.stages[0].ns;
            if ns.is_finite() {
                return Ok(ns);
            }
        }
        let reason = "the clock gave impossible times only; fathom audit checks the clock";
        Err(GpuError::Unusable(reason.to_owned()))
    }

    /// Turns that take about as long as is wanted, but no more than `most`.
    fn calibrate(&mut self, max: u32) -> Result<u32, GpuError> {
        const STEPS: usize = 24;
        const LARGEST_STEP: f64 = 16.0;
        let goal_ns = if self.gpu.adapter.software { SOFTWARE_PASS_NS } else { GPU_PASS_NS };
        let mut iterations = 1;
        // The first frame compiles, and touches fresh memory.
        self.time_ns(iterations)?;
        for _ in 0..STEPS {
            let short_by = (goal_ns / self.time_ns(iterations)?.max(0.0)).min(LARGEST_STEP);
            if short_by < 1.5 || iterations >= max {
                break;
            }
            iterations = ((f64::from(iterations) * short_by).ceil() as u32).min(max).max(1);
        }
        Ok(iterations)
    }

    fn ceiling(&mut self, limit: &Limit, turns: u32) -> Result<Ceiling, GpuError> {
        let levels = [turns, 2 * turns];
        let mut times_ns = levels.map(|_| Vec::new());
        for _ in 0..ROUNDS {
            for (level, times_ns) in levels.iter().zip(&mut times_ns) {
                times_ns.push(self.time_ns(*level)?);
            }
        }
        let [once, twice] = times_ns;
        let work = f64::from(turns) * self.kernel.work_per_iteration;
        Ok(compute_ceiling(limit, work, &once, &twice))
    }
}

/// What times in ns of so much work and of twice as much, pair by pair, say of a limit.
fn compute_ceiling(limit: &Limit, work: f64, once: &[f64], twice: &[f64]) -> Ceiling {
    // The second N of the work, without what a pass costs whatever its work.
    let difference = |(once, twice): (&f64, &f64)| (twice - once).max(MIN_SHARE * once).max(MIN_NS);
    let seconds = once.iter().zip(twice).map(|pair| difference(pair) * 1e-9);
    let rate = estimate(&seconds.map(|seconds| work / seconds).collect::<Vec<f64>>());
    Ceiling::new(limit.clone(), rate, median(twice) / median(once))
}

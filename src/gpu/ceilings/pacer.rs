//! How fast the machine is at a moment, whatever is measured then.

use super::compute::{CHAINED, KernelCode, clear, compute};
use super::kernel::{BenchKernel, KernelRun};
use super::{FrameTimer, TestBench};
use crate::{ClockPlan, Gpu, GpuError, HostClock};

/// What the second kernel clears: more than the caches of one core hold.
const BYTES: u64 = 16 << 20;

/// Two small kernels beside the frames of a visit: arithmetic, and writes to memory. Their times are in the record, and by how much they
/// scatter between visits a run is quiet or noisy.
pub struct Pacer {
    kernels: [(BenchKernel, u32); 2],
    timer: FrameTimer,
    clock: HostClock,
}

impl Pacer {
    /// Each takes about 3 ms on a software driver and 0.5 ms on a GPU, by powers of two of its work, so that runs have the same.
    ///
    /// # Errors
    /// A fault of the device.
    pub fn new(gpu: &Gpu, plan: ClockPlan) -> Result<Self, GpuError> {
        let arithmetic = KernelCode::new("multiply_add", CHAINED, CHAINED);
        let kernels = gpu.catch(|| Ok([compute(gpu, arithmetic)?, clear(gpu, BYTES)]))?;
        let calibrated = |kernel: BenchKernel| -> Result<_, GpuError> {
            let turns = TestBench::new(gpu, plan, &kernel)?.calibrate(kernel.max_iterations)?;
            Ok((kernel, 1 << turns.ilog2()))
        };
        let [arithmetic, memory] = kernels.map(calibrated);
        let timer = FrameTimer::new(gpu, plan, 1)?;
        Ok(Self { kernels: [arithmetic?, memory?], timer, clock: HostClock::from_plan(&plan) })
    }

    /// Runs both; nanoseconds.
    ///
    /// # Errors
    /// A fault of the device.
    pub fn read(&mut self, gpu: &Gpu) -> Result<[f64; 2], GpuError> {
        let mut times_ns = [0.0; 2];
        for (time_ns, (kernel, iterations)) in times_ns.iter_mut().zip(&self.kernels) {
            kernel.prepare(gpu, *iterations);
            gpu.queue.submit([]);
            gpu.wait()?;
            let stage = &KernelRun { kernel, iterations: *iterations };
            *time_ns = self.timer.on_host(gpu, &[stage])?.time_ns(self.clock);
        }
        Ok(times_ns)
    }
}

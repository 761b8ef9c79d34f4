//! Brings a GPU back to the clock that it works at.
//!
//! A GPU that had nothing to do for a second or two lowers its clock, and raises it only after a while of work. On an H100 frames took
//! 10.2 ms at 780 MHz and 4.3 ms at 1980 MHz, and 0.15 s of them passed before the clock rose.

use std::time::Instant;

use super::{TestBench, kernel_of};
use crate::{ClockPlan, Gpu, GpuError, SubmitCost};
use fathom_record::PassKind;
use fathom_record::ceilings::Limit;

/// Longest that a GPU is given to reach its clock, seconds: three times what the H100 took.
const MAX_S: f64 = 0.5;
/// A kernel that takes at most so many times its shortest time runs at the full clock. Host times scatter by less.
const TOLERANCE: f64 = 1.1;
/// Kernels in one go, about 2 ms: long beside the jitter of a submission.
const REPEATED: u32 = 4;

/// Repeats arithmetic of known length until it is as fast as it ever was on this device.
#[derive(Default)]
pub struct Waker {
    iterations: u32,
    /// 0 before the first reading.
    shortest_ns: f64,
}

impl Waker {
    /// Nothing to do on a software adapter. The first call takes all of the time, as it cannot know how fast the kernel can be.
    ///
    /// # Errors
    /// A fault of the device.
    pub fn wake(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        if gpu.adapter.software {
            return Ok(());
        }
        let kernel = kernel_of(gpu, &Limit::MultiplyAdds(PassKind::Compute))?;
        let plan = ClockPlan::fenced(SubmitCost::default());
        let mut bench = TestBench::new(gpu, plan, &kernel)?;
        if self.iterations == 0 {
            let max = kernel.max_iterations / REPEATED;
            self.iterations = REPEATED * bench.calibrate(max)?;
        }
        let start = Instant::now();
        let iterations = self.iterations;
        self.until_fast(|| Ok((bench.time_ns(iterations)?, start.elapsed().as_secs_f64())))
    }

    /// `reading` gives the kernel's time in ns, and the seconds since the first was begun.
    fn until_fast(
        &mut self,
        mut reading: impl FnMut() -> Result<(f64, f64), GpuError>,
    ) -> Result<(), GpuError> {
        let enough_ns = TOLERANCE * self.shortest_ns;
        loop {
            let (ns, elapsed_s) = reading()?;
            let is_first = self.shortest_ns == 0.0;
            self.shortest_ns = if is_first { ns } else { self.shortest_ns.min(ns) };
            if ns <= enough_ns || elapsed_s >= MAX_S {
                return Ok(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs the kernel on a modelled GPU whose clock rises after `rises_s` of work; how long that took, seconds.
    fn woken(waker: &mut Waker, rises_s: f64) -> f64 {
        let mut now_s = 0.0;
        let run = || {
            let s = if now_s < rises_s { 5e-3 } else { 2e-3 };
            now_s += s;
            Ok((s * 1e9, now_s))
        };
        waker.until_fast(run).unwrap();
        now_s
    }

    #[test]
    fn a_gpu_works_until_its_clock_is_up_and_no_longer() {
        let mut waker = Waker::default();
        assert!(woken(&mut waker, 0.15) >= MAX_S, "it cannot know yet");
        assert!(woken(&mut waker, 0.0) < 3e-3, "it is awake");
        let slept = woken(&mut waker, 0.15);
        assert!((0.15..0.16).contains(&slept), "{slept}");
        let hot = woken(&mut waker, f64::INFINITY);
        assert!((MAX_S..MAX_S + 0.01).contains(&hot), "{hot}");
    }
}

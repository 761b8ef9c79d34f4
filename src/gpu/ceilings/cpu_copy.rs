//! A copy by the CPU, to compare a software adapter's copies with. It is the Copy kernel of STREAM (McCalpin, *Memory Bandwidth and
//! Machine Balance in Current High Performance Computers*, IEEE TCCA Newsletter, 1995) in the thread that submits.

use std::hint::black_box;

use serde::Serialize;

use super::kernel;
use super::{ROUNDS, Stand};
use crate::{ClockPlan, HostClock};
use crate::{Gpu, GpuError};
use fathom_base::statistics::{Estimate, estimate, ratio_estimate};
use fathom_record::ceilings::Limit;

/// Pairs of samples: an interval of their ratio.
const PAIRS: usize = 2 * ROUNDS;

/// The adapter's copies beside the CPU's with the same working set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CopyCheck {
    pub working_set_bytes: u64,
    /// Bytes per second, read and written.
    pub adapter: Estimate,
    pub cpu: Estimate,
    /// The adapter's rate over the CPU's, pair by pair.
    pub ratio: Estimate,
}

impl CopyCheck {
    /// Of so many bytes that were read and written in these times of the adapter and of the CPU, ns.
    pub fn of_times(working_set_bytes: u64, bytes: f64, pairs_ns: &[(f64, f64)]) -> Self {
        let rate = |ns: f64| bytes / (ns * 1e-9);
        let pairs = pairs_ns.iter().map(|(adapter, cpu)| (rate(*adapter), rate(*cpu)));
        let pairs: Vec<(f64, f64)> = pairs.collect();
        let (adapter, of_cpu): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
        Self {
            working_set_bytes,
            adapter: estimate(&adapter),
            cpu: estimate(&of_cpu),
            ratio: ratio_estimate(&pairs),
        }
    }
}

/// Two buffers of half the working set each, every page of them touched.
struct CpuCopy {
    from: Vec<u8>,
    to: Vec<u8>,
}

impl CpuCopy {
    fn new(working_set_bytes: u64) -> Self {
        let half = (working_set_bytes / 2) as usize;
        Self { from: vec![1; half], to: vec![2; half] }
    }

    /// As many copies as turns: `memcpy` of the C library, which a software driver uses too.
    fn run(&mut self, turns: u32) {
        for _ in 0..turns {
            self.to.copy_from_slice(black_box(&self.from));
            black_box(&mut self.to);
        }
    }
}

/// Copies by the adapter and by the CPU in alternation, by the clock of the plan's host.
///
/// # Errors
/// A fault of the device.
pub fn compare_copies(
    gpu: &Gpu,
    plan: ClockPlan,
    working_set_bytes: u64,
) -> Result<CopyCheck, GpuError> {
    let kernel = kernel::of(gpu, Limit::Copy { working_set_bytes })?;
    let mut stand = Stand::new(gpu, plan, kernel.as_ref())?;
    let mut cpu = CpuCopy::new(working_set_bytes);
    let turns = stand.calibrate(kernel.most_turns())?;
    let bytes = kernel.work_per_turn() * f64::from(turns);
    let mut pairs_ns = Vec::new();
    for _ in 0..PAIRS {
        let adapter_ns = stand.time_ns(turns)?;
        let start_ns = HostClock::of(&plan).now_ns();
        cpu.run(turns);
        pairs_ns.push((adapter_ns, HostClock::of(&plan).now_ns() - start_ns));
    }
    Ok(CopyCheck::of_times(working_set_bytes, bytes, &pairs_ns))
}

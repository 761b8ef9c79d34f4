//! What other processes and the host of a virtual machine take from this machine, as Linux counts it.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// `USER_HZ`, in which Linux shows times to programs. Asking for it through procfs reads the program's auxiliary vector in a way that
/// ends it under valgrind.
#[cfg(target_os = "linux")]
const TICKS_PER_S: u64 = 100;
/// Over this time one tick is 4 % of a core.
const MIN_S: f64 = 0.25;
/// Digits after the point in a record: the ticks give no more.
const ROUNDED_TO: f64 = 1e3;

/// Means since the reading before, in cores: 1 is one core all the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CpuLoad {
    pub others: f32,
    pub steal: f32,
}

/// Counters since the start of the machine, seconds; those of all cores together.
#[derive(Clone, Copy, Debug)]
struct LoadCounters {
    /// Since any fixed moment.
    at_s: f64,
    /// At work for any process.
    busy_s: f64,
    stolen_s: f64,
    /// At work for this process.
    own_s: f64,
}

impl LoadCounters {
    /// The load since an earlier reading; none where too little time has passed.
    fn since(&self, before: &Self) -> Option<CpuLoad> {
        let wall_s = self.at_s - before.at_s;
        let cores = |s: f64| ((s / wall_s * ROUNDED_TO).round().max(0.0) / ROUNDED_TO) as f32;
        (wall_s >= MIN_S).then(|| CpuLoad {
            others: cores((self.busy_s - before.busy_s) - (self.own_s - before.own_s)),
            steal: cores(self.stolen_s - before.stolen_s),
        })
    }
}

/// Reads the load, as often as it is asked.
pub struct LoadReader {
    started: Instant,
    /// The latest reading, and the load up to it.
    last: Mutex<(LoadCounters, Option<CpuLoad>)>,
}

impl LoadReader {
    /// None where the system does not tell.
    pub fn open() -> Option<Self> {
        let started = Instant::now();
        Some(Self { started, last: Mutex::new((read(&started)?, None)) })
    }

    /// Up to the latest reading, which is at most [`MIN_S`] old.
    pub fn load(&self) -> Option<CpuLoad> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        // Reading takes 19 µs on two cores and more on many, so it is not done for each of many short frames.
        if self.started.elapsed().as_secs_f64() - last.0.at_s >= MIN_S {
            let now = read(&self.started)?;
            *last = (now, now.since(&last.0));
        }
        last.1
    }
}

#[cfg(target_os = "linux")]
fn read(begun: &Instant) -> Option<LoadCounters> {
    use crate::frame::HostClock;
    use procfs::{ExplicitSystemInfo, FromReadSI, KernelStats};
    let system = ExplicitSystemInfo {
        boot_time_secs: 0,
        ticks_per_second: TICKS_PER_S,
        page_size: 0,
        is_little_endian: cfg!(target_endian = "little"),
    };
    let cpu = KernelStats::from_file("/proc/stat", &system).ok()?.total;
    let seconds = |ticks: u64| ticks as f64 / TICKS_PER_S as f64;
    let kernel = cpu.irq.unwrap_or(0) + cpu.softirq.unwrap_or(0);
    // Some sandboxes count nothing.
    (cpu.user + cpu.system + cpu.idle > 0).then(|| LoadCounters {
        at_s: begun.elapsed().as_secs_f64(),
        busy_s: seconds(cpu.user + cpu.nice + cpu.system + kernel),
        stolen_s: seconds(cpu.steal.unwrap_or(0)),
        own_s: HostClock::ProcessCpu.now_ns() * 1e-9,
    })
}

#[cfg(not(target_os = "linux"))]
fn read(_: &Instant) -> Option<LoadCounters> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn others_work_is_all_but_ones_own() {
        let before = LoadCounters { at_s: 10.0, busy_s: 100.0, stolen_s: 5.0, own_s: 7.0 };
        let now = LoadCounters { at_s: 12.0, busy_s: 103.0, stolen_s: 5.1, own_s: 9.0 };
        assert_eq!(now.since(&before), Some(CpuLoad { others: 0.5, steal: 0.05 }));
        let own_alone = LoadCounters { busy_s: 101.98, ..now };
        assert_eq!(own_alone.since(&before).unwrap().others, 0.0, "a tick may be missing");
        assert_eq!(LoadCounters { at_s: 10.2, ..now }.since(&before), None);
    }
}

//! The clock that the host reads around submissions.

use std::sync::OnceLock;
use std::time::Instant;

use fathom_record::{Clock, ClockPlan};
#[cfg(target_os = "linux")]
use nix::time::ClockId;

/// What time means to the host.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HostClock {
    #[default]
    Wall,
    /// CPU time of this process, all threads together. On a software driver the process is the GPU, and what other processes
    /// take from its core does not count.
    ProcessCpu,
}

impl HostClock {
    /// What the host reads around submissions and host stages where passes are timed by this plan.
    pub fn from_plan(plan: &ClockPlan) -> Self {
        let kinds = [plan.compute, plan.render, plan.copy];
        if kinds.contains(&Clock::ProcessCpu) { Self::ProcessCpu } else { Self::Wall }
    }

    /// Nanoseconds since a fixed moment.
    pub fn now_ns(self) -> f64 {
        match self {
            Self::Wall => wall_ns(),
            Self::ProcessCpu => process_ns().unwrap_or_else(wall_ns),
        }
    }

    /// Whether this system has the clock.
    pub fn is_there(self) -> bool {
        self == Self::Wall || process_ns().is_some()
    }
}

fn wall_ns() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64() * 1e9
}

/// CPU time of this process so far; unknown outside Linux.
pub(super) fn process_ns() -> Option<f64> {
    #[cfg(target_os = "linux")]
    return cpu_ns(ClockId::CLOCK_PROCESS_CPUTIME_ID);
    #[cfg(not(target_os = "linux"))]
    None
}

/// CPU time of this thread so far, without what a driver's other threads do; wall time outside Linux.
pub(super) fn thread_ns() -> f64 {
    #[cfg(target_os = "linux")]
    return cpu_ns(ClockId::CLOCK_THREAD_CPUTIME_ID).unwrap_or_else(wall_ns);
    #[cfg(not(target_os = "linux"))]
    wall_ns()
}

#[cfg(target_os = "linux")]
fn cpu_ns(clock: ClockId) -> Option<f64> {
    let time = nix::time::clock_gettime(clock).ok()?;
    Some(time.tv_sec() as f64 * 1e9 + time.tv_nsec() as f64)
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// Set in a process of its own, where no other test takes CPU time. Neither bound depends on what other processes take: a wait only gets longer.
    const ALONE: &str = "FATHOM_TEST_WAITS_ALONE";

    #[test]
    fn waiting_takes_wall_time_and_no_cpu_time() {
        if !HostClock::ProcessCpu.is_there() {
            return;
        }
        if std::env::var_os(ALONE).is_none() {
            let name = "frame::host_clock::tests::waiting_takes_wall_time_and_no_cpu_time";
            let mut alone = Command::new(std::env::current_exe().unwrap());
            let output = alone.args(["--exact", name]).env(ALONE, "1").output().unwrap();
            let stdout = String::from_utf8_lossy(&output.stdout);
            assert!(output.status.success() && stdout.contains("1 passed"), "{stdout}");
            return;
        }
        let now_ns = || [HostClock::Wall, HostClock::ProcessCpu].map(HostClock::now_ns);
        let [wall, cpu] = now_ns();
        std::thread::sleep(std::time::Duration::from_millis(200));
        let [waited_ns, spent_ns] = [now_ns()[0] - wall, now_ns()[1] - cpu];
        assert!(waited_ns >= 200e6 && cpu > 0.0, "{waited_ns}, {cpu}");
        assert!((0.0..0.5 * waited_ns).contains(&spent_ns), "{spent_ns} of {waited_ns}");
    }
}

//! The core that a software adapter works on, as Linux tells of it.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::sysfs::number;
use fathom_record::{MachineState, ThrottleReason};

/// Where Linux lists cores.
pub const CPUS: &str = "/sys/devices/system/cpu";
/// How often the core and its package were slowed down for heat since the start of the machine: x86 only
/// (kernel documentation, Documentation/ABI/testing/sysfs-devices-system-cpu).
const EVENTS: [&str; 2] =
    ["thermal_throttle/core_throttle_count", "thermal_throttle/package_throttle_count"];
/// The core's clock, kHz (kernel documentation, *CPU Performance Scaling*).
const CLOCK: &str = "cpufreq/scaling_cur_freq";

/// Reads the state of the core that the calling thread is on. Processes that measure are kept on one.
pub struct CpuReader {
    cpus: PathBuf,
    /// The core and its events at the last reading.
    last: Mutex<Option<(usize, f64)>>,
}

impl CpuReader {
    /// None where the kernel tells nothing of the core, as in most virtual machines.
    pub fn open(cpus: &Path) -> Option<Self> {
        let reader = Self { cpus: cpus.to_owned(), last: Mutex::new(None) };
        let core = core()?;
        let tells = reader.events(core).is_some() || reader.clock_mhz(core).is_some();
        tells.then(|| {
            reader.state_of(core);
            reader
        })
    }

    pub fn state(&self) -> MachineState {
        core().map(|core| self.state_of(core)).unwrap_or_default()
    }

    /// The core counts as slowed down where an event was counted since the last reading of the same core.
    fn state_of(&self, core: usize) -> MachineState {
        let now = self.events(core);
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let more =
            last.zip(now).is_some_and(|((before, events), now)| before == core && now > events);
        *last = now.map(|events| (core, events));
        let throttle = more.then_some(ThrottleReason::ThermalLimit).into_iter().collect();
        MachineState { clock_mhz: self.clock_mhz(core), throttle, ..MachineState::default() }
    }

    fn clock_mhz(&self, core: usize) -> Option<f64> {
        number(&self.folder(core).join(CLOCK)).map(|khz| khz / 1e3)
    }

    fn events(&self, core: usize) -> Option<f64> {
        let folder = self.folder(core);
        let counts: Vec<f64> =
            EVENTS.iter().filter_map(|file| number(&folder.join(file))).collect();
        (!counts.is_empty()).then(|| counts.iter().sum())
    }

    fn folder(&self, core: usize) -> PathBuf {
        self.cpus.join(format!("cpu{core}"))
    }
}

/// The core that the calling thread is on.
#[cfg(target_os = "linux")]
fn core() -> Option<usize> {
    nix::sched::sched_getcpu().ok()
}

#[cfg(not(target_os = "linux"))]
fn core() -> Option<usize> {
    None
}

#[cfg(test)]
mod tests {
    use super::super::sysfs::made_up::write;
    use super::*;

    #[test]
    fn an_event_since_the_last_reading_of_a_core_is_throttling() {
        let cpus = tempfile::tempdir().unwrap();
        let count = |core: usize, events: &str, package: &str| {
            let files = [
                (format!("cpu{core}/{}", EVENTS[0]), events),
                (format!("cpu{core}/{}", EVENTS[1]), package),
                (format!("cpu{core}/{CLOCK}"), "2394000\n"),
            ];
            let files = files.each_ref().map(|(file, text)| (file.as_str(), *text));
            write(cpus.path(), &files);
        };
        let reader = CpuReader { cpus: cpus.path().to_owned(), last: Mutex::new(None) };
        let throttled = |core| reader.state_of(core).is_throttled();
        count(0, "7\n", "3\n");
        count(1, "90\n", "3\n");
        assert_eq!(reader.state_of(0).clock_mhz, Some(2394.0));
        assert!(!throttled(0), "events of before do not count");
        count(0, "8\n", "3\n");
        assert!(throttled(0) && !throttled(0));
        count(0, "8\n", "4\n");
        assert!(throttled(0), "the package's count too");
        assert!(!throttled(1), "another core's count is no step of this one's");
    }

    #[test]
    fn a_kernel_that_tells_nothing_is_not_asked_again() {
        let cpus = tempfile::tempdir().unwrap();
        assert!(CpuReader::open(cpus.path()).is_none());
    }
}

//! What Linux tells of a graphics card, or of the core that a software adapter works on: files of one value each.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use fathom_record::{Adapter, MachineState, ThrottleReason};

/// Where Linux lists graphics cards and cores.
const DRM: &str = "/sys/class/drm";
const CPUS: &str = "/sys/devices/system/cpu";
/// Vendors' numbers of the PCI-SIG, and what stands for a core of the CPU.
pub const AMD: u32 = 0x1002;
pub const INTEL: u32 = 0x8086;
const CORE: u32 = 0;

enum SysfsValue {
    ClockMhz,
    MemoryClockMhz,
    TemperatureC,
    PowerW,
    /// The clock is held down where the number is not 0.
    Held(ThrottleReason),
    /// The clock was held down for heat where the number grew since the last reading.
    HeatEvents,
}
use SysfsValue::{ClockMhz, HeatEvents, Held, MemoryClockMhz, PowerW, TemperatureC};
use ThrottleReason::{CurrentLimit, PowerLimit, Prochot, ThermalLimit, Unspecified};

/// Vendor, file in the folder of the card or core, what it tells, and the factor to that unit. Of several files of one figure the first
/// counts whose number is not 0: a device that sleeps has the clock 0. `*` is any name, and of a list of levels the one with the star
/// counts.
///
/// amdgpu: kernel documentation, *GPU Power/Thermal Controls and Monitoring*. i915: `intel_gt_sysfs_pm.c`. xe: `xe_gt_freq.c`,
/// `xe_gt_throttle.c`. Of both the first tile's first GT, which renders and computes; PL4 stands for the peak of power and for the
/// current, VR for the voltage regulator, RATL for the running average of the temperature. Sensors: Documentation/hwmon/sysfs-interface.rst.
/// Cores: *CPU Performance Scaling*, and Documentation/ABI/testing/sysfs-devices-system-cpu, x86 only.
#[rustfmt::skip]
const READINGS: &[(u32, &str, SysfsValue, f64)] = &[
    (AMD, "device/pp_dpm_sclk", ClockMhz, 1.0),
    (AMD, "device/pp_dpm_mclk", MemoryClockMhz, 1.0),
    (AMD, "device/hwmon/*/temp1_input", TemperatureC, 1e-3),
    (AMD, "device/hwmon/*/power1_average", PowerW, 1e-6),
    (AMD, "device/hwmon/*/power1_input", PowerW, 1e-6),
    (INTEL, "gt/gt0/rps_act_freq_mhz", ClockMhz, 1.0),
    (INTEL, "gt_act_freq_mhz", ClockMhz, 1.0),
    (INTEL, "gt_cur_freq_mhz", ClockMhz, 1.0),
    (INTEL, "device/tile0/gt0/freq0/act_freq", ClockMhz, 1.0),
    (INTEL, "device/tile0/gt0/freq0/cur_freq", ClockMhz, 1.0),
    (INTEL, "device/hwmon/*/temp1_input", TemperatureC, 1e-3),
    (INTEL, "device/hwmon/*/temp2_input", TemperatureC, 1e-3),
    (INTEL, "gt/gt0/throttle_reason_pl1", Held(PowerLimit), 1.0),
    (INTEL, "gt/gt0/throttle_reason_pl2", Held(PowerLimit), 1.0),
    (INTEL, "gt/gt0/throttle_reason_pl4", Held(CurrentLimit), 1.0),
    (INTEL, "gt/gt0/throttle_reason_vr_tdc", Held(CurrentLimit), 1.0),
    (INTEL, "gt/gt0/throttle_reason_thermal", Held(ThermalLimit), 1.0),
    (INTEL, "gt/gt0/throttle_reason_ratl", Held(ThermalLimit), 1.0),
    (INTEL, "gt/gt0/throttle_reason_vr_thermalert", Held(ThermalLimit), 1.0),
    (INTEL, "gt/gt0/throttle_reason_prochot", Held(Prochot), 1.0),
    (INTEL, "gt/gt0/throttle_reason_status", Held(Unspecified), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/reason_pl1", Held(PowerLimit), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/reason_pl2", Held(PowerLimit), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/reason_pl4", Held(CurrentLimit), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/reason_vr_tdc", Held(CurrentLimit), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/reason_thermal", Held(ThermalLimit), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/reason_ratl", Held(ThermalLimit), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/reason_vr_thermalert", Held(ThermalLimit), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/reason_prochot", Held(Prochot), 1.0),
    (INTEL, "device/tile0/gt0/freq0/throttle/status", Held(Unspecified), 1.0),
    (CORE, "cpufreq/scaling_cur_freq", ClockMhz, 1e-3),
    (CORE, "thermal_throttle/core_throttle_count", HeatEvents, 1.0),
    (CORE, "thermal_throttle/package_throttle_count", HeatEvents, 1.0),
];

/// Reads the state of a card, or of the core that the calling thread is on. Processes that measure are kept on one.
pub struct SysfsReader {
    vendor_id: u32,
    /// The card's, or that of all cores.
    folder: PathBuf,
    /// The folder that was read last, and its events.
    last: Mutex<Option<(PathBuf, f64)>>,
}

impl SysfsReader {
    /// None without a card of these vendors, and where the kernel tells nothing of the core, as in most virtual machines.
    pub fn open(adapter: &Adapter) -> Option<Self> {
        let vendor_id = if adapter.software { CORE } else { adapter.vendor_id };
        READINGS.iter().find(|row| row.0 == vendor_id)?;
        let folder = if adapter.software { CPUS.into() } else { card(Path::new(DRM), adapter)? };
        let reader = Self { vendor_id, folder, last: Mutex::new(None) };
        (!adapter.software || reader.state() != MachineState::default()).then_some(reader)
    }

    pub fn state(&self) -> MachineState {
        if self.vendor_id == CORE {
            return core().map(|core| self.state_of(&format!("cpu{core}"))).unwrap_or_default();
        }
        self.state_of("")
    }

    /// Of a folder within the reader's.
    fn state_of(&self, name: &str) -> MachineState {
        let folder = self.folder.join(name);
        let (mut state, mut events) = (MachineState::default(), 0.0);
        for (_, file, told, factor) in READINGS.iter().filter(|row| row.0 == self.vendor_id) {
            let Some(value) = value(&folder, file).filter(|value| *value != 0.0) else { continue };
            let figure = Some(value * factor);
            match told {
                ClockMhz => state.clock_mhz = state.clock_mhz.or(figure),
                MemoryClockMhz => state.memory_clock_mhz = state.memory_clock_mhz.or(figure),
                TemperatureC => state.temperature_c = state.temperature_c.or(figure),
                PowerW => state.power_w = state.power_w.or(figure),
                // The status of a driver that gives a reason too says nothing more.
                Held(Unspecified) if !state.throttle.is_empty() => {}
                Held(reason) => state.throttle.push(reason.clone()),
                HeatEvents => events += value,
            }
        }
        state.throttle.sort();
        state.throttle.dedup();
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let before = last.replace((folder.clone(), events));
        if before.is_some_and(|(before, count)| before == folder && events > count) {
            state.throttle.push(ThermalLimit);
        }
        state
    }
}

/// The folder of the only card with the adapter's PCI ids. Among several of a model, which cannot be told apart, none.
fn card(drm: &Path, adapter: &Adapter) -> Option<PathBuf> {
    let cards = fs::read_dir(drm).ok()?.flatten();
    let is_card = |name: &str| {
        name.strip_prefix("card").is_some_and(|n| n.chars().all(|c| c.is_ascii_digit()))
    };
    let cards = cards.filter(|entry| entry.file_name().to_str().is_some_and(is_card));
    let id = |card: &Path, file: &str| {
        let text = fs::read_to_string(card.join("device").join(file)).ok()?;
        u32::from_str_radix(text.trim().strip_prefix("0x")?, 16).ok()
    };
    let mut alike = cards.map(|entry| entry.path()).filter(|card| {
        id(card, "vendor") == Some(adapter.vendor_id)
            && id(card, "device") == Some(adapter.device_id)
    });
    match (alike.next(), alike.next()) {
        (Some(card), None) => Some(card),
        _ => None,
    }
}

/// The number in a file.
fn value(folder: &Path, file: &str) -> Option<f64> {
    if let Some((parent, rest)) = file.split_once("*/") {
        let entries = fs::read_dir(folder.join(parent)).ok()?.flatten();
        return entries.filter_map(|entry| value(&entry.path(), rest)).next();
    }
    let text = fs::read_to_string(folder.join(file)).ok()?;
    let level = || {
        // `1: 1000Mhz *`
        let active = text.lines().find_map(|line| line.trim().strip_suffix('*'))?;
        let (_, clock) = active.split_once(':')?;
        clock.trim().trim_end_matches(|c: char| c.is_ascii_alphabetic()).parse().ok()
    };
    text.trim().parse().ok().or_else(level)
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
    use super::*;

    /// A file below the folder, and what it holds.
    type File = (&'static str, &'static str);

    fn write(folder: &Path, files: &[(&str, &str)]) {
        for (file, text) in files {
            let path = folder.join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
    }

    /// What is read of a vendor's card with these files, as Linux 6 has them.
    fn read(vendor_id: u32, files: &[(&str, &str)]) -> MachineState {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), files);
        let (folder, last) = (folder.path().to_owned(), Mutex::new(None));
        SysfsReader { vendor_id, folder, last }.state()
    }

    fn state(figures: [Option<f64>; 4], throttle: &[ThrottleReason]) -> MachineState {
        let [clock_mhz, memory_clock_mhz, temperature_c, power_w] = figures;
        let throttle = throttle.to_vec();
        let rest = MachineState::default();
        MachineState { clock_mhz, memory_clock_mhz, temperature_c, power_w, throttle, ..rest }
    }

    #[test]
    fn the_files_of_each_driver_are_read_and_what_a_card_lacks_is_left_out() {
        const SCLK: File = ("device/pp_dpm_sclk", "0: 500Mhz\n1: 2304Mhz *\n2: 2600Mhz\n");
        const MCLK: File = ("device/pp_dpm_mclk", "S: 19Mhz *\n0: 800Mhz");
        const HEAT: File = ("device/hwmon/hwmon3/temp1_input", "54000\n");
        const POWER: File = ("device/hwmon/hwmon3/power1_average", "183000000\n");
        const ASLEEP: File = ("gt_act_freq_mhz", "0\n");
        const ASKED: File = ("gt_cur_freq_mhz", "300\n");
        const PL2: File = ("gt/gt0/throttle_reason_pl2", "1\n");
        const RATL: File = ("gt/gt0/throttle_reason_ratl", "1\n");
        const HELD: File = ("gt/gt0/throttle_reason_status", "1\n");
        const XE: File = ("device/tile0/gt0/freq0/act_freq", "2400\n");
        const XE_HELD: File = ("device/tile0/gt0/freq0/throttle/status", "1\n");
        const XE_VR: File = ("device/tile0/gt0/freq0/throttle/reason_vr_tdc", "1\n");
        let none = [None; 4];
        let amd = [Some(2304.0), Some(19.0), Some(54.0), Some(183.0)];
        let cases: [(u32, &[File], MachineState); 9] = [
            (AMD, &[SCLK, MCLK, HEAT, POWER], state(amd, &[])),
            (
                AMD,
                &[("device/pp_dpm_sclk", "0: 500Mhz\n"), POWER],
                state([None, None, None, amd[3]], &[]),
            ),
            (AMD, &[ASKED, ("device/pp_dpm_mclk", "garbage *")], state(none, &[])),
            (INTEL, &[ASLEEP, ASKED, HEAT], state([Some(300.0), None, Some(54.0), None], &[])),
            (INTEL, &[HELD, PL2, RATL], state(none, &[PowerLimit, ThermalLimit])),
            (INTEL, &[HELD], state(none, &[Unspecified])),
            (
                INTEL,
                &[XE, XE_HELD, XE_VR],
                state([Some(2400.0), None, None, None], &[CurrentLimit]),
            ),
            (INTEL, &[XE_HELD, ("gt/gt0/throttle_reason_pl1", "0\n")], state(none, &[Unspecified])),
            (INTEL, &[], state(none, &[])),
        ];
        for (vendor_id, files, expected) in cases {
            assert_eq!(read(vendor_id, files), expected, "{vendor_id:x} {files:?}");
        }
    }

    #[test]
    fn an_event_since_the_last_reading_of_a_core_is_throttling() {
        let cpus = tempfile::tempdir().unwrap();
        let (folder, last) = (cpus.path().to_owned(), Mutex::new(None));
        let reader = SysfsReader { vendor_id: CORE, folder, last };
        for (core, events, package, expected) in [
            ("cpu0", "7\n", "3\n", false),
            ("cpu0", "7\n", "3\n", false),
            ("cpu0", "8\n", "3\n", true),
            ("cpu0", "8\n", "3\n", false),
            ("cpu0", "8\n", "4\n", true),
            ("cpu1", "90\n", "4\n", false),
        ] {
            let files = [
                ("thermal_throttle/core_throttle_count", events),
                ("thermal_throttle/package_throttle_count", package),
                ("cpufreq/scaling_cur_freq", "2394000\n"),
            ];
            write(&cpus.path().join(core), &files);
            let state = reader.state_of(core);
            assert_eq!(
                (state.clock_mhz, state.is_throttled()),
                (Some(2394.0), expected),
                "{core} {events}"
            );
        }
    }

    #[test]
    fn a_card_is_found_by_its_ids_and_twins_are_not_told_apart() {
        let drm = tempfile::tempdir().unwrap();
        let made = |name: &str, device: &str| {
            let card = drm.path().join(name);
            write(&card, &[("device/vendor", "0x1002\n"), ("device/device", device)]);
            card
        };
        let found = |device_id| {
            card(drm.path(), &Adapter { vendor_id: AMD, device_id, ..Adapter::default() })
        };
        made("card0", "0x73bf\n");
        let other = made("card1", "0x744c\n");
        made("card1-DP-1", "0x744c\n");
        assert_eq!([found(0x744c), found(0x1234)], [Some(other), None]);
        made("card2", "0x744c\n");
        assert_eq!(found(0x744c), None);
    }
}

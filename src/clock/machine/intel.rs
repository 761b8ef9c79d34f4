//! Linux's two drivers of Intel devices in sysfs: i915 (`intel_gt_sysfs_pm.c`) and xe (`xe_gt_freq.c`, `xe_gt_throttle.c`). The files are
//! those of the first tile's first GT, which renders and computes.

use std::path::Path;

use itertools::Itertools;

use super::sysfs::{number, sensor};
use fathom_record::{MachineState, ThrottleReason};

/// Causes as both drivers name them. PL4 stands for the peak of power and for the current, VR for the voltage regulator,
/// RATL for the running average of the temperature.
const CAUSES: [(&str, ThrottleReason); 8] = [
    ("pl1", ThrottleReason::PowerLimit),
    ("pl2", ThrottleReason::PowerLimit),
    ("pl4", ThrottleReason::CurrentLimit),
    ("vr_tdc", ThrottleReason::CurrentLimit),
    ("thermal", ThrottleReason::ThermalLimit),
    ("ratl", ThrottleReason::ThermalLimit),
    ("vr_thermalert", ThrottleReason::ThermalLimit),
    ("prochot", ThrottleReason::Prochot),
];

/// Where a driver puts its files within a card's folder.
struct Files {
    /// The clock that the hardware runs at, and else the one it was asked for, MHz.
    clocks: &'static [&'static str],
    /// What comes before the name of a cause, and before `status`.
    cause: &'static str,
    status: &'static str,
}

const I915: Files = Files {
    clocks: &["gt/gt0/rps_act_freq_mhz", "gt_act_freq_mhz", "gt_cur_freq_mhz"],
    cause: "gt/gt0/throttle_reason_",
    status: "gt/gt0/throttle_reason_status",
};
const XE: Files = Files {
    clocks: &["device/tile0/gt0/freq0/act_freq", "device/tile0/gt0/freq0/cur_freq"],
    cause: "device/tile0/gt0/freq0/throttle/reason_",
    status: "device/tile0/gt0/freq0/throttle/status",
};

/// The state of the card in this folder.
pub fn state(card: &Path) -> MachineState {
    let clock = |files: &Files| {
        let mut clocks = files.clocks.iter().filter_map(|file| number(&card.join(file)));
        // A device that sleeps has the clock 0.
        clocks.find(|mhz| *mhz > 0.0)
    };
    let throttle = [I915, XE].iter().flat_map(|files| reasons(card, files)).sorted().dedup();
    MachineState {
        clock_mhz: clock(&I915).or_else(|| clock(&XE)),
        memory_clock_mhz: None,
        temperature_c: sensor(card, &["temp1_input", "temp2_input"], 1e3),
        power_w: None,
        throttle: throttle.collect(),
        ..MachineState::default()
    }
}

fn reasons(card: &Path, files: &Files) -> Vec<ThrottleReason> {
    let is_on = |file: &str| number(&card.join(file)).is_some_and(|value| value != 0.0);
    let told = CAUSES.iter().filter(|(cause, _)| is_on(&format!("{}{cause}", files.cause)));
    let told: Vec<ThrottleReason> = told.map(|(_, reason)| reason.clone()).collect();
    if told.is_empty() && is_on(files.status) {
        return vec![ThrottleReason::Unspecified];
    }
    told
}

#[cfg(test)]
mod tests {
    use super::super::sysfs::made_up;
    use super::*;

    fn read(files: &[(&str, &str)]) -> MachineState {
        let drm = tempfile::tempdir().unwrap();
        state(&made_up::card(drm.path(), "card0", [0x8086, 0x56a0], files))
    }

    #[test]
    fn the_files_of_i915_are_read() {
        let all_off = CAUSES.map(|(cause, _)| (format!("{}{cause}", I915.cause), "0\n"));
        let mut files: Vec<(&str, &str)> =
            all_off.iter().map(|(file, text)| (file.as_str(), *text)).collect();
        files.extend([
            ("gt/gt0/throttle_reason_status", "0\n"),
            ("gt/gt0/rps_act_freq_mhz", "1250\n"),
            ("gt_cur_freq_mhz", "1300\n"),
            ("device/hwmon/hwmon1/temp1_input", "61000\n"),
        ]);
        let free = MachineState {
            clock_mhz: Some(1250.0),
            temperature_c: Some(61.0),
            ..MachineState::default()
        };
        assert_eq!(read(&files), free);
        files.extend([
            ("gt/gt0/throttle_reason_status", "1\n"),
            ("gt/gt0/throttle_reason_pl1", "1\n"),
            ("gt/gt0/throttle_reason_ratl", "1\n"),
        ]);
        let throttle = vec![ThrottleReason::PowerLimit, ThrottleReason::ThermalLimit];
        assert_eq!(read(&files), MachineState { throttle, ..free });
    }

    #[test]
    fn the_files_of_older_kernels_and_of_sleeping_devices_give_what_they_have() {
        let asked = [("gt_act_freq_mhz", "0\n"), ("gt_cur_freq_mhz", "300\n")];
        assert_eq!(read(&asked).clock_mhz, Some(300.0));
        assert_eq!(read(&[]), MachineState::default());
        assert_eq!(read(&[("gt_cur_freq_mhz", "garbage")]), MachineState::default());
    }

    #[test]
    fn the_files_of_xe_are_read() {
        let base = "device/tile0/gt0/freq0";
        let file = |name: &str| format!("{base}/{name}");
        let (clock, status, vr) =
            (file("act_freq"), file("throttle/status"), file("throttle/reason_vr_tdc"));
        let held = read(&[(&clock, "2400\n"), (&status, "1\n"), (&vr, "1\n")]);
        assert_eq!(held.clock_mhz, Some(2400.0));
        assert_eq!(held.throttle, [ThrottleReason::CurrentLimit]);
        assert_eq!(read(&[(&status, "1\n")]).throttle, [ThrottleReason::Unspecified]);
        assert_eq!(read(&[(&status, "0\n")]).throttle, []);
    }
}

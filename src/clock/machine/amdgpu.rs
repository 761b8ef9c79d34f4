//! Linux's driver of AMD devices in sysfs (kernel documentation, *GPU Power/Thermal Controls and Monitoring*).

use std::fs;
use std::path::Path;

use super::sysfs::{sensor, text};
use fathom_record::{MachineState, ThrottleReason};

/// The state of the card in this folder.
pub fn state(card: &Path) -> MachineState {
    let clock = |file| active_mhz(&text(&card.join("device").join(file))?);
    let metrics = fs::read(card.join("device/gpu_metrics")).unwrap_or_default();
    MachineState {
        clock_mhz: clock("pp_dpm_sclk"),
        memory_clock_mhz: clock("pp_dpm_mclk"),
        temperature_c: sensor(card, &["temp1_input"], 1e3),
        power_w: sensor(card, &["power1_average", "power1_input"], 1e6),
        throttle: throttler(&metrics).map(reasons).unwrap_or_default(),
        ..MachineState::default()
    }
}

/// The clock that a list of levels marks with a star: `1: 1000Mhz *`.
fn active_mhz(levels: &str) -> Option<f64> {
    let active = levels.lines().find_map(|line| line.trim().strip_suffix('*'))?;
    let (_, clock) = active.split_once(':')?;
    let digits = clock.trim().trim_end_matches(|c: char| c.is_ascii_alphabetic());
    digits.parse().ok()
}

/// The status that is the same for all devices, in the one version of the table whose layout is read here: 1.3, of Radeon devices
/// since kernel 5.14 (`struct gpu_metrics_v1_3` in the kernel's `kgd_pp_interface.h`). Its header is the size in 16 bits, then the two
/// numbers of the version in 8 bits each, in the processor's order of bytes; the status is its last field.
fn throttler(table: &[u8]) -> Option<u64> {
    const SIZE: u16 = 120;
    const STATUS: usize = 112;
    let [low, high, version @ ..] = *table.first_chunk::<4>()?;
    let status = u64::from_ne_bytes(*table.get(STATUS..)?.first_chunk()?);
    let is_known = u16::from_ne_bytes([low, high]) == SIZE && version == [1, 3];
    // All bits are set where the device does not tell.
    (is_known && status != u64::MAX).then_some(status)
}

/// `amdgpu_smu.h` gives sixteen bits to each group of causes: power, current, temperature, others. The last two of temperature are
/// signals of heat from elsewhere.
fn reasons(status: u64) -> Vec<ThrottleReason> {
    let groups = [
        (0..16, ThrottleReason::PowerLimit),
        (16..32, ThrottleReason::CurrentLimit),
        (32..46, ThrottleReason::ThermalLimit),
        (46..48, ThrottleReason::Prochot),
        (48..64, ThrottleReason::Unspecified),
    ];
    let is_on = |bits: &std::ops::Range<u32>| bits.clone().any(|bit| status >> bit & 1 == 1);
    groups.into_iter().filter(|(bits, _)| is_on(bits)).map(|(_, reason)| reason).collect()
}

#[cfg(test)]
mod tests {
    use super::super::sysfs::made_up;
    use super::*;

    /// Files as Linux 6 has them.
    const FILES: [(&str, &str); 4] = [
        ("device/pp_dpm_sclk", "0: 500Mhz\n1: 2304Mhz *\n2: 2600Mhz\n"),
        ("device/pp_dpm_mclk", "0: 96Mhz *\n1: 1000Mhz\n"),
        ("device/hwmon/hwmon3/temp1_input", "54000\n"),
        ("device/hwmon/hwmon3/power1_average", "183000000\n"),
    ];

    fn table(version: [u8; 2], status: u64) -> Vec<u8> {
        let mut table = vec![0; 120];
        table[..2].copy_from_slice(&120_u16.to_ne_bytes());
        table[2..4].copy_from_slice(&version);
        // What depends on the device is not looked at.
        table[68..72].fill(0xff);
        table[112..].copy_from_slice(&status.to_ne_bytes());
        table
    }

    #[test]
    fn a_card_is_read_and_what_it_lacks_is_left_out() {
        let drm = tempfile::tempdir().unwrap();
        let card = made_up::card(drm.path(), "card0", [0x1002, 0x73bf], &FILES);
        let expected = MachineState {
            clock_mhz: Some(2304.0),
            memory_clock_mhz: Some(96.0),
            temperature_c: Some(54.0),
            power_w: Some(183.0),
            ..MachineState::default()
        };
        assert_eq!(state(&card), expected);
        fs::write(card.join("device/gpu_metrics"), table([1, 3], 1 << 36 | 1)).unwrap();
        let throttle = vec![ThrottleReason::PowerLimit, ThrottleReason::ThermalLimit];
        assert_eq!(state(&card), MachineState { throttle: throttle.clone(), ..expected.clone() });
        fs::remove_file(card.join("device/hwmon/hwmon3/power1_average")).unwrap();
        fs::write(card.join("device/pp_dpm_sclk"), "0: 500Mhz\n").unwrap();
        let rest = MachineState { power_w: None, clock_mhz: None, throttle, ..expected };
        assert_eq!(state(&card), rest);
        assert_eq!(state(Path::new("/nonexistent")), MachineState::default());
    }

    #[test]
    fn only_the_table_of_a_known_layout_is_read() {
        let told = |version, status| throttler(&table(version, status));
        assert_eq!(told([1, 3], 5), Some(5));
        assert_eq!(told([1, 3], 0), Some(0));
        assert_eq!(told([1, 3], u64::MAX), None);
        assert_eq!(told([1, 4], 5), None);
        assert_eq!(told([2, 3], 5), None);
        assert_eq!(throttler(&table([1, 3], 5)[..119]), None);
        assert_eq!(throttler(&[]), None);
    }

    #[test]
    fn bits_are_sorted_by_their_groups() {
        use ThrottleReason::*;
        for (bit, reason) in [
            (0, PowerLimit),
            (7, PowerLimit),
            (16, CurrentLimit),
            (22, CurrentLimit),
            (32, ThermalLimit),
            (45, ThermalLimit),
            (47, Prochot),
            (57, Unspecified),
        ] {
            assert_eq!(reasons(1 << bit), [reason], "{bit}");
        }
        assert_eq!(reasons(0), []);
    }

    #[test]
    fn the_clock_with_the_star_counts() {
        assert_eq!(active_mhz("0: 500Mhz *"), Some(500.0));
        assert_eq!(active_mhz("S: 19Mhz *\n0: 800Mhz"), Some(19.0));
        assert_eq!(active_mhz("0: 500Mhz"), None);
        assert_eq!(active_mhz("garbage *"), None);
    }
}

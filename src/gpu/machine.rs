//! State of the machine beside a measurement on a hardware adapter: clocks, temperature, power, and why clocks are held down.
//! NVIDIA's driver tells through NVML, Linux's amdgpu through sysfs. What a machine does not tell is left out; nothing here fails.

use std::fs;
use std::path::{Path, PathBuf};

use nvml_wrapper::bitmasks::device::ThrottleReasons;
use nvml_wrapper::enum_wrappers::device::{Clock, TemperatureSensor};
use nvml_wrapper::{Device, Nvml};

use crate::record::{Adapter, MachineState};

/// Vendors' numbers of the PCI-SIG.
const NVIDIA: u32 = 0x10de;
const AMD: u32 = 0x1002;
/// Where Linux lists graphics devices.
const DRM: &str = "/sys/class/drm";

/// Reads the state of one adapter, as often as it is asked. Opened once: loading NVML takes milliseconds.
pub struct MachineReader(Source);

enum Source {
    Nvml {
        library: Box<Nvml>,
        index: u32,
    },
    /// The folder `device` of a card.
    Amdgpu(PathBuf),
}

impl MachineReader {
    /// None for software adapters, and where no driver tells.
    pub fn open(adapter: &Adapter) -> Option<Self> {
        match adapter.vendor_id {
            _ if adapter.software => None,
            NVIDIA => Self::nvml(adapter),
            AMD => amd_card(Path::new(DRM), adapter).map(|card| Self(Source::Amdgpu(card))),
            _ => None,
        }
    }

    fn nvml(adapter: &Adapter) -> Option<Self> {
        let library = Nvml::init().ok()?;
        let devices = (0..library.device_count().ok()?).filter_map(|index| {
            let device = library.device_by_index(index).ok()?;
            Some((index, device.pci_info().ok()?.pci_device_id, device.name().ok()?))
        });
        let index = matching(adapter, devices.collect::<Vec<_>>())?;
        Some(Self(Source::Nvml { library: Box::new(library), index }))
    }

    /// None where the driver tells nothing any more.
    pub fn read(&self) -> Option<MachineState> {
        let state = match &self.0 {
            Source::Nvml { library, index } => nvml_state(&library.device_by_index(*index).ok()?),
            Source::Amdgpu(card) => amd_state(card),
        };
        (state != MachineState::default()).then_some(state)
    }
}

/// The one of NVML's devices (index, combined PCI id, name) that is the adapter. Among several of the same model, which cannot be
/// told apart, none: another card's state would be worse than none.
fn matching(adapter: &Adapter, devices: Vec<(u32, u32, String)>) -> Option<u32> {
    // NVML has the device in the upper half and the vendor in the lower.
    let id = adapter.device_id << 16 | adapter.vendor_id;
    let named = |name: &str| !name.is_empty() && adapter.name.contains(name);
    let mut alike: Vec<_> = devices.iter().filter(|(_, pci, _)| *pci == id).collect();
    if alike.is_empty() {
        alike = devices.iter().filter(|(_, _, name)| named(name)).collect();
    }
    match alike[..] {
        [(index, ..)] => Some(*index),
        _ => None,
    }
}

fn nvml_state(device: &Device<'_>) -> MachineState {
    let clock = |kind| device.clock_info(kind).ok().map(f64::from);
    let reasons = device.current_throttle_reasons().unwrap_or(ThrottleReasons::NONE);
    MachineState {
        clock_mhz: clock(Clock::SM),
        memory_clock_mhz: clock(Clock::Memory),
        temperature_c: device.temperature(TemperatureSensor::Gpu).ok().map(f64::from),
        power_w: device.power_usage().ok().map(|milliwatts| f64::from(milliwatts) / 1e3),
        throttle: reasons.iter_names().map(|(name, _)| name.to_lowercase()).collect(),
    }
}

/// The folder of the only amdgpu card with the adapter's PCI ids.
fn amd_card(drm: &Path, adapter: &Adapter) -> Option<PathBuf> {
    let cards = fs::read_dir(drm).ok()?.flatten();
    let is_card = |name: &str| {
        name.strip_prefix("card").is_some_and(|n| n.chars().all(|c| c.is_ascii_digit()))
    };
    let cards = cards.filter(|entry| entry.file_name().to_str().is_some_and(is_card));
    let id = |folder: &Path, file: &str| {
        let text = text(&folder.join(file))?;
        u32::from_str_radix(text.strip_prefix("0x")?, 16).ok()
    };
    let mut alike = cards.map(|card| card.path().join("device")).filter(|folder| {
        id(folder, "vendor") == Some(adapter.vendor_id)
            && id(folder, "device") == Some(adapter.device_id)
    });
    match (alike.next(), alike.next()) {
        (Some(card), None) => Some(card),
        _ => None,
    }
}

fn amd_state(card: &Path) -> MachineState {
    let clock = |file| active_mhz(&text(&card.join(file))?);
    let sensors: Vec<PathBuf> = fs::read_dir(card.join("hwmon"))
        .map(|entries| entries.flatten().map(|entry| entry.path()).collect())
        .unwrap_or_default();
    // The kernel gives temperatures in thousandths of a degree and power in microwatts (Documentation/hwmon/sysfs-interface).
    let sensor = |files: &[&str], unit: f64| {
        let paths = sensors.iter().flat_map(|folder| files.iter().map(move |f| folder.join(f)));
        paths.filter_map(|path| text(&path)?.parse::<f64>().ok()).next().map(|value| value / unit)
    };
    MachineState {
        clock_mhz: clock("pp_dpm_sclk"),
        memory_clock_mhz: clock("pp_dpm_mclk"),
        temperature_c: sensor(&["temp1_input"], 1e3),
        power_w: sensor(&["power1_average", "power1_input"], 1e6),
        throttle: Vec::new(),
    }
}

/// A file's text without the space around it.
fn text(path: &Path) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

/// The clock that a list of levels marks with a star: `1: 1000Mhz *`.
fn active_mhz(levels: &str) -> Option<f64> {
    let active = levels.lines().find_map(|line| line.trim().strip_suffix('*'))?;
    let (_, clock) = active.split_once(':')?;
    let digits = clock.trim().trim_end_matches(|c: char| c.is_ascii_alphabetic());
    digits.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, vendor_id: u32, device_id: u32) -> Adapter {
        Adapter { name: name.to_owned(), vendor_id, device_id, ..Adapter::default() }
    }

    /// A card as Linux 6 lists it.
    fn card(drm: &Path, name: &str, device: &str) -> PathBuf {
        let folder = drm.join(name).join("device");
        let sensors = folder.join("hwmon/hwmon3");
        fs::create_dir_all(&sensors).unwrap();
        for (file, text) in [
            ("vendor", "0x1002\n"),
            ("device", device),
            ("pp_dpm_sclk", "0: 500Mhz\n1: 2304Mhz *\n2: 2600Mhz\n"),
            ("pp_dpm_mclk", "0: 96Mhz *\n1: 1000Mhz\n"),
            ("hwmon/hwmon3/temp1_input", "54000\n"),
            ("hwmon/hwmon3/power1_average", "183000000\n"),
        ] {
            fs::write(folder.join(file), text).unwrap();
        }
        folder
    }

    #[test]
    fn an_amd_card_is_found_by_its_ids_and_read() {
        let drm = tempfile::tempdir().unwrap();
        card(drm.path(), "card0", "0x73bf\n");
        let other = card(drm.path(), "card1", "0x744c\n");
        fs::create_dir_all(drm.path().join("card1-DP-1/device")).unwrap();
        assert_eq!(amd_card(drm.path(), &adapter("RX", AMD, 0x744c)), Some(other.clone()));
        assert_eq!(amd_card(drm.path(), &adapter("RX", AMD, 0x1234)), None);
        let expected = MachineState {
            clock_mhz: Some(2304.0),
            memory_clock_mhz: Some(96.0),
            temperature_c: Some(54.0),
            power_w: Some(183.0),
            throttle: Vec::new(),
        };
        assert_eq!(amd_state(&other), expected);
        fs::remove_file(other.join("hwmon/hwmon3/power1_average")).unwrap();
        fs::write(other.join("pp_dpm_sclk"), "0: 500Mhz\n").unwrap();
        assert_eq!(amd_state(&other), MachineState { power_w: None, clock_mhz: None, ..expected });
    }

    #[test]
    fn two_cards_of_a_model_are_not_told_apart() {
        let drm = tempfile::tempdir().unwrap();
        card(drm.path(), "card0", "0x73bf\n");
        card(drm.path(), "card1", "0x73bf\n");
        assert_eq!(amd_card(drm.path(), &adapter("RX", AMD, 0x73bf)), None);
        let twins = vec![(0, 0x2330_10de, "H100".into()), (1, 0x2330_10de, "H100".into())];
        assert_eq!(matching(&adapter("NVIDIA H100", NVIDIA, 0x2330), twins), None);
    }

    #[test]
    fn an_nvidia_device_is_matched_by_id_and_else_by_name() {
        let devices = || {
            vec![
                (0, 0x1eb8_10de, "Tesla T4".to_owned()),
                (1, 0x2330_10de, "NVIDIA H100".to_owned()),
            ]
        };
        assert_eq!(matching(&adapter("anything", NVIDIA, 0x2330), devices()), Some(1));
        assert_eq!(matching(&adapter("Tesla T4/PCIe", NVIDIA, 0), devices()), Some(0));
        assert_eq!(matching(&adapter("GeForce", NVIDIA, 7), devices()), None);
    }

    #[test]
    fn software_adapters_and_absent_drivers_tell_nothing() {
        let software = Adapter { software: true, ..adapter("llvmpipe", NVIDIA, 1) };
        assert!(MachineReader::open(&software).is_none());
        assert!(MachineReader::open(&adapter("Intel", 0x8086, 1)).is_none());
        assert_eq!(amd_card(Path::new("/nonexistent"), &adapter("RX", AMD, 1)), None);
        assert_eq!(amd_state(Path::new("/nonexistent")), MachineState::default());
    }

    #[test]
    fn the_clock_with_the_star_counts() {
        assert_eq!(active_mhz("0: 500Mhz *"), Some(500.0));
        assert_eq!(active_mhz("S: 19Mhz *\n0: 800Mhz"), Some(19.0));
        assert_eq!(active_mhz("0: 500Mhz"), None);
        assert_eq!(active_mhz("garbage *"), None);
    }
}

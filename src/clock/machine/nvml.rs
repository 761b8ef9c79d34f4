//! NVML, the library of NVIDIA's driver, loaded at run time.

use nvml_wrapper::bitmasks::device::ThrottleReasons;
use nvml_wrapper::enum_wrappers::device::{Clock, TemperatureSensor};
use nvml_wrapper::{Device, Nvml};

use fathom_record::{Adapter, MachineState, ThrottleReason};

/// The library and the device that it is asked of.
pub struct NvmlReader {
    library: Box<Nvml>,
    index: u32,
}

impl NvmlReader {
    /// None without the library, and where no single device of it is the adapter.
    pub fn open(adapter: &Adapter) -> Option<Self> {
        let library = Nvml::init().ok()?;
        let devices = (0..library.device_count().ok()?).filter_map(|index| {
            let device = library.device_by_index(index).ok()?;
            Some((index, device.pci_info().ok()?.pci_device_id, device.name().ok()?))
        });
        let index = matching(adapter, devices.collect::<Vec<_>>())?;
        Some(Self { library: Box::new(library), index })
    }

    pub fn state(&self) -> Option<MachineState> {
        self.library.device_by_index(self.index).ok().map(|device| state(&device))
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

fn state(device: &Device<'_>) -> MachineState {
    let clock = |kind| device.clock_info(kind).ok().map(f64::from);
    MachineState {
        clock_mhz: clock(Clock::SM),
        memory_clock_mhz: clock(Clock::Memory),
        temperature_c: device.temperature(TemperatureSensor::Gpu).ok().map(f64::from),
        power_w: device.power_usage().ok().map(|milliwatts| f64::from(milliwatts) / 1e3),
        throttle: device.current_throttle_reasons().map(reasons).unwrap_or_default(),
        ..MachineState::default()
    }
}

fn reasons(told: ThrottleReasons) -> Vec<ThrottleReason> {
    use ThrottleReason::*;
    let known = [
        (ThrottleReasons::GPU_IDLE, GpuIdle),
        (ThrottleReasons::APPLICATIONS_CLOCKS_SETTING, ApplicationsClocksSetting),
        (ThrottleReasons::SW_POWER_CAP, SwPowerCap),
        (ThrottleReasons::HW_SLOWDOWN, HwSlowdown),
        (ThrottleReasons::SYNC_BOOST, SyncBoost),
        (ThrottleReasons::SW_THERMAL_SLOWDOWN, SwThermalSlowdown),
        (ThrottleReasons::HW_THERMAL_SLOWDOWN, HwThermalSlowdown),
        (ThrottleReasons::HW_POWER_BRAKE_SLOWDOWN, HwPowerBrakeSlowdown),
        (ThrottleReasons::DISPLAY_CLOCK_SETTING, DisplayClockSetting),
    ];
    let told = known.into_iter().filter(|(bit, _)| told.contains(*bit));
    told.map(|(_, reason)| reason).collect()
}

#[cfg(test)]
mod tests {
    use super::super::NVIDIA;
    use super::*;

    fn adapter(name: &str, device_id: u32) -> Adapter {
        Adapter { name: name.to_owned(), vendor_id: NVIDIA, device_id, ..Adapter::default() }
    }

    #[test]
    fn a_device_is_matched_by_id_and_else_by_name() {
        let devices = || {
            vec![
                (0, 0x1eb8_10de, "Tesla T4".to_owned()),
                (1, 0x2330_10de, "NVIDIA H100".to_owned()),
            ]
        };
        assert_eq!(matching(&adapter("anything", 0x2330), devices()), Some(1));
        assert_eq!(matching(&adapter("Tesla T4/PCIe", 0), devices()), Some(0));
        assert_eq!(matching(&adapter("GeForce", 7), devices()), None);
        let twins = vec![(0, 0x2330_10de, "H100".into()), (1, 0x2330_10de, "H100".into())];
        assert_eq!(matching(&adapter("NVIDIA H100", 0x2330), twins), None);
    }

    #[test]
    fn each_bit_of_nvml_is_a_reason_of_its_own() {
        assert_eq!(reasons(ThrottleReasons::empty()), []);
        let all = ThrottleReasons::all();
        assert_eq!(reasons(all).len() as u32, all.bits().count_ones());
    }
}

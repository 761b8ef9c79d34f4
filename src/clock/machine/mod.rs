//! State of the machine beside a measurement: clocks, temperature, power, and why clocks are held down. NVIDIA's driver tells
//! through NVML, Linux's amdgpu, i915 and xe through sysfs; of a software adapter the kernel tells of the core. What a machine does
//! not tell is left out; nothing here fails. Linux also tells what other processes and the host take from the machine.

mod load;
mod nvml;
mod sysfs;

use self::load::LoadReader;
use self::nvml::NvmlReader;
use self::sysfs::SysfsReader;
use fathom_record::{Adapter, MachineState};

/// The vendor's number of the PCI-SIG.
const NVIDIA: u32 = 0x10de;

/// Reads the state of one adapter, as often as it is asked. Opened once: loading NVML takes milliseconds.
pub struct MachineReader {
    /// None where no driver tells.
    source: Option<StateSource>,
    load: Option<LoadReader>,
}

enum StateSource {
    Nvml(NvmlReader),
    Sysfs(SysfsReader),
}

impl MachineReader {
    /// None where neither a driver nor the kernel tells.
    pub fn open(adapter: &Adapter) -> Option<Self> {
        let reader = Self { source: StateSource::open(adapter), load: LoadReader::open() };
        (reader.source.is_some() || reader.load.is_some()).then_some(reader)
    }

    /// None where nothing is told any more. Done between frames: the load takes 19 µs on two cores, four times a second at most.
    pub fn read(&self) -> Option<MachineState> {
        let state = self.source.as_ref().and_then(StateSource::state).unwrap_or_default();
        let load = self.load.as_ref().and_then(LoadReader::load);
        let state = MachineState {
            others_load: load.map(|load| load.others),
            steal: load.map(|load| load.steal),
            ..state
        };
        (state != MachineState::default()).then_some(state)
    }
}

impl StateSource {
    fn open(adapter: &Adapter) -> Option<Self> {
        match adapter.vendor_id {
            NVIDIA if !adapter.software => NvmlReader::open(adapter).map(StateSource::Nvml),
            _ => SysfsReader::open(adapter).map(StateSource::Sysfs),
        }
    }

    fn state(&self) -> Option<MachineState> {
        match self {
            StateSource::Nvml(device) => device.state(),
            StateSource::Sysfs(reader) => Some(reader.state()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Neither a machine without the vendor's driver nor one that has it and another card is a fault.
    #[test]
    fn drivers_that_are_absent_tell_nothing() {
        for vendor_id in [NVIDIA, sysfs::AMD, sysfs::INTEL, 0x1337] {
            let name = "no such card".to_owned();
            let adapter = Adapter { name, vendor_id, device_id: 0xfffe, ..Adapter::default() };
            assert!(StateSource::open(&adapter).is_none(), "{vendor_id:x}");
        }
    }

    #[test]
    fn a_software_adapter_is_never_asked_of_a_card() {
        let software = Adapter { software: true, vendor_id: NVIDIA, ..Adapter::default() };
        let source = StateSource::open(&software);
        assert!(source.is_none_or(|source| matches!(source, StateSource::Sysfs(_))));
    }
}

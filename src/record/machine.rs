//! State of the machine beside a measurement, and what of it makes a time doubtful.

use std::collections::BTreeSet;
use std::fmt;

use itertools::Itertools;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a GPU's driver says of it at one moment; of a software adapter the kernel of the core that it works on. And what others took
/// from the machine before that moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct MachineState {
    /// Of the shader cores, MHz.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock_mhz: Option<f64>,
    /// Of the memory, MHz.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_clock_mhz: Option<f64>,
    /// Of the device, °C.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Drawn by the device, watts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub power_w: Option<f64>,
    /// Why clocks are below their highest; empty where nothing holds them down or the driver does not tell.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub throttle: Vec<ThrottleReason>,
    /// CPU time of other processes, in cores: 1 is one core all the time. Mean over at least 0.25 s. Absent on systems other than Linux,
    /// as `steal`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub others_load: Option<f32>,
    /// CPU time that the host of this virtual machine gave to others while the machine had work, in the same unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steal: Option<f32>,
}

impl MachineState {
    /// The reasons that make a time doubtful.
    pub fn harmful_reasons(&self) -> impl Iterator<Item = &ThrottleReason> {
        self.throttle.iter().filter(|reason| reason.is_harmful())
    }

    /// Heat, power or something unknown held the clocks down.
    pub fn is_throttled(&self) -> bool {
        self.harmful_reasons().next().is_some()
    }
}

/// Why a driver runs a device below its highest clocks. The first nine are NVML's (NVIDIA, *NVML API Reference*,
/// NvmlClocksEventReasons), the others what other drivers' reasons amount to.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ThrottleReason {
    /// Nothing runs on the device.
    GpuIdle,
    /// The user or administrator has set the clocks of applications.
    ApplicationsClocksSetting,
    /// The clocks follow those of the other devices of a group.
    SyncBoost,
    /// The clocks of the display are set lower.
    DisplayClockSetting,
    /// The driver keeps to the power limit.
    SwPowerCap,
    /// The hardware halves the clocks or worse: for heat, power draw or the power supply's signal.
    HwSlowdown,
    /// The driver keeps to the temperature limit.
    SwThermalSlowdown,
    /// The hardware halves the clocks or worse for heat.
    HwThermalSlowdown,
    /// The hardware halves the clocks or worse at the power supply's signal.
    HwPowerBrakeSlowdown,
    /// A limit of power.
    PowerLimit,
    /// A limit of current.
    CurrentLimit,
    /// A limit of temperature.
    ThermalLimit,
    /// Another part of the machine signals heat.
    Prochot,
    /// The driver tells that clocks are held down, and not why.
    Unspecified,
}

impl ThrottleReason {
    /// Heat or power holds the clocks down, or something unknown. The rest follows from how the machine is set up, or from its
    /// having nothing to do.
    pub fn is_harmful(&self) -> bool {
        use ThrottleReason::*;
        !matches!(self, GpuIdle | ApplicationsClocksSetting | SyncBoost | DisplayClockSetting)
    }

    /// For people.
    pub fn words(&self) -> String {
        serde_json::to_value(self).map_or_else(
            |_| String::new(),
            |word| word.as_str().unwrap_or_default().replace('_', " "),
        )
    }
}

/// How often clocks were held down, and why: by [`ThrottleReason::is_harmful`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Throttling {
    /// Samples whose state is known.
    pub samples: usize,
    /// Those of them that were taken while clocks were held down; at least one.
    pub throttled: usize,
    pub reasons: BTreeSet<ThrottleReason>,
}

impl Throttling {
    /// None where no sample was taken while clocks were held down.
    pub fn from_states(states: &[MachineState]) -> Option<Self> {
        let throttled = states.iter().filter(|state| state.is_throttled()).count();
        let reasons = states.iter().flat_map(MachineState::harmful_reasons).cloned().collect();
        (throttled > 0).then_some(Self { samples: states.len(), throttled, reasons })
    }
}

/// `12 of 40 samples (sw power cap, thermal limit)`.
impl fmt::Display for Throttling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { samples, throttled, reasons } = self;
        write!(f, "{throttled} of {samples} samples ({})", words(reasons))
    }
}

/// Reasons for people, in one phrase.
pub fn words<'a>(reasons: impl IntoIterator<Item = &'a ThrottleReason>) -> String {
    reasons.into_iter().map(ThrottleReason::words).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(throttle: &[ThrottleReason]) -> MachineState {
        MachineState { throttle: throttle.to_vec(), ..MachineState::default() }
    }

    #[test]
    fn an_idle_device_and_set_clocks_are_no_throttling() {
        use ThrottleReason::*;
        let harmless = [GpuIdle, ApplicationsClocksSetting, SyncBoost, DisplayClockSetting];
        assert!(!state(&harmless).is_throttled());
        assert_eq!(Throttling::from_states(&[state(&harmless), state(&[])]), None);
        for reason in [SwPowerCap, ThermalLimit, Unspecified] {
            assert!(state(&[GpuIdle, reason.clone()]).is_throttled(), "{reason:?}");
        }
    }

    #[test]
    fn samples_are_counted_and_only_harmful_reasons_named() {
        use ThrottleReason::*;
        let states = [state(&[GpuIdle, SwPowerCap]), state(&[GpuIdle]), state(&[ThermalLimit])];
        let found = Throttling::from_states(&states).unwrap();
        assert_eq!(found.to_string(), "2 of 3 samples (sw power cap, thermal limit)");
    }
}

//! What a machine is: enough to judge times by, and nothing that names it or its owner.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A computer. What its system does not tell is absent.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Machine {
    /// Model of the processor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cpu: Option<String>,
    /// Cores that the system has, hardware threads counted one by one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cores: Option<usize>,
    /// Memory, bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_bytes: Option<u64>,
    /// Name and version of the kernel, without what its builder added.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kernel: Option<String>,
    /// How the kernel sets the clock of the first core: `performance`, `powersave` and the like.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub governor: Option<String>,
}

impl Machine {
    /// This one, as Linux tells; none on other systems.
    #[cfg(target_os = "linux")]
    pub fn detect() -> Option<Self> {
        use procfs::sys::kernel::Version;
        use procfs::{CpuInfo, Current, Meminfo};
        const GOVERNOR: &str = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
        let cpu = CpuInfo::current().ok();
        let kernel = |Version { major, minor, patch }| format!("Linux {major}.{minor}.{patch}");
        Some(Self {
            cpu: cpu.as_ref().and_then(|cpu| cpu.model_name(0)).map(str::to_owned),
            cores: cpu.map(|cpu| cpu.num_cores()),
            memory_bytes: Meminfo::current().ok().map(|memory| memory.mem_total),
            kernel: Version::current().ok().map(kernel),
            governor: std::fs::read_to_string(GOVERNOR).ok().map(|text| text.trim().to_owned()),
        })
    }

    #[cfg(not(target_os = "linux"))]
    pub fn detect() -> Option<Self> {
        None
    }
}

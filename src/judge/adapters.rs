//! Whether two sides ran on the same adapter: what their times may say of each other.

use fathom_record::comparison::ComparisonHeader;
use fathom_record::{Adapter, Mask};

/// What the adapters of two sides are to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterRelation {
    /// One device by one driver. Its settings may differ.
    Same,
    /// One device by two versions of one driver: times are judged.
    OtherVersion,
    /// Two devices or two drivers: times and instructions are reported, but not judged, as neither side is a change of the other.
    Different,
}

impl AdapterRelation {
    pub fn between(base: &Adapter, head: &Adapter) -> Self {
        if device(base) != device(head) {
            Self::Different
        } else if base.driver_info != head.driver_info {
            Self::OtherVersion
        } else {
            Self::Same
        }
    }

    pub fn from_header(header: &ComparisonHeader) -> Self {
        header.base_adapter.as_ref().map_or(Self::Same, |base| Self::between(base, &header.adapter))
    }

    /// Times and instruction counts of the sides decide something.
    pub fn is_judged(self) -> bool {
        self != Self::Different
    }
}

/// What makes a device and its driver: the interface, the ids, the driver's name, the device's without what tells versions, and what
/// was taken away.
fn device(adapter: &Adapter) -> (bool, &str, u32, u32, &str, String, &Mask) {
    let Adapter { software, backend, vendor_id, device_id, driver, name, mask, .. } = adapter;
    (*software, backend, *vendor_id, *device_id, driver, model(name), mask)
}

/// A device's name without the parts of its last parentheses that tell versions: `llvmpipe (LLVM 15.0.6, 256 bits)` is `llvmpipe`,
/// `AMD Radeon Graphics (renoir, LLVM 15.0.6, DRM 3.49)` is `AMD Radeon Graphics (renoir)`.
fn model(name: &str) -> String {
    let inner = name.strip_suffix(')').and_then(|name| name.rsplit_once('('));
    let Some((before, inner)) = inner else { return name.to_owned() };
    let parts: Vec<&str> =
        inner.split(',').map(str::trim).filter(|part| !is_version(part)).collect();
    let before = before.trim_end();
    if parts.is_empty() { before.to_owned() } else { format!("{before} ({})", parts.join(", ")) }
}

/// A number, or the compiler or kernel interface that a driver was built with or uses: Mesa and SwiftShader name these.
fn is_version(part: &str) -> bool {
    let word = part.split_whitespace().next().unwrap_or_default();
    word.starts_with(|c: char| c.is_ascii_digit())
        || ["LLVM", "DRM", "ACO", "Subzero"].contains(&word)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, driver: &str, driver_info: &str, ids: [u32; 2]) -> Adapter {
        let [vendor_id, device_id] = ids;
        let named = [name, "vulkan", driver, driver_info].map(str::to_owned);
        let [name, backend, driver, driver_info] = named;
        Adapter { name, backend, driver, driver_info, vendor_id, device_id, ..Adapter::default() }
    }

    fn lavapipe(llvm: &str, bits: u32, mesa: &str) -> Adapter {
        let name = format!("llvmpipe (LLVM {llvm}, {bits} bits)");
        adapter(&name, "llvmpipe", &format!("Mesa {mesa} (LLVM {llvm})"), [0x10005, 0])
    }

    #[test]
    fn settings_and_versions_leave_the_device_and_all_else_does_not() {
        let here = lavapipe("15.0.6", 256, "22.3.6");
        let radv = |name| adapter(name, "radv", "Mesa 24.0.0", [0x1002, 0x73bf]);
        let navi21 = radv("AMD Radeon RX 6800 XT (RADV NAVI21)");
        let amdvlk = [0x1002, 0x73bf];
        let amdvlk = adapter("AMD Radeon RX 6800 XT", "AMD open-source driver", "2023.Q4", amdvlk);
        let ids = [0x1ae0, 0xc0de];
        let swiftshader = adapter("SwiftShader Device (Subzero)", "SwiftShader driver", "", ids);
        let with = |change: fn(&mut Adapter)| {
            let mut other = here.clone();
            change(&mut other);
            other
        };
        use AdapterRelation::*;
        for (base, head, expected) in [
            (here.clone(), here.clone(), Same),
            (here.clone(), lavapipe("15.0.6", 128, "22.3.6"), Same),
            (here.clone(), lavapipe("15.0.6", 256, "24.0.0"), OtherVersion),
            (here.clone(), lavapipe("17.0.1", 512, "24.0.0"), OtherVersion),
            (here.clone(), swiftshader, Different),
            (here.clone(), with(|other| other.backend = "gl".to_owned()), Different),
            (here.clone(), with(|other| other.driver = "another".to_owned()), Different),
            (here.clone(), with(|other| other.software = true), Different),
            (here.clone(), with(|other| other.device_id = 1), Different),
            (here.clone(), with(|other| other.vendor_id = 1), Different),
            (navi21.clone(), radv("AMD Radeon RX 6800 (RADV NAVI21)"), Different),
            (navi21.clone(), radv("AMD Radeon RX 6800 XT (RADV NAVI21, LLVM 15.0.6)"), Same),
            (navi21, amdvlk, Different),
        ] {
            assert_eq!(AdapterRelation::between(&base, &head), expected, "{base:?} {head:?}");
            assert_eq!(AdapterRelation::between(&head, &base), expected);
        }
    }

    #[test]
    fn a_name_loses_its_versions_and_nothing_else() {
        for (name, expected) in [
            ("llvmpipe (LLVM 15.0.6, 256 bits)", "llvmpipe"),
            ("SwiftShader Device (LLVM 10.0.0)", "SwiftShader Device"),
            ("SwiftShader Device (Subzero)", "SwiftShader Device"),
            ("AMD Radeon (renoir, LLVM 15.0.6, DRM 3.49, 6.1.0-13-amd64)", "AMD Radeon (renoir)"),
            ("(256 bits)", ""),
            (
                "Mesa Intel(R) UHD Graphics 620 (KBL GT2)",
                "Mesa Intel(R) UHD Graphics 620 (KBL GT2)",
            ),
            ("NVIDIA H100 PCIe", "NVIDIA H100 PCIe"),
            ("odd)", "odd)"),
        ] {
            assert_eq!(model(name), expected);
        }
    }
}

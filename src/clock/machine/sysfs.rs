//! What the kernel's drivers of graphics devices have in common in sysfs.

use std::fs;
use std::path::{Path, PathBuf};

use fathom_record::Adapter;

/// Where Linux lists graphics devices.
pub const DRM: &str = "/sys/class/drm";

/// The folder of the only card with the adapter's PCI ids. Among several of a model, which cannot be told apart, none.
pub fn card(drm: &Path, adapter: &Adapter) -> Option<PathBuf> {
    let cards = fs::read_dir(drm).ok()?.flatten();
    let is_card = |name: &str| {
        name.strip_prefix("card").is_some_and(|n| n.chars().all(|c| c.is_ascii_digit()))
    };
    let cards = cards.filter(|entry| entry.file_name().to_str().is_some_and(is_card));
    let id = |card: &Path, file: &str| {
        let text = text(&card.join("device").join(file))?;
        u32::from_str_radix(text.strip_prefix("0x")?, 16).ok()
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

/// The first of these sensors that a card has, over `unit`: the kernel gives temperatures in thousandths of a degree and power in
/// microwatts (Documentation/hwmon/sysfs-interface.rst).
pub fn sensor(card: &Path, files: &[&str], unit: f64) -> Option<f64> {
    let folders = fs::read_dir(card.join("device/hwmon")).ok()?.flatten().map(|entry| entry.path());
    let folders: Vec<PathBuf> = folders.collect();
    let paths = files.iter().flat_map(|file| folders.iter().map(move |folder| folder.join(file)));
    paths.filter_map(|path| number(&path)).next().map(|value| value / unit)
}

/// A file that holds a number alone.
pub fn number(path: &Path) -> Option<f64> {
    text(path)?.parse().ok()
}

/// A file's text without the space around it.
pub fn text(path: &Path) -> Option<String> {
    fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

#[cfg(test)]
pub mod made_up {
    //! Trees of files as a kernel lists them.

    use std::fs;
    use std::path::{Path, PathBuf};

    /// A card with these ids and files, below the folder of all.
    pub fn card(drm: &Path, name: &str, ids: [u32; 2], files: &[(&str, &str)]) -> PathBuf {
        let card = drm.join(name);
        let [vendor, device] = ids.map(|id| format!("{id:#06x}\n"));
        write(&card, &[("device/vendor", &vendor), ("device/device", &device)]);
        write(&card, files);
        card
    }

    pub fn write(folder: &Path, files: &[(&str, &str)]) {
        for (file, text) in files {
            let path = folder.join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(device_id: u32) -> Adapter {
        Adapter { vendor_id: 0x1002, device_id, ..Adapter::default() }
    }

    #[test]
    fn a_card_is_found_by_its_ids_and_twins_are_not_told_apart() {
        let drm = tempfile::tempdir().unwrap();
        made_up::card(drm.path(), "card0", [0x1002, 0x73bf], &[]);
        let other = made_up::card(drm.path(), "card1", [0x1002, 0x744c], &[]);
        made_up::card(drm.path(), "card1-DP-1", [0x1002, 0x744c], &[]);
        assert_eq!(card(drm.path(), &adapter(0x744c)), Some(other));
        assert_eq!(card(drm.path(), &adapter(0x1234)), None);
        made_up::card(drm.path(), "card2", [0x1002, 0x744c], &[]);
        assert_eq!(card(drm.path(), &adapter(0x744c)), None);
        assert_eq!(card(Path::new("/nonexistent"), &adapter(1)), None);
    }
}

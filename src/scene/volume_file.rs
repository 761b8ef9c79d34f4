//! The table `[volume]` of a scene file: where a volume comes from and where it goes.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Stand, Volume, check, generators::fields};

/// Most cells of a volume: 512³, which are 512 MiB of 32-bit floats.
pub const MAX_CELLS: u64 = 1 << 27;

/// A volume: made by a generator, or read from an asset or a file.
///
/// It stands on the ground like a fitted object: the middle of its lower side is moved to
/// `translate_m`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VolumeFile {
    /// Name of a procedural volume; see [`fields`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub generator: Option<String>,
    /// Cells along x, y and z; 0 for all: a generator's own. Fewer cells show the same thing coarser.
    pub cells: [u32; 3],
    /// If not 0: the longest edge of the box, metres.
    pub fit_m: f64,
    /// Where the middle of the lower side goes, metres, y from `on`.
    pub translate_m: [f64; 3],
    /// What y is measured from.
    pub on: Stand,
    /// The generator's parameters; those left out have their defaults.
    pub params: BTreeMap<String, f64>,
}

/// Cells and their values before the volume is put into the world.
struct Samples {
    cells: [u32; 3],
    spacing_m: DVec3,
    data: Vec<f32>,
}

impl VolumeFile {
    /// Whether all values can be used; the error names the parameter and its valid range.
    pub fn validate(&self) -> Result<(), String> {
        check::within("volume.fit_m", self.fit_m, 0.0, check::FAR_M)?;
        check::point("volume.translate_m", &self.translate_m)?;
        within_limits(self.cells)
    }

    /// Makes or reads the values and puts them into the world.
    pub(super) fn build(&self, floor_depth_m: f64) -> Result<Volume, String> {
        let (name, samples) = self.samples()?;
        let cells = DVec3::from(samples.cells.map(f64::from));
        let longest = (samples.spacing_m * cells).max_element();
        let scale = if self.fit_m == 0.0 {
            1.0
        } else {
            self.fit_m / longest
        };
        let spacing_m = samples.spacing_m * scale;
        let foot = DVec3::new(0.5, 0.0, 0.5) * spacing_m * cells;
        let ground = DVec3::Y * self.on.height_m(floor_depth_m);
        let volume = Volume {
            name,
            cells: samples.cells,
            origin_m: DVec3::from(self.translate_m) + ground - foot,
            spacing_m,
            data: samples.data,
        };
        volume.validate()?;
        Ok(volume)
    }

    fn samples(&self) -> Result<(String, Samples), String> {
        let Some(name) = &self.generator else {
            return Err("it needs a `generator`".into());
        };
        let generator = fields::find(name)?;
        let cells = match self.cells {
            [0, 0, 0] => generator.cells,
            cells => cells,
        };
        let samples = Samples {
            cells,
            spacing_m: generator.extent() / DVec3::from(cells.map(f64::from)),
            data: generator.sample(&self.params, cells)?,
        };
        Ok((name.clone(), samples))
    }
}

/// Whether so many cells can be held in memory; none at all stand for a source's own.
fn within_limits(cells: [u32; 3]) -> Result<(), String> {
    let count = cells
        .iter()
        .try_fold(1u64, |n, c| n.checked_mul(u64::from(*c)));
    let [x, y, z] = cells;
    match count {
        Some(0) if cells != [0; 3] => Err(format!(
            "volume.cells = {x} × {y} × {z}: there must be one at least along each axis"
        )),
        Some(count) if count <= MAX_CELLS => Ok(()),
        _ => Err(format!(
            "volume.cells = {x} × {y} × {z}: at most {MAX_CELLS} cells are held"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smoke() -> VolumeFile {
        VolumeFile {
            generator: Some("smoke".into()),
            cells: [20, 16, 10],
            fit_m: 2.0,
            translate_m: [1.0, 0.5, -1.0],
            ..VolumeFile::default()
        }
    }

    #[test]
    fn a_volume_stands_on_its_foot_at_its_size() {
        let volume = smoke().build(3.0).unwrap();
        let bounds = volume.bounds();
        assert!((bounds.size() - DVec3::new(2.0, 1.28, 2.0)).length() < 1e-12);
        assert!((bounds.min - DVec3::new(0.0, -2.5, -2.0)).length() < 1e-12);
        assert_eq!(volume.data.len(), 3200);
        assert_eq!(volume, smoke().build(3.0).unwrap());
    }

    #[test]
    fn faults_name_their_parameter() {
        let broken = |change: fn(&mut VolumeFile)| {
            let mut file = smoke();
            change(&mut file);
            let fault = file.validate().and_then(|()| file.build(3.0).map(drop));
            fault.unwrap_err()
        };
        assert!(broken(|v| v.fit_m = -1.0).contains("volume.fit_m"));
        assert!(broken(|v| v.cells = [u32::MAX; 3]).contains("volume.cells"));
        assert!(broken(|v| v.cells = [0, 4, 4]).contains("volume.cells"));
        assert!(broken(|v| v.generator = Some("smok".into())).contains("`smoke`"));
        assert!(broken(|v| v.params = [("x".into(), 1.0)].into()).contains("`x`"));
    }
}

//! The table `[volume]` of a scene file: where a volume comes from and where it goes.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::assets::{self, AssetKind};
use super::generators::fields::{self, FieldGenerator};
use super::samples::{self, Endian, Raw, RawValues, VolumeFormat};
use super::{Anchor, SceneFile, Up, Volume, check};
use fathom_base::settings;

settings! {
    /// A volume: made by a generator, or read from an asset or a file.
    ///
    /// It stands on the ground like a fitted object: the middle of its lower side is moved to
    /// `translate_m`. The number of cells follows `cells` and `reduce`, the box that they fill does not.
    pub struct VolumeFile {
        /// Name of a procedural volume; see [`fields`].
        generator: Option<String> = None;
        /// Name of a volume to fetch; see [`assets`].
        asset: Option<String> = None;
        /// Path relative to the scene file of raw values, plain or compressed by gzip.
        file: Option<PathBuf> = None;
        /// Cells along x, y and z: how finely a generator samples its field (all 0: its own number), or how many values a
        /// file holds along each axis.
        cells: [u32; 3] = [0; 3];
        /// What a file's values are.
        format: Option<VolumeFormat> = None;
        /// Which byte of a file's values comes first.
        endian: Endian = Endian::Little;
        /// Bytes of a file, after decompression, before its first value: those of a header.
        skip_bytes: u32 = 0;
        /// Edges of a file's cells, metres; all 0: cubes and a longest edge of the box of 1 m.
        spacing_m: [f64; 3] = [0.0; 3];
        /// The stored axis that points up.
        up: Up = Up::Y;
        /// Each axis has so many times fewer cells: means over boxes of a file's cells, fewer samples of a generator's field.
        reduce: u32 = 1 => 1 ..= 64, "1";
        /// The values (low, high) that are brought to 0 and 1, linear between and clamped beyond them. Left out: the range of the
        /// type for whole numbers, 0 and 1 for `f32` and generators.
        window: Option<[f64; 2]> = None;
        /// If not 0: the longest edge of the box.
        fit_m: f64 = 0.0 => 0.0 ..= 1e5, "m";
        /// Where the middle of the lower side goes, metres, y from `on`.
        translate_m: [f64; 3] = [0.0; 3] => -1e5 ..= 1e5, "m";
        /// What y is measured from.
        on: Anchor = Anchor::Floor;
    }
}

impl VolumeFile {
    /// Whether all values can be used; the error names the parameter and its valid range.
    pub fn validate(&self) -> Result<(), String> {
        check::within_ranges("volume", self)?;
        if self.cells != [0; 3] {
            samples::cell_count(self.cells).map_err(|m| format!("volume.cells: {m}"))?;
        }
        if self.spacing_m != [0.0; 3] {
            for edge in self.spacing_m {
                check::check_range("volume.spacing_m", edge, 1e-9, check::FAR_M)?;
            }
        }
        if let Some([low, high]) = self.window {
            check::check_range("volume.window[0]", low, -1e30, 1e30)?;
            check::check_range("volume.window[1]", high, -1e30, 1e30)?;
            if low == high {
                return Err(format!("volume.window = [{low}, {high}] is empty"));
            }
        }
        self.validate_source()
    }

    /// One source, and no key that belongs to another.
    fn validate_source(&self) -> Result<(), String> {
        let (generator, file) = (self.generator.is_some(), self.file.is_some());
        let given = [generator, self.asset.is_some(), file];
        if given.iter().filter(|given| **given).count() != 1 {
            return Err("volume: it needs one of `generator`, `asset` and `file`".into());
        }
        let misplaced = [
            (self.cells != [0; 3] && !generator && !file, "cells", "`generator` or a `file`"),
            (self.format.is_some() && !file, "format", "`file`"),
            (self.endian != Endian::Little && !file, "endian", "`file`"),
            (self.skip_bytes != 0 && !file, "skip_bytes", "`file`"),
            (self.spacing_m != [0.0; 3] && !file, "spacing_m", "`file`"),
            (self.up != Up::Y && !file, "up", "`file`"),
        ];
        match misplaced.into_iter().find(|(misplaced, ..)| *misplaced) {
            Some((_, key, owner)) => Err(format!("volume.{key} belongs to a {owner}")),
            None => Ok(()),
        }
    }

    /// Makes or reads the values and places them. Adds an absent asset's stand-in to `stand_ins`.
    pub(super) fn build(
        &self,
        file: &SceneFile,
        stand_ins: &mut Vec<String>,
    ) -> Result<Volume, String> {
        let (mut volume, stored) = self.samples(file, stand_ins)?;
        volume.windowed(self.window.unwrap_or(stored));
        let size_m = volume.bounds().size();
        let scale = if self.fit_m == 0.0 { 1.0 } else { self.fit_m / size_m.max_element() };
        let foot = DVec3::new(0.5, 0.0, 0.5) * scale * size_m;
        let ground = DVec3::Y * self.on.height_m(file.floor_depth_m);
        volume.origin_m = DVec3::from(self.translate_m) + ground - foot;
        volume.spacing_m *= scale;
        volume.validate()?;
        Ok(volume)
    }

    /// What the source gives, with its name.
    fn samples(&self, file: &SceneFile, stand_ins: &mut Vec<String>) -> Result<RawValues, String> {
        let (name, (volume, window)) = if let Some(name) = &self.generator {
            (name.clone(), self.sampled(fields::find(name)?))
        } else if let Some(path) = &self.file {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let (mut volume, window) = samples::read(&file.folder.join(path), &self.raw(path)?)?;
            if self.spacing_m != [0.0; 3] {
                volume.spacing_m = DVec3::from(self.spacing_m);
            }
            (name.into_owned(), (volume.reduced(self.reduce).upright(self.up), window))
        } else {
            let name = self.asset.as_deref().unwrap_or_default();
            (name.to_owned(), self.asset(name, stand_ins)?)
        };
        Ok((Volume { name, ..volume }, window))
    }

    fn asset(&self, name: &str, stand_ins: &mut Vec<String>) -> Result<RawValues, String> {
        let asset = assets::named(name)?;
        let AssetKind::Volume { raw, up } = &asset.content else {
            return Err(format!("asset `{name}` is a mesh: it belongs to an [[object]]"));
        };
        if let Some(path) = assets::find(name) {
            let (volume, window) = samples::read(&path, raw)?;
            return Ok((volume.reduced(self.reduce).upright(*up), window));
        }
        let samples = self.sampled(fields::find(asset.stand_in.0)?);
        let [x, y, z] = samples.0.cells;
        stand_ins.push(asset.stand_in_note(&format!("{x} × {y} × {z} cells")));
        Ok(samples)
    }

    /// A generator's field; its box has a longest edge of 1 m.
    fn sampled(&self, generator: &FieldGenerator) -> RawValues {
        let cells = if self.cells == [0; 3] { generator.cells } else { self.cells };
        let cells = cells.map(|n| n.div_ceil(self.reduce));
        let spacing_m = generator.extent() / DVec3::from(cells.map(f64::from));
        let data = generator.sample(cells);
        (Volume { cells, spacing_m, data, ..Volume::default() }, [0.0, 1.0])
    }

    /// What the scene file says of a file.
    fn raw(&self, path: &Path) -> Result<Raw, String> {
        let name = path.to_string_lossy().to_ascii_lowercase();
        let is_header = [".mhd", ".nhdr"].iter().any(|end| name.ends_with(end));
        let has_header = [".mha", ".nrrd"].iter().any(|end| name.ends_with(end));
        if is_header || has_header && self.skip_bytes == 0 {
            let name = path.display();
            return Err(format!(
                "{name}: headers of .mhd, .mha, .nhdr and .nrrd files are not read. Give the file with the values as `file`, and \
                 what the header says as `cells`, `format`, `endian`, `spacing_m`; where header and uncompressed values are in one \
                 file, the header's length as `skip_bytes`"
            ));
        }
        let format = self.format.filter(|_| self.cells != [0; 3]);
        let format = format.ok_or("a volume's `file` needs both `cells` and `format`")?;
        let Self { cells, endian, skip_bytes, .. } = *self;
        Ok(Raw { cells, format, endian, skip_bytes })
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

    /// In a scene with the floor at y = −3.
    fn build(volume: &VolumeFile) -> Result<Volume, String> {
        let file = SceneFile { floor_depth_m: 3.0, ..SceneFile::load("plane").expect("a scene") };
        let mut stand_ins = Vec::new();
        let built = volume.build(&file, &mut stand_ins);
        assert!(stand_ins.is_empty());
        built
    }

    #[test]
    fn a_volume_stands_on_its_foot_at_its_size() {
        let volume = build(&smoke()).unwrap();
        let bounds = volume.bounds();
        assert!((bounds.size() - DVec3::new(2.0, 1.28, 2.0)).length() < 1e-12);
        assert!((bounds.min - DVec3::new(0.0, -2.5, -2.0)).length() < 1e-12);
        assert_eq!(volume.data.len(), 3200);
        assert_eq!(volume, build(&smoke()).unwrap());
    }

    #[test]
    fn faults_name_their_parameter() {
        let cases: &[check::InvalidCase<VolumeFile>] = &[
            (|v| v.fit_m = -1.0, "volume.fit_m"),
            (|v| v.cells = [u32::MAX; 3], "volume.cells"),
            (|v| v.cells = [0, 4, 4], "volume.cells"),
            (|v| v.generator = Some("smok".into()), "`smoke`"),
        ];
        let judged = |v: &VolumeFile| v.validate().and_then(|()| build(v).map(drop));
        check::assert_refused(&smoke(), judged, cases);
    }
}

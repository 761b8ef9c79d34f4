//! Stored values of a volume from files. Raw ones hold nothing but the cells' values, x fastest, then y, then z.

use std::io::{self, Read};
use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Volume, nifti, read};

/// Most cells of a volume: 512³, which are 512 MiB of 32-bit floats.
pub const MAX_CELLS: u64 = 1 << 27;

/// Values that are read at a time.
const CHUNK: usize = 1 << 14;

/// How numbers of one type are stored.
pub struct Stored {
    pub bytes: usize,
    /// The value, with the low byte first or last.
    pub value: fn(&[u8], bool) -> f64,
}

/// A reader of one number type in both byte orders.
macro_rules! stored {
    ($number:ty) => {
        $crate::samples::Stored {
            bytes: size_of::<$number>(),
            value: |bytes, little| {
                let bytes = bytes.try_into().unwrap_or_default();
                let order =
                    if little { <$number>::from_le_bytes } else { <$number>::from_be_bytes };
                order(bytes) as f64
            },
        }
    };
}
pub(super) use stored;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VolumeFormat {
    U8,
    /// Two bytes, the low one first.
    U16,
    /// IEEE 754 single precision, low byte first.
    F32,
}

/// What a raw file does not tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Raw {
    pub cells: [u32; 3],
    pub format: VolumeFormat,
}

impl VolumeFormat {
    /// Its numbers, and the stored values that stand for 0 and 1 unless the scene file says otherwise.
    fn stored(self) -> (Stored, [f64; 2]) {
        match self {
            VolumeFormat::U8 => (stored!(u8), [0.0, 255.0]),
            VolumeFormat::U16 => (stored!(u16), [0.0, 65_535.0]),
            VolumeFormat::F32 => (stored!(f32), [0.0, 1.0]),
        }
    }
}

/// Values as they are stored, not yet brought to 0 … 1 and placed, and those that stand for 0 and for 1.
pub type Samples = (Volume, [f64; 2]);

/// Reads `.nii` and `.nii.gz` by their header; everything else, plain or compressed by gzip, is the cells that `raw` tells.
pub fn read(path: &Path, raw: Option<&Raw>) -> Result<Samples, String> {
    let malformed = |what| format!("volume {}: {what}", path.display());
    let mut source =
        read::open(path).map_err(|e| format!("cannot read the volume {}: {e}", path.display()))?;
    let samples = match (is_nifti(path), raw) {
        (true, None) => nifti::parse(&mut source),
        (true, Some(_)) => Err("its header has `cells` and `format`: leave them out".into()),
        (false, Some(raw)) => raw_cells(&mut source, raw),
        (false, None) => Err("a raw file needs `cells` and `format`".into()),
    };
    let samples = samples.map_err(malformed)?;
    // To the end of the archive, whose checksum stands there.
    io::copy(&mut source, &mut io::sink()).map_err(|e| malformed(e.to_string()))?;
    samples.0.check_finite().map_err(malformed)?;
    Ok(samples)
}

/// Reads up to `count` values of so many bytes each: fewer where the source ends before. Gives the bytes that were read, too.
pub fn values(
    source: &mut dyn Read,
    count: usize,
    bytes: usize,
    value: impl Fn(&[u8]) -> f32,
) -> Result<(Vec<f32>, usize), String> {
    let (mut values, mut read) = (Vec::new(), 0);
    while values.len() < count {
        let wanted = (count - values.len()).min(CHUNK) * bytes;
        let chunk = up_to(source, wanted)?;
        values.extend(chunk.chunks_exact(bytes).map(&value));
        read += chunk.len();
        if chunk.len() < wanted {
            break;
        }
    }
    Ok((values, read))
}

/// The next bytes: fewer where the source ends before.
pub fn up_to(source: &mut dyn Read, wanted: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::with_capacity(wanted);
    source.take(wanted as u64).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    Ok(bytes)
}

fn is_nifti(path: &Path) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    name.ends_with(".nii") || name.ends_with(".nii.gz")
}

/// The number of cells, if so many can be held in memory.
pub fn cell_count(cells: [u32; 3]) -> Result<usize, String> {
    let [x, y, z] = cells;
    match cells.iter().try_fold(1u64, |n, c| n.checked_mul(u64::from(*c))) {
        Some(0) => {
            Err(format!("{x} × {y} × {z} cells: there must be one at least along each axis"))
        }
        Some(count) if count <= MAX_CELLS => Ok(count as usize),
        _ => Err(format!("{x} × {y} × {z} cells: at most {MAX_CELLS} are held")),
    }
}

/// Cubic cells; the longest edge of the box is 1 m.
fn raw_cells(source: &mut dyn Read, raw: &Raw) -> Result<Samples, String> {
    let count = cell_count(raw.cells)?;
    let (Stored { bytes: each, value }, window) = raw.format.stored();
    let (data, read) = values(source, count, each, |bytes| value(bytes, true) as f32)?;
    let rest = io::copy(source, &mut io::sink()).map_err(|error| error.to_string())?;
    let (held, taken) = (read as u64 + rest, (count * each) as u64);
    if held != taken {
        let [x, y, z] = raw.cells;
        return Err(format!(
            "{held} bytes, but {x} × {y} × {z} cells of {each} bytes take {taken}"
        ));
    }
    let longest = raw.cells.into_iter().max().unwrap_or(1);
    let spacing_m = DVec3::splat(1.0 / f64::from(longest));
    Ok((Volume { cells: raw.cells, spacing_m, data, ..Volume::default() }, window))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_counted_within_limits() {
        assert_eq!(cell_count([512; 3]), Ok(1 << 27));
        assert!(cell_count([513, 512, 512]).unwrap_err().contains("at most"));
        assert!(cell_count([u32::MAX; 3]).unwrap_err().contains("at most"));
        assert!(cell_count([4, 0, 4]).unwrap_err().contains("one at least"));
    }

    fn raw(format: VolumeFormat) -> Raw {
        Raw { cells: [2, 1, 1], format }
    }

    #[test]
    fn every_format_is_read() {
        let read = |format, mut bytes: &[u8]| raw_cells(&mut bytes, &raw(format)).unwrap().0.data;
        assert_eq!(read(VolumeFormat::U8, &[3, 255]), [3.0, 255.0]);
        assert_eq!(read(VolumeFormat::U16, &[1, 2, 255, 255]), [513.0, 65_535.0]);
        let floats: Vec<u8> = [0.25f32, -2.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(read(VolumeFormat::F32, &floats), [0.25, -2.0]);
    }
}

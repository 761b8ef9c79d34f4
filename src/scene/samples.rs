//! Stored values of a volume from files. Raw ones hold nothing but the cells' values, x fastest, then y, then z.

use std::io::{self, Read};
use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Volume, read};
use fathom_base::choices;

/// Most cells of a volume: 512³, which are 512 MiB of 32-bit floats.
pub const MAX_CELLS: u64 = 1 << 27;

/// Values that are read at a time.
const CHUNK: usize = 1 << 14;

/// The type of a stored value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VolumeFormat {
    U8,
    /// Two's complement, as [`VolumeFormat::I16`].
    I8,
    U16,
    I16,
    /// IEEE 754 single precision.
    F32,
}

/// Which byte of a value comes first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Endian {
    #[default]
    Little,
    Big,
}

choices!(Endian);

/// What a raw file does not tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Raw {
    pub cells: [u32; 3],
    pub format: VolumeFormat,
    pub endian: Endian,
    /// Before the first value.
    pub skip_bytes: u32,
}

impl VolumeFormat {
    /// Bytes of a value, and the stored values that stand for 0 and 1 unless the scene file says otherwise.
    fn layout(self) -> (usize, [f64; 2]) {
        match self {
            VolumeFormat::U8 => (1, [0.0, u8::MAX.into()]),
            VolumeFormat::I8 => (1, [i8::MIN.into(), i8::MAX.into()]),
            VolumeFormat::U16 => (2, [0.0, u16::MAX.into()]),
            VolumeFormat::I16 => (2, [i16::MIN.into(), i16::MAX.into()]),
            VolumeFormat::F32 => (4, [0.0, 1.0]),
        }
    }

    fn value(self, bytes: &[u8], endian: Endian) -> f32 {
        let last = bytes.len() - 1;
        let byte = |i: usize| bytes[if endian == Endian::Big { last - i } else { i }];
        match self {
            VolumeFormat::U8 => byte(0).into(),
            VolumeFormat::I8 => byte(0).cast_signed().into(),
            VolumeFormat::U16 => u16::from_le_bytes([byte(0), byte(1)]).into(),
            VolumeFormat::I16 => i16::from_le_bytes([byte(0), byte(1)]).into(),
            VolumeFormat::F32 => f32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]),
        }
    }
}

/// Values as they are stored, not yet brought to 0 … 1 and placed, and those that stand for 0 and for 1.
pub type RawValues = (Volume, [f64; 2]);

pub fn read(path: &Path, raw: &Raw) -> Result<RawValues, String> {
    let malformed = |what| format!("volume {}: {what}", path.display());
    let mut source =
        read::open(path).map_err(|e| format!("cannot read the volume {}: {e}", path.display()))?;
    let samples = raw_cells(&mut source, raw).map_err(malformed)?;
    samples.0.check_finite().map_err(malformed)?;
    Ok(samples)
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
fn raw_cells(source: &mut dyn Read, raw: &Raw) -> Result<RawValues, String> {
    let count = cell_count(raw.cells)?;
    let (each, window) = raw.format.layout();
    let skipped = io::copy(&mut source.take(raw.skip_bytes.into()), &mut io::sink());
    skipped.map_err(|error| error.to_string())?;
    let (mut data, mut read) = (Vec::new(), 0);
    while data.len() < count {
        let wanted = (count - data.len()).min(CHUNK) * each;
        let mut chunk = Vec::with_capacity(wanted);
        let taken = source.take(wanted as u64).read_to_end(&mut chunk);
        read += taken.map_err(|error| error.to_string())?;
        if chunk.len() < wanted {
            break;
        }
        data.extend(chunk.chunks_exact(each).map(|bytes| raw.format.value(bytes, raw.endian)));
    }
    let rest = io::copy(source, &mut io::sink()).map_err(|error| error.to_string())?;
    let (held, taken) = (read as u64 + rest, (count * each) as u64);
    if held != taken {
        let [x, y, z] = raw.cells;
        let skipped = match raw.skip_bytes {
            0 => String::new(),
            bytes => format!(" after the {bytes} of skip_bytes"),
        };
        return Err(format!(
            "{held} bytes{skipped}, but {x} × {y} × {z} cells of {each} bytes take {taken}"
        ));
    }
    let longest = raw.cells.into_iter().max().unwrap_or(1);
    let spacing_m = DVec3::splat(1.0 / f64::from(longest));
    let volume = Volume { cells: raw.cells, spacing_m, data, ..Volume::default() };
    Ok((volume, window))
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

    #[test]
    fn every_format_is_read() {
        use VolumeFormat::{F32, I8, I16, U8, U16};
        let floats = [0.25f32, -2.0].map(f32::to_le_bytes).concat();
        let rows: [(VolumeFormat, &[u8], [f32; 2]); 5] = [
            (U8, &[3, 255], [3.0, 255.0]),
            (I8, &[3, 255], [3.0, -1.0]),
            (U16, &[1, 2, 255, 255], [513.0, 65_535.0]),
            (I16, &[0x18, 0xfc, 0, 0x80], [-1000.0, -32_768.0]),
            (F32, &floats, [0.25, -2.0]),
        ];
        for (format, little, expected) in rows {
            let big =
                little.chunks(format.layout().0).flat_map(|value| value.iter().rev().copied());
            let big: Vec<u8> = [7; 9].into_iter().chain(big).collect();
            for (endian, skip_bytes, mut bytes) in
                [(Endian::Little, 0, little), (Endian::Big, 9, &big)]
            {
                let raw = Raw { cells: [2, 1, 1], format, endian, skip_bytes };
                let (volume, _) = raw_cells(&mut bytes, &raw).unwrap();
                assert_eq!(volume.data, expected, "{format:?} {endian:?}");
            }
        }
    }
}

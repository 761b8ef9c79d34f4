//! Raw volumes: nothing but the cells' values, x fastest, then y, then z.

use std::io::{self, Read};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::samples::{VolumeSamples, cell_count, values};

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
    fn bytes(self) -> usize {
        match self {
            VolumeFormat::U8 => 1,
            VolumeFormat::U16 => 2,
            VolumeFormat::F32 => 4,
        }
    }

    /// The value of so many bytes as one takes.
    fn value(self, bytes: &[u8]) -> f32 {
        match (self, bytes) {
            (VolumeFormat::U8, [byte]) => f32::from(*byte),
            (VolumeFormat::U16, [low, high]) => f32::from(u16::from_le_bytes([*low, *high])),
            (VolumeFormat::F32, [a, b, c, d]) => f32::from_le_bytes([*a, *b, *c, *d]),
            _ => f32::NAN,
        }
    }

    /// The stored values that stand for 0 and 1 unless the scene file says otherwise.
    fn window(self) -> [f64; 2] {
        match self {
            VolumeFormat::U8 => [0.0, 255.0],
            VolumeFormat::U16 => [0.0, 65_535.0],
            VolumeFormat::F32 => [0.0, 1.0],
        }
    }
}

/// Cubic cells; the longest edge of the box is 1 m.
pub fn parse(source: &mut dyn Read, raw: &Raw) -> Result<VolumeSamples, String> {
    let count = cell_count(raw.cells)?;
    let each = raw.format.bytes();
    let (data, read) = values(source, count, each, |b| raw.format.value(b))?;
    let rest = io::copy(source, &mut io::sink()).map_err(|error| error.to_string())?;
    let (held, taken) = (read as u64 + rest, (count * each) as u64);
    if held != taken {
        let [x, y, z] = raw.cells;
        return Err(format!(
            "{held} bytes, but {x} × {y} × {z} cells of {each} bytes take {taken}"
        ));
    }
    let longest = raw.cells.into_iter().max().unwrap_or(1);
    Ok(VolumeSamples {
        cells: raw.cells,
        spacing_m: DVec3::splat(1.0 / f64::from(longest)),
        data,
        window: raw.format.window(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(format: VolumeFormat) -> Raw {
        Raw { cells: [2, 1, 1], format }
    }

    #[test]
    fn every_format_is_read() {
        let read = |format, mut bytes: &[u8]| parse(&mut bytes, &raw(format)).unwrap().data;
        assert_eq!(read(VolumeFormat::U8, &[3, 255]), [3.0, 255.0]);
        assert_eq!(read(VolumeFormat::U16, &[1, 2, 255, 255]), [513.0, 65_535.0]);
        let floats: Vec<u8> = [0.25f32, -2.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(read(VolumeFormat::F32, &floats), [0.25, -2.0]);
    }

    #[test]
    fn a_wrong_size_is_told_in_numbers() {
        for length in [0, 3, 5] {
            let fault = parse(&mut &vec![0; length][..], &raw(VolumeFormat::U16)).unwrap_err();
            assert!(fault.contains(&format!("{length} bytes, but")), "{fault}");
            assert!(fault.contains("take 4"), "{fault}");
        }
    }
}

//! NIfTI-1 volumes in a single file (`.nii`), of either byte order. Written by the official definition, `nifti1.h` of the NIH.
//!
//! The cells come as they are stored. The orientation (qform, sform) is not read: `up` in the scene file turns the volume.

use std::io::{self, Read};

use glam::DVec3;

use super::Volume;
use super::samples::{Samples, Stored, cell_count, stored, up_to, values};

/// Bytes of the header; the first of its fields says so.
const HEADER: usize = 348;

/// The data start no earlier: header and the four bytes that tell extensions.
const FIRST_OFFSET: f32 = 352.0;

/// The header's first field in NIfTI-2.
const HEADER_2: i32 = 540;

/// Reads header and cells. Values have the header's slope and intercept applied. They stand for 0 … 1 between `cal_min` and
/// `cal_max`, or between the least and the largest value where the header does not give those.
pub fn parse(source: &mut dyn Read) -> Result<Samples, String> {
    let bytes = up_to(source, HEADER)?;
    let header = Header::new(&bytes)?;
    let cells = header.cells()?;
    let stored = header.stored()?;
    let count = cell_count(cells)?;
    let offset = header.offset()?;
    let (slope, intercept) = header.scaling()?;
    let little = header.little;
    let value = |b: &[u8]| ((stored.value)(b, little) * slope + intercept) as f32;
    let mut before = (&mut *source).take((offset - HEADER) as u64);
    io::copy(&mut before, &mut io::sink()).map_err(|error| error.to_string())?;
    let (data, _) = values(source, count, stored.bytes, value)?;
    if data.len() < count {
        let ([x, y, z], each) = (cells, stored.bytes);
        let (held, taken) = (data.len() * each, count * each);
        return Err(format!(
            "{held} bytes of data from byte {offset} on, but {x} × {y} × {z} cells of {each} bytes take {taken}"
        ));
    }
    let (spacing_m, window) = (header.spacing_m()?, header.window(&data));
    Ok((Volume { cells, spacing_m, data, ..Volume::default() }, window))
}

struct Header<'a> {
    bytes: &'a [u8],
    little: bool,
}

impl<'a> Header<'a> {
    /// Size, byte order and magic.
    fn new(file: &'a [u8]) -> Result<Self, String> {
        let Some(bytes) = file.get(..HEADER) else {
            return Err(match file.len() {
                0 => "the file is empty".to_owned(),
                length => format!("{length} bytes: a NIfTI-1 header alone has {HEADER}"),
            });
        };
        let size = [true, false].map(|little| Self { bytes, little }.i32(0));
        if size.contains(&HEADER_2) {
            return Err("sizeof_hdr = 540: this is NIfTI-2, only NIfTI-1 is read".into());
        }
        let Some(order) = size.iter().position(|s| *s == HEADER as i32) else {
            return Err(format!("sizeof_hdr = {} must be {HEADER}", size[0]));
        };
        let header = Self { bytes, little: order == 0 };
        match &bytes[344..348] {
            b"n+1\0" => Ok(header),
            b"ni1\0" => {
                Err("magic ni1: header and data in two files, only one file (n+1) is read".into())
            }
            other => Err(format!("magic {} must be n+1", other.escape_ascii())),
        }
    }

    fn i16(&self, at: usize) -> i16 {
        (stored!(i16).value)(&self.bytes[at..at + 2], self.little) as i16
    }

    fn i32(&self, at: usize) -> i32 {
        (stored!(i32).value)(&self.bytes[at..at + 4], self.little) as i32
    }

    fn f32(&self, at: usize) -> f32 {
        (stored!(f32).value)(&self.bytes[at..at + 4], self.little) as f32
    }

    /// `dim`: three axes, and nothing along those beyond.
    fn cells(&self) -> Result<[u32; 3], String> {
        let dim = |i: usize| self.i16(40 + 2 * i);
        let axes = dim(0);
        if !(3..=7).contains(&axes) {
            return Err(format!("dim[0] = {axes} axes must lie in 3 to 7"));
        }
        for i in 1..=axes as usize {
            let (length, low, high) = (dim(i), 1, if i > 3 { 1 } else { i16::MAX });
            if !(low..=high).contains(&length) {
                let why = if length > 1 { ": only one volume is read" } else { "" };
                return Err(format!("dim[{i}] = {length} must lie in {low} to {high}{why}"));
            }
        }
        Ok([dim(1), dim(2), dim(3)].map(|n| n as u32))
    }

    /// `datatype`, with which `bitpix` must agree.
    fn stored(&self) -> Result<Stored, String> {
        let (datatype, bits) = (self.i16(70), self.i16(72));
        let stored = match datatype {
            2 => stored!(u8),
            4 => stored!(i16),
            8 => stored!(i32),
            16 => stored!(f32),
            64 => stored!(f64),
            256 => stored!(i8),
            512 => stored!(u16),
            768 => stored!(u32),
            1024 => stored!(i64),
            1280 => stored!(u64),
            _ => {
                return Err(format!(
                    "datatype = {datatype}: only whole and real numbers of 8 to 64 bits are read (2, 4, 8, 16, 64, 256, 512, 768, 1024, 1280)"
                ));
            }
        };
        let expected = 8 * stored.bytes;
        if usize::try_from(bits) != Ok(expected) {
            return Err(format!("bitpix = {bits} must be {expected} for datatype {datatype}"));
        }
        Ok(stored)
    }

    fn offset(&self) -> Result<usize, String> {
        let offset = self.f32(108);
        if (FIRST_OFFSET..1e9).contains(&offset) && offset.fract() == 0.0 {
            return Ok(offset as usize);
        }
        Err(format!("vox_offset = {offset} must be a whole number from {FIRST_OFFSET} on"))
    }

    /// `scl_slope` and `scl_inter`; a slope of 0 means none.
    fn scaling(&self) -> Result<(f64, f64), String> {
        let (slope, intercept) = (self.f32(112), self.f32(116));
        if slope == 0.0 {
            return Ok((1.0, 0.0));
        }
        if slope.is_finite() && intercept.is_finite() {
            return Ok((slope.into(), intercept.into()));
        }
        Err(format!("scl_slope = {slope} and scl_inter = {intercept} must be finite"))
    }

    /// `pixdim` in the unit of `xyzt_units`; without one, millimetres.
    fn spacing_m(&self) -> Result<DVec3, String> {
        let unit_m = match self.bytes[123] & 7 {
            1 => 1.0,
            0 | 2 => 1e-3,
            3 => 1e-6,
            other => return Err(format!("xyzt_units = {other}: there is no such unit of length")),
        };
        let mut spacing = DVec3::ZERO;
        for axis in 0..3 {
            let length = self.f32(80 + 4 * axis);
            if !(length.is_finite() && length > 0.0) {
                return Err(format!("pixdim[{}] = {length} must be positive", axis + 1));
            }
            spacing[axis] = f64::from(length) * unit_m;
        }
        Ok(spacing)
    }

    fn window(&self, data: &[f32]) -> [f64; 2] {
        let (high, low) = (self.f32(124), self.f32(128));
        if low.is_finite() && high.is_finite() && low < high {
            return [low.into(), high.into()];
        }
        let least = f64::from(data.iter().copied().fold(f32::INFINITY, f32::min));
        let largest = f64::from(data.iter().copied().fold(f32::NEG_INFINITY, f32::max));
        // A volume of one value is all 0.
        [least, if largest - least > 0.0 { largest } else { least + 1.0 }]
    }
}

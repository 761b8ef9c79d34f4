//! Arrays of numbers as NumPy stores them: `.npy` files of plain 32-bit and 64-bit floats.
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>

use std::io::{self, ErrorKind, Read, Write};

use thiserror::Error;

/// First bytes of a file, before the two of its version.
const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Longest header that is read, bytes: NumPy's own limit, `_MAX_HEADER_SIZE` in `numpy/lib/_format_impl.py`.
const MAX_HEADER: usize = 10_000;
/// The data begin at a multiple of so many bytes.
const ALIGNMENT: usize = 64;
/// Most dimensions of an array: `NPY_MAXDIMS` of NumPy 2.
const MAX_DIMENSIONS: usize = 64;

/// An array in C order: the last axis runs fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    pub shape: Vec<usize>,
    /// 32-bit values are widened.
    pub values: Vec<f64>,
}

#[derive(Debug, Error)]
pub enum NpyError {
    #[error(transparent)]
    Io(io::Error),
    #[error("it is not a .npy file")]
    Magic,
    #[error("it is a .npy file of version {0}, and versions 1 to 3 are read")]
    Version(u8),
    #[error("its header is longer than {MAX_HEADER} bytes")]
    LongHeader,
    #[error("its header cannot be read: {0}")]
    Header(&'static str),
    #[error("its values are of type {0}; little-endian f32 or f64 are read")]
    Type(String),
    #[error("it holds {0} values, and at most {1} are read")]
    TooMany(String, usize),
    #[error("it is cut short")]
    Short,
    #[error("{0} bytes follow its values")]
    Longer(u64),
}

impl From<io::Error> for NpyError {
    fn from(error: io::Error) -> Self {
        if error.kind() == ErrorKind::UnexpectedEof { Self::Short } else { Self::Io(error) }
    }
}

/// Reads an array of up to `most` values. Nothing is allocated by what the header claims beyond that.
pub fn read(mut source: impl Read, most: usize) -> Result<Array, NpyError> {
    let Header { wide, fortran, shape } = Header::parse(&header_text(&mut source)?)?;
    let count = shape.iter().try_fold(1usize, |count, side| count.checked_mul(*side));
    let count = count.filter(|count| *count <= most);
    let told = || shape.iter().map(usize::to_string).collect::<Vec<_>>().join(" × ");
    let count = count.ok_or_else(|| NpyError::TooMany(told(), most))?;
    let length = (count as u64).saturating_mul(if wide { 8 } else { 4 });
    let mut bytes = Vec::new();
    source.by_ref().take(length).read_to_end(&mut bytes)?;
    if (bytes.len() as u64) < length {
        return Err(NpyError::Short);
    }
    let more = io::copy(&mut source, &mut io::sink())?;
    if more > 0 {
        return Err(NpyError::Longer(more));
    }
    let values: Vec<f64> = match wide {
        true => bytes.as_chunks().0.iter().map(|value| f64::from_le_bytes(*value)).collect(),
        false => {
            bytes.as_chunks().0.iter().map(|value| f32::from_le_bytes(*value).into()).collect()
        }
    };
    let values = if fortran { in_c_order(&shape, &values) } else { values };
    Ok(Array { shape, values })
}

/// The text of a header, whose length comes before it: two bytes in version 1, four in later ones.
fn header_text(source: &mut impl Read) -> Result<String, NpyError> {
    let mut begin = [0; 8];
    source.read_exact(&mut begin)?;
    if !begin.starts_with(MAGIC) {
        return Err(NpyError::Magic);
    }
    let mut length = [0; 4];
    match begin[6] {
        1 => source.read_exact(&mut length[..2])?,
        2 | 3 => source.read_exact(&mut length)?,
        version => return Err(NpyError::Version(version)),
    }
    let length = u32::from_le_bytes(length) as usize;
    if length > MAX_HEADER {
        return Err(NpyError::LongHeader);
    }
    let mut header = vec![0; length];
    source.read_exact(&mut header)?;
    String::from_utf8(header).map_err(|_| NpyError::Header("it is no text"))
}

/// A header says: type of the values, order of the axes, extents.
struct Header {
    wide: bool,
    fortran: bool,
    shape: Vec<usize>,
}

impl Header {
    /// A flat dictionary of Python with three keys; anything nested is refused where it begins.
    fn parse(text: &str) -> Result<Header, NpyError> {
        let (mut kind, mut fortran, mut shape) = (None, None, None);
        let mut rest =
            text.trim().strip_prefix('{').ok_or(NpyError::Header("it is no dictionary"))?;
        loop {
            rest = rest.trim_start();
            if rest == "}" {
                break;
            }
            let (key, after) = quoted(rest)?;
            let value = after.trim_start().strip_prefix(':').ok_or(NpyError::Header("no `:`"))?;
            let value = value.trim_start();
            let after = match key {
                "descr" => put(&mut kind, descriptor(value)?)?,
                "fortran_order" => put(&mut fortran, boolean(value)?)?,
                "shape" => put(&mut shape, extents(value)?)?,
                _ => return Err(NpyError::Header("it has an unknown key")),
            };
            rest = after.trim_start();
            rest = match rest.strip_prefix(',') {
                Some(after) => after,
                None if rest == "}" => rest,
                None => return Err(NpyError::Header("a value does not end where it should")),
            };
        }
        let missing = NpyError::Header("descr, fortran_order or shape is not in it");
        match (kind, fortran, shape) {
            (Some(wide), Some(fortran), Some(shape)) => Ok(Header { wide, fortran, shape }),
            _ => Err(missing),
        }
    }
}

/// Keeps a value that comes once, and gives the text after it.
fn put<'a, T>(place: &mut Option<T>, (value, rest): (T, &'a str)) -> Result<&'a str, NpyError> {
    match place.replace(value) {
        None => Ok(rest),
        Some(_) => Err(NpyError::Header("a key comes twice")),
    }
}

/// A text in quotes, and what follows it.
fn quoted(text: &str) -> Result<(&str, &str), NpyError> {
    let found = ['\'', '"'].into_iter().find_map(|q| text.strip_prefix(q)?.split_once(q));
    found.ok_or(NpyError::Header("a text is not in quotes"))
}

/// Whether values have 64 bits.
fn descriptor(text: &str) -> Result<(bool, &str), NpyError> {
    if !text.starts_with(['\'', '"']) {
        return Err(NpyError::Type("a structure".to_owned()));
    }
    let (name, rest) = quoted(text)?;
    match name {
        "<f4" => Ok((false, rest)),
        "<f8" => Ok((true, rest)),
        other => Err(NpyError::Type(format!("`{}`", crate::text::line(other)))),
    }
}

fn boolean(text: &str) -> Result<(bool, &str), NpyError> {
    let found = [("True", true), ("False", false)].into_iter();
    let mut found = found.filter_map(|(word, value)| Some((value, text.strip_prefix(word)?)));
    found.next().ok_or(NpyError::Header("fortran_order is neither True nor False"))
}

/// `(3, 4)`, `(3,)` or `()`.
fn extents(text: &str) -> Result<(Vec<usize>, &str), NpyError> {
    let fault = || NpyError::Header("shape is no tuple of whole numbers");
    let (inner, rest) = text.strip_prefix('(').and_then(|t| t.split_once(')')).ok_or_else(fault)?;
    let inner = inner.trim_end();
    let inner = inner.strip_suffix(',').unwrap_or(inner);
    if inner.is_empty() {
        return Ok((Vec::new(), rest));
    }
    let sides = inner.split(',').map(|side| side.trim().parse().map_err(|_| fault()));
    let shape: Vec<usize> = sides.take(MAX_DIMENSIONS + 1).collect::<Result<_, _>>()?;
    if shape.len() > MAX_DIMENSIONS { Err(fault()) } else { Ok((shape, rest)) }
}

/// Values of which the first axis ran fastest.
fn in_c_order(shape: &[usize], values: &[f64]) -> Vec<f64> {
    let place = |mut index: usize| {
        let mut place = 0;
        for (axis, side) in shape.iter().enumerate().rev() {
            let stride: usize = shape[..axis].iter().product();
            place += index % side * stride;
            index /= side;
        }
        place
    };
    (0..values.len()).map(|index| values[place(index)]).collect()
}

/// The beginning of a file of version 1, up to its values.
pub fn header(descriptor: &str, shape: &[usize]) -> Vec<u8> {
    let extents: String = shape.iter().map(|side| format!("{side},")).collect();
    let said =
        format!("{{'descr': '{descriptor}', 'fortran_order': False, 'shape': ({extents}), }}");
    // Magic, version and length are ten bytes; the header ends with a newline.
    let length = (10 + said.len() + 1).next_multiple_of(ALIGNMENT) - 10;
    let mut header = [&MAGIC[..], &[1, 0], &(length as u16).to_le_bytes()].concat();
    header.extend(format!("{said:<width$}\n", width = length - 1).bytes());
    header
}

/// Writes an array of 32-bit values in C order.
pub fn write(mut sink: impl Write, shape: &[usize], values: &[f32]) -> io::Result<()> {
    if shape.iter().product::<usize>() != values.len() {
        let message = format!("{} values do not fill an array of {shape:?}", values.len());
        return Err(io::Error::new(ErrorKind::InvalidInput, message));
    }
    sink.write_all(&header("<f4", shape))?;
    values.iter().try_for_each(|value| sink.write_all(&value.to_le_bytes()))?;
    sink.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of version 1 with this header.
    fn file(header: &str, values: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [&MAGIC[..], &[1, 0], &length, header.as_bytes(), values].concat()
    }

    fn fault(bytes: &[u8]) -> String {
        let fault = read(bytes, 100).unwrap_err().to_string();
        assert_eq!(fault.lines().count(), 1, "{fault}");
        fault
    }

    #[test]
    fn what_is_written_is_read() {
        for shape in [&[2, 3][..], &[6], &[1, 2, 3], &[], &[0, 4]] {
            let values: Vec<f32> = (0..shape.iter().product()).map(|i| i as f32 - 0.5).collect();
            let mut bytes = Vec::new();
            write(&mut bytes, shape, &values).unwrap();
            let data = bytes.len() - 4 * values.len();
            assert_eq!((data % ALIGNMENT, bytes[data - 1]), (0, b'\n'));
            let found = read(&bytes[..], 100).unwrap();
            assert_eq!((&found.shape[..], found.values.len()), (shape, values.len()));
            assert!(found.values.iter().zip(values).all(|(a, b)| *a == f64::from(b)));
        }
        assert!(write(&mut Vec::new(), &[2, 2], &[0.0; 3]).is_err());
    }

    /// As NumPy writes `numpy.asfortranarray([[1, 2, 3], [4, 5, 6]])`.
    #[test]
    fn both_orders_and_widths_are_read() {
        let head = "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3), }       \n";
        let stored = [1.0f64, 4.0, 2.0, 5.0, 3.0, 6.0].map(f64::to_le_bytes).concat();
        let found = read(&file(head, &stored)[..], 100).unwrap();
        let expected = Array { shape: vec![2, 3], values: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
        assert_eq!(found, expected);
        let head = "{\"shape\":(2,),\"fortran_order\":False,\"descr\":\"<f4\"}";
        let stored = [1.5f32, -2.0].map(f32::to_le_bytes).concat();
        assert_eq!(read(&file(head, &stored)[..], 100).unwrap().values, [1.5, -2.0]);
    }

    /// The nested header took a general parser of Python's literals a time that doubles with each depth.
    #[test]
    fn bad_headers_are_answered_in_one_line() {
        let nested = format!("{{'descr': {}{}, ", "(".repeat(24), ")".repeat(24));
        assert!(fault(&file(&nested, &[])).contains("a structure"));
        let shape = format!("{{'shape': {}", "(".repeat(9000));
        assert!(fault(&file(&shape, &[])).contains("shape is no tuple"));
        let keys = "{'descr': '<f4', 'fortran_order': False, 'shape': ";
        for (header, reason) in [
            ("", "no dictionary"),
            ("{", "not in quotes"),
            ("{}", "is not in it"),
            ("{'a': 1}", "unknown key"),
            ("{'descr': '<f4', 'descr': '<f4'}", "comes twice"),
            ("{'descr': '>f4'}", "of type `>f4`"),
            ("{'fortran_order': 0}", "neither True nor False"),
            (&format!("{keys}(-1,)}}"), "shape is no tuple"),
            (&format!("{keys}(1, 2) 3}}"), "does not end"),
            (&format!("{keys}(101,)}}"), "it holds 101 values, and at most 100"),
            (&format!("{keys}(9223372036854775807, 4)}}"), "at most 100"),
            (&format!("{keys}(4,)}}"), "cut short"),
            (&format!("{keys}({})}}", "1,".repeat(65)), "shape is no tuple"),
        ] {
            let told = fault(&file(header, &[0; 8]));
            assert!(told.contains(reason), "{header}: {told}");
        }
        assert!(fault(&file(&format!("{keys}(1,)}}"), &[0; 8])).contains("4 bytes follow"));
        let mut long = file("", &[]);
        (long[6], long[8], long[9]) = (2, 255, 255);
        long.extend([255; 4]);
        assert!(fault(&long).contains("longer than 10000 bytes"));
        long[6] = 4;
        assert!(fault(&long).contains("version 4"));
        assert!(fault(b"P6 1 1 255").contains("not a .npy file"));
    }
}

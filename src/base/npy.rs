//! Arrays of numbers as NumPy stores them: `.npy` files of 32-bit floats.
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>

use std::io::{self, ErrorKind, Write};

/// First bytes of a file, before the two of its version.
pub const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// The data begin at a multiple of so many bytes.
const ALIGNMENT: usize = 64;

/// The beginning of a file of version 1, up to its values.
fn header(descriptor: &str, shape: &[usize]) -> Vec<u8> {
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

    #[test]
    fn a_file_is_as_numpy_writes_it() {
        for (shape, extents) in [(&[2, 3][..], "(2,3,)"), (&[6], "(6,)"), (&[], "()")] {
            let values: Vec<f32> = (0..shape.iter().product()).map(|i| i as f32 - 0.5).collect();
            let mut bytes = Vec::new();
            write(&mut bytes, shape, &values).unwrap();
            let header = bytes.len() - 4 * values.len();
            assert_eq!((header % ALIGNMENT, bytes[header - 1]), (0, b'\n'));
            assert_eq!(bytes[..10], *b"\x93NUMPY\x01\0\x76\0");
            let said = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {extents}, }}");
            assert_eq!(std::str::from_utf8(&bytes[10..header]).unwrap().trim_end(), said);
            assert_eq!(
                bytes[header..],
                values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()
            );
        }
        assert!(write(&mut Vec::new(), &[2, 2], &[0.0; 3]).is_err());
    }
}

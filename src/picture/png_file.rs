//! Pictures as PNG.

use std::io::Cursor;

use png::{ColorType, Compression, Decoder, Encoder, Filter, Limits, Transformations};
use thiserror::Error;

use super::{Rgb, RgbImage};

#[derive(Debug, Error)]
#[error("it cannot be written as PNG: {0}")]
pub struct EncodeError(#[from] png::EncodingError);

#[derive(Debug, Error)]
pub enum DecodeError {
    #[error("it is no sound PNG file: {0}")]
    Damaged(#[from] png::DecodingError),
    #[error("it has {width} × {height} pixels, and a side may have {most}")]
    TooLarge { width: u32, height: u32, most: u32 },
}

impl RgbImage {
    /// The bytes of a file.
    ///
    /// # Errors
    /// A picture without pixels.
    pub fn to_png(&self) -> Result<Vec<u8>, EncodeError> {
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(ColorType::Rgb);
        encoder.set_compression(Compression::Balanced);
        encoder.set_filter(Filter::Adaptive);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.bytes())?;
        writer.finish()?;
        Ok(bytes)
    }

    /// The picture of a file's bytes, whatever its kind of colour, without its transparency.
    ///
    /// # Errors
    /// Damaged files, sides of more pixels than `most_side`, and what takes more than about `most_bytes` of memory.
    pub fn from_png(bytes: &[u8], most_side: u32, most_bytes: usize) -> Result<Self, DecodeError> {
        let limits = Limits { bytes: most_bytes };
        let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
        decoder.set_transformations(Transformations::normalize_to_color8());
        let (width, height) = decoder.read_header_info()?.size();
        if width.max(height) > most_side {
            return Err(DecodeError::TooLarge { width, height, most: most_side });
        }
        let mut reader = decoder.read_info()?;
        let size = reader.output_buffer_size().filter(|size| *size <= most_bytes);
        let mut data = vec![0; size.ok_or(png::DecodingError::LimitsExceeded)?];
        let color = reader.next_frame(&mut data)?.color_type;
        let channels = color.samples();
        let grey = matches!(color, ColorType::Grayscale | ColorType::GrayscaleAlpha);
        let rgb =
            |pixel: &[u8]| -> Rgb { std::array::from_fn(|i| pixel[if grey { 0 } else { i }]) };
        Ok(Self { width, height, pixels: data.chunks_exact(channels).map(rgb).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| [x as u8, y as u8, (x * 31 + y * 17) as u8])
    }

    #[test]
    fn what_is_written_is_read_again() {
        let bytes = noise(40, 30).to_png().unwrap();
        assert_eq!(RgbImage::from_png(&bytes, 40, 1 << 20).unwrap(), noise(40, 30));
        assert!(RgbImage::filled(0, 3, [0; 3]).to_png().is_err());
    }

    #[test]
    fn greys_are_read_as_colours_and_transparency_is_left_out() {
        for (color, data) in [
            (ColorType::Grayscale, &[5, 9][..]),
            (ColorType::GrayscaleAlpha, &[5, 0, 9, 255]),
            (ColorType::Rgba, &[5, 5, 5, 0, 9, 9, 9, 255]),
        ] {
            let mut bytes = Vec::new();
            let mut encoder = Encoder::new(&mut bytes, 2, 1);
            encoder.set_color(color);
            encoder.write_header().unwrap().write_image_data(data).unwrap();
            let read = RgbImage::from_png(&bytes, 2, 1 << 20).unwrap();
            assert_eq!(read.pixels(), [[5; 3], [9; 3]], "{color:?}");
        }
    }

    #[test]
    fn damaged_and_large_files_are_refused() {
        let bytes = noise(40, 30).to_png().unwrap();
        let read = |bytes: &[u8], side, memory| RgbImage::from_png(bytes, side, memory);
        assert!(read(&bytes[..bytes.len() / 2], 40, 1 << 20).is_err());
        assert!(read(b"no picture", 40, 1 << 20).is_err());
        assert!(matches!(read(&bytes, 39, 1 << 20), Err(DecodeError::TooLarge { .. })));
        assert!(read(&bytes, 40, 40 * 30 * 3 - 1).is_err());
    }
}

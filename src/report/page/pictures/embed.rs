//! A run's picture files as `data:` URIs, with limits: records and files may come from anyone.

use std::io::Cursor;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;

use fathom_base::folder::Dir;
use fathom_record::{Picture, PictureKind};
use image::codecs::jpeg::JpegEncoder;
use image::{ImageFormat, ImageReader, Limits, RgbImage, imageops};

/// Largest file that is read, bytes.
const MAX_FILE: u64 = 16 << 20;
/// Largest side of a picture that is decoded, pixels, and the memory that this may take.
const MAX_DECODED_PX: u32 = 8192;
const MAX_MEMORY: u64 = 64 << 20;
/// Pixels of all pictures that are decoded: 2,000 cells of 300 × 300 pixels.
const MAX_PIXELS: u64 = 180_000_000;
/// Longest side of a picture on the page, pixels: larger ones are scaled down.
const MAX_SHOWN_PX: u32 = 280;
/// Of JPEG, 1 … 100. Pictures of errors are noise, which takes the most bytes and needs the least detail.
const QUALITY: u8 = 60;
const QUALITY_OF_ERRORS: u8 = 40;
/// All pictures of a page, bytes before base64: with them a page of 2,000 cells stays below 5 MB.
const MAX_EMBEDDED: usize = 320 << 10;

/// A picture as it stands in the page.
pub struct Embedded {
    pub uri: String,
    pub own_px: [u32; 2],
    pub shown_px: [u32; 2],
}

/// Embeds pictures until the page holds enough of them.
#[derive(Default)]
pub struct Embedder {
    bytes: usize,
    pixels: u64,
}

impl Embedder {
    /// The picture that a record names; or why it is left out.
    pub fn embed(&mut self, folder: &Path, picture: &Picture) -> Result<Embedded, String> {
        let quality = match picture.shows {
            PictureKind::Image => QUALITY,
            PictureKind::Error => QUALITY_OF_ERRORS,
        };
        let picture = self.decode(folder, &picture.path)?;
        let own_px = [picture.width(), picture.height()];
        let picture = reduced(picture);
        let mut bytes = Vec::new();
        let written =
            picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, quality));
        written.map_err(|error| error.to_string())?;
        self.bytes += bytes.len();
        if self.bytes > MAX_EMBEDDED {
            return Err(format!("the page holds {} KiB of pictures at most", MAX_EMBEDDED >> 10));
        }
        let uri = format!("data:image/jpeg;base64,{}", BASE64.encode(bytes));
        Ok(Embedded { uri, own_px, shown_px: [picture.width(), picture.height()] })
    }

    fn decode(&mut self, folder: &Path, name: &str) -> Result<RgbImage, String> {
        if self.bytes > MAX_EMBEDDED || self.pixels > MAX_PIXELS {
            return Err("the page holds as many pictures as it takes".to_owned());
        }
        let bytes = Dir::open(folder).and_then(|folder| folder.bytes(name, MAX_FILE));
        let bytes = bytes.map_err(|error| error.to_string())?;
        let mut reader = ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
        let mut limits = Limits::default();
        limits.max_image_width = Some(MAX_DECODED_PX);
        limits.max_image_height = Some(MAX_DECODED_PX);
        limits.max_alloc = Some(MAX_MEMORY);
        reader.limits(limits);
        let picture = reader.decode().map_err(|error| error.to_string())?.into_rgb8();
        self.pixels += u64::from(picture.width()) * u64::from(picture.height());
        Ok(picture)
    }
}

fn reduced(picture: RgbImage) -> RgbImage {
    let [width, height] = [picture.width(), picture.height()];
    let longest = width.max(height);
    if longest <= MAX_SHOWN_PX {
        return picture;
    }
    let scaled = |side: u32| (side * MAX_SHOWN_PX / longest).max(1);
    imageops::resize(&picture, scaled(width), scaled(height), imageops::Triangle)
}

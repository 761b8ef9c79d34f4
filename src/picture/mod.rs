//! Pictures of 8 bits a channel, without transparency.

mod png_file;
mod scaled;

pub use png_file::{DecodeError, EncodeError};
pub use scaled::Filter;

/// Red, green and blue.
pub type Rgb = [u8; 3];

/// Row 0 is at the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RgbImage {
    width: u32,
    height: u32,
    pixels: Vec<Rgb>,
}

impl RgbImage {
    pub fn from_fn(width: u32, height: u32, color: impl Fn(u32, u32) -> Rgb) -> Self {
        let rows = 0..height;
        let pixels = rows.flat_map(|y| (0..width).map(move |x| (x, y)));
        Self { width, height, pixels: pixels.map(|(x, y)| color(x, y)).collect() }
    }

    pub fn filled(width: u32, height: u32, color: Rgb) -> Self {
        Self { width, height, pixels: vec![color; width as usize * height as usize] }
    }

    pub fn width(&self) -> u32 {
        self.width
    }

    pub fn height(&self) -> u32 {
        self.height
    }

    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Row by row.
    pub fn pixels(&self) -> &[Rgb] {
        &self.pixels
    }

    pub fn bytes(&self) -> &[u8] {
        self.pixels.as_flattened()
    }

    fn index(&self, x: u32, y: u32) -> usize {
        assert!(x < self.width && y < self.height, "({x}, {y}) is outside of {:?}", self.size());
        y as usize * self.width as usize + x as usize
    }

    /// # Panics
    /// Outside of the picture.
    pub fn pixel(&self, x: u32, y: u32) -> Rgb {
        self.pixels[self.index(x, y)]
    }

    /// # Panics
    /// Outside of the picture.
    pub fn set_pixel(&mut self, x: u32, y: u32, color: Rgb) {
        let index = self.index(x, y);
        self.pixels[index] = color;
    }

    /// Draws another picture over this one, its top left corner at (x, y). What lies outside is cut off.
    pub fn put(&mut self, picture: &Self, x: u32, y: u32) {
        let rows = picture.height.min(self.height.saturating_sub(y));
        let columns = picture.width.min(self.width.saturating_sub(x)) as usize;
        for row in (0..rows).filter(|_| columns > 0) {
            let (from, to) = (picture.index(0, row), self.index(x, y + row));
            self.pixels[to..to + columns].copy_from_slice(&picture.pixels[from..from + columns]);
        }
    }

    /// The part of this size at (x, y), less what lies outside.
    pub fn cropped(&self, x: u32, y: u32, [width, height]: [u32; 2]) -> Self {
        let width = width.min(self.width.saturating_sub(x));
        let height = height.min(self.height.saturating_sub(y));
        Self::from_fn(width, height, |i, j| self.pixel(x + i, y + j))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| [x as u8, y as u8, 7])
    }

    #[test]
    fn a_picture_is_put_on_another_and_cut_at_its_edges() {
        let mut paper = RgbImage::filled(4, 3, [255; 3]);
        paper.put(&numbered(3, 3), 2, 1);
        assert_eq!([paper.pixel(2, 1), paper.pixel(3, 2)], [[0, 0, 7], [1, 1, 7]]);
        assert_eq!(paper.pixels().iter().filter(|pixel| **pixel == [255; 3]).count(), 12 - 4);
        let before = paper.clone();
        paper.put(&numbered(3, 3), 4, 0);
        paper.put(&numbered(3, 3), 0, 9);
        assert_eq!(paper, before);
    }

    #[test]
    fn a_part_is_cut_out() {
        let part = numbered(5, 4).cropped(3, 1, [9, 2]);
        assert_eq!(part.size(), [2, 2]);
        assert_eq!(part.pixels(), [[3, 1, 7], [4, 1, 7], [3, 2, 7], [4, 2, 7]]);
    }
}

//! A bar below a picture that says what its greys mean.

use image::{Rgb, RgbImage};

/// What the greys of a picture mean: from black to white in equal steps, the pixel's value being the quantity itself.
pub struct Scale {
    /// Written at the bar's beginning, middle and end.
    pub labels: [&'static str; 3],
}

/// Visibility, 1 − A: linear, 0 is black.
pub const VISIBILITY: Scale = Scale { labels: ["0", "0.5", "1"] };

/// Pixels that a pixel of a glyph takes.
const SIZE_PX: u32 = 2;
/// Columns and rows of a glyph.
const GLYPH: [u32; 2] = [3, 5];
const BAR_PX: u32 = 10;
const MARGIN_PX: u32 = 3;
const PAPER: Rgb<u8> = Rgb([255; 3]);
const INK: Rgb<u8> = Rgb([0; 3]);

/// Rows of a glyph from the top, the left column in the highest of three bits.
fn glyph(letter: char) -> [u8; 5] {
    match letter {
        '0' => [0b111, 0b101, 0b101, 0b101, 0b111],
        '1' => [0b010, 0b110, 0b010, 0b010, 0b111],
        '5' => [0b111, 0b100, 0b111, 0b001, 0b111],
        '.' => [0b000, 0b000, 0b000, 0b000, 0b010],
        _ => [0; 5],
    }
}

/// The picture with a bar and its numbers below.
pub fn below(picture: &RgbImage, scale: &Scale) -> RgbImage {
    let (width, height) = picture.dimensions();
    let text = GLYPH[1] * SIZE_PX;
    let mut out = RgbImage::from_pixel(width, height + MARGIN_PX * 3 + BAR_PX + text, PAPER);
    image::imageops::replace(&mut out, picture, 0, 0);
    let top = height + MARGIN_PX;
    for x in 0..width {
        // The first column is black and the last white.
        let grey = (255 * x + (width - 1) / 2) / (width - 1).max(1);
        for y in top..top + BAR_PX {
            out.put_pixel(x, y, Rgb([grey as u8; 3]));
        }
    }
    let under = top + BAR_PX + MARGIN_PX;
    for (share, label) in (0..).zip(scale.labels) {
        let long = label.len() as u32 * (GLYPH[0] + 1) * SIZE_PX;
        let left = width.saturating_sub(long) * share / 2;
        write(&mut out, label, [left, under]);
    }
    out
}

fn write(out: &mut RgbImage, text: &str, [left, top]: [u32; 2]) {
    for (number, letter) in (0..).zip(text.chars()) {
        let rows = glyph(letter);
        for y in 0..GLYPH[1] * SIZE_PX {
            for x in 0..GLYPH[0] * SIZE_PX {
                let bit = GLYPH[0] - 1 - x / SIZE_PX;
                let place = left + number * (GLYPH[0] + 1) * SIZE_PX + x;
                if rows[(y / SIZE_PX) as usize] >> bit & 1 == 1 && place < out.width() {
                    out.put_pixel(place, top + y, INK);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_runs_from_black_to_white_and_each_label_is_written() {
        let picture = RgbImage::from_pixel(64, 20, Rgb([77; 3]));
        let out = below(&picture, &VISIBILITY);
        assert_eq!(out.get_pixel(5, 19), picture.get_pixel(5, 19));
        let bar = |x: u32| out.get_pixel(x, 20 + MARGIN_PX)[0];
        assert_eq!([bar(0), bar(63)], [0, 255]);
        assert!((1..64).all(|x| bar(x) > bar(x - 1)));
        let text = 20 + 2 * MARGIN_PX + BAR_PX..out.height();
        let dark = |from: u32, to: u32| {
            let inked = |x: u32| text.clone().any(|y| *out.get_pixel(x, y) == INK);
            (from..to).any(inked)
        };
        // Beginning, middle and end, and paper between them.
        assert_eq!(
            [(0, 8), (8, 20), (20, 44), (44, 56), (56, 64)].map(|(a, b)| dark(a, b)),
            [true, false, true, false, true]
        );
    }

    #[test]
    fn a_picture_of_one_column_gets_a_bar_too() {
        let out = below(&RgbImage::new(1, 1), &VISIBILITY);
        assert_eq!(out.get_pixel(0, 1 + MARGIN_PX)[0], 0);
    }
}

//! A bar below a picture of occlusion that says what its greys mean.

use image::{Rgb, RgbImage, imageops};

use super::canvas::{Canvas, Type};

const BAR_PX: u32 = 10;
const MARGIN_PX: u32 = 3;
/// Pictures narrower than this have small type.
const NARROW_PX: u32 = 160;

/// At the bar's beginning, middle and end. A picture of occlusion shows 1 − A as it is: what is closed is black.
const LABELS: [&str; 3] = ["A=1", "0.5", "A=0"];

fn size(width: u32) -> Type {
    Type(if width < NARROW_PX { 10.0 } else { 16.0 })
}

/// The picture with a bar and its labels below.
pub fn below(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    let size = size(width);
    let mut canvas = Canvas::new(width, height + MARGIN_PX * 3 + BAR_PX + size.line_px());
    imageops::replace(&mut canvas.0, picture, 0, 0);
    // The first column is black and the last white.
    let last = (width - 1).max(1);
    let bar = |x, _| Rgb([((255 * x + last / 2) / last) as u8; 3]);
    let bar = RgbImage::from_fn(width, BAR_PX, bar);
    let top = height + MARGIN_PX;
    imageops::replace(&mut canvas.0, &bar, 0, top.into());
    for (share, label) in (0..).zip(LABELS) {
        let left = width.saturating_sub(size.width_px(label)) * share / 2;
        canvas.write(&[label.to_owned()], size, left, top + BAR_PX + MARGIN_PX);
    }
    canvas.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_runs_from_black_to_white_and_each_label_is_written() {
        let picture = RgbImage::from_pixel(64, 20, Rgb([77; 3]));
        let out = below(&picture);
        assert_eq!(out.get_pixel(5, 19), picture.get_pixel(5, 19));
        let bar = |x: u32| out.get_pixel(x, 20 + MARGIN_PX)[0];
        assert_eq!([bar(0), bar(63)], [0, 255]);
        assert!((1..64).all(|x| bar(x) > bar(x - 1)));
        let text = 20 + 2 * MARGIN_PX + BAR_PX..out.height();
        let dark = |from: u32, to: u32| {
            let inked = |x: u32| text.clone().any(|y| out.get_pixel(x, y).0 != [255; 3]);
            (from..to).any(inked)
        };
        // Beginning, middle and end, and paper between them.
        assert_eq!(
            [(0, 19), (19, 25), (25, 39), (39, 45), (45, 64)].map(|(a, b)| dark(a, b)),
            [true, false, true, false, true]
        );
    }

    #[test]
    fn a_picture_of_one_column_gets_a_bar_too() {
        let out = below(&RgbImage::new(1, 1));
        assert_eq!(out.get_pixel(0, 1 + MARGIN_PX)[0], 0);
    }
}

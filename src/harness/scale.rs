//! A bar below a picture of occlusion that says what its greys mean.

use embedded_graphics::mono_font::MonoFont;
use embedded_graphics::mono_font::iso_8859_1::{FONT_5X7, FONT_9X15};
use fathom_picture::RgbImage;

use super::canvas::Canvas;

const BAR_PX: u32 = 10;
const MARGIN_PX: u32 = 3;
/// Pictures narrower than this have the small font.
const NARROW_PX: u32 = 160;

/// At the bar's beginning, middle and end. A picture of occlusion shows 1 − A as it is: what is closed is black.
const LABELS: [&str; 3] = ["A=1", "0.5", "A=0"];

fn font(width: u32) -> MonoFont<'static> {
    if width < NARROW_PX { FONT_5X7 } else { FONT_9X15 }
}

/// The picture with a bar and its labels below.
pub fn below(picture: &RgbImage) -> RgbImage {
    let [width, height] = picture.size();
    let font = font(width);
    let text = font.character_size;
    let mut canvas = Canvas::new(width, height + MARGIN_PX * 3 + BAR_PX + text.height);
    canvas.0.put(picture, 0, 0);
    // The first column is black and the last white.
    let last = (width - 1).max(1);
    let bar = RgbImage::from_fn(width, BAR_PX, |x, _| [((255 * x + last / 2) / last) as u8; 3]);
    let top = height + MARGIN_PX;
    canvas.0.put(&bar, 0, top);
    for (share, label) in (0..).zip(LABELS) {
        let left = width.saturating_sub(label.len() as u32 * text.width) * share / 2;
        canvas.write(&[label.to_owned()], &font, left, top + BAR_PX + MARGIN_PX);
    }
    canvas.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bar_runs_from_black_to_white_and_each_label_is_written() {
        let picture = RgbImage::filled(64, 20, [77; 3]);
        let out = below(&picture);
        assert_eq!(out.pixel(5, 19), picture.pixel(5, 19));
        let bar = |x: u32| out.pixel(x, 20 + MARGIN_PX)[0];
        assert_eq!([bar(0), bar(63)], [0, 255]);
        assert!((1..64).all(|x| bar(x) > bar(x - 1)));
        let text = 20 + 2 * MARGIN_PX + BAR_PX..out.height();
        let dark = |from: u32, to: u32| {
            let inked = |x: u32| text.clone().any(|y| out.pixel(x, y) == [0; 3]);
            (from..to).any(inked)
        };
        // Beginning, middle and end, and paper between them.
        assert_eq!(
            [(0, 15), (15, 24), (24, 39), (39, 49), (49, 64)].map(|(a, b)| dark(a, b)),
            [true, false, true, false, true]
        );
    }

    #[test]
    fn a_picture_of_one_column_gets_a_bar_too() {
        let out = below(&RgbImage::filled(1, 1, [0; 3]));
        assert_eq!(out.pixel(0, 1 + MARGIN_PX)[0], 0);
    }
}

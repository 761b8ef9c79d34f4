//! A picture that text is written on.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, ScaleFont, point};
use image::{Rgb, RgbImage};

/// DejaVu Sans with Latin, Greek and common signs.
static FONT: LazyLock<FontRef<'static>> = LazyLock::new(|| {
    FontRef::try_from_slice(include_bytes!("font/DejaVuSans.ttf")).expect("a font's file")
});

/// Type by its height from the highest to the lowest part, pixels.
#[derive(Clone, Copy)]
pub struct Type(pub f32);

impl Type {
    /// From the top of a line of text to that of the next, pixels.
    pub fn line_px(self) -> u32 {
        (1.15 * self.0).ceil() as u32
    }

    pub fn width_px(self, text: &str) -> u32 {
        let font = FONT.as_scaled(self.0);
        text.chars().map(|c| font.h_advance(font.glyph_id(c))).sum::<f32>().ceil() as u32
    }

    /// The text in lines of at most so many pixels, broken between words.
    pub fn wrapped(self, text: &str, width_px: u32) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_whitespace() {
            match lines.last_mut() {
                Some(line) if self.width_px(&format!("{line} {word}")) <= width_px => {
                    line.push(' ');
                    line.push_str(word);
                }
                _ => lines.push(word.to_owned()),
            }
        }
        lines
    }
}

pub struct Canvas(pub RgbImage);

impl Canvas {
    /// White.
    pub fn new(width: u32, height: u32) -> Self {
        Self(RgbImage::from_pixel(width, height, Rgb([255; 3])))
    }

    /// Lines of black text, the first one's top at `y`.
    pub fn write(&mut self, lines: &[String], size: Type, x: u32, y: u32) {
        for (line, y) in lines.iter().zip((y..).step_by(size.line_px() as usize)) {
            self.line(line, size, [x as f32, y as f32]);
        }
    }

    fn line(&mut self, line: &str, size: Type, [mut x, top]: [f32; 2]) {
        let font = FONT.as_scaled(size.0);
        for c in line.chars() {
            let glyph =
                font.glyph_id(c).with_scale_and_position(size.0, point(x, top + font.ascent()));
            x += font.h_advance(glyph.id);
            let Some(outline) = font.outline_glyph(glyph) else { continue };
            let corner = outline.px_bounds().min;
            outline.draw(|dx, dy, cover| {
                self.darken(corner.x + dx as f32, corner.y + dy as f32, cover);
            });
        }
    }

    /// A share of a pixel becomes black.
    fn darken(&mut self, x: f32, y: f32, share: f32) {
        let is_inside =
            0.0 <= x && x < self.0.width() as f32 && 0.0 <= y && y < self.0.height() as f32;
        if is_inside {
            let kept = 1.0 - share.clamp(0.0, 1.0);
            let Rgb(color) = self.0.get_pixel_mut(x as u32, y as u32);
            *color = color.map(|value| (f32::from(value) * kept).round() as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_between_words() {
        let size = Type(16.0);
        let room = size.width_px("one two").max(size.width_px("– three"));
        assert_eq!(size.wrapped("one two – three", room), ["one two", "– three"]);
        assert!(size.width_px("WWW") > size.width_px("iii"));
    }

    #[test]
    fn the_font_has_every_character_of_the_figures() {
        let figures = fathom_embedded::Folders::of(fathom_embedded::FIGURES);
        for id in crate::figures::Figure::ids(&figures) {
            let (_, text) = figures.text(&format!("{id}.toml")).unwrap();
            let missing = text.chars().filter(|c| !c.is_control() && FONT.glyph_id(*c).0 == 0);
            assert_eq!(missing.collect::<String>(), "", "{id}");
        }
    }
}

//! A picture that text is written on.

use std::convert::Infallible;

use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Pixel, Point, Size};
use embedded_graphics::text::{Baseline, Text};
use fathom_picture::RgbImage;

pub struct Canvas(pub RgbImage);

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Infallible>
    where
        I: IntoIterator<Item = Pixel<Rgb888>>,
    {
        for Pixel(Point { x, y }, color) in pixels {
            let place = (u32::try_from(x), u32::try_from(y));
            if let (Ok(x), Ok(y)) = place
                && x < self.0.width()
                && y < self.0.height()
            {
                self.0.set_pixel(x, y, [color.r(), color.g(), color.b()]);
            }
        }
        Ok(())
    }
}

impl Canvas {
    /// White.
    pub fn new(width: u32, height: u32) -> Self {
        Self(RgbImage::filled(width, height, [255; 3]))
    }

    /// Lines of black text, the first one's top at `y`.
    pub fn write(&mut self, lines: &[String], font: &MonoFont<'_>, x: u32, y: u32) {
        let style = MonoTextStyle::new(font, Rgb888::BLACK);
        for (line, y) in lines.iter().zip((y..).step_by(line_height(font) as usize)) {
            let place = Point::new(x as i32, y as i32);
            let Ok(_) = Text::with_baseline(line, place, style, Baseline::Top).draw(self);
        }
    }
}

/// From the top of a line of text to that of the next, pixels.
pub fn line_height(font: &MonoFont<'_>) -> u32 {
    font.character_size.height + 3
}

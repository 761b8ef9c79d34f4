//! Contact sheets: pictures in a grid with their captions.

use std::convert::Infallible;

use embedded_graphics::mono_font::iso_8859_1::{FONT_9X15, FONT_9X18_BOLD};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::prelude::{DrawTarget, Drawable, OriginDimensions, Pixel, Point, Size};
use embedded_graphics::text::{Baseline, Text};
use image::RgbImage;
use image::imageops::{self, FilterType};

use super::figures::{Figure, Rendered};

/// White around everything, pixels.
const MARGIN: u32 = 12;
/// Width of a bar of greys, and room for it and its labels.
const BAR: u32 = 14;
const BAR_ROOM: u32 = 90;
/// Largest width of a picture in the sheet of one figure.
const WIDTH: u32 = 720;
/// Width of a picture, and pictures side by side, in the sheet of many figures.
const SMALL: u32 = 320;
const SMALL_COLUMNS: u32 = 4;
/// Pictures that fit beside one another in the sheet of many figures.
const PAGE_COLUMNS: u32 = 8;

/// Least width of a figure's part: its title and text need room.
const NARROWEST: u32 = 400;

const HEADING: MonoFont<'static> = FONT_9X18_BOLD;
const PLAIN: MonoFont<'static> = FONT_9X15;

struct Canvas(RgbImage);

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
                self.0.put_pixel(x, y, image::Rgb([color.r(), color.g(), color.b()]));
            }
        }
        Ok(())
    }
}

impl Canvas {
    fn new(width: u32, height: u32) -> Self {
        Self(RgbImage::from_pixel(width, height, image::Rgb([255; 3])))
    }

    fn put(&mut self, picture: &RgbImage, x: u32, y: u32) {
        imageops::replace(&mut self.0, picture, x.into(), y.into());
    }

    /// Lines of text, the first one's top at `y`.
    fn write(&mut self, lines: &[String], font: &MonoFont<'_>, x: u32, y: u32) {
        let style = MonoTextStyle::new(font, Rgb888::BLACK);
        for (line, y) in lines.iter().zip((y..).step_by(line_height(font) as usize)) {
            let place = Point::new(x as i32, y as i32);
            let Ok(_) = Text::with_baseline(line, place, style, Baseline::Top).draw(self);
        }
    }
}

fn line_height(font: &MonoFont<'_>) -> u32 {
    font.character_size.height + 3
}

/// Text of the fonts' characters, ISO 8859-1.
fn latin(text: &str) -> String {
    let replaced = |c: char| match c {
        '–' | '−' => "-".to_owned(),
        '…' => "...".to_owned(),
        c if u32::from(c) < 256 => c.to_string(),
        _ => "?".to_owned(),
    };
    text.chars().map(replaced).collect()
}

/// The text in lines of at most so many pixels, broken between words.
fn wrapped(text: &str, font: &MonoFont<'_>, width: u32) -> Vec<String> {
    let most = (width / font.character_size.width).max(1) as usize;
    let mut lines: Vec<String> = Vec::new();
    for word in latin(text).split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= most => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// A picture, its bar, and its caption below.
struct Cell {
    picture: RgbImage,
    shows_visibility: bool,
    caption: Vec<String>,
}

impl Cell {
    fn new(rendered: &Rendered, width: u32) -> Self {
        let picture = &rendered.picture.image;
        let height = u64::from(picture.height()) * u64::from(width) / u64::from(picture.width());
        let picture = if picture.width() == width {
            picture.clone()
        } else {
            imageops::resize(picture, width, (height as u32).max(1), FilterType::Lanczos3)
        };
        let caption = wrapped(&rendered.caption, &PLAIN, width);
        Self { picture, shows_visibility: rendered.picture.shows_visibility, caption }
    }

    fn height(&self) -> u32 {
        self.picture.height() + MARGIN + self.caption.len() as u32 * line_height(&PLAIN)
    }

    fn draw(&self, canvas: &mut Canvas, x: u32, y: u32) {
        canvas.put(&self.picture, x, y);
        canvas.write(&self.caption, &PLAIN, x, y + self.picture.height() + MARGIN / 2);
        if self.shows_visibility {
            self.bar(canvas, x + self.picture.width() + MARGIN / 2, y);
        }
    }

    /// Greys from what nothing occludes, above, to what is closed. A picture of occlusion shows 1 − A as it is.
    fn bar(&self, canvas: &mut Canvas, x: u32, y: u32) {
        let height = self.picture.height();
        let grey = |row: u32| 255 - (255 * row / (height - 1).max(1)) as u8;
        let bar = RgbImage::from_fn(BAR, height, |column, row| {
            let edge = column == 0 || column == BAR - 1 || row == 0 || row == height - 1;
            image::Rgb([if edge { 0 } else { grey(row) }; 3])
        });
        canvas.put(&bar, x, y);
        let font = PLAIN.character_size.height;
        for (share, label) in [(0.0, "A = 0"), (0.5, "0.5"), (1.0, "A = 1")] {
            let at = (share * f64::from(height.saturating_sub(font))) as u32;
            canvas.write(&[label.to_owned()], &PLAIN, x + BAR + MARGIN / 2, y + at);
        }
    }
}

/// The panels of a figure in a grid of so many columns, pictures so many pixels wide, below its title.
fn block(figure: &Figure, panels: &[Rendered], columns: u32, width: u32) -> RgbImage {
    let columns = columns.min(panels.len() as u32).max(1);
    let bars = panels.iter().any(|panel| panel.picture.shows_visibility);
    let stride = width + MARGIN + if bars { BAR_ROOM } else { 0 };
    let whole = MARGIN + columns * stride;
    let text = whole.max(NARROWEST) - 2 * MARGIN;
    let title = wrapped(&format!("{}: {}", figure.source, figure.title), &HEADING, text);
    let about = wrapped(&figure.about, &PLAIN, text);
    let cells: Vec<Cell> = panels.iter().map(|panel| Cell::new(panel, width)).collect();
    let rows: Vec<&[Cell]> = cells.chunks(columns as usize).collect();
    let row_height = |row: &[Cell]| row.iter().map(Cell::height).max().unwrap_or(0) + MARGIN;
    let head = MARGIN
        + title.len() as u32 * line_height(&HEADING)
        + about.len() as u32 * line_height(&PLAIN)
        + MARGIN / 2;
    let height = head + rows.iter().map(|row| row_height(row)).sum::<u32>();
    let mut canvas = Canvas::new(text + 2 * MARGIN, height);
    canvas.write(&title, &HEADING, MARGIN, MARGIN);
    let below = MARGIN + title.len() as u32 * line_height(&HEADING);
    canvas.write(&about, &PLAIN, MARGIN, below);
    let mut y = head;
    for row in rows {
        for (cell, column) in row.iter().zip(0..) {
            cell.draw(&mut canvas, MARGIN + column * stride, y);
        }
        y += row_height(row);
    }
    canvas.0
}

/// The sheet of one figure.
pub fn of_figure(figure: &Figure, panels: &[Rendered]) -> RgbImage {
    let widest = panels.iter().map(|panel| panel.picture.image.width()).max().unwrap_or(1);
    block(figure, panels, figure.columns, widest.min(WIDTH))
}

/// A figure's part of the sheet of many.
pub fn small(figure: &Figure, panels: &[Rendered]) -> RgbImage {
    block(figure, panels, figure.columns.min(SMALL_COLUMNS), SMALL)
}

/// Parts side by side in rows as wide as the widest of them, in their order.
pub fn of_all(parts: &[RgbImage]) -> RgbImage {
    let width = (PAGE_COLUMNS * (SMALL + MARGIN + BAR_ROOM) + MARGIN)
        .max(parts.iter().map(RgbImage::width).max().unwrap_or(1));
    let (mut x, mut y, mut row) = (0, 0, 0);
    let places: Vec<(u32, u32)> = parts
        .iter()
        .map(|part| {
            if x + part.width() > width {
                (x, y, row) = (0, y + row, 0);
            }
            let place = (x, y);
            x += part.width();
            row = row.max(part.height());
            place
        })
        .collect();
    let mut canvas = Canvas::new(width, (y + row).max(1));
    for (part, (x, y)) in parts.iter().zip(places) {
        canvas.put(part, x, y);
    }
    canvas.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::harness::render::Bare;

    #[test]
    fn lines_break_between_words() {
        let lines = wrapped("one two – three", &PLAIN, 9 * 7);
        assert_eq!(lines, ["one two", "- three"]);
        assert_eq!(latin("8 × 8 …, γ"), "8 × 8 ..., ?");
    }

    fn panel(height: u32, shows_visibility: bool) -> Rendered {
        let image = RgbImage::from_pixel(40, height, image::Rgb([9, 99, 199]));
        Rendered { picture: Bare { image, shows_visibility }, caption: "caption".into() }
    }

    fn figure() -> Figure {
        let text =
            "id = \"f\"\ntitle = \"t\"\nsource = \"s\"\nabout = \"a\"\n[[panel]]\ncaption = \"c\"";
        toml::from_str(text).unwrap()
    }

    fn count(sheet: &RgbImage, color: [u8; 3]) -> usize {
        sheet.pixels().filter(|pixel| pixel.0 == color).count()
    }

    #[test]
    fn a_sheet_holds_every_picture_and_its_caption() {
        let panels: Vec<_> = (0..3).map(|_| panel(20, false)).collect();
        let sheet = of_figure(&figure(), &panels);
        assert_eq!(count(&sheet, [9, 99, 199]), 3 * 40 * 20);
        let without = Rendered { caption: String::new(), ..panel(20, false) };
        let bare = of_figure(&figure(), &[without]);
        assert!(count(&of_figure(&figure(), &[panel(20, false)]), [0; 3]) > count(&bare, [0; 3]));
    }

    #[test]
    fn a_bar_shows_all_greys_between_white_and_black() {
        let sheet = of_figure(&figure(), &[panel(512, true)]);
        assert!((1..255).all(|grey| count(&sheet, [grey; 3]) > 0));
    }

    #[test]
    fn parts_of_a_sheet_do_not_overlap() {
        let sizes = [(400, 90), (2900, 50), (700, 200), (400, 10)];
        let color = |i: usize| [i as u8 + 1, 0, 0];
        let part = |(i, &(w, h))| RgbImage::from_pixel(w, h, image::Rgb(color(i)));
        let parts: Vec<_> = sizes.iter().enumerate().map(part).collect();
        let sheet = of_all(&parts);
        for (i, (w, h)) in sizes.into_iter().enumerate() {
            assert_eq!(count(&sheet, color(i)), (w * h) as usize);
        }
        assert_eq!(sheet.height(), 90 + 200);
    }
}

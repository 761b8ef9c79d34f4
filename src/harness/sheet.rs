//! Contact sheets: pictures in a grid with their captions.

use image::{RgbImage, imageops};

use super::canvas::{Canvas, Type};
use super::figures::{Figure, Rendered};
use super::picture;

/// White around everything, pixels.
const MARGIN: u32 = 12;
/// Largest width of a picture in the sheet of one figure.
const WIDTH: u32 = 720;
/// Largest width of a picture in the sheet of many figures, and how many pictures of that width make a file of about 1.5 MB.
const SMALL: f64 = 280.0;
const PICTURES: f64 = 20.0;
/// Pictures of a figure side by side there.
const SMALL_COLUMNS: u32 = 4;
/// Pictures that fit beside one another in the sheet of many figures.
const PAGE_COLUMNS: u32 = 4;

/// Least width of a figure's part: its title and text need room.
const NARROWEST: u32 = 400;

const HEADING: Type = Type(21.0);
const PLAIN: Type = Type(17.0);

/// A picture, with what its greys mean, and its caption below.
struct Cell {
    picture: RgbImage,
    caption: Vec<String>,
}

impl Cell {
    fn new(rendered: &Rendered, width: u32) -> Self {
        let picture = &rendered.picture.image;
        let height = u64::from(picture.height()) * u64::from(width) / u64::from(picture.width());
        let picture = if picture.width() == width {
            picture.clone()
        } else {
            imageops::resize(picture, width, (height as u32).max(1), imageops::Lanczos3)
        };
        let caption = PLAIN.wrapped(&rendered.caption, width);
        Self { picture: picture::explained(picture, rendered.picture.shows_visibility), caption }
    }

    fn height(&self) -> u32 {
        self.picture.height() + MARGIN + self.caption.len() as u32 * PLAIN.line_px()
    }

    fn draw(&self, canvas: &mut Canvas, x: u32, y: u32) {
        imageops::replace(&mut canvas.0, &self.picture, x.into(), y.into());
        canvas.write(&self.caption, PLAIN, x, y + self.picture.height() + MARGIN / 2);
    }
}

/// The panels of a figure in a grid of so many columns, pictures so many pixels wide, below its title.
fn block(figure: &Figure, panels: &[Rendered], columns: u32, width: u32) -> RgbImage {
    let columns = columns.min(panels.len() as u32).max(1);
    let stride = width + MARGIN;
    let whole = MARGIN + columns * stride;
    let text = whole.max(NARROWEST) - 2 * MARGIN;
    let title = HEADING.wrapped(&format!("{}: {}", figure.source, figure.title), text);
    let about = PLAIN.wrapped(&figure.about, text);
    let cells: Vec<Cell> = panels.iter().map(|panel| Cell::new(panel, width)).collect();
    let rows: Vec<&[Cell]> = cells.chunks(columns as usize).collect();
    let row_height = |row: &[Cell]| row.iter().map(Cell::height).max().unwrap_or(0) + MARGIN;
    let head = MARGIN
        + title.len() as u32 * HEADING.line_px()
        + about.len() as u32 * PLAIN.line_px()
        + MARGIN / 2;
    let height = head + rows.iter().map(|row| row_height(row)).sum::<u32>();
    let mut canvas = Canvas::new(text + 2 * MARGIN, height);
    canvas.write(&title, HEADING, MARGIN, MARGIN);
    let below = MARGIN + title.len() as u32 * HEADING.line_px();
    canvas.write(&about, PLAIN, MARGIN, below);
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

/// Width of each of so many pictures in one sheet: more of them are smaller.
pub fn width_among(pictures: usize) -> u32 {
    (SMALL * (PICTURES / pictures as f64).sqrt().min(1.0)) as u32
}

/// A figure's part of the sheet of many, its pictures so many pixels wide.
pub fn small(figure: &Figure, panels: &[Rendered], width: u32) -> RgbImage {
    block(figure, panels, figure.columns.min(SMALL_COLUMNS), width)
}

/// Parts with pictures of a width side by side, in rows as wide as the widest of them, in their order.
pub fn of_all(parts: &[RgbImage], picture: u32) -> RgbImage {
    // Each part has margins of its own.
    let width = (PAGE_COLUMNS * (picture + 2 * MARGIN))
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
        imageops::replace(&mut canvas.0, part, x.into(), y.into());
    }
    canvas.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Bare;
    use image::Rgb;

    fn panel(height: u32, shows_visibility: bool) -> Rendered {
        let image = RgbImage::from_pixel(40, height, Rgb([9, 99, 199]));
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
        let inked = |sheet: &RgbImage| sheet.pixels().filter(|p| p[0] < 128).count();
        let with = of_figure(&figure(), &[panel(20, false)]);
        assert!(inked(&with) > inked(&bare));
    }

    #[test]
    fn a_picture_of_visibility_gets_a_bar_of_greys() {
        // A row that becomes lighter over the columns of the picture.
        let has_bar = |shows: bool| {
            let sheet = of_figure(&figure(), &[panel(20, shows)]);
            let rises = |x: u32, y: u32| sheet.get_pixel(x, y)[0] < sheet.get_pixel(x + 1, y)[0];
            let is_ramp = |x: u32, y: u32| (x..x + 38).all(|x| rises(x, y));
            (0..sheet.height()).any(|y| (0..sheet.width() - 39).any(|x| is_ramp(x, y)))
        };
        assert!(has_bar(true) && !has_bar(false));
    }

    #[test]
    fn parts_of_a_sheet_do_not_overlap() {
        let sizes = [(400, 90), (2200, 50), (700, 200), (400, 10)];
        let color = |i: usize| [i as u8 + 1, 0, 0];
        let part = |(i, &(w, h))| RgbImage::from_pixel(w, h, Rgb(color(i)));
        let parts: Vec<_> = sizes.iter().enumerate().map(part).collect();
        let sheet = of_all(&parts, 700);
        for (i, (w, h)) in sizes.into_iter().enumerate() {
            assert_eq!(count(&sheet, color(i)), (w * h) as usize);
        }
        assert_eq!(sheet.height(), 90 + 200);
    }
}

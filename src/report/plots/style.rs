//! Colours, markers and type.

use itertools::Itertools;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Colours that are told apart with any colour vision (Okabe & Ito, *Color Universal Design* (2008)); yellow last, as
/// it is faint on white.
const PALETTE: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(240, 228, 66),
];

pub const INK: RGBColor = RGBColor(34, 34, 34);
pub const FAINT: RGBColor = RGBColor(110, 110, 110);
pub const GRID: RGBColor = RGBColor(226, 226, 226);
pub const REST: RGBColor = RGBColor(190, 190, 190);

/// Colours before they repeat.
pub const COLORS: usize = PALETTE.len();

pub fn color(index: usize) -> RGBColor {
    PALETTE[index % PALETTE.len()]
}

fn font(size: u32, color: RGBColor) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&color)
}

pub fn title() -> TextStyle<'static> {
    font(19, INK)
}

pub fn heading() -> TextStyle<'static> {
    font(15, INK)
}

pub fn label() -> TextStyle<'static> {
    font(13, INK)
}

pub fn small() -> TextStyle<'static> {
    font(12, FAINT)
}

/// Ends at its anchor, centred on it vertically.
pub fn ending(style: TextStyle<'static>) -> TextStyle<'static> {
    style.pos(Pos::new(HPos::Right, VPos::Center))
}

/// Starts at its anchor, centred on it vertically.
pub fn starting(style: TextStyle<'static>) -> TextStyle<'static> {
    style.pos(Pos::new(HPos::Left, VPos::Center))
}

/// Centred on its anchor.
pub fn centered(style: TextStyle<'static>) -> TextStyle<'static> {
    style.pos(Pos::new(HPos::Center, VPos::Center))
}

/// Stops of a colour scale from dark to light that reads in order with any colour vision and in grey (viridis; Smith & van
/// der Walt 2015).
const SHADES: [(u8, u8, u8); 6] =
    [(68, 1, 84), (65, 68, 135), (42, 120, 142), (34, 168, 132), (122, 209, 81), (253, 231, 37)];

/// Colour at a share of the scale, 0 … 1.
pub fn shade(share: f64) -> RGBColor {
    let last = SHADES.len() - 1;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = (place as usize).min(last - 1);
    let (a, b) = (SHADES[below], SHADES[below + 1]);
    let mix = |a: u8, b: u8| {
        (f64::from(a) + (place - below as f64) * (f64::from(b) - f64::from(a))).round() as u8
    };
    RGBColor(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
}

/// Type that stands out against a colour: white on dark, ink on light.
pub fn on(color: RGBColor, style: TextStyle<'static>) -> TextStyle<'static> {
    let RGBColor(r, g, b) = color;
    let luma = 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
    style.color(if luma < 130.0 { &WHITE } else { &INK })
}

/// A line of text in pieces of at most `limit` characters, broken at spaces.
pub fn wrap(line: &str, limit: usize) -> Vec<String> {
    let join = |piece: String, word: String| {
        let joined = format!("{piece} {word}");
        match joined.chars().count() {
            _ if piece.is_empty() => Ok(word),
            length if length <= limit => Ok(joined),
            _ => Err((piece, word)),
        }
    };
    line.split(' ').map(str::to_owned).coalesce(join).collect()
}

/// Outline of the marker of a series, as offsets in pixels from the point: shapes tell series apart without colour.
pub fn marker(index: usize) -> Vec<(i32, i32)> {
    match index % 6 {
        0 => vec![(5, 2), (2, 5), (-2, 5), (-5, 2), (-5, -2), (-2, -5), (2, -5), (5, -2)],
        1 => vec![(-4, -4), (4, -4), (4, 4), (-4, 4)],
        2 => vec![(0, -6), (5, 4), (-5, 4)],
        3 => vec![(0, -6), (6, 0), (0, 6), (-6, 0)],
        4 => vec![(0, 6), (5, -4), (-5, -4)],
        _ => vec![(-2, -6), (2, -6), (2, 6), (-2, 6)],
    }
}

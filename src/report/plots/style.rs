//! Colours, markers and type.

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

/// Outline of the marker of a series, as offsets in pixels from the point: shapes tell series apart without colour.
pub fn marker(index: usize) -> Vec<(i32, i32)> {
    match index % 6 {
        0 => vec![
            (5, 2),
            (2, 5),
            (-2, 5),
            (-5, 2),
            (-5, -2),
            (-2, -5),
            (2, -5),
            (5, -2),
        ],
        1 => vec![(-4, -4), (4, -4), (4, 4), (-4, 4)],
        2 => vec![(0, -6), (5, 4), (-5, 4)],
        3 => vec![(0, -6), (6, 0), (0, 6), (-6, 0)],
        4 => vec![(0, 6), (5, -4), (-5, -4)],
        _ => vec![(-2, -6), (2, -6), (2, 6), (-2, 6)],
    }
}

//! Colours, markers, type, and the style sheet for dark pages.

use itertools::Itertools;
use maud::html;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::colors::Color as StageColor;
use crate::document::Tone;

/// Colours that are told apart with any colour vision (Okabe & Ito, *Color Universal Design* (2008)), without the yellow, which is
/// faint on white; its black is a grey here.
const PALETTE: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(84, 84, 84),
];

pub const INK: RGBColor = RGBColor(34, 34, 34);
pub const FAINT: RGBColor = RGBColor(110, 110, 110);
pub const GRID: RGBColor = RGBColor(226, 226, 226);
/// Of a stage that has no colour of its own, and of gaps.
pub const REST: RGBColor = RGBColor(150, 150, 150);
pub const GAPS: RGBColor = RGBColor(200, 200, 200);
pub const GOOD: RGBColor = RGBColor(27, 110, 60);
pub const BAD: RGBColor = RGBColor(179, 38, 30);
pub const OPEN: RGBColor = RGBColor(138, 90, 0);
/// What a claim allows.
pub const BAND: RGBColor = RGBColor(222, 238, 228);

/// Class of the root element, which the style sheet is confined to.
const CLASS: &str = "fathom-chart";
/// Colours of a light page and what stands for them on a dark one. They come from nothing but this module's constants.
const DARK: [(RGBColor, &str); 10] = [
    (WHITE, "#14171b"),
    (INK, "#e6e8eb"),
    (FAINT, "#a3abb6"),
    (GRID, "#363c45"),
    (BAND, "#20382b"),
    (PALETTE[0], "#3d9be0"),
    (PALETTE[6], "#b4bac2"),
    (GOOD, "#72cf95"),
    (BAD, "#ff9a92"),
    (OPEN, "#eab955"),
];

/// The style sheet of all charts, which replaces ink, grid and background where a dark page is asked for. Its rules speak of one class
/// alone.
pub fn sheet() -> String {
    let rules: String = DARK.iter().map(|(light, dark)| rule(*light, dark)).collect();
    format!(
        ".{CLASS} text {{font-family: sans-serif}}@media (prefers-color-scheme: dark) {{{rules}}}"
    )
}

/// The picture as a file, with the sheet in it.
pub fn with_style_sheet(svg: &str) -> String {
    svg.replacen(">\n", &format!(">\n<style>{}</style>\n", sheet()), 1)
}

/// White type lies on colours, and stays white.
fn rule(light: RGBColor, dark: &str) -> String {
    let RGBColor(r, g, b) = light;
    let hex = format!("#{r:02X}{g:02X}{b:02X}");
    let filled = if light == WHITE { "rect" } else { "" };
    format!(
        ".{CLASS} {filled}[fill=\"{hex}\"]{{fill:{dark}}}.{CLASS} [stroke=\"{hex}\"]{{stroke:{dark}}}"
    )
}

/// Attributes that repeat SVG's defaults or the style sheet.
const DEFAULTS: [&str; 5] = [
    " opacity=\"1\"",
    " stroke=\"none\"",
    " stroke-width=\"1\"",
    " text-anchor=\"start\"",
    " font-family=\"sans-serif\"",
];

/// Marks a tooltip among the texts of a drawing: plotters has no titles, so [`titled`] makes titles of them.
pub const TIP: char = '\u{1}';

/// The picture with its class, with what it shows in words, and with titles where the drawing has tips.
pub fn titled(svg: &str, about: &str) -> String {
    let about = html! { (about) }.into_string();
    let root = format!("<svg class=\"{CLASS}\" role=\"img\" aria-label=\"{about}\" ");
    let title = format!(">\n<title>{about}</title>\n");
    let mut svg = svg.replacen("<svg ", &root, 1).replacen(">\n", &title, 1);
    for default in DEFAULTS {
        svg = svg.replace(default, "");
    }
    let mut pieces = svg.split("<text ");
    let mut titled = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let tip = piece.split_once(&format!(">\n{TIP}"));
        let tip = tip.and_then(|(_, rest)| rest.split_once("\n</text>\n"));
        let shape = titled.rfind('<').filter(|_| titled.ends_with("/>\n"));
        match tip.zip(shape) {
            Some(((words, rest), start)) => {
                let name = titled[start + 1..].split(' ').next().unwrap_or_default().to_owned();
                titled.truncate(titled.len() - "/>\n".len());
                titled += &format!("><title>{words}</title></{name}>\n{rest}");
            }
            None => titled += &format!("<text {piece}"),
        }
    }
    titled
}

pub fn tone_color(tone: Tone) -> RGBColor {
    match tone {
        Tone::Good => GOOD,
        Tone::Bad => BAD,
        Tone::Open => OPEN,
        Tone::Neutral => FAINT,
    }
}

pub fn stage_color(color: StageColor) -> RGBColor {
    RGBColor(color.0, color.1, color.2)
}

/// Width of a character over the size of type: no font is at hand, and common sans-serif ones are narrower.
const CHARACTER: f64 = 0.58;

/// About how wide a line of type is, pixels.
pub fn width_px(line: &str, size_px: u32) -> u32 {
    (line.chars().count() as f64 * f64::from(size_px) * CHARACTER).ceil() as u32
}

/// Characters of a label that fit into so many pixels.
pub fn max_characters(room_px: u32) -> usize {
    (f64::from(room_px) / (f64::from(LABEL_PX) * CHARACTER)) as usize
}

/// At most so many characters, with an ellipsis where something does not fit.
pub fn truncate(line: &str, limit: usize) -> String {
    if line.chars().count() <= limit {
        return line.to_owned();
    }
    line.chars().take(limit.saturating_sub(1)).chain(['…']).collect()
}

/// Sizes of type, pixels: nothing is smaller than [`SMALL_PX`].
pub const LABEL_PX: u32 = 13;
pub const SMALL_PX: u32 = 12;

/// Of a series by its number.
pub fn color(index: usize) -> RGBColor {
    PALETTE[index % PALETTE.len()]
}

/// Of one of so many series that nothing but colour tells apart.
pub fn color_of(index: usize, count: usize) -> RGBColor {
    if count <= PALETTE.len() { color(index) } else { shade(index as f64 / (count - 1) as f64) }
}

/// The backend divides a font's size by this to write the size in pixels of the em square (plotters 0.3, `svg.rs`).
const BACKEND_DIVISOR: f64 = 1.24;

/// Of this size in the picture, pixels.
fn font(size_px: u32, color: RGBColor) -> TextStyle<'static> {
    ("sans-serif", f64::from(size_px) * BACKEND_DIVISOR).into_font().color(&color)
}

pub fn title() -> TextStyle<'static> {
    font(19, INK)
}

pub fn heading() -> TextStyle<'static> {
    font(15, INK)
}

pub fn label() -> TextStyle<'static> {
    font(LABEL_PX, INK)
}

/// Width of a character of small text on average, rounded up: DejaVu Sans has 6.1 px at 12 px.
pub const SMALL_CHARACTER_PX: f64 = 6.2;

pub fn small() -> TextStyle<'static> {
    font(SMALL_PX, FAINT)
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

/// The shape of marks, so that series differ by more than colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Shape {
    Circle,
    Square,
    Triangle,
    Diamond,
    Hanging,
    Upright,
}

/// What the points of a series are marked with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Marker {
    pub shape: Shape,
    pub hollow: bool,
}

impl Marker {
    /// By a series' place among those of its colour: every shape filled, then every shape hollow, and so on: labels tell them apart.
    pub fn nth(place: usize) -> Marker {
        use Shape::*;
        let shapes = [Circle, Square, Triangle, Diamond, Hanging, Upright];
        let count = shapes.len();
        Marker { shape: shapes[place % count], hollow: place % (2 * count) >= count }
    }
}

/// Outline of the marker of a series, as offsets in pixels from the point: shapes tell series apart without colour.
pub fn marker(shape: Shape) -> Vec<(i32, i32)> {
    match shape {
        Shape::Circle => {
            vec![(5, 2), (2, 5), (-2, 5), (-5, 2), (-5, -2), (-2, -5), (2, -5), (5, -2)]
        }
        Shape::Square => vec![(-4, -4), (4, -4), (4, 4), (-4, 4)],
        Shape::Triangle => vec![(0, -6), (5, 4), (-5, 4)],
        Shape::Diamond => vec![(0, -6), (6, 0), (0, 6), (-6, 0)],
        Shape::Hanging => vec![(0, 6), (5, -4), (-5, -4)],
        Shape::Upright => vec![(-2, -6), (2, -6), (2, 6), (-2, 6)],
    }
}

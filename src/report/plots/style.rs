//! Colours of plots, and lines of text.

use itertools::Itertools;

use crate::colors::Color;
use fathom_experiments::Verdict;

/// Colours that are told apart with any colour vision (Okabe & Ito, *Color Universal Design* (2008)); yellow last, as
/// it is faint on white.
const PALETTE: [Color; 7] = [
    Color(0, 114, 178),
    Color(213, 94, 0),
    Color(0, 158, 115),
    Color(204, 121, 167),
    Color(86, 180, 233),
    Color(230, 159, 0),
    Color(240, 228, 66),
];

/// Of gaps and of fields without a value.
pub const GAPS: Color = Color(200, 200, 200);

pub fn color(index: usize) -> Color {
    PALETTE[index % PALETTE.len()]
}

/// Told apart by the word beside it, too.
pub fn of_verdict(verdict: Verdict) -> Color {
    match verdict {
        Verdict::Supported => Color(0, 150, 105),
        Verdict::Contradicted => Color(213, 94, 0),
        Verdict::Inconclusive => Color(140, 120, 200),
        Verdict::NotRun => Color(150, 150, 150),
    }
}

/// Stops of a colour scale from dark to light that reads in order with any colour vision and in grey (viridis; Smith & van
/// der Walt 2015).
const SHADES: [Color; 6] = [
    Color(68, 1, 84),
    Color(65, 68, 135),
    Color(42, 120, 142),
    Color(34, 168, 132),
    Color(122, 209, 81),
    Color(253, 231, 37),
];

/// Colour at a share of the scale, 0 … 1.
pub fn shade(share: f64) -> Color {
    let last = SHADES.len() - 1;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = (place as usize).min(last - 1);
    let (a, b) = (SHADES[below], SHADES[below + 1]);
    let mix = |a: u8, b: u8| {
        (f64::from(a) + (place - below as f64) * (f64::from(b) - f64::from(a))).round() as u8
    };
    Color(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
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

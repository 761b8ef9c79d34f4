//! A figure with its interval beside the band that it must lie in: one field of a table.

use maud::{Markup, PreEscaped, html};
use plotters::prelude::*;

use super::chart::Mark;
use super::drawing;
use super::style::{self, Marker, Shape};
use fathom_record::{Estimate, Interval};

const WIDTH_PX: i32 = 196;
const HEIGHT_PX: i32 = 26;
/// Room for the ends of marks.
const MARGIN_PX: i32 = 8;

/// On an axis with these ends; what lies beyond is drawn at the edge. `tip` says the same in words.
pub fn strip(
    [low, high]: [f64; 2],
    band: Interval,
    figure: &Estimate,
    published: Option<f64>,
    tip: &str,
) -> Markup {
    let room = f64::from(WIDTH_PX - 2 * MARGIN_PX);
    let x = |value: f64| {
        MARGIN_PX + (room * ((value - low) / (high - low)).clamp(0.0, 1.0)).round() as i32
    };
    let middle = HEIGHT_PX / 2;
    let svg = drawing((WIDTH_PX as u32, HEIGHT_PX as u32), tip, |area| {
        let line =
            |[a, b]: [i32; 2], style| PathElement::new(vec![(a, middle), (b, middle)], style);
        area.draw(&line([0, WIDTH_PX], style::FAINT.stroke_width(1)))?;
        let [start, end] = [x(band.low), x(band.high).max(x(band.low) + 1)];
        area.draw(&Rectangle::new([(start, 3), (end, HEIGHT_PX - 3)], style::BAND.filled()))?;
        if let Some(value) = published {
            let marker = Marker { shape: Shape::Diamond, hollow: false };
            Mark::Series(marker, style::OPEN).draw(area, x(value), middle)?;
        }
        area.draw(&line(figure.ends().map(x), style::INK.stroke_width(2)))?;
        area.draw(&Circle::new((x(figure.median), middle), 4, style::INK.filled()))
    });
    html! { span.strip data-tip=(tip) { (PreEscaped(svg)) } }
}

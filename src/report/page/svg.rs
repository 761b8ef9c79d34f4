//! Charts as SVG: axes, marks that tell their exact value, and lines.
//!
//! A mark has a `<title>` for readers without script, and `data-tip` for the page's script, which shows it under the pointer
//! and walks over the marks of a chart by the arrow keys.

use maud::{Markup, html};

use crate::report::colors::Color;
use crate::report::plots::scale::{Scale, ScaleKind};

/// Least size of type on the page.
pub const TYPE_PX: f64 = 12.0;

/// An axis that lies along pixels of a chart.
#[derive(Clone, Debug)]
pub struct Axis {
    scale: Scale,
    /// The pixels of the low and the high end.
    ends_px: [f64; 2],
}

impl Axis {
    /// None where no value can be shown.
    pub fn fit(
        kind: ScaleKind,
        values: impl IntoIterator<Item = f64>,
        ends_px: [f64; 2],
    ) -> Option<Axis> {
        Scale::fit(kind, values.into_iter()).map(|scale| Axis { scale, ends_px })
    }

    /// From one value to the other, without room around them.
    pub fn spanning(kind: ScaleKind, values: [f64; 2], ends_px: [f64; 2]) -> Option<Axis> {
        let mut axis = Axis::fit(kind, values, ends_px)?;
        let [low, high] = values;
        (axis.scale.low, axis.scale.high) = (axis.scale.at(low)?, axis.scale.at(high)?);
        Some(axis)
    }

    /// The pixel of a value; none for what a logarithm cannot show.
    pub fn px(&self, value: f64) -> Option<f64> {
        let share = (self.scale.at(value)? - self.scale.low) / (self.scale.high - self.scale.low);
        let [low, high] = self.ends_px;
        Some(tenth(low + share * (high - low)))
    }

    /// The pixel of a value, or that of the end of the axis beyond which it lies.
    pub fn px_within(&self, value: f64) -> f64 {
        let [low, high] = self.ends_px;
        let inside = |px: f64| px.clamp(low.min(high), low.max(high));
        self.px(value).map_or(low, inside)
    }

    /// Pixels and labels.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let [low, high] = self.ends_px;
        let (start, length) = (self.scale.low, self.scale.high - self.scale.low);
        let place = |tick: f64| tenth(low + (tick - start) / length * (high - low));
        let ticks = self.scale.ticks().iter();
        ticks.map(|tick| (place(*tick), self.scale.tick_label(*tick))).collect()
    }
}

/// A tenth of a pixel is fine enough, and short.
pub fn tenth(px: f64) -> f64 {
    (10.0 * px).round() / 10.0
}

/// A horizontal axis: grid lines up to `top_px`, labels below `bottom_px`, and what it shows.
pub fn x_axis(axis: &Axis, [top_px, bottom_px]: [f64; 2], title: &str) -> Markup {
    let middle = tenth((axis.ends_px[0] + axis.ends_px[1]) / 2.0);
    html! {
        g.axis aria-hidden="true" {
            @for (x, label) in axis.ticks() {
                line.grid x1=(x) x2=(x) y1=(top_px) y2=(bottom_px) {}
                text x=(x) y=(bottom_px + 16.0) text-anchor="middle" { (label) }
            }
            text.title x=(middle) y=(bottom_px + 34.0) text-anchor="middle" { (title) }
        }
    }
}

/// A vertical axis: grid lines up to `right_px`, labels at the left of `left_px`, and what it shows above.
pub fn y_axis(axis: &Axis, [left_px, right_px]: [f64; 2], title: &str) -> Markup {
    let top = axis.ends_px[0].min(axis.ends_px[1]);
    html! {
        g.axis aria-hidden="true" {
            @for (y, label) in axis.ticks() {
                line.grid x1=(left_px) x2=(right_px) y1=(y) y2=(y) {}
                text x=(left_px - 6.0) y=(y + 4.0) text-anchor="end" { (label) }
            }
            text.title x="2" y=(top - 8.0) { (title) }
        }
    }
}

/// A point that tells its value.
pub fn dot([x, y]: [f64; 2], color: Color, tip: &str) -> Markup {
    html! {
        circle.mark cx=(x) cy=(y) r="4" fill=(color.hex()) data-tip=(tip) { title { (tip) } }
    }
}

/// A bar that tells its value.
pub fn bar([x, y]: [f64; 2], [width, height]: [f64; 2], color: Color, tip: &str) -> Markup {
    html! {
        rect.mark x=(x) y=(y) width=(width) height=(height) fill=(color.hex()) data-tip=(tip) {
            title { (tip) }
        }
    }
}

/// A chart of fixed size; `about` says in one sentence what it shows.
pub fn chart([width, height]: [f64; 2], about: &str, content: &Markup) -> Markup {
    html! {
        svg.chart role="img" aria-label=(about) width=(width) height=(height)
            viewBox={ "0 0 " (width) " " (height) } { (content) }
    }
}

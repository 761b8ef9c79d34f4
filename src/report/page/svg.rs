//! Charts as SVG: axes, marks that tell their exact value, and lines.
//!
//! A mark has a `<title>` for readers without script, and `data-tip` for the page's script, which shows it under the pointer
//! and walks over the marks of a chart by the arrow keys.

use maud::{Markup, html};

use crate::colors::Color;
use crate::plots::scale::{Scale, ScaleKind};

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

    /// Linear about the values, which may lie far from 0. None where no value can be shown.
    pub fn tight(values: impl IntoIterator<Item = f64>, ends_px: [f64; 2]) -> Option<Axis> {
        Scale::tight(values.into_iter()).map(|scale| Axis { scale, ends_px })
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
        Some(self.px_at(self.scale.at(value)?))
    }

    /// The pixel of a coordinate: of a value, or of its decimal logarithm.
    pub fn px_at(&self, coordinate: f64) -> f64 {
        let share = (coordinate - self.scale.low) / (self.scale.high - self.scale.low);
        let [low, high] = self.ends_px;
        tenth(low + share * (high - low))
    }

    /// The coordinates of its ends.
    pub fn coordinates(&self) -> [f64; 2] {
        [self.scale.low, self.scale.high]
    }

    /// The pixel of a value, or that of the end of the axis beyond which it lies.
    pub fn px_within(&self, value: f64) -> f64 {
        let [low, high] = self.ends_px;
        let inside = |px: f64| px.clamp(low.min(high), low.max(high));
        self.px(value).map_or(low, inside)
    }

    /// Pixels and labels.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let ticks = self.scale.ticks().iter();
        ticks.map(|tick| (self.px_at(*tick), self.scale.tick_label(*tick))).collect()
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
            @for (x, _) in axis.ticks() {
                line.grid x1=(x) x2=(x) y1=(top_px) y2=(bottom_px) {}
            }
            @for (x, label) in spaced(axis.ticks()) {
                text x=(x) y=(bottom_px + 16.0) text-anchor="middle" { (label) }
            }
            @if !title.is_empty() {
                text.title x=(middle) y=(bottom_px + 34.0) text-anchor="middle" { (title) }
            }
        }
    }
}

/// Without the labels that would touch the one before.
fn spaced(ticks: Vec<(f64, String)>) -> Vec<(f64, String)> {
    let mut kept: Vec<(f64, String)> = Vec::new();
    for (x, label) in ticks {
        let fits = |(before, other): &(f64, String)| {
            (x - before).abs() > (text_px(&label) + text_px(other)) / 2.0 + 6.0
        };
        if kept.last().is_none_or(fits) {
            kept.push((x, label));
        }
    }
    kept
}

/// Width of a text, about: fonts differ.
pub fn text_px(text: &str) -> f64 {
    0.56 * TYPE_PX * text.chars().count() as f64
}

/// What fits into a width, with an ellipsis for the rest.
pub fn shortened(text: &str, width_px: f64) -> String {
    if text_px(text) <= width_px {
        return text.to_owned();
    }
    let kept = (width_px / text_px("…")).max(1.0) as usize - 1;
    text.chars().take(kept).chain(['…']).collect()
}

/// A text in two lines where one is too short, the second shortened.
pub fn in_two_lines(text: &str, width_px: f64) -> Vec<String> {
    let breaks = text.match_indices(' ').map(|(place, _)| place);
    let fitting = breaks.rev().find(|place| text_px(&text[..*place]) <= width_px);
    match fitting {
        Some(place) if text_px(text) > width_px => {
            vec![text[..place].to_owned(), shortened(&text[place + 1..], width_px)]
        }
        _ => vec![shortened(text, width_px)],
    }
}

/// Moves labels down where they would cover the one above: heights in, heights out, in pixels.
pub fn apart(heights_px: &[f64], least_px: f64, bottom_px: f64) -> Vec<f64> {
    let mut order: Vec<usize> = (0..heights_px.len()).collect();
    order.sort_by(|a, b| heights_px[*a].total_cmp(&heights_px[*b]));
    let mut placed = heights_px.to_vec();
    for pair in order.windows(2) {
        placed[pair[1]] = placed[pair[1]].max(placed[pair[0]] + least_px);
    }
    let mut lowest = bottom_px;
    for index in order.into_iter().rev() {
        placed[index] = tenth(placed[index].min(lowest));
        lowest = placed[index] - least_px;
    }
    placed
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
            @if !title.is_empty() { text.title x="2" y=(top - 8.0) { (title) } }
        }
    }
}

/// What marks are painted with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paint {
    Stage(Color),
    /// Of what is no stage's.
    Ink,
    Accent,
}

impl Paint {
    /// A colour of CSS.
    pub fn css(self) -> String {
        match self {
            Self::Stage(color) => color.hex(),
            Self::Ink => "var(--ink)".to_owned(),
            Self::Accent => "var(--accent)".to_owned(),
        }
    }
}

/// The shape of a run's marks, so that runs differ by more than colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    Circle,
    Square,
    Triangle,
    Diamond,
}

impl Shape {
    /// By the run's place on the page. A fifth run has the shape of the first: labels tell them apart.
    pub fn of_run(place: usize) -> Shape {
        [Self::Circle, Self::Square, Self::Triangle, Self::Diamond][place % 4]
    }

    /// For text.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Circle => "●",
            Self::Square => "■",
            Self::Triangle => "▲",
            Self::Diamond => "◆",
        }
    }

    /// Its outline about a point.
    pub fn path(self, [x, y]: [f64; 2]) -> String {
        match self {
            Self::Circle => format!("M{} {y}a4 4 0 1 0 8 0a4 4 0 1 0 -8 0z", tenth(x - 4.0)),
            Self::Square => format!("M{} {}h7v7h-7z", tenth(x - 3.5), tenth(y - 3.5)),
            Self::Triangle => format!("M{x} {}l4.5 8h-9z", tenth(y - 5.0)),
            Self::Diamond => format!("M{x} {}l5 5l-5 5l-5 -5z", tenth(y - 5.0)),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_moved_apart_and_stay_inside() {
        assert_eq!(apart(&[10.0, 50.0], 14.0, 100.0), [10.0, 50.0]);
        assert_eq!(apart(&[50.0, 50.0, 52.0], 14.0, 100.0), [50.0, 64.0, 78.0]);
        assert_eq!(apart(&[98.0, 96.0], 14.0, 100.0), [100.0, 86.0]);
    }

    #[test]
    fn long_texts_are_shortened_to_the_width() {
        assert_eq!(shortened("short", 60.0), "short");
        let cut = shortened("a name that is far too long", 60.0);
        assert!(cut.ends_with('…') && text_px(&cut) <= 60.0, "{cut}");
    }

    #[test]
    fn a_text_is_broken_at_a_space_where_it_is_too_long() {
        assert_eq!(in_two_lines("all stages", 100.0), ["all stages"]);
        assert_eq!(in_two_lines("photons in view that", 100.0), ["photons in", "view that"]);
    }

    #[test]
    fn labels_of_an_axis_do_not_touch() {
        let ticks = [10.0, 20.0, 60.0].map(|x| (x, "1000".to_owned())).to_vec();
        let kept: Vec<f64> = spaced(ticks).into_iter().map(|(x, _)| x).collect();
        assert_eq!(kept, [10.0, 60.0]);
    }
}

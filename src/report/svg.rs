//! Charts as SVG: axes, and marks that tell their exact value.
//!
//! On the page a mark has a `<title>`. The page's script shows it under the pointer and walks over the marks of a chart by the
//! arrow keys.

use maud::{Markup, html};

use crate::axis::{Axis, tenth};

/// Least size of type in a chart.
pub const TYPE_PX: f64 = 12.0;

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

/// A vertical axis: grid lines up to `right_px`, labels at the left of `left_px`, and what it shows above.
pub fn y_axis(axis: &Axis, [left_px, right_px]: [f64; 2], title: &str) -> Markup {
    let top = axis.ends_px[0].min(axis.ends_px[1]);
    html! {
        g.axis aria-hidden="true" {
            @for (y, label) in axis.ticks() {
                line.grid x1=(left_px) x2=(right_px) y1=(y) y2=(y) {}
                text x=(left_px - 6.0) y=(y + 4.0) text-anchor="end" { (label) }
            }
            @if !title.is_empty() { text.title x="2" y=(top - 14.0) { (title) } }
        }
    }
}

/// Width of a text, about: fonts differ.
pub fn text_px(text: &str) -> f64 {
    0.56 * TYPE_PX * text.chars().count() as f64
}

/// Moves blocks of these heights down where they would cover the one above, and up where they would reach below the bottom: upper
/// edges in, upper edges out, in pixels.
pub fn apart(edges_px: &[f64], heights_px: &[f64], [top_px, bottom_px]: [f64; 2]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..edges_px.len()).collect();
    order.sort_by(|a, b| edges_px[*a].total_cmp(&edges_px[*b]));
    let mut placed = edges_px.to_vec();
    let mut free = top_px;
    for index in &order {
        placed[*index] = placed[*index].max(free);
        free = placed[*index] + heights_px[*index];
    }
    let mut end = bottom_px;
    for index in order.into_iter().rev() {
        placed[index] = tenth(placed[index].min(end - heights_px[index]));
        end = placed[index];
    }
    placed
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

impl Shape {
    pub const COUNT: usize = 6;

    /// By the place of a series. A seventh has the shape of the first: labels tell them apart.
    pub fn of(place: usize) -> Shape {
        use Shape::*;
        [Circle, Square, Triangle, Diamond, Hanging, Upright][place % Self::COUNT]
    }
}

/// What the points of a series are marked with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Marker {
    pub shape: Shape,
    pub hollow: bool,
}

impl Marker {
    pub const COUNT: usize = 2 * Shape::COUNT;

    /// By a series' place among those of its colour: every shape filled, then every shape hollow.
    pub fn of(place: usize) -> Marker {
        Marker { shape: Shape::of(place), hollow: place % Self::COUNT >= Shape::COUNT }
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
    fn blocks_are_moved_apart_in_their_order_and_stay_inside() {
        for (edges, height, bottom, expected) in [
            (&[10.0, 50.0][..], 14.0, 114.0, &[10.0, 50.0][..]),
            (&[50.0, 50.0, 52.0], 14.0, 114.0, &[50.0, 64.0, 78.0]),
            (&[98.0, 96.0], 14.0, 114.0, &[100.0, 86.0]),
            (&[12.0, 14.0, 82.0], 20.0, 120.0, &[12.0, 32.0, 82.0]),
            // What does not fit below is moved up.
            (&[92.0, 90.0], 20.0, 110.0, &[90.0, 70.0]),
        ] {
            let heights = vec![height; edges.len()];
            assert_eq!(apart(edges, &heights, [0.0, bottom]), expected);
        }
    }

    #[test]
    fn labels_of_an_axis_do_not_touch() {
        let ticks = [10.0, 20.0, 60.0].map(|x| (x, "1000".to_owned())).to_vec();
        let kept: Vec<f64> = spaced(ticks).into_iter().map(|(x, _)| x).collect();
        assert_eq!(kept, [10.0, 60.0]);
    }
}

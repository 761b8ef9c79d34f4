//! Charts of horizontal rows along one axis, with labels at the left and figures at the right; legends.

use maud::{Markup, html};

use super::drawing::{Drawing, MARGIN_PX, WIDTH_PX};
use crate::axis::{Axis, tenth};
use crate::colors::Color;
use crate::svg::{Shape, shortened, text_px, x_axis};

/// Axis below the rows, with its title.
const AXIS_PX: f64 = 50.0;
/// Room for the labels of rows.
const LABELS_PX: [f64; 2] = [60.0, 400.0];
/// Between a label and its row.
const GAP_PX: f64 = 8.0;

pub struct Rows {
    axis: Axis,
    rows: Vec<Drawing>,
}

impl Rows {
    /// With an axis that holds these values, and room for labels and for figures at the right; none where no value can be shown.
    pub fn new<'l>(
        values: impl IntoIterator<Item = f64>,
        labels: impl IntoIterator<Item = &'l str>,
        right_px: f64,
    ) -> Option<Rows> {
        let [least, most] = LABELS_PX;
        let longest =
            labels.into_iter().map(|label| text_px(label) + GAP_PX + 1.0).fold(least, f64::max);
        let ends_px = [MARGIN_PX + longest.min(most), WIDTH_PX - right_px].map(tenth);
        Some(Rows { axis: Axis::of_bars(values, ends_px)?, rows: Vec::new() })
    }

    /// Adds a row with its label at the left of its middle.
    pub fn push(&mut self, label: &str, row: Drawing) {
        let [left, _] = self.axis.ends_px;
        let label = shortened(label, left - MARGIN_PX - GAP_PX);
        let content = html! {
            (row.content)
            text.label x=(left - GAP_PX) y=(row.height_px / 2.0 + 4.0) text-anchor="end" { (label) }
        };
        self.rows.push(Drawing::new(row.height_px, content));
    }

    pub fn drawing(self, legend: Legend, title: &str) -> Drawing {
        let title = format!("{title}, {}", self.axis.kind.name());
        let rows = Drawing::column(self.rows);
        let content = html! { (x_axis(&self.axis, [0.0, rows.height_px], &title)) (rows.content) };
        Drawing::column([legend.drawing(), Drawing::new(rows.height_px + AXIS_PX, content)])
    }

    /// A bar from one value to another.
    pub fn bar(&self, values: [f64; 2], y_px: [f64; 2], color: Color) -> Markup {
        let [from, to] = values.map(|value| self.axis.px_within(value));
        html! { rect.bar x=(from) y=(y_px[0]) width=(tenth(to - from)) height=(y_px[1] - y_px[0]) fill=(color.hex()) {} }
    }

    /// What a claim allows; it may have no end.
    pub fn band(&self, values: [f64; 2], y_px: [f64; 2]) -> Markup {
        let [from, to] = values.map(|value| self.axis.px_within(value));
        html! { rect.band x=(from) y=(y_px[0]) width=(tenth(to - from)) height=(y_px[1] - y_px[0]) {} }
    }

    pub fn interval(&self, values: [f64; 2], y_px: f64) -> Markup {
        let [from, to] = values.map(|value| self.axis.px_within(value));
        html! { line.line x1=(from) x2=(to) y1=(y_px) y2=(y_px) {} }
    }

    /// A line across the row.
    pub fn across(&self, value: f64, y_px: [f64; 2], class: &str) -> Markup {
        let x = self.axis.px_within(value);
        html! { line.(class) x1=(x) x2=(x) y1=(y_px[0]) y2=(y_px[1]) {} }
    }

    pub fn mark(&self, shape: Shape, value: f64, y_px: f64, fill: Option<Color>) -> Markup {
        let path = shape.path([self.axis.px_within(value), y_px]);
        html! { path.ink[fill.is_none()] d=(path) fill=[fill.map(Color::hex)] {} }
    }

    /// Words at the right of a value.
    pub fn beside(&self, value: f64, y_px: f64, words: &str) -> Markup {
        html! { text.small x=(self.axis.px_within(value) + GAP_PX) y=(y_px + 4.0) { (words) } }
    }

    /// Words at the right of the chart.
    pub fn at_the_right(&self, y_px: f64, words: &str) -> Markup {
        html! { text.small x=(self.axis.ends_px[1] + GAP_PX) y=(y_px + 4.0) { (words) } }
    }
}

/// A mark beside a legend's words.
#[derive(Clone, Copy)]
pub enum Mark {
    Square(Color),
    /// What a claim allows.
    Band,
    /// The untimed frame.
    Diamond,
    /// Published times.
    Published,
}

/// Marks and words in rows from left to right.
#[derive(Clone, Default)]
pub struct Legend(pub Vec<(Mark, String)>);

const LEGEND_ROW_PX: f64 = 20.0;
/// The mark before an entry's words and the space behind them.
const MARK_PX: f64 = 20.0;
const SPACE_PX: f64 = 18.0;

impl Legend {
    pub fn drawing(&self) -> Drawing {
        let (mut x, mut y) = (MARGIN_PX, 0.0);
        let placed = self.0.iter().map(|(mark, words)| {
            let width = MARK_PX + text_px(words) + SPACE_PX;
            if x > MARGIN_PX && x + width > WIDTH_PX {
                (x, y) = (MARGIN_PX, y + LEGEND_ROW_PX);
            }
            let at = [x, y];
            x += width;
            (at, mark, words)
        });
        let content = html! {
            @for ([x, y], mark, words) in placed {
                (mark.markup([x + 7.0, y + 10.0]))
                text x=(tenth(x + MARK_PX)) y=(y + 14.0) { (words) }
            }
        };
        let height_px = if self.0.is_empty() { 0.0 } else { y + LEGEND_ROW_PX + 6.0 };
        Drawing::new(height_px, content)
    }
}

impl Mark {
    fn markup(self, at: [f64; 2]) -> Markup {
        let [x, y] = at.map(tenth);
        html! {
            @match self {
                Mark::Square(color) => { rect x=(x - 6.0) y=(y - 6.0) width="12" height="12" fill=(color.hex()) {} }
                Mark::Band => { rect.band x=(x - 6.0) y=(y - 6.0) width="12" height="12" {} }
                Mark::Diamond => { path.ink d=(Shape::Diamond.path([x, y])) {} }
                Mark::Published => { line.published x1=(x) x2=(x) y1=(y - 8.0) y2=(y + 8.0) {} }
            }
        }
    }
}

//! Panels of horizontal bars: the stages of each cell one after the other, the untimed frame marked.

use indexmap::IndexMap;
use maud::{Markup, html};

use super::drawing::Drawing;
use super::rows::{Legend, Mark, Rows};
use super::{PlotInput, names, style};
use crate::colors::{Color, NEUTRAL};
use crate::format::{NS_PER_MS, three};
use crate::svg::Shape;
use fathom_experiments::schema::Published;
use fathom_record::{Cell, Estimate, Measured};

const BAR_PX: f64 = 34.0;
/// Room for figures.
const RIGHT_PX: f64 = 110.0;
/// A stage that has less of every cell's frame is drawn among the others.
const LEAST_SHARE: f64 = 0.01;

/// A cell, times in milliseconds.
struct Bar {
    label: String,
    /// One per stage of the panel, then the rest, then the gaps.
    parts: Vec<f64>,
    frame: Estimate,
    /// From the shortest to the longest published time.
    published: Option<[f64; 2]>,
}

/// None where no cell was timed.
pub fn drawing(input: &PlotInput<'_>) -> Option<Drawing> {
    let timed = |cell: &&Cell| cell.measured().is_some_and(Measured::is_timed);
    let cells = input.cells.iter().copied().filter(timed);
    let figures: Vec<(&Cell, &Measured)> =
        cells.filter_map(|cell| Some((cell, cell.measured()?))).collect();
    let stages = coloured(&figures);
    let bars = figures.iter().map(|(cell, measured)| Bar::new(cell, measured, &stages, input));
    let bars: Vec<Bar> = bars.collect();
    let ends = bars.iter().flat_map(|bar| [bar.end(), bar.frame.ends()[0], bar.frame.median]);
    let mut rows = Rows::new(ends, bars.iter().map(|bar| bar.label.as_str()), RIGHT_PX)?;
    let of_stages = stages.iter().map(|stage| (input.colors.of(stage), stage.to_string()));
    let others = [(NEUTRAL, "all other stages"), (style::GAPS, "gaps between passes")];
    let others = others.map(|(color, words)| (color, words.to_owned()));
    let parts: Vec<(Color, String)> = of_stages.chain(others).collect();
    for bar in &bars {
        rows.push(&bar.label, Drawing::new(BAR_PX, bar.markup(&rows, &parts)));
    }
    let is_there =
        |part: usize| part < stages.len() || bars.iter().any(|bar| bar.parts[part] > 0.0);
    let shown = (0..parts.len()).filter(|part| is_there(*part)).map(|part| &parts[part]);
    let shown = shown.map(|(color, words)| (Mark::Square(*color), words.clone()));
    let frame = (Mark::Diamond, "frame without stage timing".to_owned());
    let published = bars.iter().any(|bar| bar.published.is_some());
    let published = published.then(|| (Mark::Published, "published".to_owned()));
    Some(rows.drawing(Legend(shown.chain([frame]).chain(published).collect()), "time (ms)"))
}

/// The stages with a share of some cell that can be seen, in frame order.
fn coloured<'a>(figures: &[(&Cell, &'a Measured)]) -> Vec<&'a str> {
    let mut shares = IndexMap::<&str, f64>::new();
    for (_, measured) in figures {
        let total: f64 = measured.stages.iter().map(|stage| stage.time.median).sum();
        for stage in &measured.stages {
            let most = shares.entry(&stage.stage).or_default();
            *most = most.max(stage.time.median / total);
        }
    }
    let seen = shares.into_iter().filter(|(_, share)| *share >= LEAST_SHARE);
    seen.map(|(name, _)| name).collect()
}

impl Bar {
    fn new(cell: &Cell, measured: &Measured, stages: &[&str], input: &PlotInput<'_>) -> Bar {
        let mut parts = vec![0.0; stages.len() + 2];
        // A time below the clock's resolution has no length.
        for stage in measured.stages.iter().filter(|s| s.is_resolved()) {
            let place = stages.iter().position(|name| stage.stage == **name);
            parts[place.unwrap_or(stages.len())] += stage.time.median / NS_PER_MS;
        }
        let frame = &measured.frame;
        let gaps = fathom_base::statistics::median(&frame.gap_samples_ns) / NS_PER_MS;
        parts[stages.len() + 1] = if gaps.is_finite() { gaps.max(0.0) } else { 0.0 };
        Bar {
            label: names::cell(cell, None, input.experiment),
            parts,
            frame: frame.untimed.scaled(1.0 / NS_PER_MS),
            published: input.published(cell).map(Published::span_ms),
        }
    }

    /// Where everything that it shows ends.
    fn end(&self) -> f64 {
        let published = self.published.map_or(0.0, |span| span[1]);
        self.parts.iter().sum::<f64>().max(self.frame.ends()[1]).max(published)
    }

    fn markup(&self, rows: &Rows, parts: &[(Color, String)]) -> Markup {
        let mut start = 0.0;
        let placed = self.parts.iter().zip(parts).map(|(length, (color, _))| {
            start += length;
            ([start - length, start], *color)
        });
        let middle = BAR_PX / 2.0;
        let words = format!("{}, n = {}", three(self.frame.median), self.frame.n);
        html! {
            @for (ends, color) in placed {
                @if ends[0] < ends[1] { (rows.bar(ends, [6.0, BAR_PX - 6.0], color)) }
            }
            (rows.interval(self.frame.ends(), middle))
            @if let Some(span) = self.published {
                @for at in span { (rows.across(at, [1.0, BAR_PX - 1.0], "published")) }
                @for y in [1.0, BAR_PX - 1.0] { (rows.interval(span, y)) }
            }
            (rows.mark(Shape::Diamond, self.frame.median, middle, None))
            (rows.beside(self.end(), middle, &words))
        }
    }
}

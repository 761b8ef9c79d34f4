//! Panels of horizontal bars: the stages of each cell one after the other, the untimed frame marked.

use plotters::prelude::RGBColor;

use super::chart::{BarChart, Item, Legend, MAX_LABELS_PX, Mark};
use super::{PlotInput, names, style};
use crate::format::{NS_PER_MS, three};
use fathom_experiments::Measure;
use fathom_experiments::schema::Published;
use fathom_record::{Cell, Estimate, Measured};

const BAR_PX: u32 = 34;
/// Beside a label.
const LABEL_MARGIN_PX: u32 = 20;
/// A stage that has less of every cell's frame is drawn among the others.
const MIN_SHARE: f64 = 0.01;

/// A cell, times in milliseconds.
struct Bar {
    label: String,
    /// One per stage of the panel, then the rest and what is in no stage.
    parts: Vec<f64>,
    frame: Estimate,
    /// From the shortest to the longest published time.
    published: Option<[f64; 2]>,
}

/// None where no cell was timed.
pub fn chart(input: &PlotInput<'_>) -> Option<BarChart> {
    let is_timed = |cell: &&Cell| cell.measured().is_some_and(Measured::is_timed);
    let cells: Vec<&Cell> = input.cells.iter().copied().filter(is_timed).collect();
    let figures: Vec<&Measured> = cells.iter().filter_map(|cell| cell.measured()).collect();
    let stages = coloured(&figures);
    let labels = names::cells(&cells, input.experiment, MAX_LABELS_PX - LABEL_MARGIN_PX);
    let bar = |(label, cell): (String, &&Cell)| Bar::new(label, cell, &stages, input);
    let bars: Vec<Bar> = labels.into_iter().zip(&cells).filter_map(bar).collect();
    let ends = bars.iter().flat_map(|bar| {
        let [low, high] = bar.frame.ends();
        let timed: f64 = bar.parts.iter().sum();
        [timed, low, bar.frame.median, high, bar.published.map_or(0.0, |span| span[1])]
    });
    let of_stages = stages.iter().map(|stage| style::stage_color(input.colors.color(stage)));
    let colors: Vec<RGBColor> = of_stages.chain([style::REST, style::GAPS]).collect();
    let rows = bars.iter().zip((0..bars.len()).rev());
    let names = [&stages[..], &OTHERS].concat();
    Some(BarChart {
        x_title: "time (ms)".to_owned(),
        scale: BarChart::scale(ends)?,
        rows_px: bars.len() as u32 * BAR_PX,
        rows: bars.len() as f64,
        right_px: 110,
        items: rows.flat_map(|(bar, row)| bar.items(row as f64, &names, &colors)).collect(),
        legend: legend(&names, &bars, &colors),
    })
}

/// What stands behind the stages of a bar.
const OTHERS: [&str; 2] = ["all other stages", "in no stage"];

fn legend(names: &[&str], bars: &[Bar], colors: &[RGBColor]) -> Legend {
    let named = names.iter().zip(colors).enumerate();
    let shown = named.filter(|(place, _)| bars.iter().any(|bar| bar.parts[*place] > 0.0));
    let mut entries: Vec<(Mark, String)> =
        shown.map(|(_, (name, color))| (Mark::Square(*color), (*name).to_owned())).collect();
    entries.push((Mark::Diamond, "frame without stage timing".to_owned()));
    if bars.iter().any(|bar| bar.published.is_some()) {
        entries.push((Mark::Published, "published".to_owned()));
    }
    Legend(entries)
}

/// The stages with a share of some cell that can be seen, in frame order.
fn coloured<'a>(figures: &[&'a Measured]) -> Vec<&'a str> {
    let mut shares = indexmap::IndexMap::<&str, f64>::new();
    for measured in figures {
        let total: f64 = measured.stages.iter().map(|stage| stage.time.median).sum();
        for stage in &measured.stages {
            let max_share = shares.entry(&stage.stage).or_insert(f64::NEG_INFINITY);
            *max_share = max_share.max(stage.time.median / total);
        }
    }
    shares.into_iter().filter(|(_, share)| *share >= MIN_SHARE).map(|(name, _)| name).collect()
}

impl Bar {
    fn new(label: String, cell: &Cell, stages: &[&str], input: &PlotInput<'_>) -> Option<Bar> {
        let measured = cell.measured()?;
        let mut parts = vec![0.0; stages.len() + 1];
        // A time below the clock's resolution has no length.
        for stage in measured.stages.iter().filter(|s| s.is_resolved()) {
            let place = stages.iter().position(|name| *stage.stage == **name);
            parts[place.unwrap_or(stages.len())] += stage.time.median / NS_PER_MS;
        }
        parts.push(measured.in_no_stage_ns() / NS_PER_MS);
        Some(Bar {
            label,
            parts,
            frame: measured.frame.untimed.scaled(1.0 / NS_PER_MS),
            published: input.published(cell, &Measure::frame()).map(Published::span_ms),
        })
    }

    fn items(&self, row: f64, names: &[&str], colors: &[RGBColor]) -> Vec<Item> {
        let (middle, mut start) = (row + 0.5, 0.0);
        let mut items = Vec::new();
        // Neighbours are told apart by more than their colours.
        let gap = 0.003 * self.parts.iter().sum::<f64>();
        for ((length, name), color) in self.parts.iter().zip(names).zip(colors) {
            if *length > 0.0 {
                let end = start + length - gap.min(0.4 * length);
                let corners = [(start, row + 0.18), (end, row + 0.82)];
                let tip = Item::Tip(format!("{name}: {} ms", three(*length)));
                items.extend([Item::Bar(corners, *color), tip]);
            }
            start += length;
        }
        let ends = self.frame.ends();
        items.push(Item::Line(ends.map(|end| (end, middle)), 2));
        if let Some([low, high]) = self.published {
            let edges = [row + 0.04, row + 0.96];
            items.extend([low, high].map(|at| Item::Line(edges.map(|edge| (at, edge)), 4)));
            items.extend(edges.map(|edge| Item::Line([(low, edge), (high, edge)], 2)));
        }
        let end = self.published.map_or(0.0, |span| span[1]).max(ends[1]).max(start);
        let words = format!("{}, n = {}", three(self.frame.median), self.frame.n);
        items.extend([
            Item::Diamond((self.frame.median, middle)),
            Item::Label(self.label.clone(), middle),
            Item::Words(words, (end, middle), 10),
        ]);
        items
    }
}

//! What a frame costs the CPU: encoding and submission.

use super::{Fold, Page, PageRun, PageSection};
use crate::document::{self, Block, ColumnKind, Table};
use crate::format::interval;
use fathom_base::statistics::Estimate;
use fathom_record::{Cell, HostCosts};
use itertools::Itertools;

pub const SECTION: PageSection = PageSection {
    id: "host",
    title: "What it costs the CPU",
    question: "How long does the CPU encode and submit a frame?",
    fold: Fold::Folded,
    write: |page| document::html_if_any(parts(page)),
};

const NS_PER_US: f64 = 1e3;

/// The latest cell of each pipeline that has such figures.
fn costs<'a>(run: &PageRun<'a>) -> Vec<(&'a Cell, &'a HostCosts)> {
    let cells = run.view.sections.iter().flat_map(|section| section.cells());
    let timed = cells.filter_map(|cell| Some((cell, cell.measured()?.host.as_ref()?)));
    timed
        .sorted_by_key(|(cell, _)| cell.pipeline.as_str())
        .dedup_by(|a, b| a.0.pipeline == b.0.pipeline)
        .collect()
}

fn parts(page: &Page<'_>) -> Vec<Block> {
    let lead = "One cell per pipeline. Encoding and submission are CPU time of the thread that does them (on Linux), with the interval at 95 %. \
                A software driver may do a frame's work within the submission.";
    page.each_run(lead, |run| {
        let costs = costs(run);
        let table = (!costs.is_empty()).then(|| Block::Table(frames(&costs)));
        table.into_iter().chain(costs.iter().map(|(cell, host)| stages(cell, host))).collect()
    })
}

fn frames(costs: &[(&Cell, &HostCosts)]) -> Table {
    let columns = ["pipeline", "cell", "encode (µs)", "submit (µs)"];
    let rows = costs.iter().map(|(cell, host)| {
        let [encode, submit] = [&host.encode, &host.submit].map(spread);
        [cell.pipeline.clone(), cell.cell.clone(), encode, submit]
    });
    Table::new("What a frame of each pipeline costs the CPU", columns)
        .with(ColumnKind::Numbers, &columns[2..])
        .with_rows(rows)
}

fn stages(cell: &Cell, host: &HostCosts) -> Block {
    let columns = ["stage", "encode (µs)"];
    let rows = host.stages.iter().map(|stage| [stage.stage.to_string(), spread(&stage.encode)]);
    let table = Table::new("CPU time to encode each stage", columns)
        .with(ColumnKind::Numbers, &columns[1..])
        .with_rows(rows);
    let words = format!("Stages of {}, each encoded alone", cell.pipeline);
    Block::Fold(words.into(), vec![Block::Table(table)])
}

/// `12.3 (11.9 – 12.8)`, in microseconds.
fn spread(of: &Estimate) -> String {
    interval(&of.scaled(1.0 / NS_PER_US))
}

//! `cells.csv`: one row per cell and stage, as RFC 4180 has it. A cell without figures has one row with an empty stage.
//! A name that a spreadsheet would take for a formula has an apostrophe in front; see [`text::csv`].

use super::{Artifact, Entry, Exporter, ReportError, View};
use crate::record::{Estimate, Fenced, Measured, Outcome, StageRecord};
use crate::statistics::median;
use crate::text;

pub const EXPORTER: Exporter =
    Exporter { name: "cells.csv", about: "one row per cell and stage", export };

const HEADER: [&str; 35] = [
    "experiment",
    "cell",
    "pipeline",
    "scene",
    "stand_ins",
    "adapter",
    "software",
    "profile",
    "status",
    "reason",
    "stage",
    "clock",
    "median_ns",
    "low_ns",
    "high_ns",
    "samples",
    "submit_cost_median_ns",
    "resolution_ns",
    "photons",
    "triangles",
    "primitives",
    "fragments",
    "texel_fetches",
    "bytes_read",
    "bytes_written",
    "frame_untimed_median_ns",
    "frame_untimed_low_ns",
    "frame_untimed_high_ns",
    "frame_untimed_samples",
    "accounting_error",
    "timing_cost",
    "allocated_bytes",
    "warm_up_frames",
    "rejected_frames",
    "quantities",
];

fn export(view: &View<'_>) -> Result<Vec<Artifact>, ReportError> {
    let mut text = row(HEADER.map(str::to_owned).as_slice());
    for section in &view.sections {
        for entry in &section.entries {
            rows(entry, &mut text);
        }
    }
    Ok(vec![Artifact { name: EXPORTER.name.to_owned(), bytes: text.into_bytes() }])
}

fn rows(entry: &Entry<'_>, text: &mut String) {
    match &entry.cell.outcome {
        Outcome::Measured(measured) => {
            for stage in &measured.stages {
                let mut fields = identity(entry, "measured", "");
                fields.extend(stage_fields(stage));
                fields.extend(frame_fields(measured));
                *text += &row(&fields);
            }
        }
        Outcome::Skipped { reason } => *text += &unmeasured(entry, "skipped", reason),
        Outcome::Failed { reason } => *text += &unmeasured(entry, "failed", reason),
    }
}

fn unmeasured(entry: &Entry<'_>, status: &str, reason: &str) -> String {
    let mut fields = identity(entry, status, reason);
    fields.resize(HEADER.len(), String::new());
    row(&fields)
}

fn identity(entry: &Entry<'_>, status: &str, reason: &str) -> Vec<String> {
    let cell = entry.cell;
    let adapter = entry.run.map(|run| &run.adapter);
    vec![
        cell.experiment.clone(),
        cell.cell.clone(),
        cell.pipeline.clone(),
        cell.scene.clone(),
        cell.stand_ins.join("; "),
        adapter.map_or_else(String::new, |adapter| adapter.name.clone()),
        adapter.map_or_else(String::new, |adapter| adapter.software.to_string()),
        entry.run.map_or_else(String::new, |run| run.profile.clone()),
        status.to_owned(),
        reason.to_owned(),
    ]
}

fn stage_fields(stage: &StageRecord) -> Vec<String> {
    let clock = serde_json::to_value(stage.clock).unwrap_or_default();
    let mut fields = vec![stage.stage.clone(), clock.as_str().unwrap_or_default().to_owned()];
    fields.extend(time_fields(stage));
    let work = &stage.work;
    let counts = [
        work.photons,
        work.triangles,
        work.primitives,
        work.fragments,
        work.texel_fetches,
        work.bytes_read,
        work.bytes_written,
    ];
    fields.extend(counts.map(|count| count.to_string()));
    fields
}

/// No figures of a time that is below the resolution, which then stands alone.
fn time_fields(stage: &StageRecord) -> Vec<String> {
    let mut fields = estimate_fields(&stage.time);
    if !stage.is_resolved() {
        fields[..3].fill(String::new());
    }
    let cost_ns = |fenced: &Fenced| median(&fenced.submit_cost_samples_ns).to_string();
    let resolution_ns = |fenced: &Fenced| fenced.resolution_ns.to_string();
    let fenced = stage.fenced.as_ref();
    fields.push(fenced.map(cost_ns).unwrap_or_default());
    fields.push(fenced.map(resolution_ns).unwrap_or_default());
    fields
}

fn frame_fields(measured: &Measured) -> Vec<String> {
    let frame = &measured.frame;
    let rejected: u32 = measured.rejected.values().sum();
    let quantities: Vec<String> =
        measured.figures().iter().map(|(name, value)| format!("{name}={value}")).collect();
    let mut fields = estimate_fields(&frame.untimed);
    fields.extend([
        frame.accounting_error.to_string(),
        frame.timing_cost.median.to_string(),
        measured.allocated_bytes.to_string(),
        measured.warm_up_frames.to_string(),
        rejected.to_string(),
        quantities.join("; "),
    ]);
    fields
}

fn estimate_fields(estimate: &Estimate) -> Vec<String> {
    vec![
        estimate.median.to_string(),
        estimate.low.to_string(),
        estimate.high.to_string(),
        estimate.n.to_string(),
    ]
}

/// One line of CSV, CRLF at the end.
fn row(fields: &[String]) -> String {
    let fields: Vec<String> = fields.iter().map(|field| text::csv(field)).collect();
    fields.join(",") + "\r\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Record;
    use crate::report::fixtures;

    #[test]
    fn fields_are_quoted_as_rfc_4180_has_it() {
        let fields = ["plain", "a,b", "say \"x\"", "two\nlines", ""].map(str::to_owned);
        assert_eq!(row(&fields), "plain,\"a,b\",\"say \"\"x\"\"\",two lines,\r\n");
    }

    #[test]
    fn every_row_has_every_column() {
        let records = fixtures::run();
        let files = export(&View::new(&records, &[])).unwrap();
        let text = String::from_utf8(files[0].bytes.clone()).unwrap();
        let mut columns = Vec::new();
        for line in text.split_terminator("\r\n") {
            let mut quoted = false;
            let commas = line.chars().filter(|c| {
                quoted ^= *c == '"';
                *c == ',' && !quoted
            });
            columns.push(commas.count() + 1);
        }
        assert!(columns.len() > 20);
        assert!(columns.iter().all(|count| *count == HEADER.len()));
        assert!(text.contains(",skipped,"));
    }

    #[test]
    fn a_time_below_the_resolution_has_no_figures_but_its_bound() {
        let mut records = fixtures::run();
        let stages = records.iter_mut().find_map(|record| match record {
            Record::Cell(cell) => match &mut cell.outcome {
                Outcome::Measured(measured) => Some(&mut measured.stages),
                _ => None,
            },
            _ => None,
        });
        let stage = &mut stages.unwrap()[0];
        stage.time = Estimate { median: 5e4, low: 5e4, high: 6e4, n: 7 };
        stage.fenced = Some(Fenced {
            wall_samples_ns: vec![6e4; 7],
            submit_cost_samples_ns: vec![6e4; 7],
            resolution_ns: 5e4,
        });
        assert_eq!(time_fields(stage), ["", "", "", "7", "60000", "50000"]);
        let text = crate::report::format::stage_ms(stage);
        assert_eq!(text, "< 0.0500");
        let exporter = crate::report::summary::EXPORTER;
        let page = (exporter.export)(&View::new(&records, &[])).unwrap();
        let page = String::from_utf8(page[0].bytes.clone()).unwrap();
        assert!(page.contains("| &lt; 0.0500 |"), "{page}");
        assert!(page.contains("no ratio or slope is drawn"));
    }
}

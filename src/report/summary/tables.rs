//! The summary's tables: claims, where the time goes, and how it scales.

use itertools::Itertools;

use super::super::facts::{self, Exponent, Representative, RuledClaim, StageShare};
use super::super::format::{self, Table, percent, si};
use super::super::{ReportView, Section, charts};
use super::{cut, link};
use fathom_base::text;
use fathom_experiments::{RuledFigure, Ruling, Verdict, Whose};

/// Rows for the claims of each verdict.
const MOST_CONTRADICTED: usize = 16;
const MOST_NEAR_BOUND: usize = 8;
const MOST_INCONCLUSIVE: usize = 4;
const MOST_NOT_RUN: usize = 4;
/// Experiments whose supported claims are named.
const MOST_SUPPORTED: usize = 14;
/// Own hypotheses beside the papers' claims.
const MOST_OF_OTHERS: usize = 8;
/// Rows of all frames.
const MOST_OF_FRAMES: usize = 46;
/// Stages below this share of a frame stand in one row.
const SMALL_SHARE: f64 = 0.04;
const MOST_EXPONENTS: usize = 26;

/// Adds a table of Markdown with a row for each of these below the words, and how many do not fit; nothing where there are none.
fn add<T, const N: usize>(
    text: &mut String,
    above: &str,
    head: [&str; N],
    (of, most): (Vec<T>, usize),
    row: impl Fn(T) -> Option<[String; N]>,
) {
    let (of, more) = cut(of, most);
    let mut table = Table::new(head);
    of.into_iter().filter_map(row).for_each(|row| table.row_of_markdown(row));
    table.add_to(text, &format!("{above}{more}\n\n"));
}

/// The contradicted first, the supported by experiment.
pub fn claims(view: &ReportView<'_>, text: &mut String) {
    let claims = facts::claims(view);
    if claims.is_empty() {
        return;
    }
    *text += "## Claims\n\nAn interval for the claim is wider than the 95 % interval of the same figure in plots and other tables: it allows \
              for several looks at the samples and, where the claim is contradicted, for its number of comparisons.\n\n";
    let mut parts = facts::tallies(view).map(|(whose, _)| whose);
    if let Some(whose) = parts.next() {
        *text += &format!("### {}\n\n", whose.title());
        by_verdict(&claims, whose, text);
    }
    for whose in parts {
        let of = claims.iter().copied().filter(|claim| claim.ruling.whose == whose).collect();
        let head = ["verdict", "claim", "plot", "measured (interval), or why not"];
        add(text, &format!("### {}", whose.title()), head, (of, MOST_OF_OTHERS), |claim| {
            let ruling = claim.ruling;
            let figure = ruling.deciding.first();
            let told = figure.map_or_else(|| ruling.reason.clone(), RuledFigure::text);
            let [claimed, told] = [&ruling.text, &told].map(|told| text::markdown(told));
            Some([ruling.marked(), claimed, plot(claim.section), told])
        });
    }
}

fn by_verdict(claims: &[RuledClaim<'_, '_>], whose: Whose, text: &mut String) {
    let of = |verdict: Verdict| -> Vec<RuledClaim<'_, '_>> {
        let is_of = |claim: &&RuledClaim<'_, '_>| {
            claim.ruling.whose == whose && claim.ruling.verdict == verdict
        };
        claims.iter().filter(is_of).copied().collect()
    };
    let head = ["claim", "plot", "figure", "measured (interval)", "asked for", "published"];
    add(text, "Contradicted", head, (of(Verdict::Contradicted), MOST_CONTRADICTED), measured);
    add(text, "Near the bound", head, (of(Verdict::NearBound), MOST_NEAR_BOUND), measured);
    add(text, "Inconclusive", head, (of(Verdict::Inconclusive), MOST_INCONCLUSIVE), measured);
    let not_run = (of(Verdict::NotRun), MOST_NOT_RUN);
    add(text, "Not run", ["claim", "plot", "reason"], not_run, |claim| {
        let [told, reason] =
            [&claim.ruling.text, &claim.ruling.reason].map(|told| text::markdown(told));
        Some([told, plot(claim.section), reason])
    });
    let supported = of(Verdict::Supported);
    let supported = supported.chunk_by(|a, b| a.section.id == b.section.id).collect();
    add(text, "Supported", ["plot", "claims"], (supported, MOST_SUPPORTED), |claims| {
        let each = claims.iter().map(|claim| text::markdown(&marked_text(claim.ruling))).join("; ");
        Some([plot(claims[0].section), each])
    });
}

/// With the figure that decided.
fn measured(RuledClaim { section, ruling }: RuledClaim<'_, '_>) -> Option<[String; 6]> {
    let figure = ruling.deciding.first()?;
    let published = ruling.published.map_or_else(|| "–".to_owned(), |value| value.to_string());
    let [claim, name, measured, asked] =
        [&marked_text(ruling), &figure.name, &figure.text(), &figure.asked()]
            .map(|told| text::markdown(told));
    Some([claim, plot(section), name, measured, asked, published])
}

/// The claim with the mark of its verdict, which the table's heading tells.
fn marked_text(ruling: &Ruling) -> String {
    format!("{}{}", ruling.text, ruling.mark())
}

/// The experiment's name, linked to its plot where it has one.
fn plot(section: &Section<'_>) -> String {
    if section.figure().svg.is_some() {
        link(section.id, &charts::file_name(section))
    } else {
        text::markdown(section.id)
    }
}

/// A frame for each pipeline, by stage.
pub fn frames(view: &ReportView<'_>, text: &mut String) {
    let rows: Vec<[String; 4]> = facts::representatives(view).iter().flat_map(rows).collect();
    let about = "## Where the time goes\n\n\
                 A frame for each pipeline: of those with every stage above the clock's resolution the one nearest to the defaults, \
                 by the parameters that its experiment sets. Medians with 95 % intervals.";
    let head = ["frame", "stage", "time (ms)", "share of the stages"];
    add(text, about, head, (rows, MOST_OF_FRAMES), Some);
}

/// The frame's longest stages, and the sum of its short ones.
fn rows(frame: &Representative<'_>) -> Vec<[String; 4]> {
    let mut stages = frame.stages();
    stages.sort_by(|a, b| b.share.median.total_cmp(&a.share.median));
    let (long, short): (Vec<_>, Vec<_>) =
        stages.into_iter().partition(|stage| stage.share.median >= SMALL_SHARE);
    let mut rows: Vec<[String; 4]> = long.iter().map(of_stage).collect();
    rows.extend(sum_of(&short));
    if let Some(first) = rows.first_mut() {
        first[0] = text::markdown(&format!(
            "{} ({} {}, {}, n = {})",
            frame.cell.pipeline,
            frame.cell.experiment,
            frame.cell.cell,
            frame.conditions(),
            frame.measured.frame.untimed.n
        ));
    }
    rows
}

fn of_stage(stage: &StageShare<'_>) -> [String; 4] {
    let bound = if stage.stage.is_resolved() { "" } else { "< " };
    [
        String::new(),
        stage.stage.stage.to_string(),
        format::stage_ms(stage.stage),
        format!("{bound}{}", facts::share(&stage.share)),
    ]
    .map(|cell| text::markdown(&cell))
}

fn sum_of(short: &[StageShare<'_>]) -> Option<[String; 4]> {
    let time: f64 = short.iter().map(|stage| stage.stage.time.median).sum();
    let share: f64 = short.iter().map(|stage| stage.share.median).sum();
    (!short.is_empty()).then(|| {
        [
            String::new(),
            if short.len() == 1 { "1 other".to_owned() } else { format!("{} others", short.len()) },
            format::three(time / format::NS_PER_MS),
            percent(share),
        ]
    })
}

/// Fitted exponents.
pub fn scaling(view: &ReportView<'_>, text: &mut String) {
    let about = "## How it scales\n\n\
                 Exponents b of y ∝ xᵇ, fitted to the cells whose fixed cost is at most a tenth of the time: 1 is linear. The \
                 interval is that of 95 % over the rounds of sampling, or the extremes with one cell left out where figures are exact. \
                 *Of medians*: cells were measured apart, so medians are fitted, and the interval is by resampling each cell.";
    let head = ["plot", "what", "over", "exponent (interval)", "range", "cells"];
    add(text, about, head, (facts::exponents(view), MOST_EXPONENTS), of_fit);
}

fn of_fit(exponent: Exponent<'_, '_>) -> Option<[String; 6]> {
    let what = match exponent.group.as_str() {
        "" => exponent.y_title(),
        group => format!("{} ({group})", exponent.y_title()),
    };
    let (low, high) = exponent.fit.range;
    Some([
        plot(exponent.section),
        text::markdown(&what),
        text::markdown(&exponent.x_title()),
        exponent.text(),
        format!("{} – {}", si(low), si(high)),
        exponent.fit.slope.n.to_string(),
    ])
}

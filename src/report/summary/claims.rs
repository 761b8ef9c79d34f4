//! Claims: the contradicted first, the supported by experiment.

use itertools::Itertools;

use super::super::facts::{self, RuledClaim};
use super::super::format::Table;
use super::super::{ReportView, Section, plots};
use super::{cut, link};
use fathom_base::text;
use fathom_experiments::Verdict;

/// Rows for the claims of each verdict.
const MOST_CONTRADICTED: usize = 21;
const MOST_INCONCLUSIVE: usize = 5;
const MOST_NOT_RUN: usize = 4;
/// Experiments whose supported claims are named.
const MOST_SUPPORTED: usize = 26;

pub fn write(view: &ReportView<'_>, text: &mut String) {
    let claims = facts::claims(view);
    if claims.is_empty() {
        return;
    }
    *text += "## Claims\n\n";
    let of = |verdict: Verdict| -> Vec<RuledClaim<'_, '_>> {
        claims.iter().copied().filter(|claim| claim.ruling.verdict == verdict).collect()
    };
    measured("Contradicted", of(Verdict::Contradicted), MOST_CONTRADICTED, text);
    measured("Inconclusive", of(Verdict::Inconclusive), MOST_INCONCLUSIVE, text);
    not_run(of(Verdict::NotRun), text);
    supported(&of(Verdict::Supported), text);
}

/// A row each, with the figure that decided.
fn measured(title: &str, claims: Vec<RuledClaim<'_, '_>>, most: usize, text: &mut String) {
    let (claims, more) = cut(claims, most);
    let head = "claim|plot|figure|measured (interval)|asked for|published";
    let mut table = Table::new(head.split('|'));
    for RuledClaim { section, ruling } in claims {
        let Some(figure) = ruling.deciding.first() else { continue };
        let published = ruling.published.map_or_else(|| "–".to_owned(), |value| value.to_string());
        table.row_of_markdown([
            text::markdown(&ruling.text),
            plot(section),
            text::markdown(&figure.name),
            text::markdown(&figure.text()),
            text::markdown(&figure.asked()),
            published,
        ]);
    }
    table.add_to(text, &format!("### {title}{more}\n\n"));
}

fn not_run(claims: Vec<RuledClaim<'_, '_>>, text: &mut String) {
    let (claims, more) = cut(claims, MOST_NOT_RUN);
    let mut table = Table::new(["claim", "plot", "reason"]);
    for RuledClaim { section, ruling } in claims {
        let [claim, reason] = [&ruling.text, &ruling.reason].map(|text| text::markdown(text));
        table.row_of_markdown([claim, plot(section), reason]);
    }
    table.add_to(text, &format!("### Not run{more}\n\n"));
}

/// A row per experiment.
fn supported(claims: &[RuledClaim<'_, '_>], text: &mut String) {
    let by_section = claims.iter().chunk_by(|claim| claim.section.id);
    let rows: Vec<[String; 2]> = by_section
        .into_iter()
        .map(|(_, claims)| {
            let claims: Vec<&RuledClaim<'_, '_>> = claims.collect();
            let each = claims.iter().map(|claim| text::markdown(&claim.ruling.text)).join("; ");
            [plot(claims[0].section), each]
        })
        .collect();
    let (rows, more) = cut(rows, MOST_SUPPORTED);
    let mut table = Table::new(["plot", "claims"]);
    rows.into_iter().for_each(|row| table.row_of_markdown(row));
    table.add_to(text, &format!("### Supported{more}\n\n"));
}

/// The experiment's name, linked to its plot where it has one.
pub fn plot(section: &Section<'_>) -> String {
    if section.figure().svg.is_some() {
        link(section.id, &plots::file_name(section))
    } else {
        text::markdown(section.id)
    }
}

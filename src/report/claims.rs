//! A table of the papers' claims: paper and item, the sentence, the figure that it prints, experiment, verdict and balance.

use indexmap::IndexMap;
use serde_json::{Map, Value};

use super::document::{Block, Table, markdown};
use super::page::setting_words;
use super::{Exporter, Report, RunExporter, RunFormat, Section, Timing, facts};
use fathom_experiments::schema::{Balance, Claim};
use fathom_experiments::{ClaimOrigin, Ruling, flatten};
use fathom_record::Run;

pub const EXPORTER: RunExporter = Exporter {
    name: "claims",
    about: "the papers' claims as Markdown: item, experiment, verdict, balance",
    file: "claims-of-the-papers.md",
    written: Timing::OnRequest,
    export: RunFormat::One(export),
};

const HEAD: [&str; 8] = [
    "paper item",
    "claim",
    "printed",
    "experiment",
    "verdict",
    "balance",
    "what else could make it true",
    "what would break it",
];

struct ClaimRow<'v, 'a> {
    section: &'v Section<'a>,
    claim: &'v Claim,
    ruling: &'v Ruling,
}

fn export(view: &Report<'_>) -> String {
    let rows: Vec<ClaimRow<'_, '_>> = view.sections.iter().flat_map(rows).collect();
    let (of_papers, own): (Vec<_>, Vec<_>) =
        rows.into_iter().partition(|row| row.claim.origin() == ClaimOrigin::Publication);
    let mut parts = vec![Block::paragraph(
        "`fathom export claims RUN` writes this page from the records of a run. A claim of a paper is tested only on cells that run the \
         paper's own method. Where its balance counts, it is tested only where triangles, pixels, voxels and photons are to each other as in \
         the paper, within a factor of 2. Our bound: the paper prints no number, so that the band is this project's choice; a figure that \
         is not told from it is near the bound.",
    )];
    parts.extend(view.run().map(|run| {
        let (adapter, program) = (run.adapter.title(), facts::program(run));
        let Run { profile, started_at, .. } = run;
        Block::paragraph(format!(
            "The run: {adapter}, profile {profile}, {program}, started {started_at}."
        ))
    }));
    let mut papers = IndexMap::<&str, Vec<ClaimRow<'_, '_>>>::new();
    for row in of_papers {
        papers.entry(paper(row.claim)).or_default().push(row);
    }
    papers.sort_unstable_keys();
    let mut add = |title: &str, about: Option<&str>, table: Table| {
        if !table.rows.is_empty() {
            parts.push(Block::Title(title.into()));
            parts.extend(about.map(Block::paragraph));
            parts.push(Block::Table(table));
        }
    };
    for (paper, mut rows) in papers {
        rows.sort_by_key(|row| item(row.claim));
        add(paper, None, table(&rows));
    }
    add("Own hypotheses", Some("No paper contains these sentences."), table(&own));
    let about = "What the experiments set for claims of the papers.";
    add("The papers' methods", Some(about), methods(view));
    format!("# Claims of the papers\n\n{}", markdown(&parts))
}

fn rows<'v, 'a>(section: &'v Section<'a>) -> impl Iterator<Item = ClaimRow<'v, 'a>> {
    section.claims().map(move |(claim, ruling)| ClaimRow { section, claim, ruling })
}

/// `SPT` of `SPT §4, Table 1`.
fn paper(claim: &Claim) -> &str {
    claim.source.as_deref().unwrap_or_default().split(' ').next().unwrap_or_default()
}

/// `§4, Table 1` of `SPT §4, Table 1`.
fn item(claim: &Claim) -> &str {
    claim.source.as_deref().and_then(|source| source.split_once(' ')).map_or("", |(_, item)| item)
}

fn table(rows: &[ClaimRow<'_, '_>]) -> Table {
    let fields = rows.iter().map(|ClaimRow { section, claim, ruling }| {
        [
            item(claim).to_owned(),
            claim.text.clone(),
            claim.printed.clone().unwrap_or_else(|| "–".to_owned()),
            section.id.to_owned(),
            verdict(ruling),
            balance(claim, ruling).unwrap_or_else(|| "–".to_owned()),
            claim.otherwise.clone(),
            claim.broken_by.what.clone(),
        ]
    });
    Table::new("Claims", HEAD).with_rows(fields)
}

/// With the figure that decided, or the reason why nothing did.
fn verdict(ruling: &Ruling) -> String {
    match ruling.deciding.first() {
        Some(figure) => {
            format!("{}: {} where {} is asked", ruling.marked(), figure.text(), figure.limits())
        }
        None => format!("{}: {}", ruling.marked(), ruling.reason),
    }
}

fn methods(view: &Report<'_>) -> Table {
    let rows = view.sections.iter().filter_map(|section| {
        let method = &section.experiment.as_ref()?.method;
        (!method.is_empty()).then(|| [section.id.to_owned(), format_settings(method)])
    });
    Table::new("Methods", ["experiment", "settings"]).with_rows(rows)
}

/// At which sizes a claim was tested, or why that does not matter.
pub fn balance(claim: &Claim, ruling: &Ruling) -> Option<String> {
    match (claim.balance.as_ref()?, ruling.scale) {
        (Balance::Free(reason), _) => Some(format!("free: {reason}")),
        (Balance::Published, Some(scale)) => Some(format!("the paper's, {scale}")),
        (Balance::Published, None) => Some("the paper's: not met".to_owned()),
    }
}

pub fn format_settings(settings: &Map<String, Value>) -> String {
    let settings = flatten(settings);
    setting_words(settings.iter().map(|(path, value)| (path, value)))
}

#[cfg(test)]
mod tests {
    use itertools::Itertools;

    use super::*;
    use crate::testing;
    use fathom_base::text;

    #[test]
    fn every_claim_has_a_row_below_its_paper() {
        let view = testing::view();
        let text = export(&view);
        let rows = view.sections.iter().flat_map(rows).collect_vec();
        for row in &rows {
            let [told, id] = [&*row.claim.text, row.section.id].map(text::markdown);
            let is_row = |line: &&str| line.contains(&told) && line.contains(&format!("| {id} |"));
            let line = text.lines().find(is_row).expect(&told);
            assert!(line.contains(&row.ruling.verdict.to_string()), "{line}");
            let above = &text[..text.find(line).unwrap()];
            let heading = above.rsplit("\n## ").next().unwrap().lines().next().unwrap();
            let expected = match row.claim.origin() {
                ClaimOrigin::Publication => paper(row.claim),
                ClaimOrigin::Own => ClaimOrigin::Own.title(),
            };
            assert_eq!(heading, expected, "{line}");
        }
        assert!(rows.len() > 50);
    }
}

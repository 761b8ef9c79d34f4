//! Each claim with its verdict, and the figure that decided beside the band that it must lie in.

use indexmap::IndexMap;
use itertools::Itertools;
use maud::Markup;

use super::{Fold, Page, PageSection};
use crate::charts::strip;
use crate::claims::{balance, format_settings};
use crate::document::{self, Block, ColumnKind, Line, Span, Table, Tone};
use crate::format::three;
use crate::{Report, Section};
use fathom_experiments::schema::Claim;
use fathom_experiments::{ClaimOrigin, RuledFigure, Ruling, Verdict};
use fathom_record::{Estimate, Interval};

pub const SECTION: PageSection = PageSection {
    id: "claims",
    title: "Claims",
    question: "Which claims of the papers hold, and by how much do others fail?",
    fold: Fold::Folded,
    write: |page| document::html_if_any(parts(page)),
};

/// Share of the spread of a row's figures that is shown beyond them.
const ROOM: f64 = 0.25;

/// A claim with its rulings in several runs.
pub(crate) struct RuledClaim<'a> {
    pub section: &'a Section<'a>,
    pub claim: &'a Claim,
    pub rulings: Vec<RunRuling<'a>>,
}

pub(crate) struct RunRuling<'a> {
    /// Place of the run among the others.
    pub run: usize,
    /// As the run defines it.
    pub claim: &'a Claim,
    pub ruling: &'a Ruling,
}

impl RuledClaim<'_> {
    /// The worst verdict of all runs.
    fn verdict(&self) -> Verdict {
        self.verdicts().min().unwrap_or(Verdict::NotRun)
    }

    pub fn verdicts(&self) -> impl Iterator<Item = Verdict> {
        self.rulings.iter().map(|of_run| of_run.ruling.verdict)
    }

    /// How far the furthest figure of any run lies outside its band.
    fn excess(&self) -> f64 {
        let figures = self.rulings.iter().filter_map(|of_run| of_run.ruling.deciding.first());
        figures.map(RuledFigure::excess).fold(0.0, f64::max)
    }
}

pub fn parts(page: &Page<'_>) -> Vec<Block> {
    let mut rows = ruled_claims(page.runs.iter().map(|run| run.view));
    if rows.is_empty() {
        return Vec::new();
    }
    rows.sort_by(|a, b| {
        a.verdict().cmp(&b.verdict()).then_with(|| b.excess().total_cmp(&a.excess()))
    });
    let lead = "A claim is supported if the interval of its figure lies inside the band, contradicted if it lies outside, near the \
         bound if the bound is our own and the figure is not told from it, and otherwise inconclusive. \
         Claims are read once, when sampling has ended. Where one of several figures contradicts a claim, its interval is wider than 95 %, as each \
         could do so by chance. On the page the dot is the \
         measured figure, the line its interval, the shaded part the claim's band, and the diamond the published figure.";
    let of =
        |whose| part(page, whose, rows.iter().filter(|row| row.claim.origin() == whose).collect());
    std::iter::once(Block::paragraph(lead))
        .chain(ClaimOrigin::ALL.into_iter().flat_map(of))
        .collect()
}

/// The papers' claims, or own hypotheses: those that are not supported first.
fn part(page: &Page<'_>, whose: ClaimOrigin, rows: Vec<&RuledClaim<'_>>) -> Vec<Block> {
    if rows.is_empty() {
        return Vec::new();
    }
    let mut groups = rows.into_iter().into_group_map_by(|row| match row.verdict() {
        verdict @ (Verdict::Supported | Verdict::NotRun) => Some(verdict),
        _ => None,
    });
    let about = match whose {
        ClaimOrigin::Publication => "Each is tested with the method that its paper describes.",
        ClaimOrigin::Own => {
            "No paper contains these sentences: this project or a user states them."
        }
    };
    let title = whose.title();
    let table = |rows: &[&RuledClaim<'_>], words: &str| {
        Block::Table(table_of(page, rows, &format!("{title} that are {words}")))
    };
    let mut parts = vec![Block::Heading(title.into()), Block::paragraph(about)];
    let open = groups.remove(&None).map(|open| table(&open, "not supported"));
    parts.extend(open);
    for verdict in [Verdict::Supported, Verdict::NotRun] {
        let rows = groups.remove(&Some(verdict)).unwrap_or_default();
        let words = format!("{} {whose} {verdict}", rows.len());
        let folded = (!rows.is_empty()).then(|| vec![table(&rows, &verdict.to_string())]);
        parts.extend(folded.map(|table| Block::Fold(words.into(), table)));
    }
    parts
}

fn table_of(page: &Page<'_>, rows: &[&RuledClaim<'_>], about: &str) -> Table {
    let columns =
        ["Verdict", "Claim", "Measured (interval)", "Against its band", "Band", "Published"];
    let fields = rows.iter().flat_map(|row| fields(page, row));
    Table::new(about, columns)
        .with(ColumnKind::Sentences, &columns[1..2])
        .with(ColumnKind::Numbers, &columns[4..])
        .with(ColumnKind::Drawings, &columns[3..4])
        .with_class("claims")
        .with_rows(fields)
}

/// Claims in the order of their experiments, each once.
pub(crate) fn ruled_claims<'a>(views: impl Iterator<Item = &'a Report<'a>>) -> Vec<RuledClaim<'a>> {
    let mut rows = IndexMap::<(&str, &str), RuledClaim<'_>>::new();
    for (run, view) in views.enumerate() {
        for section in &view.sections {
            for (claim, ruling) in section.claims() {
                let row = rows.entry((section.id, &claim.id));
                let row = row.or_insert_with(|| RuledClaim { section, claim, rulings: Vec::new() });
                row.rulings.push(RunRuling { run, claim, ruling });
            }
        }
    }
    rows.into_values().collect()
}

/// A row for each run.
fn fields(page: &Page<'_>, row: &RuledClaim<'_>) -> Vec<[Line; 6]> {
    let (claim, ends) = (row.claim, ends(row));
    let of_run = |(index, of_run): (usize, &RunRuling<'_>)| {
        let ruling = of_run.ruling;
        let mut sentence = Line::default();
        if index == 0 {
            sentence = Line::from(claim.text.as_str()).and(" ").and(row.section.span());
        }
        if page.is_overlay() {
            sentence = sentence.and(Span::Faint(format!(" {}", page.runs[of_run.run].label)));
        }
        let reason = Block::paragraph(ruling.reason.as_str());
        let why = [Some(reason), comparisons(ruling), Some(grounds(claim, ruling))];
        let why = Block::Fold("why".into(), why.into_iter().flatten().collect());
        let [measured, drawn, asked] = match ruling.deciding.first() {
            Some(figure) => {
                let n = figure.n.map_or_else(String::new, |n| format!(", n = {n}"));
                let name = Span::Faint(format!(" {}{n}", figure.name));
                let drawn = Span::Drawn(picture(ends, figure, claim.published));
                [Line::from(figure.text()).and(name), drawn.into(), figure.limits().into()]
            }
            None => [ruling.reason.as_str().into(), Line::default(), "–".into()],
        };
        [
            verdict_mark(ruling).into(),
            sentence.and(Span::Drawn(document::html(&[why]))),
            measured,
            drawn,
            asked,
            claim.published.map_or_else(|| "–".to_owned(), three).into(),
        ]
    };
    row.rulings.iter().enumerate().map(of_run).collect()
}

/// Whose sentence it is, at which sizes it was tested, and what else could make it true.
fn grounds(claim: &Claim, ruling: &Ruling) -> Block {
    let rows = [
        ("Source", claim.source.clone()),
        ("Printed", claim.printed.clone()),
        ("Method", (!claim.method.is_empty()).then(|| format_settings(&claim.method))),
        ("Balance", balance(claim, ruling)),
        ("What else could make it true", Some(claim.otherwise.clone())),
        ("What would break it", Some(claim.broken_by.what.clone())),
    ];
    let line = |(about, words): (&str, Option<String>)| {
        let words = words.filter(|words| !words.is_empty())?;
        Some(Line::from(Span::Faint(format!("{about}: "))).and(words))
    };
    Block::list(rows.into_iter().filter_map(line))
}

/// Every comparison of a claim that has several.
fn comparisons(ruling: &Ruling) -> Option<Block> {
    let all = || ruling.deciding.iter().chain(&ruling.others);
    let columns = ["Verdict", "Comparison", "Measured (interval)", "Band"];
    let row = |figure: &RuledFigure| -> [Line; 4] {
        let verdict = Span::Chip(Tone::from_verdict(figure.verdict), figure.verdict.to_string());
        [verdict.into(), figure.name.as_str().into(), figure.text().into(), figure.limits().into()]
    };
    let table = || {
        let table = Table::new("Comparisons", columns).with(ColumnKind::Numbers, &columns[2..]);
        Block::Table(table.with_rows(all().map(row)))
    };
    (all().count() > 1).then(table)
}

/// A verdict, told by a word, a mark and a colour, with its remark.
pub fn verdict_mark(ruling: &Ruling) -> Span {
    Span::Chip(Tone::from_verdict(ruling.verdict), ruling.marked())
}

/// Of one axis for a claim's figures of all runs, so that they can be compared by eye.
fn ends(row: &RuledClaim<'_>) -> [f64; 2] {
    let deciding = row.rulings.iter().filter_map(|of_run| of_run.ruling.deciding.first());
    let ends = deciding.flat_map(|deciding| {
        let Interval { low, high } = deciding.interval.unwrap_or(deciding.band);
        [deciding.value, low, high, deciding.band.low, deciding.band.high]
    });
    let values = ends.chain(row.claim.published).filter(|value| value.is_finite());
    let (low, high) = values.minmax().into_option().unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
    let room = ROOM * (high - low).max(1e-3 * high.abs().max(low.abs())).max(f64::MIN_POSITIVE);
    [low - room, high + room]
}

fn picture(ends: [f64; 2], deciding: &RuledFigure, published: Option<f64>) -> Markup {
    let RuledFigure { value, interval, band, .. } = *deciding;
    let figure = Estimate { median: value, interval, n: deciding.n.unwrap_or(1) };
    let tip = format!("{}: {} against {}", deciding.name, deciding.text(), deciding.limits());
    strip(ends, band, &figure, published, &tip)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn why_lists_every_comparison_with_its_own_verdict() {
        let view = testing::view();
        let sections = view.sections.iter();
        let rulings = sections.flat_map(|section| section.rulings());
        let mixed = rulings.filter(|ruling| !ruling.others.is_empty()).collect::<Vec<_>>();
        assert!(!mixed.is_empty());
        for ruling in mixed {
            let html = document::html(&[comparisons(ruling).unwrap()]).into_string();
            let rows = ruling.deciding.len() + ruling.others.len();
            assert_eq!(html.matches("<tr>").count(), rows + 1, "{html}");
            assert!(ruling.deciding.iter().all(|figure| figure.verdict == ruling.verdict));
            assert!(ruling.others.iter().all(|figure| figure.verdict > ruling.verdict));
        }
    }
}

//! Figures that publications state, beside those that the run measured at the same size.
//!
//! Frame rates of a software driver say nothing beside those of a GPU: there only ratios, slopes and errors are compared.

use indexmap::IndexSet;
use serde_json::Value;

use super::setting_words;
use super::{Fold, Page, PageRun, PageSection};
use crate::Section;
use crate::document::{self, Block, ColumnKind, Field, Line, Span, Table};
use crate::format::three;
use fathom_experiments::schema::{Published, Relation};
use fathom_experiments::{fits, flatten, fps};
use fathom_record::Estimate;

pub const SECTION: PageSection = PageSection {
    id: "published",
    title: "Published figures",
    question: "How do measured ratios compare with those of the papers?",
    fold: Fold::Folded,
    write: |page| document::html_if_any(parts(page)),
};

/// A published figure and the measured one.
struct Pair {
    /// Place of the run on the page.
    run: usize,
    published: f64,
    measured: f64,
    /// Of the interval; the figure twice where there is none.
    ends: [f64; 2],
    what: String,
}

fn parts(page: &Page<'_>) -> Vec<Block> {
    let of_runs = |pairs: fn(usize, &PageRun<'_>) -> Vec<Pair>| -> Vec<Pair> {
        page.runs.iter().enumerate().flat_map(|(place, run)| pairs(place, run)).collect()
    };
    let (ratios, rates) = (of_runs(ratios), of_runs(rates));
    let listed = listed(page);
    if ratios.is_empty() && listed.is_empty() {
        return Vec::new();
    }
    let lead = if ratios.is_empty() && rates.is_empty() {
        "No published frame rate can be compared with this run: no two of an experiment are of sizes that were measured."
    } else {
        "The last column is 1 where a figure agrees with the publication. Intervals stand in brackets."
    };
    let mut parts = vec![Block::paragraph(lead)];
    for (about, pairs) in [
        ("Published and measured ratios", ratios),
        ("Published and measured frames per second", rates),
    ] {
        if !pairs.is_empty() {
            parts.extend([
                Block::Heading(about.into()),
                Block::Table(pairs_table(page, about, &pairs)),
            ]);
        }
    }
    if !listed.is_empty() {
        parts.push(rates_table(page, &listed));
    }
    parts
}

/// Ratios between published frame rates hold on any device.
fn ratios(place: usize, run: &PageRun<'_>) -> Vec<Pair> {
    let sections = run.view.sections.iter();
    sections.flat_map(|section| rate_pairs(place, section)).collect()
}

/// A published frame rate, and the frame time of the first cell of its size that was timed.
#[derive(Clone, Copy)]
struct MatchedCell<'p> {
    published: &'p Published,
    frame: &'p Estimate,
}

fn matched<'p>(section: &'p Section<'_>) -> Vec<MatchedCell<'p>> {
    let published = section.experiment.iter().flat_map(|experiment| &experiment.published);
    let with_cell = published.filter_map(|published| {
        let (_, measured) = section.timed().find(|(cell, _)| fits(cell, &published.filter))?;
        Some(MatchedCell { published, frame: &measured.frame.untimed })
    });
    with_cell.collect()
}

/// Each published frame rate over the latest one before it that differs in a single condition, such as the method. Bounds and
/// ranges have no ratio.
fn rate_pairs(run: usize, section: &Section<'_>) -> Vec<Pair> {
    let is_stated = |one: &MatchedCell<'_>| one.published.comparison == Relation::About;
    let stated: Vec<MatchedCell<'_>> = matched(section).into_iter().filter(is_stated).collect();
    let pair = |(place, one): (usize, &MatchedCell<'_>)| {
        let mut before = stated[..place].iter().rev();
        let base = before.find(|base| differing(one.published, base.published) == 1)?;
        Some(ratio(run, section.id, one, base))
    };
    stated.iter().enumerate().filter_map(pair).collect()
}

type Condition = (String, Value);

/// Conditions of the first figure that the second does not share, and those that both share.
fn split(one: &Published, other: &Published) -> [Vec<Condition>; 2] {
    let others = flatten(&other.filter);
    let (shared, own) = flatten(&one.filter).into_iter().partition(|one| others.contains(one));
    [own, shared]
}

/// In how many conditions two published figures differ.
fn differing(one: &Published, other: &Published) -> usize {
    split(one, other)[0].len().max(split(other, one)[0].len())
}

fn ratio(run: usize, experiment: &str, one: &MatchedCell<'_>, base: &MatchedCell<'_>) -> Pair {
    let ([low, high], [base_low, base_high]) = (one.frame.ends(), base.frame.ends());
    let [own, shared] = split(one.published, base.published);
    let [of_base, _] = split(base.published, one.published);
    let [own, of_base, shared] =
        [own, of_base, shared].map(|conditions| format_conditions(&conditions));
    let what = format!("{experiment}: frame rate of {own} over that of {of_base} ({shared})");
    Pair {
        run,
        published: one.published.fps / base.published.fps,
        measured: base.frame.median / one.frame.median,
        ends: [base_low / high, base_high / low],
        what,
    }
}

/// Frame rates of hardware; of a software driver none is compared.
fn rates(run: usize, on_page: &PageRun<'_>) -> Vec<Pair> {
    let sections = on_page.view.sections.iter().filter(|section| !section.software());
    let pairs = sections.flat_map(|section| {
        matched(section).into_iter().map(move |MatchedCell { published, frame }| {
            let rate = fps(frame);
            let what =
                format!("{}: {} fps ({})", section.id, published.figure(), conditions(published));
            Pair { run, published: published.fps, measured: rate.median, ends: rate.ends(), what }
        })
    });
    pairs.collect()
}

/// Where a published figure holds, in words: `scene: tank, width of the picture 800 px`.
fn conditions(published: &Published) -> String {
    format_conditions(&flatten(&published.filter))
}

fn format_conditions(conditions: &[Condition]) -> String {
    setting_words(conditions.iter().map(|(path, value)| (path, value)))
}

fn pairs_table(page: &Page<'_>, about: &str, pairs: &[Pair]) -> Table {
    let columns = ["What", "Published", "Measured (interval)", "Measured / published"];
    let rows = pairs.iter().map(|pair| {
        let [low, high] = pair.ends;
        let interval = (low < high).then(|| format!(" ({} – {})", three(low), three(high)));
        let measured = Line::from(three(pair.measured));
        let fields = [
            pair.what.as_str().into(),
            three(pair.published).into(),
            measured.and(Span::Faint(interval.unwrap_or_default())),
            three(pair.measured / pair.published).into(),
        ];
        page.run_fields(&page.runs[pair.run], fields.map(Field::from))
    });
    page.table(about, &columns)
        .with(ColumnKind::Sentences, &columns[..1])
        .with(ColumnKind::Numbers, &columns[1..])
        .with_rows(rows)
}

/// A published frame rate and where it holds.
#[derive(PartialEq, Eq, Hash)]
struct PublishedRow<'p> {
    experiment: &'p str,
    figure: String,
    conditions: String,
    hardware: &'p str,
    note: &'p str,
}

/// All published frame rates of the page's experiments, each once.
fn listed<'p>(page: &'p Page<'p>) -> IndexSet<PublishedRow<'p>> {
    let sections = page.runs.iter().flat_map(|run| &run.view.sections);
    let figures = sections.flat_map(|section| {
        let published = section.experiment.iter().flat_map(|experiment| &experiment.published);
        published.map(|one| PublishedRow {
            experiment: section.id,
            figure: one.figure(),
            conditions: conditions(one),
            hardware: &one.hardware,
            note: &one.note,
        })
    });
    figures.collect()
}

fn rates_table(page: &Page<'_>, listed: &IndexSet<PublishedRow<'_>>) -> Block {
    let is_software = page.runs.iter().any(|run| run.view.sections.iter().any(Section::software));
    let rows = listed.iter().map(|one| {
        let note = if one.note.is_empty() { String::new() } else { format!("; {}", one.note) };
        let of = format!("{}{note}", one.conditions);
        [one.experiment, one.figure.as_str(), of.as_str(), one.hardware].map(str::to_owned)
    });
    let columns = ["Experiment", "Frames per second", "Of", "Hardware"];
    let table = Table::new("Published frame rates", columns)
        .with(ColumnKind::Numbers, &columns[1..2])
        .with(ColumnKind::Sentences, &columns[2..3])
        .with_rows(rows);
    let words = format!("{} published frame rates, each with its hardware", listed.len());
    let note = is_software.then(|| Block::paragraph("They were measured on the hardware named. Frame rates of a software driver are not comparable with them, so none are shown."));
    Block::Fold(words.into(), note.into_iter().chain([Block::Table(table)]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Report;
    use crate::testing;
    use fathom_experiments::fixtures;
    use fathom_record::{Profile, Record};

    /// A run at the published sizes.
    fn records(software: bool) -> Vec<Record> {
        let mut records = fixtures::profile(Profile::Paper);
        for record in &mut records {
            if let Record::Run(run) = record {
                run.adapter.software = software;
            }
        }
        records
    }

    fn with_page<T>(records: &[Record], read: impl Fn(&Page<'_>) -> T) -> T {
        read(&testing::page(&[&Report::new(records, None)]))
    }

    fn section<'p>(page: &'p Page<'p>, id: &str) -> &'p Section<'p> {
        let mut sections = page.runs[0].view.sections.iter();
        sections.find(|section| section.id == id).unwrap()
    }

    #[test]
    fn frame_rates_are_compared_on_hardware_only() {
        for software in [true, false] {
            with_page(&records(software), |page| {
                let rates = rates(0, &page.runs[0]);
                assert_eq!(rates.is_empty(), software);
                let text = (SECTION.write)(page).unwrap().into_string();
                assert_eq!(text.contains("measured frames per second"), !software);
                assert!(text.contains("GeForce GTX 260"));
            });
        }
    }

    #[test]
    fn ratios_of_published_rates_are_those_of_the_measured_cells() {
        with_page(&records(true), |page| {
            let section = section(page, "spt-refraction");
            let (pairs, all) = (rate_pairs(0, section), matched(section));
            // The teapot in the larger viewport, traced, differs in both sides from all before.
            assert!(pairs.len() + 2 == all.len() && pairs.len() >= 8, "{}", pairs.len());
            let (trace, two_interface) = (all[0], all[1]);
            assert_eq!(pairs[0].published, two_interface.published.fps / trace.published.fps);
            assert_eq!(pairs[0].measured, trace.frame.median / two_interface.frame.median);
            for Pair { ends: [low, high], measured, .. } in &pairs {
                assert!(low <= measured && measured <= high);
            }
        });
    }

    #[test]
    fn bounds_and_ranges_have_no_ratio() {
        with_page(&records(true), |page| {
            let section = section(page, "uw-photons");
            assert!(matched(section).len() >= 2);
            assert_eq!(rate_pairs(0, section).len(), 0);
        });
    }

    #[test]
    fn a_run_without_published_figures_has_no_section() {
        assert_eq!(testing::written(SECTION.write, &[]), "");
    }
}

//! Figures that publications state, beside those that the run measured at the same size.
//!
//! Frame rates of a software driver say nothing beside those of a GPU: there only ratios, slopes and errors are compared.

use indexmap::IndexMap;
use serde_json::Value;

use super::setting_words;
use super::{Fold, Page, PageSection};
use crate::Section;
use crate::claims::format_settings;
use crate::document::{self, Block, ColumnKind, Field, Line, Span, Table};
use crate::format::{interval, three};
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

/// A ratio of published frame rates and the measured one.
struct PublishedPair {
    published: f64,
    measured: f64,
    /// Of the interval.
    ends: [f64; 2],
    what: String,
}

fn parts(page: &Page<'_>) -> Vec<Block> {
    let (ratios, listed) = (ratios_table(page), listed(page));
    let mut parts = Vec::new();
    if !ratios.rows.is_empty() {
        let about = "Ratios between published frame rates hold on any device. The last column is 1 where a figure agrees with the publication. \
                     Intervals stand in brackets.";
        parts.extend([Block::paragraph(about), Block::Table(ratios)]);
    }
    if !listed.is_empty() {
        parts.push(rates_table(page, &listed));
    }
    parts
}

/// A published frame rate, and the frame time of the first cell of its size that was timed.
#[derive(Clone, Copy)]
struct MatchedCell<'p> {
    published: &'p Published,
    frame: &'p Estimate,
}

fn matched<'p>(section: &'p Section<'_>) -> Vec<MatchedCell<'p>> {
    let published = section.experiment.iter().flat_map(|experiment| &experiment.published);
    let with_cell = published
        .filter_map(|published| Some(MatchedCell { published, frame: frame(section, published)? }));
    with_cell.collect()
}

fn frame<'p>(section: &'p Section<'_>, published: &Published) -> Option<&'p Estimate> {
    let (_, measured) = section.timed().find(|(cell, _)| fits(cell, &published.filter))?;
    Some(&measured.frame.untimed)
}

/// Each published frame rate over the latest one before it that differs in a single condition, such as the method. Bounds and
/// ranges have no ratio.
fn rate_pairs(section: &Section<'_>) -> Vec<PublishedPair> {
    let is_stated = |one: &MatchedCell<'_>| one.published.comparison == Relation::About;
    let stated: Vec<MatchedCell<'_>> = matched(section).into_iter().filter(is_stated).collect();
    let pair = |(place, one): (usize, &MatchedCell<'_>)| {
        let mut before = stated[..place].iter().rev();
        let base = before.find(|base| differing(one.published, base.published) == 1)?;
        Some(ratio(section.id, one, base))
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

fn ratio(experiment: &str, one: &MatchedCell<'_>, base: &MatchedCell<'_>) -> PublishedPair {
    let ([low, high], [base_low, base_high]) = (one.frame.ends(), base.frame.ends());
    let [own, shared] = split(one.published, base.published);
    let [of_base, _] = split(base.published, one.published);
    let [own, of_base, shared] =
        [own, of_base, shared].map(|conditions| format_conditions(&conditions));
    let what = format!("{experiment}: frame rate of {own} over that of {of_base} ({shared})");
    PublishedPair {
        published: one.published.fps / base.published.fps,
        measured: base.frame.median / one.frame.median,
        ends: [base_low / high, base_high / low],
        what,
    }
}

fn format_conditions(conditions: &[Condition]) -> String {
    setting_words(conditions.iter().map(|(path, value)| (path, value)))
}

fn ratios_table(page: &Page<'_>) -> Table {
    let columns = ["What", "Published", "Measured (interval)", "Measured / published"];
    let pairs = page.runs.iter().flat_map(|run| {
        let sections = run.view.sections.iter();
        sections.flat_map(rate_pairs).map(move |pair| (run, pair))
    });
    let rows = pairs.map(|(run, pair)| {
        let interval = format!(" ({} – {})", three(pair.ends[0]), three(pair.ends[1]));
        let fields = [
            pair.what.as_str().into(),
            three(pair.published).into(),
            Line::from(three(pair.measured)).and(Span::Faint(interval)),
            three(pair.measured / pair.published).into(),
        ];
        page.run_fields(run, fields.map(Field::from))
    });
    page.table("Published and measured ratios", &columns)
        .with(ColumnKind::Sentences, &columns[..1])
        .with(ColumnKind::Numbers, &columns[1..])
        .with_rows(rows)
}

/// A published frame rate and where it holds.
#[derive(PartialEq, Eq, Hash)]
struct PublishedRow<'p> {
    experiment: &'p str,
    figure: String,
    /// Such as `scene: tank, width of the picture 800 px`.
    conditions: String,
    hardware: &'p str,
    note: &'p str,
}

/// All published frame rates of the page's experiments, each once, with those that were measured on hardware.
fn listed<'p>(page: &'p Page<'p>) -> IndexMap<PublishedRow<'p>, Vec<String>> {
    let mut all = IndexMap::<_, Vec<String>>::new();
    for (run, section) in
        page.runs.iter().flat_map(|run| run.view.sections.iter().map(move |s| (run, s)))
    {
        for one in section.experiment.iter().flat_map(|experiment| &experiment.published) {
            let row = PublishedRow {
                experiment: section.id,
                figure: one.figure(),
                conditions: format_settings(&one.filter),
                hardware: &one.hardware,
                note: &one.note,
            };
            let measured = frame(section, one).filter(|_| !section.software());
            let label = if page.is_overlay() { format!("{}: ", run.label) } else { String::new() };
            let measured = measured.map(|frame| format!("{label}{}", interval(&fps(frame))));
            all.entry(row).or_default().extend(measured);
        }
    }
    all
}

fn rates_table(page: &Page<'_>, listed: &IndexMap<PublishedRow<'_>, Vec<String>>) -> Block {
    let is_software = page.runs.iter().any(|run| run.view.sections.iter().any(Section::software));
    let are_measured = listed.values().any(|measured| !measured.is_empty());
    let rows = listed.iter().map(|(one, measured)| {
        let note = if one.note.is_empty() { String::new() } else { format!("; {}", one.note) };
        let mut row = vec![one.experiment.to_owned(), one.figure.clone()];
        row.extend(are_measured.then(|| measured.join("; ")));
        row.extend([format!("{}{note}", one.conditions), one.hardware.to_owned()]);
        row
    });
    let mut columns = vec!["Experiment", "Frames per second", "Of", "Hardware"];
    if are_measured {
        columns.insert(2, "Measured (interval)");
    }
    let table = Table::new("Published frame rates", columns)
        .with(ColumnKind::Numbers, &["Frames per second", "Measured (interval)"])
        .with(ColumnKind::Sentences, &["Of"])
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
        let runs = records.iter_mut().filter_map(Record::try_as_run_mut);
        runs.for_each(|run| run.adapter.software = software);
        records
    }

    #[test]
    fn frame_rates_are_compared_on_hardware_only() {
        for software in [true, false] {
            let text = testing::written(SECTION.write, &records(software));
            let (rates, ratios) = (text.split("<details>").nth(1).unwrap(), "measured ratios");
            assert_eq!(rates.contains("Measured (interval)"), !software);
            assert!(text.contains(ratios) && rates.contains("GeForce GTX 260"), "{text}");
        }
        assert_eq!(testing::written(SECTION.write, &[]), "");
    }

    #[test]
    fn ratios_of_published_rates_are_those_of_the_measured_cells() {
        let records = records(true);
        let view = Report::new(&records, None);
        let section = |id: &str| view.sections.iter().find(|section| section.id == id).unwrap();
        let refraction = section("spt-refraction");
        let (pairs, all) = (rate_pairs(refraction), matched(refraction));
        // The teapot in the larger viewport, traced, differs in both sides from all before.
        assert!(pairs.len() + 2 == all.len() && pairs.len() >= 8, "{}", pairs.len());
        let (trace, two_interface) = (all[0], all[1]);
        assert_eq!(pairs[0].published, two_interface.published.fps / trace.published.fps);
        assert_eq!(pairs[0].measured, trace.frame.median / two_interface.frame.median);
        for PublishedPair { ends: [low, high], measured, .. } in &pairs {
            assert!(low <= measured && measured <= high);
        }
        // Bounds and ranges have no ratio.
        let photons = section("uw-photons");
        assert!(matched(photons).len() >= 2 && rate_pairs(photons).is_empty());
    }
}

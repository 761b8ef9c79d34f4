//! One SVG per experiment, its panels one below the other. No font is needed to write it.
//!
//! Each panel begins with its title and the verdicts of the claims that speak of what it shows. Series are named at the ends of
//! their lines, and legends stand in rows above the data.

mod bars;
mod drawing;
mod lines;
mod map;
pub(super) mod names;
mod ratios;
mod roofline;
mod rows;
mod stacked;
mod style;

use indexmap::IndexSet;
use itertools::Itertools;
use maud::html;

use self::drawing::{Drawing, MARGIN_PX};
use super::colors::StageColors;
use super::{Artifact, Exporter, OfRun, ReportView, RunExporter, Section, Written};
use fathom_base::text;
use fathom_experiments as experiments;
use fathom_experiments::schema::{Experiment, Plot, PlotKind, Published};
use fathom_experiments::{Measure, Ruling};
use fathom_record::Cell;

pub use roofline::EXPORTER as ROOFLINES;

pub const EXPORTER: RunExporter = Exporter {
    name: "plots",
    about: "the plots of each experiment, SVG",
    file: "EXPERIMENT.svg",
    written: Written::WithEveryReport,
    export: OfRun::Several(export),
};

/// Heights of the picture's title and of a panel's, and what is left between panels.
const TITLE_PX: f64 = 36.0;
const HEADING_PX: f64 = 30.0;
const GAP_PX: f64 = 18.0;
/// Characters of 12-px type that fit into a line.
const LINE_CHARACTERS: usize = 134;

/// Cells of a plot beyond which it is not drawn: nobody can read it.
const MOST_CELLS: usize = 2_000;

/// What plots are made from.
#[derive(Clone)]
pub struct PlotInput<'s> {
    pub experiment: &'s Experiment,
    pub cells: Vec<&'s Cell>,
    pub rulings: &'s [Ruling],
    /// Measured on a software driver: published times are not drawn beside its own.
    pub software: bool,
    pub colors: &'s StageColors,
}

impl<'s> PlotInput<'s> {
    /// With the cells that a plot shows.
    fn of(&self, plot: &Plot) -> PlotInput<'s> {
        let belongs = |cell: &&Cell| {
            let on_axis = plot.over.as_ref().is_none_or(|over| cell.axes.contains_key(over));
            on_axis && experiments::fits(cell, &plot.filter)
        };
        PlotInput { cells: self.cells.iter().copied().filter(belongs).collect(), ..self.clone() }
    }

    /// The published frame time of a cell's size; none beside a software driver's.
    fn published(&self, cell: &Cell) -> Option<&'s Published> {
        self.experiment.published_for(cell).filter(|_| !self.software)
    }
}

/// An experiment's panels, and its plots that have none.
#[derive(Default)]
pub struct Figure {
    /// What holds for all of its cells.
    common: String,
    panels: Vec<Drawing>,
    /// Titles of the plots that have no panel, and why.
    pub missing: Vec<(String, &'static str)>,
}

impl Figure {
    pub fn new(input: &PlotInput<'_>) -> Figure {
        let mut figure = Figure { common: names::common(input), ..Figure::default() };
        for plot in &input.experiment.plot {
            match panel(plot, &input.of(plot)) {
                Ok(panel) => figure.panels.push(panel),
                Err(reason) => figure.missing.push((plot.title.clone(), reason)),
            }
        }
        figure
    }

    pub fn is_drawn(&self) -> bool {
        !self.panels.is_empty()
    }
}

pub fn file_name(section: &Section<'_>) -> String {
    format!("{}.svg", text::file_stem(section.id))
}

fn export(view: &ReportView<'_>) -> Vec<Artifact> {
    let drawn = view.sections.iter().filter(|section| section.figure().is_drawn());
    drawn.map(|section| Artifact::of(file_name(section), svg(view, section))).collect()
}

/// A plot below its title, the verdicts and the published figures that belong to it.
fn panel(plot: &Plot, input: &PlotInput<'_>) -> Result<Drawing, &'static str> {
    if input.cells.len() > MOST_CELLS {
        return Err("it has more than 2,000 cells, which cells.csv lists");
    }
    let body = match plot.kind {
        PlotKind::Scaling | PlotKind::Lines => lines::drawing(plot, input),
        PlotKind::Stacked => stacked::drawing(input),
        PlotKind::Bars => bars::drawing(plot, input),
        PlotKind::Ratios => ratios::drawing(plot, input),
        PlotKind::Map => map::drawing(plot, input)?,
    };
    let body = body.ok_or("no records hold its data")?;
    let title = html! { text.heading x=(MARGIN_PX) y="20" { (plot.title) } };
    let mut parts = vec![Drawing::new(HEADING_PX, title)];
    parts.extend(rulings(plot, input).map(verdict));
    parts.push(Drawing::lines(MARGIN_PX, &published_lines(plot, input)));
    parts.extend([Drawing::space(6.0), body, Drawing::space(GAP_PX)]);
    Ok(Drawing::column(parts))
}

/// The rulings on the claims about what a plot shows: the same measure, along an axis that its cells have.
fn rulings<'s>(plot: &'s Plot, input: &'s PlotInput<'_>) -> impl Iterator<Item = &'s Ruling> {
    let has_axis = |axis: &str| input.cells.iter().any(|cell| cell.axes.contains_key(axis));
    let is_shown = |y: &Measure| match plot.kind {
        PlotKind::Stacked => *y == Measure::frame(),
        _ => plot.y.contains(y),
    };
    let claims = input.experiment.claim.iter().zip(input.rulings);
    let about = claims.filter(move |(claim, _)| {
        is_shown(claim.test.y()) && claim.test.over().is_none_or(has_axis)
    });
    about.map(|(_, ruling)| ruling)
}

/// A claim's verdict and text.
fn verdict(ruling: &Ruling) -> Drawing {
    let Ruling { verdict, text, .. } = ruling;
    let told = style::wrap(&format!("{verdict}: {text}"), LINE_CHARACTERS);
    let lines = Drawing::lines(MARGIN_PX + 18.0, &told);
    let color = style::of_verdict(*verdict).hex();
    let content =
        html! { circle cx=(MARGIN_PX + 6.0) cy="8" r="5" fill=(color) {} (lines.content) };
    Drawing::new(lines.height_px, content)
}

/// Published figures of the sizes shown, in words: all figures, then the hardware.
fn published_lines(plot: &Plot, input: &PlotInput<'_>) -> Vec<String> {
    let of_frames = plot.kind == PlotKind::Stacked || plot.y.contains(&Measure::frame());
    let cells = input.cells.iter().filter(|cell| of_frames && cell.measured().is_some());
    let published: IndexSet<(String, &str)> = cells
        .filter_map(|cell| input.experiment.published_for(cell))
        .map(|one| (one.figure(), one.hardware.as_str()))
        .collect();
    if published.is_empty() {
        return Vec::new();
    }
    let figures = published.iter().map(|(figure, _)| figure).unique().join(", ");
    let hardware = published.iter().map(|(_, hardware)| hardware).unique().join(", ");
    let mut line = format!("Published for cells of this size: {figures} frames/s on {hardware}.");
    if input.software {
        line += " Not drawn: a software driver's times are not comparable.";
    }
    style::wrap(&line, LINE_CHARACTERS)
}

/// Lines below the title: where and from what the figures are, and what all cells share.
fn subtitle(section: &Section<'_>, view: &ReportView<'_>) -> Vec<String> {
    let adapter = view.run().map(|run| {
        let kind = if run.adapter.software { "software driver" } else { "hardware" };
        format!("{} ({kind}) · profile {}", run.adapter.name, run.profile.name())
    });
    let source = section.experiment.as_ref().map(|experiment| experiment.source.clone());
    let first = adapter.into_iter().chain(source).join(" · ");
    let common = Some(section.figure().common.as_str()).filter(|common| !common.is_empty());
    let common = common.map(|common| format!("All cells: {common}"));
    let lines = std::iter::once(first).chain(common);
    lines.flat_map(|line| style::wrap(&line, LINE_CHARACTERS)).collect()
}

/// The figure of an experiment of a view.
pub fn svg(view: &ReportView<'_>, section: &Section<'_>) -> String {
    let title = format!("{}: {}", section.id, section.title());
    let title = html! { text.name x=(MARGIN_PX) y="27" { (title) } };
    let subtitle = Drawing::lines(MARGIN_PX, &subtitle(section, view));
    let head = [Drawing::new(TITLE_PX, title), subtitle, Drawing::space(10.0)];
    Drawing::column(head.into_iter().chain(section.figure().panels.iter().cloned())).svg()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::{Definition, Outcome, Profile, Record};

    #[test]
    fn every_builtin_figure_has_data_in_a_full_run() {
        let svgs = svgs(&fixtures::run());
        for id in fathom_experiments::Experiment::builtin_ids() {
            assert!(svgs.contains_key(&format!("{id}.svg")), "{id}");
        }
    }

    fn svgs(records: &[Record]) -> BTreeMap<String, String> {
        let files = export(&ReportView::new(records, None));
        let text = |file: Artifact| (file.name, String::from_utf8(file.bytes).unwrap());
        files.into_iter().map(text).collect()
    }

    #[test]
    fn scaling_figures_show_the_fitted_exponent_and_name_their_series_and_scale() {
        let svgs = svgs(&fixtures::run());
        let photons = &svgs["uw-photons.svg"];
        assert!(photons.contains("exponent 1.0") || photons.contains("exponent 0.9"));
        assert!(photons.contains("caustics/trace") && photons.contains("(ms), logarithmic"));
        assert!(svgs["uw-waves.svg"].contains(", linear"));
    }

    #[test]
    fn published_times_are_words_beside_a_software_driver_and_marks_on_hardware() {
        let mut records = fixtures::profile(Profile::Paper);
        let software = svgs(&records);
        let Record::Run(run) = &mut records[0] else { panic!() };
        run.adapter.software = false;
        let hardware = svgs(&records);
        let marks = |svg: &str| svg.matches("class=\"published\"").count();
        for name in ["uw-default.svg", "uw-photons.svg"] {
            let (software, hardware) = (&software[name], &hardware[name]);
            assert!(software.contains("GeForce") && hardware.contains("GeForce"), "{name}");
            assert!(software.contains("Not drawn"), "{name}");
            assert_eq!(marks(software), 0, "{name}");
            assert!(!hardware.contains("Not drawn"), "{name}");
        }
        assert!(marks(&hardware["uw-default.svg"]) > 0);
    }

    #[test]
    fn every_panel_of_a_claim_has_its_verdict_as_a_word() {
        let svgs = svgs(&fixtures::run());
        let has_word = |svg: &str| {
            ["supported:", "contradicted:", "inconclusive:"].iter().any(|word| svg.contains(word))
        };
        for name in ["uw-photons.svg", "vao-skipping.svg", "vao-resolution.svg"] {
            assert!(has_word(&svgs[name]), "{name}");
        }
        assert!(svgs["uw-photons.svg"].contains("All cells: scene tank · viewport"));
        assert!(svgs["uw-photons.svg"].contains("software driver"));
    }

    #[test]
    fn type_is_large_enough_and_the_dark_sheet_stays_within_the_picture() {
        for (name, svg) in svgs(&fixtures::run()) {
            assert!(!svg.contains(" id=\"") && !svg.contains("font-size=\""), "{name}");
            let sheet = svg.split("<style>").nth(1).unwrap().split("</style>").next().unwrap();
            let rules = sheet.lines().filter(|line| line.contains('{') && !line.starts_with('@'));
            assert!(rules.clone().all(|rule| rule.starts_with(".fathom-plot ")), "{sheet}");
            let words = sheet.split([' ', ';']).filter_map(|word| word.strip_suffix("px"));
            let sizes: Vec<f64> = words.map(|size| size.parse().unwrap()).collect();
            assert!(sizes.len() == 3 && sizes.iter().all(|size| *size >= 12.0), "{sizes:?}");
        }
    }

    #[test]
    fn categories_are_never_joined() {
        // A logarithm shows no zero.
        let above_zero = |records: &mut Vec<Record>| {
            let Record::Cell(cell) = &mut records[2] else { panic!() };
            let quantities = &mut cell.measured_mut().unwrap().quantities;
            quantities.insert("caustics_photon_error_p99_m".to_owned(), 0.5);
        };
        let drawn = |kind: &str, over: &str, values: &str| {
            let text = CATEGORIES.replace("KIND", kind).replace("OVER", over);
            let records = records_of(&text.replace("VALUES", values), above_zero);
            svgs(&records).remove("own.svg").unwrap()
        };
        for kind in ["lines", "scaling"] {
            let numbers = drawn(kind, "caustics.grid", "[10, 20, 40]");
            assert!(numbers.contains("<polyline"), "{kind}");
            let scenes = drawn(kind, "scene", r#"["tank", "port", "storage"]"#);
            assert!(!scenes.contains("<polyline"), "{kind}");
            assert!(["tank", "port", "storage"].iter().all(|name| scenes.contains(name)), "{kind}");
        }
    }

    const CATEGORIES: &str = r#"
        id = "own"
        title = "Own"
        source = "none"
        pipeline = "underwater"
        scene = "tank"
        [[sweep]]
        [[sweep.axis]]
        name = "OVER"
        values = VALUES
        [[plot]]
        title = "Error"
        kind = "KIND"
        over = "OVER"
        x = "quantity:caustics_photon_error_p99_m"
        y = ["frame"]
    "#;

    #[test]
    fn many_series_are_drawn_as_small_charts() {
        let svg = &svgs(&fixtures::run())["spt-photons.svg"];
        // Three measures of three scenes each.
        let titles = ["sprites/draw", "ldi/peel"].map(|name| svg.matches(name).count());
        assert!(titles.iter().all(|count| *count >= 1), "{titles:?}");
        assert_eq!(svg.matches("time (ms), logarithmic").count(), 3, "{svg}");
    }

    #[test]
    fn ratios_have_intervals_and_the_band_of_the_claim() {
        let svg = &svgs(&fixtures::run())["uw-tessellation.svg"];
        assert!(svg.contains("n = 15") && svg.contains("what the claim allows"));
        // Cells of 4 and of 16 photons; the model's loop takes 1.4 times as long.
        assert!(svg.contains("1.4") || svg.contains("1.3"), "{svg}");
        assert!(svg.matches("class=\"band\"").count() >= 3, "two bands and the legend");
    }

    const MAPPED: &str = r#"
        id = "own"
        title = "Own"
        source = "none"
        pipeline = "underwater"
        scene = "tank"
        [[sweep]]
        [[sweep.axis]]
        name = "caustics.grid"
        title = "grid"
        values = [10, 20, 40]
        [[sweep.axis]]
        name = "godrays.grid"
        values = [5, 10]
        [[sweep.axis]]
        name = "scene"
        values = ["tank", "port"]
        [[plot]]
        title = "Error"
        kind = "map"
        columns = "caustics.grid"
        rows = "godrays.grid"
        panels = ["scene"]
        y = ["quantity:caustics_photon_error_p99_m"]
        y_title = "error (m)"
        [[plot]]
        title = "By scene"
        kind = "bars"
        over = "scene"
        where = { "godrays.grid" = 10 }
        y = ["frame"]
    "#;

    /// Records of an experiment whose error is the number of the cell.
    fn records_of(toml: &str, change: impl Fn(&mut Vec<Record>)) -> Vec<Record> {
        let experiment = Experiment::parse("own", toml).unwrap();
        let mut random = rand::SeedableRng::seed_from_u64(1);
        let mut records = vec![
            Record::Run(Box::new(fixtures::header(Profile::Quick))),
            Record::Experiment(Definition { id: "own".to_owned(), toml: toml.to_owned() }),
        ];
        for (number, plan) in (0..).zip(experiment.cells(Profile::Quick, &[], &[]).unwrap()) {
            let mut measured = fixtures::measure(&experiment, &plan, &mut random);
            let name = "caustics_photon_error_p99_m".to_owned();
            measured.quantities.insert(name, f64::from(number));
            records.push(fixtures::cell(&plan, Outcome::Measured(Box::new(measured))));
        }
        change(&mut records);
        records
    }

    /// Those of [`MAPPED`]; one cell was not measured.
    fn mapped() -> Vec<Record> {
        records_of(MAPPED, |records| {
            let Record::Cell(cell) = &mut records[2 + 7] else { panic!() };
            cell.outcome = Outcome::Failed { reason: "lost".to_owned() };
        })
    }

    #[test]
    fn maps_have_a_panel_for_each_value_and_a_number_in_each_field() {
        let svg = svgs(&mapped()).remove("own.svg").unwrap();
        let texts = svg.split("<text").skip(1).filter_map(|text| text.split(['<', '>']).nth(1));
        let texts: Vec<&str> = texts.collect();
        // Scenes move fastest, then rows: of tank 0, 4, 8 above 2, 6, 10; of port 1, 5, 9 above 3, –, 11.
        let port = texts.iter().position(|text| *text == "port").unwrap();
        let (tank, port) = texts.split_at(port);
        for (map, fields) in [
            (tank, ["0", "4.00", "8.00", "2.00", "6.00", "10.0"]),
            (port, ["1.00", "5.00", "9.00", "3.00", "–", "11.0"]),
        ] {
            let places = fields.map(|field| map.iter().position(|text| *text == field));
            assert!(places.iter().all(Option::is_some), "{fields:?} {map:?}");
            assert!(places.is_sorted(), "{places:?}");
        }
        for text in ["Error", "error (m)", "smallest value", "By scene"] {
            assert!(svg.contains(text), "{text}");
        }
    }

    #[test]
    fn a_map_of_large_values_takes_no_colours_from_the_others() {
        let svg = svgs(&mapped()).remove("own.svg").unwrap();
        // The lightest colour, once in each map.
        assert_eq!(svg.matches("\"#fde725\"").count(), 2);
    }

    #[test]
    fn bars_stand_by_value_and_are_told_apart_by_the_other_axes() {
        let svg = svgs(&mapped()).remove("own.svg").unwrap();
        let bars = svg.split("By scene").nth(1).unwrap();
        for (row, (scene, count)) in bars.split("class=\"label\"").zip([("tank", 3), ("port", 2)]) {
            assert_eq!(row.matches("class=\"bar\"").count(), count, "{scene}");
        }
    }

    #[test]
    fn a_section_without_figures_draws_nothing() {
        let records = fixtures::all_skipped();
        assert!(export(&ReportView::new(&records, None)).is_empty());
    }
}

//! One SVG per experiment, its panels one below the other. No font is needed to write it.
//!
//! Each panel begins with its title and the verdicts of the claims that speak of what it shows. Series are named at the ends of
//! their lines, and legends stand in rows above the data.

mod bars;
mod chart;
mod lines;
pub(super) mod names;
pub mod png;
pub mod points;
mod stacked;
mod strip;
pub mod style;

use indexmap::IndexSet;
use itertools::Itertools;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::*;

use self::lines::LineCharts;
pub use self::strip::strip;
use super::colors::StageColors;
use super::document::Tone;
use super::{Artifact, Exporter, Report, RunExporter, RunFormat, Section, Timing};
use fathom_base::text;
use fathom_experiments as experiments;
use fathom_experiments::Measure;
use fathom_experiments::schema::{Experiment, Plot, PlotKind, Published};
use fathom_record::Cell;

pub const EXPORTER: RunExporter = Exporter {
    name: "plots",
    about: "the plots of each experiment, SVG",
    file: "EXPERIMENT.svg",
    written: Timing::WithEveryReport,
    export: RunFormat::Several(export),
};

const WIDTH_PX: u32 = 980;
/// A plot at a glance, and its largest height.
const SMALL_PX: (u32, u32) = (540, 220);
const MAX_SMALL_PX: u32 = 380;
/// Title of the picture, and of each panel.
const TITLE_PX: u32 = 36;
const HEADING_PX: u32 = 32;
/// A line of small type.
const LINE_PX: u32 = 17;
/// Between panels.
const GAP_PX: u32 = 18;
/// Characters of 12-px type that fit into a line.
const LINE_CHARACTERS: usize = 134;

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type DrawResult<T = ()> = Result<T, DrawingAreaErrorKind<std::io::Error>>;

/// Cells of a plot beyond which it is not drawn: nobody can read it.
const MAX_CELLS: usize = 2_000;

/// What a panel draws below its title.
trait Panel {
    fn height_px(&self) -> u32;

    fn draw(&self, area: &Area<'_>) -> DrawResult;
}

/// What plots are made from.
struct PlotInput<'s> {
    experiment: &'s Experiment,
    cells: Vec<&'s Cell>,
    colors: &'s StageColors,
    /// Measured on a software driver: published times are not drawn beside its own.
    software: bool,
}

impl<'s> PlotInput<'s> {
    fn new(section: &'s Section<'_>) -> Option<PlotInput<'s>> {
        let experiment = section.experiment.as_ref()?;
        let (cells, software) = (section.cells(), section.software());
        Some(PlotInput { experiment, cells, colors: &section.colors, software })
    }

    fn select(&self, plot: &Plot) -> PlotInput<'s> {
        let belongs = |cell: &&Cell| {
            let on_axes = plot.axes().all(|axis| cell.axes.contains_key(axis));
            on_axes && experiments::fits(cell, &plot.filter)
        };
        PlotInput { cells: self.cells.iter().copied().filter(belongs).collect(), ..*self }
    }

    /// The published frame time of a cell's size, beside that of frames; none beside a software driver's.
    fn published(&self, cell: &Cell, y: &Measure) -> Option<&'s Published> {
        let is_drawn = !self.software && *y == Measure::frame();
        self.experiment.published_for(cell).filter(|_| is_drawn)
    }
}

struct TitledPanel<'s> {
    title: &'s str,
    /// Lines of small type.
    lines: Vec<String>,
    body: Box<dyn Panel + 's>,
}

/// The plots of an experiment.
#[derive(Default)]
pub struct Figure {
    /// All panels; none where no plot has one.
    pub svg: Option<String>,
    /// Titles of the plots that have no panel, and why.
    pub missing: Vec<(String, &'static str)>,
}

impl Figure {
    pub fn draw(section: &Section<'_>) -> Figure {
        let Some(input) = PlotInput::new(section) else { return Figure::default() };
        let plots: Vec<(&Plot, PlotInput<'_>)> =
            input.experiment.plot.iter().map(|plot| (plot, input.select(plot))).collect();
        let (mut panels, mut missing) = (Vec::new(), Vec::new());
        for (plot, input) in &plots {
            match TitledPanel::new(plot, input, section) {
                Ok(panel) => panels.push(panel),
                Err(reason) => missing.push((plot.title.clone(), reason)),
            }
        }
        let svg = (!panels.is_empty()).then(|| picture(section, &names::common(&input), &panels));
        Figure { svg, missing }
    }
}

/// A scaling plot of an experiment alone, without words around it; none where its series need more room or have one size.
pub fn small_plot(section: &Section<'_>, plot: &Plot) -> Option<String> {
    let input = PlotInput::new(section)?.select(plot);
    let chart = LineCharts::new(plot, &input)?.into_single()?;
    let about = format!("{}: {}", section.id, plot.title);
    let needed_px = chart.ends_px().max(style::width_px(&chart.y_title, style::LABEL_PX) + 60);
    let size_px = (SMALL_PX.0, SMALL_PX.1.max(needed_px));
    let is_line = chart.series.iter().any(|series| series.points.len() > 1);
    let svg = || drawing(size_px, &about, |area| chart.draw_with_names(area));
    (is_line && size_px.1 <= MAX_SMALL_PX).then(svg)
}

/// Scene, viewport and sizes that all cells of an experiment share, in words.
pub fn common(section: &Section<'_>) -> String {
    PlotInput::new(section).map_or_else(String::new, |input| names::common(&input))
}

pub fn file_name(section: &Section<'_>) -> String {
    format!("{}.svg", text::file_stem(section.id))
}

fn export(view: &Report<'_>) -> Vec<Artifact> {
    let drawn = view.sections.iter().filter_map(|section| {
        let svg = section.figure().svg.as_ref()?;
        Some(Artifact::new(file_name(section), style::with_style_sheet(svg)))
    });
    drawn.collect()
}

/// A drawing of this size; `about` says in one sentence what it shows.
fn drawing(size_px: (u32, u32), about: &str, draw: impl FnOnce(&Area<'_>) -> DrawResult) -> String {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size_px).into_drawing_area();
        let drawn = root.fill(&WHITE).and_then(|()| draw(&root)).and_then(|()| root.present());
        // It cannot fail but by a bug in the drawing.
        drawn.expect("a string takes every drawing");
    }
    // The backend escapes marks of XML; what XML cannot hold at all is left to do.
    text::block(style::titled(&svg, about))
}

impl<'s> TitledPanel<'s> {
    fn new(
        plot: &'s Plot,
        input: &'s PlotInput<'s>,
        section: &Section<'_>,
    ) -> Result<TitledPanel<'s>, &'static str> {
        if input.cells.len() > MAX_CELLS {
            return Err("it has more than 2,000 cells, which cells.csv lists");
        }
        let body = body(plot, input).ok_or("no records hold its data")?;
        let mut lines = verdicts(plot, input, section);
        lines.extend(published(plot, input));
        Ok(TitledPanel { title: &plot.title, lines, body })
    }

    fn head_px(&self) -> u32 {
        HEADING_PX + self.lines.len() as u32 * LINE_PX + 4
    }

    fn height_px(&self) -> u32 {
        self.head_px() + self.body.height_px() + GAP_PX
    }

    fn draw(&self, area: &Area<'_>) -> DrawResult {
        area.draw_text(self.title, &style::heading(), (16, 8))?;
        for (row, line) in (0..).zip(&self.lines) {
            let y = (HEADING_PX + 6 + row * LINE_PX) as i32;
            area.draw_text(line, &style::starting(style::small()), (16, y))?;
        }
        let (_, body) = area.split_vertically(self.head_px());
        self.body.draw(&body)
    }
}

fn body<'s>(plot: &'s Plot, input: &'s PlotInput<'s>) -> Option<Box<dyn Panel + 's>> {
    fn boxed<'s, P: Panel + 's>(panel: P) -> Box<dyn Panel + 's> {
        Box::new(panel)
    }
    match plot.kind {
        PlotKind::Scaling | PlotKind::Lines => LineCharts::new(plot, input).map(boxed),
        PlotKind::Stacked => stacked::chart(input).map(boxed),
        PlotKind::Bars => bars::chart(plot, input).map(boxed),
    }
}

/// The rulings on the claims about what a plot shows: the same measure, along an axis that its cells have.
fn verdicts(plot: &Plot, input: &PlotInput<'_>, section: &Section<'_>) -> Vec<String> {
    let frame = [Measure::frame()];
    let shown = if plot.kind == PlotKind::Stacked { &frame } else { plot.y.as_slice() };
    let has_axis = |axis: &str| input.cells.iter().any(|cell| cell.axes.contains_key(axis));
    let claims = input.experiment.claim.iter().zip(section.rulings());
    let about = claims.filter(|(claim, _)| {
        shown.contains(claim.test.y()) && claim.test.over().is_none_or(has_axis)
    });
    let lines = about.flat_map(|(_, ruling)| {
        let mark = Tone::from_verdict(ruling.verdict).mark();
        style::wrap(&format!("{mark} {}: {}", ruling.marked(), ruling.text), LINE_CHARACTERS)
    });
    lines.collect()
}

/// Published figures of the sizes shown, in words: all figures, then the hardware.
fn published(plot: &Plot, input: &PlotInput<'_>) -> Vec<String> {
    let of_frames = plot.kind == PlotKind::Stacked || plot.y.contains(&Measure::frame());
    let cells = input.cells.iter().filter(|cell| of_frames && cell.measured().is_some());
    let published: Vec<&Published> =
        cells.filter_map(|cell| input.experiment.published_for(cell)).collect();
    if published.is_empty() {
        return Vec::new();
    }
    let figures: IndexSet<String> = published.iter().map(|one| one.figure()).collect();
    let hardware: IndexSet<&str> = published.iter().map(|one| one.hardware.as_str()).collect();
    let (figures, hardware) = (figures.iter().join(", "), hardware.iter().join(", "));
    let mut line = format!("Published for cells of this size: {figures} frames/s on {hardware}.");
    if input.software {
        line += " Not drawn: a software driver's times are not comparable.";
    }
    style::wrap(&line, LINE_CHARACTERS)
}

/// Lines below the title: where and from what the figures are, and what all cells share.
fn subtitle(section: &Section<'_>, common: &str) -> Vec<String> {
    let adapter = section.run.map(|run| {
        let kind = if run.adapter.software { "software driver" } else { "hardware" };
        format!("{} ({kind}) · profile {}", run.adapter.title(), run.profile)
    });
    let source = section.experiment.as_ref().map(|experiment| experiment.source.clone());
    let source = source.filter(|source| !source.is_empty());
    let first = adapter.into_iter().chain(source).join(" · ");
    let common = (!common.is_empty()).then(|| format!("All cells: {common}"));
    let lines = std::iter::once(first).chain(common);
    lines.flat_map(|line| style::wrap(&line, LINE_CHARACTERS)).collect()
}

fn picture(section: &Section<'_>, common: &str, panels: &[TitledPanel<'_>]) -> String {
    let subtitle = subtitle(section, common);
    let head_px = TITLE_PX + subtitle.len() as u32 * LINE_PX + 10;
    let height_px = head_px + panels.iter().map(TitledPanel::height_px).sum::<u32>();
    let title = format!("{}: {}", section.id, section.title());
    drawing((WIDTH_PX, height_px), &title, |root| {
        root.draw_text(&title, &style::title(), (16, 12))?;
        for (index, line) in (0..).zip(&subtitle) {
            let y = (TITLE_PX + index * LINE_PX) as i32;
            root.draw_text(line, &style::small(), (16, y))?;
        }
        let (_, mut rest) = root.split_vertically(head_px);
        for panel in panels {
            let (area, below) = rest.split_vertically(panel.height_px());
            panel.draw(&area)?;
            rest = below;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::chart::Item;
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::{Definition, Outcome, Profile, Record};

    fn svgs(records: &[Record]) -> BTreeMap<String, String> {
        let files = export(&Report::new(records, None));
        let text = |file: Artifact| (file.name, String::from_utf8(file.bytes).unwrap());
        files.into_iter().map(text).collect()
    }

    /// Of each file, what must stand in it and how often at least. Of `uw-tessellation` the cells have 4 and 16 photons.
    #[test]
    fn charts_say_what_they_show() {
        let svgs = svgs(&fixtures::run());
        for (file, words, min_count) in [
            ("uw-photons", "exponent ", 1),
            ("uw-photons", "caustics/trace", 1),
            ("uw-photons", "log scale", 1),
            ("uw-photons", "All cells: scene tank · viewport", 1),
            ("uw-photons", "software driver", 1),
            ("uw-photons", "supported", 1),
            ("vao-skipping", "supported", 1),
            ("vao-resolution", "supported", 1),
            ("uw-waves", "linear scale", 1),
            // Three measures of three scenes each as small charts, and the whole frame in a plot of its own.
            ("spt-photons", "time (ms), log", 4),
            ("spt-photons", "sprites/draw", 1),
            ("spt-photons", "ldi/peel", 1),
            ("uw-tessellation", "n = 5", 4),
            ("uw-tessellation", "loop bound dynamic", 1),
        ] {
            let svg = &svgs[&format!("{file}.svg")];
            assert!(svg.matches(words).count() >= min_count, "{file}: {words}");
        }
    }

    #[test]
    fn published_times_are_words_beside_a_software_driver_and_marks_on_hardware() {
        let mut records = fixtures::profile(Profile::Paper);
        let software = svgs(&records);
        let Record::Run(run) = &mut records[0] else { panic!() };
        run.adapter.software = false;
        let hardware = svgs(&records);
        let marks = |svg: &str| svg.matches("stroke-width=\"4\"").count();
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
    fn type_is_large_enough_and_the_dark_sheet_stays_within_the_picture() {
        for (name, svg) in svgs(&fixtures::run()) {
            let sizes = svg.split("font-size=\"").skip(1);
            let sizes: Vec<f64> =
                sizes.map(|rest| rest.split('"').next().unwrap().parse().unwrap()).collect();
            assert!(sizes.iter().all(|size| *size >= 11.99), "{name}: {sizes:?}");
            assert!(sizes.len() > 10, "{name}");
            assert!(!svg.contains(" id=\""), "{name}");
            let sheet = svg.split("<style>").nth(1).unwrap().split("</style>").next().unwrap();
            let rules = sheet.split("dark) {").nth(1).unwrap();
            let selectors = rules.split('}').map(|rule| rule.split('{').next().unwrap());
            for selector in selectors.filter(|selector| !selector.is_empty()) {
                assert!(selector.starts_with(".fathom-chart "), "{selector}");
            }
        }
    }

    /// The title has the first 72 rows of a PNG for itself.
    #[test]
    fn a_png_is_its_plot_at_twice_the_size_with_words() {
        let bars = CATEGORIES.replace("KIND", "bars").replace("OVER", "scene");
        let records = records_of(&bars.replace("VALUES", r#"["tank", "port"]"#), |_| {});
        let wordless = png::Rasterizer(Default::default());
        let dark = |rasterizer: &png::Rasterizer, rows| {
            let files = rasterizer.pictures(&Report::new(&records, None)).unwrap();
            let picture = image::load_from_memory(&files[0].bytes).unwrap().to_luma8();
            let [w, h] = [picture.width() / 2, picture.height() / 2];
            assert!(svgs(&records)["own.svg"].contains(&format!("width=\"{w}\" height=\"{h}\"")));
            assert_eq!((&*files[0].name, files.len(), picture[(0, 0)][0]), ("own.png", 1, 255));
            picture.rows().take(rows).flatten().filter(|pixel| pixel[0] < 100).count()
        };
        assert!(dark(&wordless, 72) == 0 && dark(&wordless, usize::MAX) > 500);
        let has_words = png::Rasterizer::new().map(|rasterizer| dark(&rasterizer, 72) > 500);
        assert!(has_words.unwrap_or_else(|error| error.to_string().contains("fonts-dejavu-core")));
    }

    /// Lines of a series that join points.
    fn joins(svg: &str) -> usize {
        svg.matches("opacity=\"0.8\"").count()
    }

    /// [`CATEGORIES`] with these words.
    fn drawn(kind: &str, over: &str, values: &str) -> String {
        // A logarithm shows no zero.
        let above_zero = |records: &mut Vec<Record>| {
            let Record::Cell(cell) = &mut records[2] else { panic!() };
            let quantities = &mut cell.measured_mut().unwrap().quantities;
            quantities.insert("caustics_photon_error_p99_m".to_owned(), 0.5);
        };
        let text = CATEGORIES.replace("KIND", kind).replace("OVER", over);
        let records = records_of(&text.replace("VALUES", values), above_zero);
        svgs(&records).remove("own.svg").unwrap()
    }

    #[test]
    fn groups_of_one_measure_share_their_axes() {
        let groups = "\n[[sweep.axis]]\nname = \"godrays.grid\"\nvalues = ";
        let all = [1, 2, 3, 4, 5, 6, 7, 8];
        for (several, charts) in [(7, 1), (8, 8)] {
            let values = format!("[10, 20, 40]{groups}{:?}", &all[..several]);
            let svg = drawn("lines", "caustics.grid", &values);
            assert_eq!(svg.matches("linear scale").count(), charts);
            assert_eq!(svg.matches("\n15\n").count(), charts);
        }
    }

    #[test]
    fn categories_are_never_joined() {
        for kind in ["lines", "scaling"] {
            assert_eq!(joins(&drawn(kind, "caustics.grid", "[10, 20, 40]")), 2, "{kind}");
            let scenes = drawn(kind, "scene", r#"["tank", "port", "storage"]"#);
            assert_eq!(joins(&scenes), 0, "{kind}");
            assert!(["tank", "port", "storage"].iter().all(|name| scenes.contains(name)), "{kind}");
        }
    }

    const CATEGORIES: &str = r#"
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

    const MAPPED: &str = r#"
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
        [[plot]]
        title = "Over the other scene"
        kind = "ratios"
        over = "scene"
        numerator = "port"
        denominator = "tank"
        y = ["frame", "stage:caustics/trace"]
    "#;

    /// Records of an experiment whose error is the number of the cell.
    fn records_of(toml: &str, change: impl Fn(&mut Vec<Record>)) -> Vec<Record> {
        let experiment = fixtures::own(toml);
        let mut random = rand::SeedableRng::seed_from_u64(1);
        let mut records = vec![
            Record::Run(Box::new(fixtures::header(Profile::Quick))),
            Record::Experiment(Definition { id: "own".to_owned(), toml: experiment.text.clone() }),
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

    /// A plot of maps, as earlier versions had it.
    #[test]
    fn lines_have_a_chart_for_each_value_of_an_axis_with_panels() {
        let svg = svgs(&mapped()).remove("own.svg").unwrap();
        let texts = svg.lines().filter(|line| !line.starts_with('<')).map(str::trim);
        let row = "side of the godray photon grid 5";
        let shown = texts.filter(|text| ["tank", "port", row].contains(text)).take(4);
        assert_eq!(shown.collect_vec(), ["tank", row, "port", row]);
        for text in ["Error", "error (m), linear", "By scene"] {
            assert!(svg.contains(text), "{text}");
        }
        // Of three points each, and of one series without one that was lost.
        assert_eq!(joins(&svg), 3 * 2 + 1);
    }

    #[test]
    fn bars_stand_by_value_and_are_told_apart_by_the_other_axes() {
        let records = mapped();
        let view = Report::new(&records, None);
        let experiment = fixtures::own(MAPPED);
        let (cells, colors) = (view.sections[0].cells(), &view.colors);
        let input = PlotInput { experiment: &experiment, cells, colors, software: true };
        let shape = |plot: usize| {
            let plot = &experiment.plot[plot];
            let chart = bars::chart(plot, &input.select(plot)).unwrap();
            let words = chart.items.into_iter().filter_map(|item| match item {
                Item::Label(label, _) => Some(label),
                Item::Bar(..) => Some("bar".to_owned()),
                _ => None,
            });
            (words.collect_vec(), chart.legend.0.into_iter().map(|(_, words)| words).collect_vec())
        };
        let (by_scene, series) = shape(1);
        assert_eq!(by_scene, ["tank", "bar", "bar", "bar", "port", "bar", "bar"]);
        assert_eq!(series.len(), 3);
        // Ratios of two measures, as earlier versions had them.
        assert_eq!(experiment.plot.len(), 4);
        for plot in [2, 3] {
            let (pairs, scenes) = shape(plot);
            let sizes = pairs.split(|word| word != "bar").skip(1).map(<[String]>::len);
            assert!(sizes.eq([2, 2, 2, 1, 2, 2]), "{pairs:?}");
            assert_eq!(scenes, ["tank", "port"]);
        }
    }
}

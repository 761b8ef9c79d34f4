//! One SVG per experiment, its panels one below the other. No font is needed to write it.
//!
//! The legend has a column of its own at the right and covers no data.

mod bars;
mod chart;
mod lines;
mod map;
mod roofline;
mod scale;
mod stacked;
mod style;

use indexmap::IndexSet;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::*;

use self::{bars::Bars, lines::Lines, map::Map, stacked::Stacked};
use super::format::{NS_PER_MS, Table};
use super::{Artifact, Exporter, ReportError, ReportView, Section};
use crate::experiments::schema::{Experiment, Plot, PlotKind, Published};
use crate::experiments::{self, Measure};
use crate::record::Cell;
use crate::text;

pub use roofline::EXPORTER as ROOFLINES;

pub const EXPORTER: Exporter =
    Exporter { name: "EXPERIMENT.svg", about: "a figure per experiment", export };

const WIDTH_PX: u32 = 980;
const TITLE_PX: u32 = 56;

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
/// Drawing on a string cannot fail but by a bug in the drawing.
type Fault = DrawingAreaErrorKind<std::io::Error>;
type Drawn = Result<(), Fault>;

/// Cells of a plot beyond which it is not drawn: nobody can read it.
const MOST_CELLS: usize = 2_000;

trait Panel {
    fn height_px(&self) -> u32;

    fn draw(&self, area: &Area<'_>) -> Drawn;

    /// Its numbers where the summary has them too: tables with their titles.
    fn tables(&self) -> Vec<(String, Table)> {
        Vec::new()
    }
}

/// An experiment's panels, and its plots that have none.
#[derive(Default)]
pub struct Figure {
    panels: Vec<Box<dyn Panel>>,
    /// Titles of the plots that have no panel, and why.
    pub missing: Vec<(String, &'static str)>,
}

impl Figure {
    pub fn new(experiment: &Experiment, cells: &[&Cell]) -> Figure {
        let mut figure = Figure::default();
        for plot in &experiment.plot {
            match panel(plot, experiment, cells) {
                Ok(panel) => figure.panels.push(panel),
                Err(reason) => figure.missing.push((plot.title.clone(), reason)),
            }
        }
        figure
    }

    pub fn is_drawn(&self) -> bool {
        !self.panels.is_empty()
    }

    /// The numbers of its maps.
    pub fn map_tables(&self) -> Vec<(String, Table)> {
        self.panels.iter().flat_map(|panel| panel.tables()).collect()
    }
}

pub fn file_name(section: &Section<'_>) -> String {
    format!("{}.svg", text::file_stem(section.id))
}

fn export(view: &ReportView<'_>) -> Result<Vec<Artifact>, ReportError> {
    let mut files = Vec::new();
    for section in &view.sections {
        let panels = &section.figure().panels;
        if panels.is_empty() {
            continue;
        }
        let adapter = view.run().map_or("", |run| run.adapter.name.as_str());
        let svg = figure(section, adapter, panels).map_err(|fault| ReportError::Plot {
            experiment: section.id.to_owned(),
            message: fault.to_string(),
        })?;
        files.push(Artifact { name: file_name(section), bytes: svg.into_bytes() });
    }
    Ok(files)
}

fn panel(
    plot: &Plot,
    experiment: &Experiment,
    cells: &[&Cell],
) -> Result<Box<dyn Panel>, &'static str> {
    let cells: Vec<&Cell> = cells.iter().copied().filter(|cell| belongs(plot, cell)).collect();
    if cells.len() > MOST_CELLS {
        return Err("it has more than 2,000 cells, which cells.csv lists");
    }
    fn boxed<P: Panel + 'static>(panel: P) -> Box<dyn Panel> {
        Box::new(panel)
    }
    let panel = match plot.kind {
        PlotKind::Scaling | PlotKind::Lines => Lines::new(plot, experiment, &cells).map(boxed),
        PlotKind::Stacked => Stacked::new(plot, experiment, &cells).map(boxed),
        PlotKind::Bars => Bars::new(plot, experiment, &cells).map(boxed),
        PlotKind::Map => Map::new(plot, experiment, &cells)?.map(boxed),
    };
    panel.ok_or("no records hold its data")
}

/// Times are shown in milliseconds, everything else as it is.
fn unit(measure: &Measure) -> f64 {
    if measure.is_time() { 1.0 / NS_PER_MS } else { 1.0 }
}

fn belongs(plot: &Plot, cell: &Cell) -> bool {
    let on_axis = plot.over.as_ref().is_none_or(|over| cell.axes.contains_key(over));
    on_axis && experiments::fits(cell, &plot.filter)
}

fn figure(
    section: &Section<'_>,
    adapter: &str,
    panels: &[Box<dyn Panel>],
) -> Result<String, Fault> {
    let heights: Vec<u32> = panels.iter().map(|panel| panel.height_px()).collect();
    let height = TITLE_PX + heights.iter().sum::<u32>();
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (WIDTH_PX, height)).into_drawing_area();
        root.fill(&WHITE)?;
        let source =
            section.experiment.as_ref().map_or("", |experiment| experiment.source.as_str());
        let title = format!("{}: {}", section.id, section.title());
        root.draw_text(&title, &style::title(), (16, 12))?;
        let below = [adapter, source].join(" · ");
        root.draw_text(&below, &style::small(), (16, 36))?;
        let (_, mut rest) = root.split_vertically(TITLE_PX);
        for (panel, height) in panels.iter().zip(heights) {
            let (area, below) = rest.split_vertically(height);
            panel.draw(&area)?;
            rest = below;
        }
        root.present()?;
    }
    // The backend escapes marks of XML; what XML cannot hold at all is left to do.
    Ok(text::block(&svg))
}

/// The legend's words on published figures: all of them in one line, then the hardware, in lines of its own.
fn published_lines(published: &[&Published]) -> Vec<String> {
    let figures: IndexSet<String> = published.iter().map(|one| one.figure()).collect();
    let hardware: IndexSet<&str> = published.iter().map(|one| one.hardware.as_str()).collect();
    if figures.is_empty() {
        return Vec::new();
    }
    let first = format!("published: {} fps", figures.into_iter().collect::<Vec<_>>().join(", "));
    let parts = hardware.iter().flat_map(|text| text.split(", "));
    [first].into_iter().chain(parts.map(str::to_owned)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fixtures;

    #[test]
    fn every_builtin_figure_has_data_in_a_full_run() {
        let records = fixtures::run();
        let view = ReportView::new(&records, None);
        let files = export(&view).unwrap();
        let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
        for id in crate::experiments::Experiment::builtin_ids() {
            assert!(names.contains(&format!("{id}.svg").as_str()), "{id}");
        }
    }

    #[test]
    fn scaling_figures_show_the_fitted_slope_and_the_published_figure() {
        let records = fixtures::run();
        let files = export(&ReportView::new(&records, None)).unwrap();
        let svg = |name: &str| {
            let file = files.iter().find(|file| file.name == name).unwrap();
            String::from_utf8(file.bytes.clone()).unwrap()
        };
        let photons = svg("uw-photons.svg");
        assert!(photons.contains("slope 1.0") || photons.contains("slope 0.9"));
        assert!(svg("uw-default.svg").contains("published"));
    }

    /// Heights of the texts that contain these words, pixels from the top.
    fn heights(svg: &str, words: &str) -> Vec<i32> {
        let texts = svg.split("<text ").skip(1).filter(|text| text.contains(words));
        let height = |text: &str| text.split("y=\"").nth(1)?.split('"').next()?.parse().ok();
        texts.filter_map(height).collect()
    }

    #[test]
    fn a_long_legend_ends_above_the_next_panel() {
        let files = export(&ReportView::new(&fixtures::run(), None)).unwrap();
        let file = files.iter().find(|file| file.name == "spt-photons.svg").unwrap();
        let svg = String::from_utf8(file.bytes.clone()).unwrap();
        let next = heights(&svg, "Distance from the exact end")[0];
        let above: Vec<i32> =
            heights(&svg, "sprites/draw").into_iter().filter(|y| *y < next + 200).collect();
        // Three rays, three of peeling and three of sprites: nine entries.
        assert!(above.len() == 3 && above.iter().all(|y| *y < next), "{above:?} {next}");
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

    /// Records of [`MAPPED`] whose error is the number of the cell; one cell was not measured.
    fn mapped() -> Vec<crate::record::Record> {
        use crate::record::{Definition, Outcome, Profile, Record};
        let experiment = Experiment::parse("own", MAPPED).unwrap();
        let mut random = rand::SeedableRng::seed_from_u64(1);
        let mut records = vec![
            Record::Run(Box::new(fixtures::header(Profile::Quick))),
            Record::Experiment(Definition { id: "own".to_owned(), toml: MAPPED.to_owned() }),
        ];
        for (number, plan) in (0..).zip(experiment.cells(Profile::Quick, &[], &[]).unwrap()) {
            let mut measured = fixtures::measure(&experiment, &plan, &mut random);
            let name = "caustics_photon_error_p99_m".to_owned();
            measured.quantities.insert(name, f64::from(number));
            let outcome = match number {
                7 => Outcome::Failed { reason: "lost".to_owned() },
                _ => Outcome::Measured(Box::new(measured)),
            };
            records.push(fixtures::cell(&plan, outcome));
        }
        records
    }

    #[test]
    fn maps_have_a_panel_for_each_value_and_a_number_in_each_field() {
        let records = mapped();
        let view = ReportView::new(&records, None);
        let tables = view.sections[0].figure().map_tables();
        let titles: Vec<&str> = tables.iter().map(|(title, _)| title.as_str()).collect();
        assert_eq!(titles, ["Error, tank", "Error, port"]);
        // Scenes move fastest, then rows: of tank 0, 4, 8 above 2, 6, 10; of port 1, 5, 9 above 3, –, 11.
        let tank = tables[0].1.markdown();
        assert!(tank.contains("| 5 | 0 | 4.00 | 8.00 |"), "{tank}");
        assert!(tank.contains("| 10 | 2.00 | 6.00 | 10.0 |"), "{tank}");
        let port = tables[1].1.markdown();
        assert!(port.contains("| 10 | 3.00 | – | 11.0 |"), "{port}");
        let files = export(&view).unwrap();
        let svg = String::from_utf8(files[0].bytes.clone()).unwrap();
        for text in ["Error", "error (m)", "grid", "tank", "11.0", "5.50", "By scene"] {
            assert!(svg.contains(text), "{text}");
        }
    }

    #[test]
    fn bars_stand_by_value_and_are_told_apart_by_the_other_axes() {
        let records = mapped();
        let view = ReportView::new(&records, None);
        let (cells, experiment) = (view.sections[0].cells(), Experiment::parse("own", MAPPED));
        let experiment = experiment.unwrap();
        let plot = &experiment.plot[1];
        let cells: Vec<&Cell> = cells.into_iter().filter(|cell| belongs(plot, cell)).collect();
        let bars = Bars::new(plot, &experiment, &cells).unwrap();
        assert_eq!(bars.shape(), [("tank", 3), ("port", 2)]);
    }

    #[test]
    fn a_section_without_figures_draws_nothing() {
        let records = fixtures::all_skipped();
        assert!(export(&ReportView::new(&records, None)).unwrap().is_empty());
    }
}

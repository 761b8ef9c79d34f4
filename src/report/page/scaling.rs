//! How times and errors grow: a small chart for each experiment and axis, with fitted exponents.

use std::collections::{BTreeSet, HashSet};

use indexmap::IndexMap;
use itertools::Itertools;
use maud::{Markup, html};
use serde_json::{Map, Value};

use super::parts::setting_words;
use super::{Fold, Page, PageRun, PageSection};
use crate::axis::{Axis, ScaleKind};
use crate::facts;
use crate::format::{si, three};
use crate::series::{Point, Series, Source};
use crate::svg::{self, Marker, Paint, Shape};
use fathom_experiments as experiments;
use fathom_experiments::schema::{Claim, Experiment, Plot, PlotKind, Test};
use fathom_experiments::words::Unit;
use fathom_experiments::{Measure, groups};
use fathom_record::Cell;

pub const SECTION: PageSection = PageSection {
    id: "scaling",
    title: "How it scales",
    question: "With which exponent does a stage grow, and how certain is that?",
    fold: Fold::Listed,
    write,
};

const SIZE_PX: [f64; 2] = [324.0, 190.0];
const LEFT_PX: f64 = 48.0;
const RIGHT_PX: f64 = 306.0;
const TOP_PX: f64 = 8.0;
const BOTTOM_PX: f64 = 166.0;
/// Charts of an experiment that are shown, and series of a chart.
const MOST_CHARTS: usize = 12;
const MOST_SERIES: usize = 8;
/// Points of a series that are drawn.
const MOST_POINTS: usize = 100;

/// What charts show: measures over a number, from a plot or from claims of an experiment.
struct Spec<'a> {
    title: &'a str,
    over: Option<&'a str>,
    filter: &'a Map<String, Value>,
    x: &'a Measure,
    x_title: Option<&'a str>,
    y: Vec<&'a Measure>,
    kind: ScaleKind,
}

/// A chart: the series of one group of cells, or one measure of all groups.
struct Chart<'a> {
    /// What all its cells share on the axes that it is not over.
    group: String,
    series: Vec<Series<'a>>,
}

fn write(page: &Page<'_>) -> Option<Markup> {
    let experiments = experiments(page);
    let shown: Vec<(&str, &Experiment, Vec<Markup>)> = experiments
        .into_iter()
        .map(|(id, experiment)| (id, experiment, charts_of(page, id, experiment)))
        .filter(|(.., charts)| !charts.is_empty())
        .collect();
    if shown.is_empty() {
        return None;
    }
    Some(html! {
        p.lead {
            "Points and exponents are medians with their 95 % intervals. Lines join the points of an axis of numbers; scenes and other categories "
            "are not joined. On logarithmic charts the dashed line is the fitted power law, y ∝ x to the exponent given below "
            "the chart; dotted lines have the slope 1: twice the work takes twice the time. † No exponent: too few cells, or in most "
            "of them a fixed part is more than 10 % of the time; the mark says how much. Of medians: cells were measured apart, so their "
            "medians are fitted, and the interval is by resampling each cell."
        }
        @if page.is_overlay() { (runs(page)) }
        div.controls.script-only {
            label { "Stage "
                select #scaling-stage {
                    option value="" { "all" }
                    @for stage in stages(page) { option { (stage) } }
                }
            }
            output #scaling-count {}
        }
        @for (id, experiment, charts) in &shown {
            div.scaling-experiment {
                h3 { (experiment.title) " " a.source href={ "#plot-" (id) } { (id) } }
                div.multiples {
                    @for chart in charts.iter().take(MOST_CHARTS) { (chart) }
                }
                @if charts.len() > MOST_CHARTS {
                    p.faint { (charts.len() - MOST_CHARTS) " more charts are not shown; cells.csv has their cells." }
                }
            }
        }
    })
}

/// Shapes of the runs' marks.
pub fn runs(page: &Page<'_>) -> Markup {
    html! {
        p { @for (place, run) in page.runs.iter().enumerate() {
            (Shape::of(place).symbol()) " " (run.label) "  "
        } }
    }
}

/// Each experiment once, as the first run that has it defines it.
fn experiments<'a>(page: &'a Page<'a>) -> Vec<(&'a str, &'a Experiment)> {
    let sections = page.runs.iter().flat_map(|run| &run.view.sections);
    let defined = sections.filter_map(|section| Some((section.id, section.experiment.as_ref()?)));
    defined.unique_by(|(id, _)| *id).collect()
}

/// All stages of charts, for the choice.
fn stages<'a>(page: &'a Page<'a>) -> BTreeSet<&'a str> {
    let measured = page.runs.iter().flat_map(|run| run.view.timed());
    let stages = measured.flat_map(|(_, measured)| &measured.stages);
    stages.map(|stage| stage.stage.as_str()).collect()
}

fn charts_of(page: &Page<'_>, id: &str, experiment: &Experiment) -> Vec<Markup> {
    let specs = specs(experiment);
    let charts = specs.iter().flat_map(|spec| {
        let joined = spec.over.is_none_or(|over| !experiment.is_category(over));
        let charts = charts(page, id, spec, joined);
        charts.into_iter().filter_map(|chart| figure(spec, &chart)).collect::<Vec<_>>()
    });
    charts.collect()
}

/// Of its plots, then of claims about slopes and straight lines that no plot shows.
fn specs(experiment: &Experiment) -> Vec<Spec<'_>> {
    let mut specs: Vec<Spec<'_>> = experiment.plot.iter().filter_map(of_plot).collect();
    for claim in experiment.claim.iter().filter_map(of_claim) {
        let same = |spec: &&mut Spec<'_>| spec.x == claim.x && spec.over == claim.over;
        let y = claim.y[0];
        match specs.iter_mut().find(same) {
            Some(spec) if spec.y.contains(&y) => {}
            Some(spec)
                if spec.kind == claim.kind && spec.filter == claim.filter && is_alike(spec, y) =>
            {
                spec.y.push(y)
            }
            _ => specs.push(claim),
        }
    }
    specs
}

fn of_plot(plot: &Plot) -> Option<Spec<'_>> {
    let kind = match plot.kind {
        PlotKind::Scaling => ScaleKind::Log,
        PlotKind::Lines => ScaleKind::Linear,
        _ => return None,
    };
    Some(Spec {
        title: &plot.title,
        over: plot.over.as_deref(),
        filter: &plot.filter,
        x: plot.x.as_ref()?,
        x_title: plot.x_title.as_deref(),
        y: plot.y.iter().collect(),
        kind,
    })
}

fn of_claim(claim: &Claim) -> Option<Spec<'_>> {
    let (x, y, over, kind) = match &claim.test {
        Test::Slope { x, y, over, .. } => (x, y, over, ScaleKind::Log),
        Test::Affine { x, y, over, .. } => (x, y, over, ScaleKind::Linear),
        _ => return None,
    };
    let (title, over) = (claim.text.as_str(), Some(over.as_str()));
    Some(Spec { title, over, filter: &claim.filter, x, x_title: None, y: vec![y], kind })
}

/// The measure has the unit of the chart's others.
fn is_alike(spec: &Spec<'_>, y: &Measure) -> bool {
    spec.y.iter().all(|other| other.label().unit == y.label().unit)
}

/// A chart for each group of cells that differ in the chart's axis only; of one measure of one run a chart for all groups, whose
/// names are what differs between them.
fn charts<'a>(page: &Page<'a>, id: &str, spec: &Spec<'a>, joined: bool) -> Vec<Chart<'a>> {
    let runs = page.runs.iter().enumerate();
    let groups = runs.flat_map(|(place, run)| {
        grouped(run, id, spec).into_iter().map(move |cells| (place, cells))
    });
    let groups: Vec<(usize, Vec<&'a Cell>)> = groups.collect();
    let together = spec.y.len() == 1 && !page.is_overlay();
    let differing = differing(groups.iter().map(|(_, cells)| cells.as_slice()));
    let words = |cells: &[&Cell], wanted: &dyn Fn(&str) -> bool| {
        let axes = cells.first().into_iter().flat_map(|cell| &cell.axes);
        let others = axes.filter(|(axis, _)| Some(axis.as_str()) != spec.over && wanted(axis));
        setting_words(others)
    };
    let mut charts = IndexMap::<String, Vec<Series<'a>>>::new();
    for (run, cells) in &groups {
        let own = words(cells, &|axis| differing.contains(axis));
        let chart = words(cells, &|axis| !together || !differing.contains(axis));
        for y in &spec.y {
            let is_group = together && !own.is_empty();
            let name =
                if is_group { own.clone() } else { page.naming(*run, ": ") + &name(page, y) };
            let series = series(page, *run, spec, y, name, cells, joined);
            add(charts.entry(chart.clone()).or_default(), series);
        }
    }
    let charts = charts.into_iter().filter(|(_, series)| !series.is_empty());
    let marked = charts.map(|(group, series)| (group, marked(series, page.runs.len())));
    marked.map(|(group, series)| Chart { group, series }).collect()
}

/// A series that would hide another of its run is drawn once, under both names.
fn add<'a>(all: &mut Vec<Series<'a>>, series: Option<Series<'a>>) {
    let Some(series) = series else { return };
    match all.iter_mut().find(|other| other.run == series.run && other.coincides(&series)) {
        Some(other) => other.name += &format!("; {}", series.name),
        None => all.push(series),
    }
}

/// Gives each series a marker that no other of its colour has. A run's first series of a colour has the run's shape.
fn marked(mut series: Vec<Series<'_>>, runs: usize) -> Vec<Series<'_>> {
    let mut taken = HashSet::new();
    for one in &mut series {
        let of_run = (one.run..).step_by(runs).take(Marker::COUNT);
        let markers = of_run.chain(0..Marker::COUNT).map(Marker::of);
        let free = markers.into_iter().find(|marker| taken.insert((one.color.clone(), *marker)));
        one.marker = free.unwrap_or(one.marker);
    }
    series
}

/// Axes on which the groups' cells do not all have the same value.
fn differing<'c>(groups: impl Iterator<Item = &'c [&'c Cell]>) -> BTreeSet<&'c str> {
    let firsts = groups.filter_map(|cells| cells.first()).collect_vec();
    let axes = firsts.iter().flat_map(|cell| cell.axes.keys()).map(String::as_str);
    axes.filter(|axis| !firsts.iter().map(|cell| cell.axes.get(*axis)).all_equal()).collect()
}

/// The cells of a chart, by the values of their other axes.
fn grouped<'a>(run: &PageRun<'a>, id: &str, spec: &Spec<'_>) -> Vec<Vec<&'a Cell>> {
    let Some(section) = run.view.sections.iter().find(|section| section.id == id) else {
        return Vec::new();
    };
    let cells = section.measured().map(|(cell, _)| cell);
    let cells: Vec<&Cell> = cells.filter(|cell| experiments::fits(cell, spec.filter)).collect();
    let Some(over) = spec.over else { return vec![cells] };
    groups(&cells, over).into_iter().map(|(_, cells)| cells).collect()
}

fn name(page: &Page<'_>, y: &Measure) -> String {
    y.stage_name().filter(|stage| page.colors.has(stage)).unwrap_or_else(|| y.label().words)
}

/// None where no cell has both figures, or all have the same x.
fn series<'a>(
    page: &Page<'a>,
    run: usize,
    spec: &Spec<'a>,
    y: &'a Measure,
    name: String,
    cells: &[&'a Cell],
    joined: bool,
) -> Option<Series<'a>> {
    let factors = [spec.x, y].map(|measure| measure.label().unit.factor());
    let source = Source { x: spec.x, y, factors, joined, fitted: spec.kind == ScaleKind::Log };
    let mut figures = source.read(cells);
    let [first, .., last] = figures.points.as_slice() else { return None };
    if first.x >= last.x {
        return None;
    }
    // Of many points some, spread over all.
    let step = figures.points.len().div_ceil(MOST_POINTS);
    figures.points = figures.points.into_iter().step_by(step).collect();
    let label = page.naming(run, "\n");
    for point in &mut figures.points {
        point.tip = Some(tip(&label, &name, y, point));
    }
    let color = paint(page, y).css();
    Some(Series { figures, name, color, run, marker: Marker::of(run) })
}

fn tip(run: &str, name: &str, y: &Measure, point: &Point<'_>) -> String {
    let interval = point.y.interval.filter(|interval| interval.low < interval.high);
    let interval = interval.map(|i| format!(" ({} – {})", three(i.low), three(i.high)));
    format!(
        "{run}{name}\n{}: {} {}{}\n{}, n = {}",
        si(point.x),
        three(point.y.median),
        y.label().unit.symbol(),
        interval.unwrap_or_default(),
        point.cell.cell,
        point.y.n
    )
}

/// None where a logarithm can show no point.
fn figure(spec: &Spec<'_>, chart: &Chart<'_>) -> Option<Markup> {
    let shown = &chart.series[..chart.series.len().min(MOST_SERIES)];
    let content = drawing(spec, shown)?;
    let about = format!("{}: {} over {}", spec.title, y_title(spec), x_title(spec));
    let stages = stages_of(shown).into_iter().join("\n");
    Some(html! {
        figure.multiple data-stages=(stages) {
            figcaption {
                b { (spec.title) }
                @if !chart.group.is_empty() { br; (chart.group) }
            }
            p.axis-title { "↑ " (y_title(spec)) ", " (spec.kind.name()) }
            (svg::chart(SIZE_PX, &about, &content))
            p.axis-title.x { "→ " (x_title(spec)) ", " (spec.kind.name()) }
            (fits(shown))
            @if chart.series.len() > shown.len() {
                p.faint { (chart.series.len() - shown.len()) " more lines are not shown." }
            }
        }
    })
}

fn x_title(spec: &Spec<'_>) -> String {
    let label = spec.x.label();
    match (spec.x_title, label.unit) {
        (None, _) | (_, Unit::Percent | Unit::Mebibytes) => label.text(),
        (Some(title), _) => title.to_owned(),
    }
}

fn y_title(spec: &Spec<'_>) -> String {
    let labels: Vec<_> = spec.y.iter().map(|y| y.label()).collect();
    match labels.as_slice() {
        [one] if one.unit != Unit::Milliseconds => one.text(),
        labels if labels.iter().all(|label| label.unit == Unit::Milliseconds) => {
            "time (ms)".to_owned()
        }
        labels => labels.iter().map(|label| label.text()).join("; "),
    }
}

/// Names of the stages whose time or work the series show.
fn stages_of<'a>(series: &[Series<'a>]) -> BTreeSet<&'a str> {
    let of_series = |series: &Series<'a>| {
        let y = series.y;
        let measured = series.points.iter().filter_map(|point| point.cell.measured());
        let stages =
            measured.flat_map(|measured| &measured.stages).map(|stage| stage.stage.as_str());
        stages.filter(|stage| y.stages().any(|name| name.covers(stage))).collect::<BTreeSet<_>>()
    };
    series.iter().flat_map(of_series).collect()
}

/// Names of the lines, with their exponents.
fn fits(series: &[Series<'_>]) -> Markup {
    html! {
        ul.fits {
            @for one in series {
                li {
                    span style={ "color:" (one.color) } aria-hidden="true" { (one.marker.symbol()) }
                    " " (one.name) " "
                    @match &one.fit {
                        Some(Ok(fit)) => { b { "∝ x^" (facts::exponent(fit)) } }
                        Some(Err(reason)) => { span.faint title=(reason) { "†" } }
                        None => {}
                    }
                }
            }
        }
    }
}

fn paint(page: &Page<'_>, y: &Measure) -> Paint {
    match y.stage_name() {
        Some(stage) if page.colors.has(&stage) => Paint::Stage(page.colors.of(&stage)),
        _ if y.is_time() => Paint::Ink,
        _ => Paint::Accent,
    }
}

/// Series on their axes.
fn drawing(spec: &Spec<'_>, series: &[Series<'_>]) -> Option<Markup> {
    let points = series.iter().flat_map(|one| &one.points);
    let x = Axis::fit(spec.kind, points.map(|point| point.x), [LEFT_PX, RIGHT_PX])?;
    let y = Axis::fit(spec.kind, series.iter().flat_map(|one| one.ends()), [BOTTOM_PX, TOP_PX])?;
    let axes = [&x, &y];
    Some(html! {
        (svg::x_axis(&x, [TOP_PX, BOTTOM_PX], ""))
        (svg::y_axis(&y, [LEFT_PX, RIGHT_PX], ""))
        @if spec.kind == ScaleKind::Log && series.iter().all(|one| one.y.is_time()) { (guides(axes)) }
        @for one in series { (one.lines(axes)) }
        @for one in series { (one.marks(axes)) }
    })
}

/// Lines of slope 1, one for each decade.
fn guides([x, y]: [&Axis; 2]) -> Markup {
    let [[x_low, x_high], [y_low, y_high]] = [x.coordinates(), y.coordinates()];
    let offsets = (y_low - x_high).ceil() as i32..=(y_high - x_low).floor() as i32;
    let ends = offsets.map(|offset| {
        let offset = f64::from(offset);
        [(y_low - offset).max(x_low), (y_high - offset).min(x_high)].map(|x| [x, x + offset])
    });
    html! {
        @for [from, to] in ends {
            line.guide x1=(x.px_at(from[0])) y1=(y.px_at(from[1])) x2=(x.px_at(to[0])) y2=(y.px_at(to[1])) {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{self, overlaid, page, written};
    use fathom_experiments::fixtures;

    fn figures<'h>(html: &'h str, title: &str) -> Vec<&'h str> {
        let figures = html.split("<figure").skip(1);
        figures.filter(|figure| figure.contains(&format!("<b>{title}</b>"))).collect()
    }

    #[test]
    fn a_scaling_chart_tells_its_exponent_and_its_axes() {
        let html = written(write, &fixtures::run());
        let figure = figures(&html, "Caustic photons")[0];
        let fit = figure.split("caustics/trace <b>∝ x^").nth(1).unwrap();
        let exponent: f64 = fit.split(' ').next().unwrap().parse().unwrap();
        assert!((exponent - 1.0).abs() < 0.05, "{exponent}");
        assert!(
            figure.contains("caustic photons, logarithmic") && figure.contains("class=\"guide\"")
        );
        assert!(figure.contains("time (ms), logarithmic"));
        assert!(figure.split('>').next().unwrap().contains("caustics/trace"), "{figure}");
    }

    #[test]
    fn a_linear_chart_says_so_and_has_no_guides() {
        let html = written(write, &fixtures::run());
        let figure = figures(&html, "Frame against the number of objects")[0];
        assert!(figure.contains("crates, linear") && !figure.contains("class=\"guide\""));
        assert!(figure.contains("<polyline"));
    }

    #[test]
    fn categories_are_not_joined() {
        let view = testing::view();
        let page = page(&[&view]);
        for (id, experiment) in experiments(&page) {
            for spec in specs(experiment) {
                let category = spec.over.is_some_and(|over| experiment.is_category(over));
                let charts = charts(&page, id, &spec, !category);
                for chart in charts.iter().filter(|_| category) {
                    let html = figure(&spec, chart).unwrap().into_string();
                    assert!(!html.contains("<polyline") && !html.contains("∝ x"), "{id}");
                }
            }
        }
    }

    #[test]
    fn runs_differ_by_the_shape_of_their_marks() {
        let html = overlaid(write);
        assert!(html.contains("● one") && html.contains("■ two"));
        let figure = figures(&html, "Caustic photons")[0];
        let square = Shape::Square.path([0.0, 0.0]);
        assert!(figure.contains(square.split_once('h').unwrap().1), "{figure}");
    }

    #[test]
    fn no_two_series_of_a_chart_share_colour_and_marker_or_a_name() {
        let view = testing::view();
        for page in [page(&[&view]), page(&[&view, &view]), page(&[&view; 4])] {
            let mut several = 0;
            for (id, experiment) in experiments(&page) {
                for spec in specs(experiment) {
                    for chart in charts(&page, id, &spec, true) {
                        let looks = chart.series.iter().map(|one| (&one.color, one.marker));
                        assert!(looks.clone().all_unique(), "{id}: {:?}", looks.collect_vec());
                        assert!(chart.series.iter().map(|one| &one.name).all_unique(), "{id}");
                        several += usize::from(chart.series.len() > 1);
                    }
                }
            }
            assert!(several > 20, "{several}");
        }
    }

    #[test]
    fn series_are_named_by_what_differs_between_them() {
        let html = written(write, &fixtures::run());
        let figure = figures(&html, "Marching against pixels")[0];
        let names = figure.split("data-series=\"").skip(1).map(|rest| rest.split('"').next());
        let names = names.flatten().collect_vec();
        assert!(names.len() > 1 && names.iter().all_unique(), "{names:?}");
    }

    #[test]
    fn a_claim_that_no_plot_shows_has_a_chart_and_others_have_none() {
        let experiment = |plots: &str| {
            let toml = format!(
                "id = \"own\"\ntitle = \"Own\"\nsource = \"none\"\npipeline = \"underwater\"\nscene = \"tank\"\n
                [[sweep]]\n[[sweep.axis]]\nname = \"caustics.grid\"\nvalues = [1, 2]\n
                [[claim]]\nid = \"linear\"\ntext = \"It is linear\"\n
                test.slope = {{ y = \"frame\", x = \"axis:caustics.grid\", over = \"caustics.grid\", expected = 1.0, tolerance = 0.1 }}\n{plots}"
            );
            Experiment::parse("own", &toml).unwrap()
        };
        let bare = experiment("");
        let titles = |experiment: &Experiment| {
            specs(experiment).iter().map(|s| s.title.to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(titles(&bare), ["It is linear"]);
        let plotted = experiment(
            "[[plot]]\ntitle = \"Plotted\"\nkind = \"scaling\"\nover = \"caustics.grid\"\nx = \"axis:caustics.grid\"\ny = [\"frame\"]",
        );
        assert_eq!(titles(&plotted), ["Plotted"]);
    }

    #[test]
    fn nothing_is_written_where_nothing_was_measured() {
        assert_eq!(written(write, &fixtures::all_skipped()), "");
    }
}

//! How times and errors grow: a small chart for each experiment and axis, with fitted exponents.

use std::collections::BTreeSet;

use indexmap::IndexMap;
use itertools::Itertools;
use maud::{Markup, html};
use serde_json::{Map, Value};

use super::svg::{self, Axis, Paint, Shape};
use super::{Page, PageRun, PageSection, setting};
use crate::facts;
use crate::format::three;
use crate::plots::scale::ScaleKind;
use fathom_experiments as experiments;
use fathom_experiments::schema::{Claim, Experiment, FIXED_SHARE, Plot, PlotKind, Test};
use fathom_experiments::words::Unit;
use fathom_experiments::{Measure, Scaling, groups, scaling};
use fathom_record::{Cell, Estimate};

pub const SECTION: PageSection = PageSection { id: "scaling", title: "How it scales", write };

const SIZE_PX: [f64; 2] = [324.0, 190.0];
const LEFT_PX: f64 = 48.0;
const TOP_PX: f64 = 8.0;
const BOTTOM_PX: f64 = 166.0;
/// Most room for labels at the ends of lines.
const LABELS_PX: f64 = 112.0;
const LINE_PX: f64 = 13.0;
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
    group: String,
    series: Vec<Series<'a>>,
}

struct Series<'a> {
    /// Its place on the page.
    run: usize,
    name: String,
    y: &'a Measure,
    points: Vec<Point<'a>>,
    /// Why there is no exponent, where one was asked for.
    fit: Option<Result<Scaling, String>>,
    /// Its points have an order.
    joined: bool,
}

/// In the units shown.
struct Point<'a> {
    x: f64,
    y: Estimate,
    cell: &'a Cell,
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
            "Points are medians with their 95 % intervals. On logarithmic charts the line is the fitted power law, y ∝ x to the "
            "exponent that stands below the chart; dotted lines have the slope 1: twice the work takes twice the time. "
            "Elsewhere lines join the points of an axis of numbers; scenes and other categories are not joined."
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
fn runs(page: &Page<'_>) -> Markup {
    html! {
        p { @for (place, run) in page.runs.iter().enumerate() {
            (Shape::of_run(place).symbol()) " " (run.label) "  "
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
        charts.into_iter().filter_map(|chart| figure(page, spec, &chart)).collect::<Vec<_>>()
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

/// A chart for each group of cells that differ in the chart's axis only; of one measure a chart for all groups.
fn charts<'a>(page: &Page<'a>, id: &str, spec: &Spec<'a>, joined: bool) -> Vec<Chart<'a>> {
    let mut charts = IndexMap::<String, Vec<Series<'a>>>::new();
    for (place, run) in page.runs.iter().enumerate() {
        for (group, cells) in grouped(run, id, spec) {
            for y in &spec.y {
                let alone = spec.y.len() == 1 && !group.is_empty();
                let name = if alone { group.clone() } else { name(page, y) };
                let one = series(spec, y, name, &cells, joined);
                let chart = if alone { String::new() } else { group.clone() };
                let one = one.map(|one| Series { run: place, ..one });
                charts.entry(chart).or_default().extend(one);
            }
        }
    }
    let charts = charts.into_iter().filter(|(_, series)| !series.is_empty());
    charts.map(|(group, series)| Chart { group, series }).collect()
}

/// The cells of a chart, by the values of their other axes in words.
fn grouped<'a>(run: &PageRun<'a>, id: &str, spec: &Spec<'_>) -> Vec<(String, Vec<&'a Cell>)> {
    let Some(section) = run.view.sections.iter().find(|section| section.id == id) else {
        return Vec::new();
    };
    let cells = section.measured().map(|(cell, _)| cell);
    let cells: Vec<&Cell> = cells.filter(|cell| experiments::fits(cell, spec.filter)).collect();
    let Some(over) = spec.over else { return vec![(String::new(), cells)] };
    let in_words = |cells: &[&Cell]| {
        let axes = cells.first().into_iter().flat_map(|cell| &cell.axes);
        setting::in_words(axes.filter(|(name, _)| *name != over))
    };
    groups(&cells, over).into_iter().map(|(_, cells)| (in_words(&cells), cells)).collect()
}

fn name(page: &Page<'_>, y: &Measure) -> String {
    y.stage_name().filter(|stage| page.colors.has(stage)).unwrap_or_else(|| y.label().words)
}

/// None where no cell has both figures, or all have the same x.
fn series<'a>(
    spec: &Spec<'a>,
    y: &'a Measure,
    name: String,
    cells: &[&'a Cell],
    joined: bool,
) -> Option<Series<'a>> {
    let [x_factor, y_factor] = [spec.x, y].map(|measure| measure.label().unit.factor());
    let point = |cell: &&'a Cell| {
        let measured = cell.measured()?;
        let x = spec.x.read(cell, measured)?.median() * x_factor;
        let y = y.read(cell, measured)?.estimate().scaled(y_factor);
        Some(Point { x, y, cell })
    };
    let mut points: Vec<Point<'_>> = cells.iter().filter_map(point).collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    let [first, .., last] = points.as_slice() else { return None };
    if first.x >= last.x {
        return None;
    }
    let fit =
        (joined && spec.kind == ScaleKind::Log).then(|| scaling(y, spec.x, cells, FIXED_SHARE));
    Some(Series { run: 0, name, y, points, fit, joined })
}

/// None where a logarithm can show no point.
fn figure(page: &Page<'_>, spec: &Spec<'_>, chart: &Chart<'_>) -> Option<Markup> {
    let shown = &chart.series[..chart.series.len().min(MOST_SERIES)];
    let drawing = Drawing::new(page, spec, shown)?;
    let about = format!("{}: {} over {}", spec.title, y_title(spec), x_title(spec));
    let stages = stages_of(shown).into_iter().join("\n");
    Some(html! {
        figure.multiple data-stages=(stages) {
            figcaption {
                b { (spec.title) }
                @if !chart.group.is_empty() { br; (chart.group) }
            }
            p.axis-title { "↑ " (y_title(spec)) ", " (kind_name(spec.kind)) }
            (svg::chart(SIZE_PX, &about, &drawing.content()))
            p.axis-title.x { "→ " (x_title(spec)) ", " (kind_name(spec.kind)) }
            (fits(page, shown))
            @if chart.series.len() > shown.len() {
                p.faint { (chart.series.len() - shown.len()) " more lines are not shown." }
            }
        }
    })
}

fn kind_name(kind: ScaleKind) -> &'static str {
    match kind {
        ScaleKind::Linear => "linear",
        ScaleKind::Log => "logarithmic",
    }
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
fn fits(page: &Page<'_>, series: &[Series<'_>]) -> Markup {
    html! {
        ul.fits {
            @for one in series {
                @if one.fit.is_some() || series.len() > 1 {
                    li {
                        span style={ "color:" (paint(page, one).css()) } aria-hidden="true" { (Shape::of_run(one.run).symbol()) }
                        " " (one.name) " "
                        @match &one.fit {
                            Some(Ok(fit)) => { b { "∝ x^" (facts::exponent(fit)) } }
                            Some(Err(reason)) => { span.faint { "no exponent: " (reason) } }
                            None => {}
                        }
                    }
                }
            }
        }
    }
}

fn paint(page: &Page<'_>, series: &Series<'_>) -> Paint {
    match series.y.stage_name() {
        Some(stage) if page.colors.has(&stage) => Paint::Stage(page.colors.of(&stage)),
        _ if series.y.is_time() => Paint::Ink,
        _ => Paint::Accent,
    }
}

/// Series on their axes.
struct Drawing<'d> {
    page: &'d Page<'d>,
    series: &'d [Series<'d>],
    kind: ScaleKind,
    /// Of x and y, from the record to what is shown.
    factors: [f64; 2],
    x: Axis,
    y: Axis,
    right_px: f64,
}

impl<'d> Drawing<'d> {
    fn new(page: &'d Page<'d>, spec: &Spec<'_>, series: &'d [Series<'d>]) -> Option<Drawing<'d>> {
        let labels = series.iter().map(|one| svg::text_px(&label(page, one)) + 10.0);
        let right_px = SIZE_PX[0] - labels.fold(0.0, f64::max).min(LABELS_PX);
        let points = || series.iter().flat_map(|one| &one.points);
        let x = Axis::fit(spec.kind, points().map(|point| point.x), [LEFT_PX, right_px])?;
        let ends =
            points().flat_map(|point| [point.y.ends()[0], point.y.median, point.y.ends()[1]]);
        let y = Axis::fit(spec.kind, ends, [BOTTOM_PX, TOP_PX])?;
        let y_factor = series.first()?.y.label().unit.factor();
        let factors = [spec.x.label().unit.factor(), y_factor];
        Some(Drawing { page, series, kind: spec.kind, factors, x, y, right_px })
    }

    fn content(&self) -> Markup {
        html! {
            (svg::x_axis(&self.x, [TOP_PX, BOTTOM_PX], ""))
            (svg::y_axis(&self.y, [LEFT_PX, self.right_px], ""))
            @if self.kind == ScaleKind::Log && self.series.iter().all(|one| one.y.is_time()) { (self.guides()) }
            @for one in self.series { (self.line(one)) }
            @for one in self.series { (self.points(one)) }
            (self.labels())
        }
    }

    /// Lines of slope 1, one for each decade.
    fn guides(&self) -> Markup {
        let [[x_low, x_high], [y_low, y_high]] = [self.x.coordinates(), self.y.coordinates()];
        let offsets = (y_low - x_high).ceil() as i32..=(y_high - x_low).floor() as i32;
        let ends = offsets.map(|offset| {
            let offset = f64::from(offset);
            [(y_low - offset).max(x_low), (y_high - offset).min(x_high)].map(|x| [x, x + offset])
        });
        html! {
            @for [from, to] in ends {
                line.guide x1=(self.x.px_at(from[0])) y1=(self.y.px_at(from[1])) x2=(self.x.px_at(to[0])) y2=(self.y.px_at(to[1])) {}
            }
        }
    }

    /// The fitted power law, or a line through the points of an axis that has an order.
    fn line(&self, series: &Series<'_>) -> Markup {
        let stroke = paint(self.page, series).css();
        let ends = match &series.fit {
            Some(Ok(fit)) => self.fitted(fit).to_vec(),
            _ if series.joined => drawn(series).map(|point| [point.x, point.y.median]).collect(),
            _ => Vec::new(),
        };
        let places = ends.iter().filter_map(|[x, y]| Some([self.x.px(*x)?, self.y.px_within(*y)]));
        let places = places.map(|[x, y]| format!("{x},{y}")).join(" ");
        html! {
            @if !places.is_empty() { polyline.series points=(places) style={ "stroke:" (stroke) } {} }
        }
    }

    fn fitted(&self, fit: &Scaling) -> [[f64; 2]; 2] {
        let [x_factor, y_factor] = self.factors;
        [fit.range.0, fit.range.1].map(|x| {
            let y = (fit.slope.intercept + fit.slope.slope * x.ln()).exp();
            [x * x_factor, y * y_factor]
        })
    }

    fn points(&self, series: &Series<'_>) -> Markup {
        let fill = paint(self.page, series).css();
        let shape = Shape::of_run(series.run);
        let placed = drawn(series).filter_map(|point| {
            let at = [self.x.px(point.x)?, self.y.px(point.y.median)?];
            Some((at, point.y.ends().map(|end| self.y.px_within(end)), self.tip(series, point)))
        });
        html! {
            @for ([x, y], [low, high], tip) in placed {
                @if low - high > 1.0 { line.whisker x1=(x) x2=(x) y1=(low) y2=(high) style={ "stroke:" (fill) } {} }
                path.mark d=(shape.path([x, y])) style={ "fill:" (fill) } data-tip=(tip) { title { (tip) } }
            }
        }
    }

    fn tip(&self, series: &Series<'_>, point: &Point<'_>) -> String {
        let run = self.page.is_overlay().then(|| format!("{}\n", self.page.runs[series.run].label));
        let unit = series.y.label().unit.symbol();
        let interval = point.y.interval.filter(|interval| interval.low < interval.high);
        let interval = interval.map(|i| format!(" ({} – {})", three(i.low), three(i.high)));
        format!(
            "{}{}\n{}: {} {unit}{}\n{}, n = {}",
            run.unwrap_or_default(),
            series.name,
            crate::format::si(point.x),
            three(point.y.median),
            interval.unwrap_or_default(),
            point.cell.cell,
            point.y.n
        )
    }

    /// Names at the right ends of lines.
    fn labels(&self) -> Markup {
        let ends = self.series.iter().map(|one| {
            let last = drawn(one).last().map_or(f64::NAN, |point| point.y.median);
            self.y.px_within(last) + 4.0
        });
        let room = SIZE_PX[0] - self.right_px - 8.0;
        let labels = self.series.iter().map(|one| svg::in_two_lines(&label(self.page, one), room));
        let labels: Vec<Vec<String>> = labels.collect();
        let lines = labels.iter().map(Vec::len).max().unwrap_or(1) as f64;
        let bottom = BOTTOM_PX + 4.0 - (lines - 1.0) * LINE_PX;
        let heights = svg::apart(&ends.collect::<Vec<_>>(), lines * LINE_PX + 1.0, bottom);
        let x = svg::tenth(self.right_px + 6.0);
        html! {
            @for (label, height) in labels.iter().zip(heights) {
                text.end x=(x) y=(height) {
                    @for (place, line) in label.iter().enumerate() {
                        tspan x=(x) dy=(if place > 0 { LINE_PX } else { 0.0 }) { (line) }
                    }
                }
            }
        }
    }
}

/// A line's name at its end, behind the shape of its run where there are several.
fn label(page: &Page<'_>, series: &Series<'_>) -> String {
    if page.is_overlay() {
        format!("{} {}", Shape::of_run(series.run).symbol(), series.name)
    } else {
        series.name.clone()
    }
}

/// Of many points some, spread over all.
fn drawn<'s>(series: &'s Series<'s>) -> impl Iterator<Item = &'s Point<'s>> {
    let step = series.points.len().div_ceil(MOST_POINTS).max(1);
    series.points.iter().step_by(step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ReportView;
    use fathom_experiments::fixtures;

    fn shown(views: &[&ReportView<'_>]) -> String {
        let labels = ["one", "two"].into_iter().zip(views);
        let runs = labels.map(|(label, view)| PageRun { label: label.into(), view }).collect();
        write(&Page::new(runs)).map_or_else(String::new, Markup::into_string)
    }

    fn figures<'h>(html: &'h str, title: &str) -> Vec<&'h str> {
        let figures = html.split("<figure").skip(1);
        figures.filter(|figure| figure.contains(&format!("<b>{title}</b>"))).collect()
    }

    #[test]
    fn a_scaling_chart_tells_its_exponent_and_its_axes() {
        let records = fixtures::run();
        let html = shown(&[&ReportView::new(&records, None)]);
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
        let records = fixtures::run();
        let html = shown(&[&ReportView::new(&records, None)]);
        let figure = figures(&html, "Frame against the number of objects")[0];
        assert!(figure.contains("crates, linear") && !figure.contains("class=\"guide\""));
        assert!(figure.contains("<polyline"));
    }

    #[test]
    fn categories_are_not_joined() {
        let records = fixtures::run();
        let view = ReportView::new(&records, None);
        let page = Page::new(vec![PageRun { label: "one".into(), view: &view }]);
        for (id, experiment) in experiments(&page) {
            for spec in specs(experiment) {
                let category = spec.over.is_some_and(|over| experiment.is_category(over));
                let charts = charts(&page, id, &spec, !category);
                for chart in charts.iter().filter(|_| category) {
                    let html = figure(&page, &spec, chart).unwrap().into_string();
                    assert!(!html.contains("<polyline") && !html.contains("∝ x"), "{id}");
                }
            }
        }
    }

    #[test]
    fn runs_differ_by_the_shape_of_their_marks() {
        let records = fixtures::run();
        let view = ReportView::new(&records, None);
        let html = shown(&[&view, &view]);
        assert!(html.contains("● one") && html.contains("■ two"));
        let figure = figures(&html, "Caustic photons")[0];
        let square = Shape::Square.path([0.0, 0.0]);
        assert!(figure.contains(square.split_once('h').unwrap().1), "{figure}");
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
        let records = fixtures::all_skipped();
        assert!(shown(&[&ReportView::new(&records, None)]).is_empty());
    }
}

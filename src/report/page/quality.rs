//! Quality against time: of settings that solve the same task, the error and the time of the frame, and which are the best.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use indexmap::IndexMap;
use itertools::Itertools;
use maud::{Markup, html};
use serde_json::Value;

use super::table::{self, numbers, table, words};
use super::{Page, PageRun, PageSection, setting};
use crate::axis::{Axis, ScaleKind};
use crate::format::{NS_PER_MS, three};
use crate::svg::{self, Paint, Shape};
use fathom_experiments::words::{Unit, figure as label};
use fathom_experiments::{flatten, label_text};
use fathom_record::{Cell, ErrorFigure, Estimate, Measured};

pub const SECTION: PageSection =
    PageSection { id: "quality", title: "Quality against time", write };

/// The limit that a reader finds first: 20 frames per second.
const LIMIT_MS: f64 = 50.0;
/// Fewer settings are told in the table alone.
const LEAST_CHARTED: usize = 4;
/// Tasks with fewer settings are folded.
const LEAST_TOLD: usize = 3;
/// A range above this factor is shown on a logarithmic axis.
const LOG_ABOVE: f64 = 8.0;
/// Errors that differ by less, as a share of the largest, tell nothing about the settings.
const LEAST_DIFFERENCE: f64 = 0.1;
const SIZE_PX: [f64; 2] = [324.0, 196.0];
const X_PX: [f64; 2] = [48.0, 310.0];
const Y_PX: [f64; 2] = [170.0, 10.0];

/// Groups of parameters that say what is computed rather than how: they change the reference or the work that every setting has.
const TASK_GROUPS: [&str; 7] =
    ["view", "camera", "light", "water", "animation", "objects", "floor_depth_m"];
/// The same among parameters of a method, by the last part of their paths: the reference of occlusion depends on them.
const TASK_LEAVES: [&str; 3] = ["r_max_m", "r_max_share", "attenuation"];

/// Cells whose errors can be compared.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Task<'a> {
    experiment: &'a str,
    scene: &'a str,
    /// Names of the axes that differ between its cells.
    axes: Vec<&'a str>,
    /// The parameters of [`TASK_GROUPS`] and [`TASK_LEAVES`] and their values.
    params: String,
}

/// A setting of a task as a run measured it.
struct Setting<'a> {
    run: usize,
    cell: &'a Cell,
    time_ms: Estimate,
    /// In the unit shown; its size.
    error: f64,
    /// No other setting of the run is better in one and as good in the other.
    front: bool,
}

/// A task with one of its errors.
struct Comparison<'a> {
    task: Task<'a>,
    error: &'a ErrorFigure,
    settings: Vec<Setting<'a>>,
    /// Axes by which the settings differ.
    varying: BTreeSet<&'a str>,
}

fn write(page: &Page<'_>) -> Option<Markup> {
    let comparisons = comparisons(page);
    if comparisons.is_empty() {
        return None;
    }
    let (told, folded): (Vec<_>, Vec<_>) =
        comparisons.iter().enumerate().partition(|(_, one)| count(one) >= LEAST_TOLD);
    Some(html! {
        p.lead {
            "Settings are compared where they solve the same task: the same experiment and axes, scene, view, size, light and water, and "
            "the same error against the same reference. Of the errors that differ by a tenth or more, the one of the last stage is "
            "shown. The best setting has the least error of those whose median frame time is at most the limit; of equal errors "
            "the fastest."
        }
        div.controls.script-only {
            label { "At most " input #quality-limit type="number" min="0" step="any" value=(LIMIT_MS) size="6"; " ms per frame" }
        }
        (best_settings(page, &told))
        @if !folded.is_empty() {
            details { summary { (folded.len()) " tasks with two settings" } (best_settings(page, &folded)) }
        }
        div.multiples {
            @for (place, one) in &told {
                @if is_charted(one) { (figure(page, *place, one)) }
            }
        }
    })
}

fn is_charted(one: &Comparison<'_>) -> bool {
    count(one) >= LEAST_CHARTED
}

/// Its settings, those of several runs once.
fn count(one: &Comparison<'_>) -> usize {
    one.settings.iter().map(|setting| setting.cell.cell.as_str()).unique().count()
}

fn best_settings(page: &Page<'_>, comparisons: &[(usize, &Comparison<'_>)]) -> Markup {
    let heads = html! {
        (table::run(page.is_overlay()))
        (words(&["Task"]))
        th scope="col" { "Best setting of at most " span.quality-limit { (three(LIMIT_MS)) } " ms" }
        (words(&["Its error and time"]))
        (numbers(&["Settings"]))
    };
    let rows = html! { @for (place, one) in comparisons { (rows(page, *place, one)) } };
    table("Best settings", "quality-table", &heads, &rows)
}

/// Those of many settings first within a pipeline.
fn comparisons<'a>(page: &Page<'a>) -> Vec<Comparison<'a>> {
    let mut tasks = IndexMap::<Task<'a>, Vec<(usize, &'a Cell, &'a Measured)>>::new();
    for (place, run) in page.runs.iter().enumerate() {
        for (cell, measured) in run.view.timed() {
            tasks.entry(task(cell)).or_default().push((place, cell, measured));
        }
    }
    let mut compared: Vec<Comparison<'a>> =
        tasks.into_iter().filter_map(|(task, cells)| compare(task, &cells)).collect();
    let pipelines: Vec<&str> = compared.iter().map(pipeline).unique().collect();
    compared.sort_by_key(|one| {
        let place = pipelines.iter().position(|known| *known == pipeline(one));
        (place, Reverse(count(one)))
    });
    compared
}

fn pipeline<'a>(one: &Comparison<'a>) -> &'a str {
    &one.settings[0].cell.pipeline
}

fn task(cell: &Cell) -> Task<'_> {
    let leaves = flatten(&cell.params.to_map());
    let of_task = leaves.iter().filter(|(path, _)| is_of_task(path));
    let mut params = of_task.map(|(path, value)| format!("{}={}", last(path), label_text(value)));
    let axes = cell.axes.keys().map(String::as_str).filter(|axis| !is_of_task(axis));
    Task {
        experiment: &cell.experiment,
        scene: &cell.scene,
        axes: axes.collect(),
        params: params.join(";"),
    }
}

fn is_of_task(path: &str) -> bool {
    let group = path.split('.').next().unwrap_or(path);
    path == "scene" || TASK_GROUPS.contains(&group) || TASK_LEAVES.contains(&last(path))
}

/// `r_max_m` of `ao.r_max_m`: methods that are compared have groups of their own.
fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

/// None where fewer than two settings differ in an error that all have.
fn compare<'a>(
    task: Task<'a>,
    cells: &[(usize, &'a Cell, &'a Measured)],
) -> Option<Comparison<'a>> {
    let error = shown_error(cells)?;
    let factor = factor(error);
    let settings = cells.iter().filter_map(|(run, cell, measured)| {
        let error = measured.errors.iter().find(|known| known.name == error.name)?;
        let time_ms = measured.frame.untimed.scaled(1.0 / NS_PER_MS);
        let error = error.value.abs() * factor;
        Some(Setting { run: *run, cell, time_ms, error, front: false })
    });
    let mut settings: Vec<Setting<'_>> = settings.collect();
    let fronts: Vec<bool> = settings.iter().map(|one| is_front(one, &settings)).collect();
    settings.iter_mut().zip(fronts).for_each(|(one, front)| one.front = front);
    let varying = varying(&settings);
    Some(Comparison { task, error, settings, varying })
}

/// Of the errors that all cells have and that differ between them, the first of the stage that runs last.
fn shown_error<'a>(cells: &[(usize, &'a Cell, &'a Measured)]) -> Option<&'a ErrorFigure> {
    let (_, _, first) = cells.first()?;
    let differs = |error: &ErrorFigure| {
        let of_cell = |measured: &Measured| {
            measured.errors.iter().find(|known| known.name == error.name).map(|e| e.value.abs())
        };
        let values: Option<Vec<f64>> =
            cells.iter().map(|(.., m)| of_cell(m).filter(|e| e.is_finite())).collect();
        let (low, high) = values?.into_iter().minmax().into_option()?;
        Some(high - low > LEAST_DIFFERENCE * high)
    };
    let shown = first.errors.iter().filter(|error| differs(error) == Some(true));
    let runs_at = |error: &&ErrorFigure| first.stages.iter().position(|s| s.stage == error.stage);
    shown.rev().max_by_key(runs_at)
}

fn is_front(one: &Setting<'_>, all: &[Setting<'_>]) -> bool {
    let (time, error) = (one.time_ms.median, one.error);
    !all.iter().any(|other| {
        let [faster, better] = [other.time_ms.median < time, other.error < error];
        other.run == one.run
            && other.time_ms.median <= time
            && other.error <= error
            && (faster || better)
    })
}

/// The least error within the limit; of equal ones the fastest.
fn best<'s, 'a>(one: &'s Comparison<'a>, run: usize, limit_ms: f64) -> Option<&'s Setting<'a>> {
    let of_run = one.settings.iter().filter(|setting| setting.run == run);
    let within = of_run.filter(|setting| setting.time_ms.median <= limit_ms);
    within.min_by(|a, b| {
        let by_time = || a.time_ms.median.total_cmp(&b.time_ms.median);
        a.error.total_cmp(&b.error).then_with(by_time)
    })
}

/// From the record to what is shown: the table of words may show a share as per cent.
fn factor(error: &ErrorFigure) -> f64 {
    label(&error.name).unit.factor()
}

/// `RMS error of occlusion 0.031`, `caustic photons lost 3.1 %`
fn error_text(error: &ErrorFigure, shown: f64) -> String {
    let label = label(&error.name);
    format!("{} {} {}", label.words, three(shown), unit(error)).trim_end().to_owned()
}

/// The unit shown: that of the words, else the record's.
fn unit(error: &ErrorFigure) -> &str {
    match label(&error.name).unit {
        Unit::One if error.unit != "1" => &error.unit,
        unit => unit.symbol(),
    }
}

fn error_title(error: &ErrorFigure) -> String {
    let label = label(&error.name);
    match unit(error) {
        "" => label.words,
        unit => format!("{} ({unit})", label.words),
    }
}

fn varying<'a>(settings: &[Setting<'a>]) -> BTreeSet<&'a str> {
    let axes = settings.iter().flat_map(|setting| setting.cell.axes.keys()).map(String::as_str);
    let value = |setting: &Setting<'_>, axis: &str| setting.cell.axes.get(axis).map(label_text);
    let differ = |axis: &&str| !settings.iter().map(|setting| value(setting, axis)).all_equal();
    axes.unique().filter(differ).collect()
}

/// The axes by which its settings differ, in words.
fn setting_text(one: &Comparison<'_>, setting: &Setting<'_>) -> String {
    let axes = setting.cell.axes.iter().filter(|(name, _)| one.varying.contains(name.as_str()));
    setting::in_words(axes)
}

/// Scene, size and the other axes that its settings share: `crates, 160 × 160 px, crates 3`.
fn conditions(one: &Comparison<'_>) -> String {
    let cell = one.settings[0].cell;
    let side = |name: &str| cell.params.get("view")?.get(name).and_then(Value::as_u64);
    let sides = side("width").zip(side("height"));
    let is_told = |value: &Value| {
        let size = sides.map(|(width, height)| format!("{width}x{height}"));
        value.as_str().is_some_and(|text| text == cell.scene || Some(text) == size.as_deref())
    };
    let shared = cell
        .axes
        .iter()
        .filter(|(name, value)| !one.varying.contains(name.as_str()) && !is_told(value));
    let size = sides.map(|(width, height)| format!("{width} × {height} px"));
    let parts = [Some(cell.scene.clone()), size, Some(setting::in_words(shared))];
    parts.into_iter().flatten().filter(|part| !part.is_empty()).join(", ")
}

/// Pipelines of its settings: `hsao and volume_ao`.
fn pipelines(one: &Comparison<'_>) -> String {
    one.settings.iter().map(|setting| setting.cell.pipeline.as_str()).unique().join(" and ")
}

fn runs_of<'p, 'a>(page: &'p Page<'a>, one: &Comparison<'_>) -> Vec<(usize, &'p PageRun<'a>)> {
    let runs = page.runs.iter().enumerate();
    runs.filter(|(place, _)| one.settings.iter().any(|setting| setting.run == *place)).collect()
}

fn rows(page: &Page<'_>, place: usize, one: &Comparison<'_>) -> Markup {
    let charted = is_charted(one);
    html! {
        @for (index, (run, of_run)) in runs_of(page, one).into_iter().enumerate() {
            @let best = best(one, run, LIMIT_MS);
            tr data-comparison=(place) data-run=(run) {
                @if page.is_overlay() { td { (of_run.label) } }
                th scope="row" {
                    @if index == 0 {
                        b { (pipelines(one)) } " " (conditions(one)) " "
                        @if charted { a.source href={ "#quality-" (place) } { (one.task.experiment) } }
                        @else { span.source { (one.task.experiment) } }
                    }
                }
                td.best-setting { @match best { Some(best) => { b { (setting_text(one, best)) } } None => { span.faint { (none(one, run)) } } } }
                td.best-figures { @if let Some(best) = best { (figures_text(one, best)) } }
                td.number { (one.settings.iter().filter(|setting| setting.run == run).count()) }
            }
            @if !charted { (uncharted(place, one, run)) }
        }
    }
}

/// Why there is no best setting.
fn none(one: &Comparison<'_>, run: usize) -> String {
    let of_run = one.settings.iter().filter(|setting| setting.run == run);
    let fastest = of_run.map(|setting| setting.time_ms.median).fold(f64::INFINITY, f64::min);
    format!("none: the fastest takes {} ms", three(fastest))
}

/// The figures of settings without a chart, which the script reads.
fn uncharted(place: usize, one: &Comparison<'_>, run: usize) -> Markup {
    html! {
        tr hidden data-of=(place) { td {
            @for setting in one.settings.iter().filter(|setting| setting.run == run) {
                span data-setting=(setting_text(one, setting)) data-run=(run) data-ms=(setting.time_ms.median)
                    data-error=(setting.error) data-figures=(figures_text(one, setting)) {}
            }
        } }
    }
}

fn figures_text(one: &Comparison<'_>, setting: &Setting<'_>) -> String {
    let time = setting.time_ms.median;
    format!("{} in {} ms", error_text(one.error, setting.error), three(time))
}

/// Error against time of a task's settings.
struct Scatter<'s, 'a> {
    page: &'s Page<'a>,
    one: &'s Comparison<'a>,
    x: Axis,
    y: Axis,
}

fn figure(page: &Page<'_>, place: usize, one: &Comparison<'_>) -> Markup {
    let Some(scatter) = Scatter::new(page, one) else { return html! {} };
    let about = format!("{} against frame time, {}", error_title(one.error), conditions(one));
    html! {
        figure.multiple.quality id={ "quality-" (place) } data-of=(place) {
            figcaption { b { (pipelines(one)) " " (one.task.experiment) } br; (conditions(one)) }
            p.axis-title { "↑ " (error_title(one.error)) ", " (scatter.y.kind.name()) }
            (svg::chart(SIZE_PX, &about, &scatter.content()))
            p.axis-title.x { "→ frame time (ms), " (scatter.x.kind.name()) }
            @for (run, of_run) in runs_of(page, one) {
                p.best data-run=(run) {
                    @if page.is_overlay() { (Shape::of(run).symbol()) " " (of_run.label) ": " }
                    span.best-words { (sentence(one, run)) }
                }
                (front_table(one, run))
            }
        }
    }
}

fn sentence(one: &Comparison<'_>, run: usize) -> String {
    let limit = three(LIMIT_MS);
    match best(one, run, LIMIT_MS) {
        Some(best) => format!(
            "Best of at most {limit} ms: {}: {}.",
            setting_text(one, best),
            figures_text(one, best)
        ),
        None => format!("Best of at most {limit} ms: {}.", none(one, run)),
    }
}

fn front_table(one: &Comparison<'_>, run: usize) -> Markup {
    let of_run = || one.settings.iter().filter(|setting| setting.run == run);
    let front = of_run().filter(|setting| setting.front);
    let front = front.sorted_by(|a, b| a.time_ms.median.total_cmp(&b.time_ms.median));
    html! {
        details {
            summary { "the front: " (front.len()) " of " (of_run().count()) " settings that no other beats" }
            ul.fits { @for setting in front { li { (setting_text(one, setting)) ": " (figures_text(one, setting)) } } }
        }
    }
}

impl<'s, 'a> Scatter<'s, 'a> {
    fn new(page: &'s Page<'a>, one: &'s Comparison<'a>) -> Option<Scatter<'s, 'a>> {
        let times: Vec<f64> = one.settings.iter().map(|setting| setting.time_ms.median).collect();
        let errors: Vec<f64> = one.settings.iter().map(|setting| setting.error).collect();
        let x = Axis::fit(kind(&times), times, X_PX)?;
        let y = Axis::fit(kind(&errors), errors, Y_PX)?;
        Some(Scatter { page, one, x, y })
    }

    fn content(&self) -> Markup {
        let [x_low, x_high] = self.x.coordinates();
        html! {
            (svg::x_axis(&self.x, [Y_PX[1], Y_PX[0]], ""))
            (svg::y_axis(&self.y, X_PX, ""))
            @for (run, _) in runs_of(self.page, self.one) { (self.front(run)) }
            @let limit = self.x.px_within(LIMIT_MS);
            line.limit x1=(limit) x2=(limit) y1=(Y_PX[1]) y2=(Y_PX[0]) data-low=(x_low) data-high=(x_high)
                data-log=(self.x.kind == ScaleKind::Log) data-left=(X_PX[0]) data-right=(X_PX[1]) {}
            @for setting in &self.one.settings { (self.mark(setting)) }
        }
    }

    /// Steps along the settings that no other beats.
    fn front(&self, run: usize) -> Markup {
        let front = self.one.settings.iter().filter(|setting| setting.run == run && setting.front);
        let places = front.filter_map(|setting| self.place(setting));
        let places = places.sorted_by(|a, b| a[0].total_cmp(&b[0])).collect_vec();
        let steps = places.iter().tuple_windows().flat_map(|(from, to)| [[to[0], from[1]], *to]);
        let all = places.first().copied().into_iter().chain(steps);
        html! { polyline.front points=(all.map(|[x, y]| format!("{x},{y}")).join(" ")) {} }
    }

    fn place(&self, setting: &Setting<'_>) -> Option<[f64; 2]> {
        Some([self.x.px(setting.time_ms.median)?, self.y.px(setting.error)?])
    }

    /// Filled on the front, hollow else; the best within the limit is ringed.
    fn mark(&self, setting: &Setting<'_>) -> Markup {
        let Some([x, y]) = self.place(setting) else { return html! {} };
        let best = best(self.one, setting.run, LIMIT_MS);
        let is_best = best.is_some_and(|best| std::ptr::eq(best, setting));
        let path = Shape::of(setting.run).path([x, y]);
        let tip = self.tip(setting);
        let fill = if setting.front { Paint::Accent.css() } else { "var(--ground)".to_owned() };
        html! {
            path.mark.setting.best[is_best] d=(path) style={ "fill:" (fill) } data-tip=(tip)
                data-setting=(setting_text(self.one, setting)) data-run=(setting.run) data-ms=(setting.time_ms.median)
                data-error=(setting.error) data-figures=(figures_text(self.one, setting)) { title { (tip) } }
        }
    }

    fn tip(&self, setting: &Setting<'_>) -> String {
        let run = self.page.naming(setting.run, "\n");
        let [low, high] = setting.time_ms.ends().map(three);
        format!(
            "{}{}\n{}\nframe {} ms ({low} – {high}), n = {}{}",
            run,
            setting_text(self.one, setting),
            error_text(self.one.error, setting.error),
            three(setting.time_ms.median),
            setting.time_ms.n,
            if setting.front { "\nno other setting beats it" } else { "" }
        )
    }
}

/// Logarithmic where values span much and a logarithm can show all of them.
fn kind(values: &[f64]) -> ScaleKind {
    match values.iter().copied().minmax().into_option() {
        Some((low, high)) if low > 0.0 && high > LOG_ABOVE * low => ScaleKind::Log,
        _ => ScaleKind::Linear,
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::page;
    use super::*;
    use crate::ReportView;
    use fathom_experiments::fixtures;
    use fathom_record::Record;

    /// Invented errors and times of the cells of an experiment: error and ms by the number of the cell.
    fn records(experiment: &str, figures: fn(usize) -> (f64, f64)) -> Vec<Record> {
        let mut records = fixtures::run();
        let cells = fixtures::cells(&mut records).filter(|cell| cell.experiment == experiment);
        for (number, measured) in cells.filter_map(Cell::measured_mut).enumerate() {
            let (error, ms) = figures(number);
            measured.errors = vec![ErrorFigure::new("ao_rmse", error, "1", "ao/march")];
            measured.frame.untimed.median = ms * NS_PER_MS;
        }
        records
    }

    /// Better settings take longer.
    fn trade(number: usize) -> (f64, f64) {
        (1.0 / (number + 1) as f64, 10.0 + 10.0 * number as f64)
    }

    #[test]
    fn the_best_setting_has_the_least_error_within_the_limit() {
        let records = records("vao-samples", trade);
        let view = ReportView::new(&records, None);
        let compared = comparisons(&page(&[&view]));
        let [one] = compared.as_slice() else { panic!("{} comparisons", compared.len()) };
        let best_at = |limit| best(one, 0, limit).map(|best| best.time_ms.median);
        assert_eq!(best_at(LIMIT_MS), Some(50.0));
        assert_eq!(best_at(5.0), None);
        assert!(one.settings.iter().all(|setting| setting.front));
        let html = write(&page(&[&view])).unwrap().into_string();
        assert!(html.contains("RMS error of occlusion 0.200 in 50.0 ms"), "{html}");
        assert_eq!(html.matches("setting best").count(), 1);
    }

    #[test]
    fn settings_that_another_beats_are_not_on_the_front() {
        // The first is both the best and the fastest.
        let records = records("vao-samples", |number| (number as f64 + 1.0, number as f64 + 1.0));
        let view = ReportView::new(&records, None);
        let compared = comparisons(&page(&[&view]));
        assert_eq!(compared[0].settings.iter().filter(|setting| setting.front).count(), 1);
    }

    #[test]
    fn only_cells_of_one_scene_and_one_size_are_compared() {
        let records = records("vao-vs-hsao", trade);
        let view = ReportView::new(&records, None);
        for one in comparisons(&page(&[&view])) {
            let scenes = one.settings.iter().map(|setting| setting.cell.scene.as_str()).unique();
            assert_eq!(scenes.count(), 1);
        }
        // Each cell has its own viewport: there is nothing to compare.
        let sizes = self::records("uw-viewport", trade);
        let view = ReportView::new(&sizes, None);
        assert!(comparisons(&page(&[&view])).is_empty());
    }

    #[test]
    fn an_error_that_does_not_differ_is_not_shown() {
        let same = records("vao-samples", |number| (0.5, number as f64 + 1.0));
        let view = ReportView::new(&same, None);
        assert!(write(&page(&[&view])).is_none());
    }

    #[test]
    fn each_run_has_its_own_best_setting() {
        let [slow, fast] = [
            records("vao-samples", |number| (trade(number).0, 2.0 * trade(number).1)),
            records("vao-samples", trade),
        ];
        let views = [&ReportView::new(&slow, None), &ReportView::new(&fast, None)];
        let compared = comparisons(&page(&views));
        let bests = [0, 1].map(|run| best(&compared[0], run, LIMIT_MS).unwrap().time_ms.median);
        assert_eq!(bests, [40.0, 50.0]);
        let html = write(&page(&views)).unwrap().into_string();
        assert!(html.contains("● one: ") && html.contains("■ two: "));
    }
}

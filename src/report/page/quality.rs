//! Quality against time: of settings that solve the same task, the error and the time of the frame, and which are the best.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use indexmap::IndexMap;
use itertools::Itertools;
use maud::{Markup, html};
use serde_json::Value;

use super::parts::{numbers, setting_words, table, words};
use super::{Fold, Page, PageSection};
use crate::axis::{Axis, ScaleKind};
use crate::format::{NS_PER_MS, three};
use crate::svg::{self, Paint, Shape};
use fathom_experiments::words::{Unit, figure as figure_words};
use fathom_experiments::{Experiment, label_text};
use fathom_record::{Cell, ErrorFigure, Estimate, Measured};

pub const SECTION: PageSection = PageSection {
    id: "quality",
    title: "Quality against time",
    question: "Which setting has the least error within a time?",
    fold: Fold::Folded,
    write,
};

/// The limit that a reader finds first, as a multiple of the time of the task's fastest setting: tasks differ in how long they take.
const LIMIT: f64 = 2.0;
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

/// Cells whose errors can be compared.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Task<'a> {
    experiment: &'a str,
    scene: &'a str,
    size_px: Option<[u64; 2]>,
    /// The axes that change what is computed, with their values.
    given: Vec<(&'a str, String)>,
    /// Names of the others, along which its settings differ.
    axes: Vec<&'a str>,
}

/// A cell as the run at that place of the page timed it.
type Timed<'a> = (usize, &'a Cell, &'a Measured);

/// A setting of a task as a run measured it.
struct Setting<'a> {
    run: usize,
    cell: &'a Cell,
    time_ms: Estimate,
    /// In the unit shown; its size.
    error: f64,
    /// No other setting of the run is better in one and as good in the other.
    front: bool,
    /// The axes by which the settings differ, in words.
    words: String,
    /// `RMS error of occlusion 0.031`, `caustic photons lost 3.1 %`
    error_words: String,
}

/// A task with one of its errors.
struct Comparison<'a> {
    experiment: &'a str,
    /// Those of its settings: `hsao and volume_ao`.
    pipelines: String,
    /// Scene, size and the other axes that its settings share: `crates, 160 × 160 px, crates 3`.
    conditions: String,
    error_title: String,
    settings: Vec<Setting<'a>>,
}

fn write(page: &Page<'_>) -> Option<Markup> {
    let comparisons = comparisons(page);
    if comparisons.is_empty() {
        return None;
    }
    let (told, folded): (Vec<_>, Vec<_>) =
        comparisons.iter().enumerate().partition(|(_, one)| one.count() >= LEAST_TOLD);
    Some(html! {
        p.lead {
            "Settings are compared if they solve the same task: the same experiment, scene and size, and the same error against the "
            "same reference. Of the errors that differ by a tenth or more, the one of the last stage is shown. The best setting has the "
            "smallest error among those within the limit, which is a multiple of the fastest setting's median frame time; of equal "
            "errors the fastest."
        }
        div.controls.script-only {
            label { "At most " input #quality-limit type="number" min="1" step="0.1" value=(LIMIT) size="4"; " × the time of the fastest setting" }
        }
        (best_settings(page, &told))
        @if !folded.is_empty() {
            details { summary { (folded.len()) " tasks with two settings" } (best_settings(page, &folded)) }
        }
        div.multiples {
            @for (place, one) in &told {
                @if one.is_charted() { (figure(page, *place, one)) }
            }
        }
    })
}

fn best_settings(page: &Page<'_>, comparisons: &[(usize, &Comparison<'_>)]) -> Markup {
    let heads = html! {
        (page.run_head())
        (words(&["Task"]))
        th scope="col" { "Best setting within " span.quality-limit { (LIMIT) } " × the fastest" }
        (words(&["Its error and time"]))
        (numbers(&["Settings"]))
    };
    let rows = html! { @for (place, one) in comparisons { (rows(page, *place, one)) } };
    table("Best settings", "quality-table", &heads, &rows)
}

/// Those of many settings first within a pipeline.
fn comparisons<'a>(page: &Page<'a>) -> Vec<Comparison<'a>> {
    let mut tasks = IndexMap::<Task<'a>, Vec<Timed<'a>>>::new();
    for (place, run) in page.runs.iter().enumerate() {
        for section in &run.view.sections {
            // Texts of earlier versions do not mark the axes of a task.
            let builtin = Experiment::builtin_ids().contains(&section.id.to_owned());
            let builtin = builtin.then(|| Experiment::load(section.id).ok()).flatten();
            let defined = || section.experiment.iter().chain(&builtin);
            for (cell, measured) in section.timed() {
                let task = task(cell, |axis| defined().any(|one| one.is_task(axis)));
                tasks.entry(task).or_default().push((place, cell, measured));
            }
        }
    }
    let mut compared: Vec<Comparison<'a>> =
        tasks.values().filter_map(|cells| Comparison::new(cells)).collect();
    let pipeline = |one: &Comparison<'a>| one.settings[0].cell.pipeline.as_str();
    let pipelines: Vec<&str> = compared.iter().map(pipeline).unique().collect();
    compared.sort_by_key(|one| {
        let place = pipelines.iter().position(|known| *known == pipeline(one));
        (place, Reverse(one.count()))
    });
    compared
}

fn task(cell: &Cell, is_given: impl Fn(&str) -> bool) -> Task<'_> {
    let axes = cell.axes.iter().map(|(axis, value)| (axis.as_str(), label_text(value)));
    let (given, others): (Vec<_>, Vec<_>) = axes.partition(|(axis, _)| is_given(axis));
    Task {
        experiment: &cell.experiment,
        scene: &cell.scene,
        size_px: size_px(cell),
        given,
        axes: others.into_iter().map(|(axis, _)| axis).collect(),
    }
}

fn size_px(cell: &Cell) -> Option<[u64; 2]> {
    let side = |name: &str| cell.params.get("view")?.get(name).and_then(Value::as_u64);
    Some([side("width")?, side("height")?])
}

fn error_of<'a>(measured: &'a Measured, name: &str) -> Option<&'a ErrorFigure> {
    measured.errors.iter().find(|known| known.name == name)
}

/// Of the errors that all cells have and that differ between them, the first of the stage that runs last.
fn shown_error<'a>(cells: &[Timed<'a>]) -> Option<&'a ErrorFigure> {
    let (_, _, first) = cells.first()?;
    let differs = |error: &ErrorFigure| {
        let size = |measured| error_of(measured, &error.name).map(|error| error.value.abs());
        let values: Option<Vec<f64>> =
            cells.iter().map(|(.., measured)| size(measured).filter(|e| e.is_finite())).collect();
        let (low, high) = values?.into_iter().minmax().into_option()?;
        Some(high - low > LEAST_DIFFERENCE * high)
    };
    let shown = first.errors.iter().filter(|error| differs(error) == Some(true));
    let runs_at = |error: &&ErrorFigure| first.stages.iter().position(|s| s.stage == error.stage);
    shown.rev().max_by_key(runs_at)
}

/// Names of the axes whose values differ.
fn varying<'a>(cells: &[Timed<'a>]) -> BTreeSet<&'a str> {
    let axes = cells.iter().flat_map(|(_, cell, _)| cell.axes.keys()).map(String::as_str);
    let value = |cell: &Cell, axis: &str| cell.axes.get(axis).map(label_text);
    let differ = |axis: &&str| !cells.iter().map(|(_, cell, _)| value(cell, axis)).all_equal();
    axes.unique().filter(differ).collect()
}

fn conditions(cell: &Cell, varying: &BTreeSet<&str>) -> String {
    let sides = size_px(cell);
    let is_told = |value: &Value| {
        let size = sides.map(|[width, height]| format!("{width}x{height}"));
        value.as_str().is_some_and(|text| text == cell.scene || Some(text) == size.as_deref())
    };
    let axes = cell.axes.iter();
    let shared = axes.filter(|(name, value)| !varying.contains(name.as_str()) && !is_told(value));
    let size = sides.map(|[width, height]| format!("{width} × {height} px"));
    let parts = [Some(cell.scene.clone()), size, Some(setting_words(shared))];
    parts.into_iter().flatten().filter(|part| !part.is_empty()).join(", ")
}

impl<'a> Comparison<'a> {
    /// None where fewer than two settings differ in an error that all have.
    fn new(cells: &[Timed<'a>]) -> Option<Comparison<'a>> {
        let error = shown_error(cells)?;
        let (_, first, _) = cells.first()?;
        // From the record to what is shown: the table of words may show a share as per cent.
        let label = figure_words(&error.name);
        let unit = match label.unit {
            Unit::One if error.unit != "1" => error.unit.as_str(),
            unit => unit.symbol(),
        };
        let varying = varying(cells);
        let setting = |(run, cell, measured): &Timed<'a>| {
            let error = error_of(measured, &error.name)?.value.abs() * label.unit.factor();
            let axes = cell.axes.iter().filter(|(name, _)| varying.contains(name.as_str()));
            Some(Setting {
                run: *run,
                cell,
                time_ms: measured.frame.untimed.scaled(1.0 / NS_PER_MS),
                error,
                front: false,
                words: setting_words(axes),
                error_words: format!("{} {} {unit}", label.words, three(error))
                    .trim_end()
                    .to_owned(),
            })
        };
        let mut settings: Vec<Setting<'_>> = cells.iter().filter_map(setting).collect();
        let fronts: Vec<bool> = settings.iter().map(|one| one.is_front(&settings)).collect();
        settings.iter_mut().zip(fronts).for_each(|(one, front)| one.front = front);
        let pipelines = settings.iter().map(|setting| setting.cell.pipeline.as_str()).unique();
        Some(Comparison {
            experiment: &first.experiment,
            pipelines: pipelines.collect_vec().join(" and "),
            conditions: conditions(first, &varying),
            error_title: match unit {
                "" => label.words,
                unit => format!("{} ({unit})", label.words),
            },
            settings,
        })
    }

    /// Its settings, those of several runs once.
    fn count(&self) -> usize {
        self.settings.iter().map(|setting| setting.cell.cell.as_str()).unique().count()
    }

    fn is_charted(&self) -> bool {
        self.count() >= LEAST_CHARTED
    }

    /// Places of the runs that have a setting of it.
    fn runs(&self) -> impl Iterator<Item = usize> {
        self.settings.iter().map(|setting| setting.run).dedup()
    }

    fn of_run(&self, run: usize) -> impl Iterator<Item = &Setting<'a>> {
        self.settings.iter().filter(move |setting| setting.run == run)
    }

    fn fastest_ms(&self, run: usize) -> f64 {
        self.of_run(run).map(|setting| setting.time_ms.median).fold(f64::INFINITY, f64::min)
    }

    /// The least error within this multiple of the fastest setting's time; of equal ones the fastest.
    fn best(&self, run: usize, limit: f64) -> Option<&Setting<'a>> {
        let most_ms = limit * self.fastest_ms(run);
        let within = self.of_run(run).filter(|setting| setting.time_ms.median <= most_ms);
        within.min_by(|a, b| {
            let by_time = || a.time_ms.median.total_cmp(&b.time_ms.median);
            a.error.total_cmp(&b.error).then_with(by_time)
        })
    }
}

impl Setting<'_> {
    fn is_front(&self, all: &[Setting<'_>]) -> bool {
        let figures = |one: &Setting<'_>| [one.time_ms.median, one.error];
        let [time, error] = figures(self);
        !all.iter().filter(|other| other.run == self.run).any(|other| {
            let [other_time, other_error] = figures(other);
            other_time <= time && other_error <= error && (other_time < time || other_error < error)
        })
    }

    /// Its error and time.
    fn figures(&self) -> String {
        format!("{} in {} ms", self.error_words, three(self.time_ms.median))
    }

    fn tip(&self, page: &Page<'_>) -> String {
        let [low, high] = self.time_ms.ends().map(three);
        format!(
            "{}{}\n{}\nframe {} ms ({low} – {high}), n = {}{}",
            page.naming(self.run, "\n"),
            self.words,
            self.error_words,
            three(self.time_ms.median),
            self.time_ms.n,
            if self.front { "\nno other setting beats it" } else { "" }
        )
    }
}

fn rows(page: &Page<'_>, place: usize, one: &Comparison<'_>) -> Markup {
    let charted = one.is_charted();
    html! {
        @for (index, run) in one.runs().enumerate() {
            @let best = one.best(run, LIMIT);
            tr data-comparison=(place) data-run=(run) {
                @if page.is_overlay() { td { (page.runs[run].label) } }
                th scope="row" {
                    @if index == 0 {
                        b { (one.pipelines) } " " (one.conditions) " "
                        @if charted { a.source href={ "#quality-" (place) } { (one.experiment) } }
                        @else { span.source { (one.experiment) } }
                    }
                }
                td.best-setting { @if let Some(best) = best { b { (best.words) } } }
                td.best-figures { @if let Some(best) = best { (best.figures()) } }
                td.number { (one.of_run(run).count()) }
            }
            // The figures of settings without a chart, which the script reads.
            @if !charted {
                tr hidden data-of=(place) { td {
                    @for setting in one.of_run(run) {
                        span data-setting=(setting.words) data-run=(run) data-ms=(setting.time_ms.median)
                            data-error=(setting.error) data-figures=(setting.figures()) {}
                    }
                } }
            }
        }
    }
}

fn figure(page: &Page<'_>, place: usize, one: &Comparison<'_>) -> Markup {
    let times: Vec<f64> = one.settings.iter().map(|setting| setting.time_ms.median).collect();
    let errors: Vec<f64> = one.settings.iter().map(|setting| setting.error).collect();
    let x = Axis::fit(kind(&times), times, X_PX);
    let y = Axis::fit(kind(&errors), errors, Y_PX);
    let (Some(x), Some(y)) = (x, y) else { return html! {} };
    let about = format!("{} against frame time, {}", one.error_title, one.conditions);
    html! {
        figure.multiple.quality id={ "quality-" (place) } data-of=(place) {
            figcaption { b { (one.pipelines) " " (one.experiment) } br; (one.conditions) }
            p.axis-title { "↑ " (one.error_title) ", " (y.kind.name()) }
            (svg::chart(SIZE_PX, &about, &scatter(page, one, &x, &y)))
            p.axis-title.x { "→ frame time (ms), " (x.kind.name()) }
            @for run in one.runs() {
                p.best data-run=(run) {
                    @if page.is_overlay() { (Shape::of(run).symbol()) " " (page.runs[run].label) ": " }
                    span.best-words {
                        @if let Some(best) = one.best(run, LIMIT) { "Best within the limit: " (best.words) ": " (best.figures()) "." }
                    }
                }
                (front_table(one, run))
            }
        }
    }
}

fn front_table(one: &Comparison<'_>, run: usize) -> Markup {
    let front = one.of_run(run).filter(|setting| setting.front);
    let front = front.sorted_by(|a, b| a.time_ms.median.total_cmp(&b.time_ms.median));
    html! {
        details {
            summary { "the front: " (front.len()) " of " (one.of_run(run).count()) " settings that no other beats" }
            ul.fits { @for setting in front { li { (setting.words) ": " (setting.figures()) } } }
        }
    }
}

/// Error against time of a task's settings, with steps along those that no other of the run beats. Marks are filled on these, hollow
/// else; the best within the limit is ringed.
fn scatter(page: &Page<'_>, one: &Comparison<'_>, x: &Axis, y: &Axis) -> Markup {
    let [x_low, x_high] = x.coordinates();
    let place = |setting: &Setting<'_>| Some([x.px(setting.time_ms.median)?, y.px(setting.error)?]);
    let front = |run| {
        let places = one.of_run(run).filter(|setting| setting.front).filter_map(place);
        let places = places.sorted_by(|a, b| a[0].total_cmp(&b[0])).collect_vec();
        let steps = places.iter().tuple_windows().flat_map(|(from, to)| [[to[0], from[1]], *to]);
        let all = places.first().copied().into_iter().chain(steps);
        all.map(|[x, y]| format!("{x},{y}")).join(" ")
    };
    let is_best = |setting: &Setting<'_>| {
        one.best(setting.run, LIMIT).is_some_and(|best| std::ptr::eq(best, setting))
    };
    let fill = |setting: &Setting<'_>| {
        if setting.front { Paint::Accent.css() } else { "var(--ground)".to_owned() }
    };
    html! {
        (svg::x_axis(x, [Y_PX[1], Y_PX[0]], ""))
        (svg::y_axis(y, X_PX, ""))
        @for run in one.runs() {
            polyline.front points=(front(run)) {}
            @let limit = x.px_within(LIMIT * one.fastest_ms(run));
            line.limit x1=(limit) x2=(limit) y1=(Y_PX[1]) y2=(Y_PX[0]) data-low=(x_low) data-high=(x_high)
                data-log=(x.kind == ScaleKind::Log) data-left=(X_PX[0]) data-right=(X_PX[1]) data-fastest=(one.fastest_ms(run)) {}
        }
        @for (setting, at) in one.settings.iter().filter_map(|setting| Some((setting, place(setting)?))) {
            @let tip = setting.tip(page);
            path.mark.setting.best[is_best(setting)] d=(Shape::of(setting.run).path(at)) style={ "fill:" (fill(setting)) }
                data-setting=(setting.words) data-run=(setting.run) data-ms=(setting.time_ms.median)
                data-error=(setting.error) data-figures=(setting.figures()) { title { (tip) } }
        }
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
    use super::*;
    use crate::ReportView;
    use crate::testing::page;
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
        let best_at = |limit| one.best(0, limit).map(|best| best.time_ms.median);
        // Times are 10, 20, … ms.
        assert_eq!([best_at(LIMIT), best_at(5.0)], [Some(20.0), Some(50.0)]);
        assert!(one.settings.iter().all(|setting| setting.front));
        let html = write(&page(&[&view])).unwrap().into_string();
        assert!(html.contains("RMS error of occlusion 0.500 in 20.0 ms"), "{html}");
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
        // An axis that the experiment marks as part of the task divides its cells: the number of crates, or of occluders.
        let objects = self::records("vao-objects", trade);
        let view = ReportView::new(&objects, None);
        let compared = comparisons(&page(&[&view]));
        assert!(!compared.is_empty());
        for one in compared {
            for axis in ["crates", "occluders"] {
                assert!(one.settings.iter().map(|setting| setting.cell.axes.get(axis)).all_equal());
            }
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
        let bests = [0, 1].map(|run| compared[0].best(run, LIMIT).unwrap().time_ms.median);
        assert_eq!(bests, [40.0, 20.0]);
        let html = write(&page(&views)).unwrap().into_string();
        assert!(html.contains("● one: ") && html.contains("■ two: "));
    }
}

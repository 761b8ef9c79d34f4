//! Where the time of a frame goes: a bar for each frame that stands for a pipeline, and the stages of one frame after the other.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use itertools::Itertools;
use maud::{Markup, html};

use super::parts::{numbers, table, words};
use super::{Fold, Page, PageRun, PageSection};
use crate::axis::tenth;
use crate::facts::{self, Representative, StageShare};
use crate::format::{self, NS_PER_MS, three};
use fathom_base::statistics;
use fathom_record::{Clock, StageRecord};

pub const SECTION: PageSection = PageSection {
    id: "time",
    title: "Where the time goes",
    question: "Which stage dominates a frame?",
    fold: Fold::Folded,
    write,
};

/// A frame as each run that timed it has it.
type SameFrame<'a> = Vec<(&'a PageRun<'a>, Representative<'a>)>;

fn write(page: &Page<'_>) -> Option<Markup> {
    let frames = frames(page);
    let (run, default) = frames.first()?.first()?;
    Some(html! {
        p.lead {
            "One bar per pipeline, at the measurable setting closest to the defaults. A segment is a stage's share of the sum of all "
            "stages, by median times. A stage below the clock's resolution has no segment."
        }
        div.controls.script-only {
            label { "Length of the bars "
                select #time-unit {
                    option value="share" { "per cent of the frame's stages" }
                    option value="ms" { "ms, one scale for all" }
                }
            }
        }
        div #time-frames { @for frame in &frames { (same_frame(page, frame)) } }
        h3 { "One frame, stage by stage" }
        p.lead {
            "Stages in execution order. The gaps between passes are known as a "
            "sum only, which stands last. "
            span.script-only { "Choose another cell, and a frame of it." }
        }
        div.controls.script-only {
            label { "Cell " select #waterfall-cell disabled {} }
            label { "Frame " input #waterfall-frame type="range" min="0" value="0" disabled; }
            label { "Zoom " input #waterfall-zoom type="range" min="0" max="6" step="0.25" value="0"; }
            label { "Place " input #waterfall-from type="range" min="0" max="100" value="0"; }
            output #waterfall-shown {}
        }
        (waterfall(page, run, default))
    })
}

/// The frame nearest to the defaults first.
fn frames<'a>(page: &'a Page<'a>) -> Vec<SameFrame<'a>> {
    let first = page.runs.iter().find_map(|run| facts::default_frame(run.view));
    let first = first.map(|frame| frame.cell.pipeline.as_str());
    let all = page.runs.iter().flat_map(|run| facts::representatives(run.view));
    let chosen = all.unique_by(|frame| frame.cell.pipeline.as_str());
    let ordered = chosen.sorted_by_key(|frame| Some(frame.cell.pipeline.as_str()) != first);
    let in_runs = ordered.map(|frame| {
        let runs = page.runs.iter();
        runs.filter_map(|run| Some((run, facts::same_frame(run.view, &frame)?))).collect()
    });
    in_runs.collect()
}

fn same_frame(page: &Page<'_>, frame: &SameFrame<'_>) -> Markup {
    let Some((_, first)) = frame.first() else { return html! {} };
    html! {
        h3.frame-name {
            (first.cell.pipeline) " "
            span.faint { (first.cell.experiment) ", " (first.conditions()) }
        }
        @for (run, frame) in frame {
            div.frame-head {
                @if page.is_overlay() { span.run { (run.label) } " " }
                span { "Frame: " b { (frame_ms(frame)) } " ms, n = " (frame.measured.frame.untimed.n) }
            }
            (bar(page, frame))
            (every_stage(page, frame))
        }
    }
}

fn frame_ms(frame: &Representative<'_>) -> String {
    let frame = &frame.measured.frame;
    format::ms(&frame.untimed, &frame.untimed_samples_ns)
}

fn bar(page: &Page<'_>, frame: &Representative<'_>) -> Markup {
    let stages = resolved(frame);
    let sum_ns: f64 = stages.iter().map(|share| share.stage.time.median).sum();
    html! {
        div.stack.chart-bars role="img" aria-label=(about(frame)) data-ms=(three(sum_ns / NS_PER_MS)) {
            @for StageShare { stage, share } in &stages {
                @let color = page.colors.of(&stage.stage);
                @let tip = format!("{}: {} ms, {}", stage.stage, format::stage_ms(stage), facts::share(share));
                span.part.mark data-tip=(tip) title=(tip)
                    style={ "width:" (tenth(100.0 * stage.time.median / sum_ns.max(f64::MIN_POSITIVE))) "%;background:" (color.hex()) ";color:" (color.ink().hex()) } {
                    span.part-name {
                        span { (stage.stage) }
                        span { (three(stage.time.median / NS_PER_MS)) " ms" }
                    }
                }
            }
        }
    }
}

fn resolved<'a>(frame: &Representative<'a>) -> Vec<StageShare<'a>> {
    frame.stages().into_iter().filter(|share| share.stage.is_resolved()).collect()
}

/// The bar in one sentence.
fn about(frame: &Representative<'_>) -> String {
    let pipeline = &frame.cell.pipeline;
    match frame.slowest() {
        Some(slowest) => format!(
            "Stages of {pipeline}; the longest is {} with {}.",
            slowest.stage.stage,
            facts::share(&slowest.share)
        ),
        None => format!("No stage of {pipeline} is above the clock's resolution."),
    }
}

fn every_stage(page: &Page<'_>, frame: &Representative<'_>) -> Markup {
    let gaps_ns = statistics::median(&frame.measured.frame.gap_samples_ns);
    html! {
        details.stage-table {
            summary { "every stage" }
            @let heads = html! { (words(&["Stage"])) (numbers(&["Time, ms (95 %)", "Share (95 %)"])) (words(&["Clock"])) };
            @let rows = html! {
                @for StageShare { stage, share } in &frame.stages() {
                    tr {
                        th scope="row" { span.swatch style={ "background:" (page.colors.of(&stage.stage).hex()) } {} (stage.stage) }
                        td.number { (format::stage_ms(stage)) }
                        td.number { @if stage.is_resolved() { (facts::share(share)) } @else { "–" } }
                        td { (stage.clock.name()) }
                    }
                }
                @if gaps_ns.is_finite() {
                    tr { th scope="row" { "gaps between passes" } td.number { (three(gaps_ns / NS_PER_MS)) } td.number { "–" } td { "–" } }
                }
            };
            (table(&format!("Stages of {}", frame.cell.pipeline), "", &heads, &rows))
        }
    }
}

/// One of the lines of a waterfall. Places are shares of its width, per cent.
struct Step {
    name: String,
    start: f64,
    length: f64,
    text: String,
    color: String,
}

fn waterfall(page: &Page<'_>, run: &PageRun<'_>, frame: &Representative<'_>) -> Markup {
    let samples = &frame.measured.frame.envelope_samples_ns;
    let Some(index) = statistics::nearest_to_median(samples) else {
        return html! { p.faint { "No frame of it was timed by stage." } };
    };
    let steps = steps(page, frame, index);
    let of_run = if page.is_overlay() { format!(" on {}", run.label) } else { String::new() };
    html! {
        p #waterfall-about {
            (frame.cell.experiment) ", " (frame.cell.cell) (of_run) ": frame " (index + 1) " of " (samples.len())
            ", the one nearest to the median. " (clocks(&frame.measured.stages))
        }
        ol #waterfall.waterfall.chart-bars data-run=(run.label) data-experiment=(frame.cell.experiment) data-cell=(frame.cell.cell) data-frame=(index) {
            @for step in &steps { (step_markup(step)) }
        }
    }
}

fn step_markup(step: &Step) -> Markup {
    html! {
        li {
            span.step-name { (step.name) }
            span.step-track {
                @if step.length > 0.0 {
                    span.step-bar.mark data-tip={ (step.name) ": " (step.text) }
                        style={ "--start:" (step.start) ";--length:" (step.length) ";background:" (step.color) } {}
                }
            }
            span.step-time { (step.text) }
        }
    }
}

/// The stages of a frame, then its gaps.
fn steps(page: &Page<'_>, frame: &Representative<'_>, index: usize) -> Vec<Step> {
    let measured = frame.measured;
    let sample = |stage: &StageRecord| {
        stage.samples_ns.get(index).copied().filter(|_| stage.is_resolved()).unwrap_or(0.0)
    };
    let gaps_ns = measured.frame.gap_samples_ns.get(index).copied().unwrap_or(0.0).max(0.0);
    let whole_ns: f64 = measured.stages.iter().map(sample).sum::<f64>() + gaps_ns;
    let mut end_ns = 0.0;
    let mut step = |name: &str, ns: f64, text: String, color: String| {
        let (start, length) = (tenth(100.0 * end_ns / whole_ns), tenth(100.0 * ns / whole_ns));
        end_ns += ns;
        Step { name: name.to_owned(), start, length, text, color }
    };
    let mut steps: Vec<Step> = Vec::new();
    for stage in &measured.stages {
        let ns = sample(stage);
        let color = page.colors.of(&stage.stage).hex();
        let text = if stage.is_resolved() { in_ms(ns) } else { below(stage) };
        steps.push(step(&stage.stage, ns, text, color));
    }
    steps.push(step("gaps between passes", gaps_ns, in_ms(gaps_ns), "var(--rule)".to_owned()));
    steps
}

fn in_ms(ns: f64) -> String {
    format!("{} ms", three(ns / NS_PER_MS))
}

fn below(stage: &StageRecord) -> String {
    format!("{} ms", format::stage_ms(stage))
}

/// Which clock timed the stages.
fn clocks(stages: &[StageRecord]) -> String {
    let mut by_clock = BTreeMap::<Clock, Vec<&StageRecord>>::new();
    stages.iter().for_each(|stage| by_clock.entry(stage.clock).or_default().push(stage));
    let told = by_clock.into_iter().sorted_by_key(|(_, stages)| Reverse(stages.len()));
    let told = told.map(|(clock, stages)| of_clock(clock, &stages)).join("; ");
    format!("Clocks: {told}.")
}

/// Stages that share a clock, by name where they are few.
fn of_clock(clock: Clock, stages: &[&StageRecord]) -> String {
    const NAMED: usize = 3;
    let names = stages.iter().map(|stage| stage.stage.as_str()).join(", ");
    match stages.len() {
        count if count > NAMED => format!("{} ({count} stages)", clock.name()),
        _ => format!("{} ({names})", clock.name()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{self, overlaid, page, written};
    use fathom_experiments::fixtures;
    use fathom_record::Cell;

    /// Widths of the parts of the first bar, per cent.
    fn widths(html: &str) -> Vec<f64> {
        let bar = html.split("class=\"stack").nth(1).unwrap().split("</div>").next().unwrap();
        let widths = bar.split("width:").skip(1);
        widths.map(|rest| rest.split('%').next().unwrap().parse().unwrap()).collect()
    }

    #[test]
    fn the_default_frame_comes_first_and_its_parts_fill_the_bar() {
        let records = fixtures::run();
        let html = written(write, &records);
        let first = html.split("<h3").nth(1).unwrap();
        assert!(first.contains("uw-default") && first.contains("caustics/trace"), "{first}");
        let sum: f64 = widths(&html).iter().sum();
        assert!((sum - 100.0).abs() < 1.0, "{sum}");
    }

    #[test]
    fn the_same_frame_of_two_runs_stands_together() {
        let html = overlaid(write);
        let first = html.split("<h3").nth(1).unwrap();
        assert_eq!(first.matches("class=\"stack").count(), 2);
        assert!(first.contains(">one<") && first.contains(">two<"));
    }

    #[test]
    fn a_stage_below_the_resolution_has_no_part_and_no_share() {
        let mut records = fixtures::run();
        let cells = fixtures::cells(&mut records).filter(|cell| cell.pipeline == "underwater");
        for measured in cells.filter_map(Cell::measured_mut) {
            let stage = measured.stages.iter_mut().find(|s| s.stage == "caustics/trace").unwrap();
            let [wall, cost] = [vec![2e6; 15], vec![1e6; 15]];
            stage.fenced = Some(fathom_record::Fenced {
                wall_samples_ns: wall,
                submit_cost_samples_ns: cost,
                resolution_ns: 1e12,
            });
        }
        let html = written(write, &records);
        let frame = html.split("<h3").find(|part| part.contains("uw-default")).unwrap();
        let bar = frame.split("<details").next().unwrap();
        assert!(!bar.contains("caustics/trace:"), "{bar}");
        let row = frame.split("<tr>").find(|row| row.contains("caustics/trace")).unwrap();
        assert!(row.contains("&lt; ") && row.contains("–"), "{row}");
    }

    #[test]
    fn steps_of_a_waterfall_follow_each_other_to_the_end() {
        let view = testing::view();
        let page = page(&[&view]);
        let frame = facts::default_frame(&view).unwrap();
        let steps = steps(&page, &frame, 3);
        assert!(steps.is_sorted_by(|a, b| (a.start + a.length - b.start).abs() < 0.2));
        let last = steps.last().unwrap();
        assert!((last.start + last.length - 100.0).abs() < 0.3);
        assert_eq!(steps.len(), frame.measured.stages.len() + 1);
    }

    #[test]
    fn nothing_is_written_where_nothing_was_timed() {
        assert_eq!(written(write, &fixtures::all_skipped()), "");
    }
}

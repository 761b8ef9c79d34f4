//! Where the time of a frame goes: a bar for each frame that stands for a pipeline.

use itertools::Itertools;
use maud::{Markup, html};

use super::parts::{numbers, table, words};
use super::{Fold, Page, PageRun, PageSection};
use crate::axis::tenth;
use crate::facts::{self, Representative, StageShare};
use crate::format::{self, NS_PER_MS, three};
use fathom_base::statistics;

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
    frames.first()?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{overlaid, written};
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
    fn nothing_is_written_where_nothing_was_timed() {
        assert_eq!(written(write, &fixtures::all_skipped()), "");
    }
}

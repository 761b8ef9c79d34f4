//! Where the time of a frame goes: a bar for each frame that stands for a pipeline.

use itertools::Itertools;
use maud::{Markup, PreEscaped, html};

use super::parts::{numbers, table, words};
use super::{Fold, Page, PageRun, PageSection};
use crate::charts::shares;
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
        div.scroll tabindex="0" role="region" aria-label="Shares of stages" { (PreEscaped(bars(page, &frames))) }
        @for frame in frames.iter().flatten() { (every_stage(page, frame)) }
    })
}

fn bars(page: &Page<'_>, frames: &[SameFrame<'_>]) -> String {
    let rows = frames.iter().flatten().map(|(run, frame)| {
        let run = if page.is_overlay() { format!(", {}", run.label) } else { String::new() };
        (format!("{}{run}", frame.cell.pipeline), resolved(frame))
    });
    shares(&rows.collect_vec(), &page.colors)
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

fn frame_ms(frame: &Representative<'_>) -> String {
    let frame = &frame.measured.frame;
    format::ms(&frame.untimed, &frame.untimed_samples_ns)
}

fn resolved<'a>(frame: &Representative<'a>) -> Vec<StageShare<'a>> {
    frame.stages().into_iter().filter(|share| share.stage.is_resolved()).collect()
}

fn every_stage(page: &Page<'_>, (run, frame): &(&PageRun<'_>, Representative<'_>)) -> Markup {
    let gaps_ns = statistics::median(&frame.measured.frame.gap_samples_ns);
    html! {
        details.stage-table {
            summary {
                b { (frame.cell.pipeline) } @if page.is_overlay() { " " span.run { (run.label) } }
                ": frame " (frame_ms(frame)) " ms, n = " (frame.measured.frame.untimed.n) " "
                span.faint { (frame.cell.experiment) ", " (frame.conditions()) }
            }
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

    #[test]
    fn the_default_frame_comes_first_and_its_parts_fill_the_bar() {
        let html = written(write, &fixtures::run());
        let first = html.split("<details").nth(1).unwrap();
        assert!(first.contains("uw-default") && first.contains("caustics/trace"), "{first}");
        let titles = html.split("<title>underwater, ").skip(1);
        let shares = titles.map(|title| title.split([';', '%']).nth(1).unwrap().trim());
        let sum: f64 = shares.map(|share| share.parse::<f64>().unwrap()).sum();
        assert!((sum - 100.0).abs() < 1.0, "{sum}");
    }

    #[test]
    fn the_same_frame_of_two_runs_stands_together() {
        let html = overlaid(write);
        let rows: Vec<&str> = html.split("<details").skip(1).take(2).collect();
        assert!(rows[0].contains(">one<") && rows[1].contains(">two<"), "{rows:?}");
        assert!(rows.iter().all(|row| row.contains("uw-default")));
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
        assert!(!html.contains("underwater, caustics/trace"), "{html}");
        let frame = html.split("<details").find(|part| part.contains("uw-default")).unwrap();
        let row = frame.split("<tr>").find(|row| row.contains("caustics/trace")).unwrap();
        assert!(row.contains("&lt; ") && row.contains("–"), "{row}");
    }

    #[test]
    fn nothing_is_written_where_nothing_was_timed() {
        assert_eq!(written(write, &fixtures::all_skipped()), "");
    }
}

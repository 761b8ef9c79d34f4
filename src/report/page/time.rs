//! Where the time of a frame goes: a bar for each frame that stands for a pipeline.

use itertools::Itertools;
use maud::{Markup, html};

use super::{Fold, Page, PageRun, PageSection, pictures};
use crate::document::{self, Block, ColumnKind, Field, Line, Span};
use crate::facts::{self, Representative, StageShare};
use crate::format::{self, NS_PER_MS, count_noun, percent, three};
use crate::sizes::DrawPicture;
use fathom_base::statistics;
use fathom_record::PictureKind;

pub const SECTION: PageSection = PageSection {
    id: "time",
    title: "Where the time goes",
    question: "Which stage dominates a frame?",
    fold: Fold::Folded,
    write: |page| document::html_if_any(parts(page)),
};

/// Stages below this share of a frame stand in one row.
const SMALL_SHARE: f64 = 0.04;

/// A frame as each run that timed it has it.
type SameFrame<'a> = Vec<(&'a PageRun<'a>, Representative<'a>)>;

pub fn parts(page: &Page<'_>) -> Vec<Block> {
    let frames = frames(page);
    if frames.is_empty() {
        return Vec::new();
    }
    let columns = ["Frame", "Stage", "Time (ms)", "Share of the stages", "Clock"];
    let table = page.table("Stages of a frame of each pipeline", &columns);
    let table = table.with(ColumnKind::Numbers, &columns[2..4]);
    let rows = frames.iter().flatten().flat_map(|(run, frame)| {
        rows(page, frame).into_iter().map(move |row| page.run_fields(run, row))
    });
    vec![
        Block::paragraph(
            "One frame per pipeline, at the measurable setting closest to the defaults. A share is that of the sum of all stages, by \
             median times, with its 95 % interval. On the page a bar shows it; a stage below the clock's resolution has no part.",
        ),
        Block::Table(table.with_rows(rows)),
    ]
}

/// A bar for each pipeline with the names of its longest stages, beside its picture.
pub fn bars(page: &Page<'_>) -> Option<Markup> {
    let run = page.runs.first()?;
    let draw = pictures::drawing(run.view);
    let frames = frames(page);
    let bars = frames.iter().flatten().map(|(_, frame)| bar(page, run, frame, &draw));
    (!frames.is_empty()).then(|| html! { div.bars { @for bar in bars { (bar) } } })
}

fn bar(
    page: &Page<'_>,
    run: &PageRun<'_>,
    frame: &Representative<'_>,
    draw: DrawPicture<'_>,
) -> Markup {
    let (pipeline, none_ns) = (&frame.cell.pipeline, frame.measured.in_no_stage_ns());
    let stages = resolved(frame);
    let sum_ns = none_ns + stages.iter().map(|of| of.stage.time.median).sum::<f64>();
    let length = |ns: f64| 100.0 * ns / sum_ns.max(f64::MIN_POSITIVE);
    let parts = stages.iter().map(|StageShare { stage, share }| {
        let (name, of_frame, ms) =
            (&stage.stage, length(stage.time.median), format::stage_ms(stage));
        let tip = format!(
            "{pipeline}, {name}; {of_frame:.1} % of the medians: {ms} ms, {}",
            facts::share(share)
        );
        (name.as_str(), of_frame, page.colors.color(name).hex(), tip)
    });
    let none = (none_ns / NS_PER_MS, length(none_ns));
    let tip = format!("{pipeline}, in no stage; {:.1} %: {} ms", none.1, three(none.0));
    let parts = parts.chain([("in no stage", none.1, "var(--rule)".to_owned(), tip)]).collect_vec();
    let mut cells = run.view.measured().filter(|(cell, _)| cell.pipeline == *pipeline);
    let picture =
        cells.find_map(|(cell, _)| Some((&cell.experiment, draw(cell, PictureKind::Image)?)));
    html! {
        div.bar {
            @if let Some((id, picture)) = picture { a.thumb href={ "#pictures-" (id) } { (picture) } }
            div {
                b { (pipeline) } " " span.faint { (format::ms(&frame.measured.frame.untimed)) " ms" }
                div.stack { @for (_, length, color, tip) in &parts {
                    span style={ "flex-grow:" (format!("{length:.2}")) ";background:" (color) } data-tip=(tip) {}
                } }
                div.names { @for (name, length, color, _) in &parts { @if *length >= 100.0 * SMALL_SHARE {
                    span { span.swatch style={ "background:" (color) } {} (name) (format!(" {length:.0} %")) } " "
                } } }
            }
        }
    }
}

/// The frame nearest to the defaults first.
fn frames<'a>(page: &'a Page<'a>) -> Vec<SameFrame<'a>> {
    let first = page.runs.iter().find_map(|run| facts::default_frame(run.view));
    let first = first.map(|frame| frame.cell.pipeline.as_str());
    let all = page.runs.iter().flat_map(|run| run.view.representatives.iter().copied());
    let chosen = all.unique_by(|frame| frame.cell.pipeline.as_str());
    let ordered = chosen.sorted_by_key(|frame| Some(frame.cell.pipeline.as_str()) != first);
    let in_runs = ordered.map(|frame| {
        let runs = page.runs.iter();
        runs.filter_map(|run| Some((run, facts::same_frame(run.view, &frame)?))).collect()
    });
    in_runs.collect()
}

fn resolved<'a>(frame: &Representative<'a>) -> Vec<StageShare<'a>> {
    frame.stages().into_iter().filter(|share| share.stage.is_resolved()).collect()
}

/// The frame's longest stages, the sum of its short ones, and what is in none.
fn rows(page: &Page<'_>, frame: &Representative<'_>) -> Vec<[Field; 5]> {
    let stages =
        frame.stages().into_iter().sorted_by(|a, b| b.share.median.total_cmp(&a.share.median));
    let (long, short): (Vec<_>, Vec<_>) = stages.partition(|s| s.share.median >= SMALL_SHARE);
    let sum = |of: fn(&StageShare<'_>) -> f64| short.iter().map(of).sum::<f64>();
    let others = (!short.is_empty()).then(|| {
        [
            Line::default(),
            count_noun(short.len(), "other").into(),
            three(sum(|share| share.stage.time.median) / NS_PER_MS).into(),
            percent(sum(|share| share.share.median)).into(),
            Line::default(),
        ]
    });
    let ms = three(frame.measured.in_no_stage_ns() / NS_PER_MS);
    let none = [Line::default(), "in no stage".into(), ms.into(), "–".into(), "–".into()];
    let rows = long.iter().map(|share| stage_row(page, share)).chain(others).chain([none]);
    let mut rows: Vec<[Field; 5]> = rows.map(|row| row.map(Field::from)).collect();
    if let Some(first) = rows.first_mut() {
        let (cell, times) = (frame.cell, &frame.measured.frame);
        let place = format!(" ({} {}, {})", cell.experiment, cell.cell, frame.conditions());
        let statistics::Estimate { n, interval, .. } = times.untimed;
        let n = interval.map_or_else(String::new, |_| format!(", n = {n}"));
        let ms = format::ms(&times.untimed);
        let summary = Line::from(format!("{}: {ms} ms{n}", cell.pipeline));
        first[0] = summary.and(Span::Faint(place)).into();
    }
    rows
}

fn stage_row(page: &Page<'_>, StageShare { stage, share }: &StageShare<'_>) -> [Line; 5] {
    let color = page.colors.color(&stage.stage).hex();
    let swatch = html! { span.swatch style={ "background:" (color) } {} };
    [
        Line::default(),
        Line::from(Span::Drawn(swatch)).and(stage.stage.as_str()),
        format::stage_ms(stage).into(),
        format!("{}{}", if stage.is_resolved() { "" } else { "< " }, facts::share(share)).into(),
        stage.clock.name().into(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::overview;
    use crate::testing::{overlaid, written};
    use fathom_experiments::fixtures;
    use fathom_record::Cell;

    #[test]
    fn the_default_frame_comes_first_and_its_parts_fill_the_bar() {
        let html = written(SECTION.write, &fixtures::run());
        let first = html.split("<tr>").nth(2).unwrap();
        assert!(first.contains("uw-default"), "{first}");
        let bars = written(overview::SECTION.write, &fixtures::run());
        let titles = bars.split("data-tip=\"underwater, ").skip(1);
        let shares = titles.map(|title| title.split([';', '%']).nth(1).unwrap().trim());
        let sum: f64 = shares.map(|share| share.parse::<f64>().unwrap()).sum();
        assert!((sum - 100.0).abs() < 1.0, "{sum}");
        assert_eq!(written(SECTION.write, &fixtures::all_skipped()), "");
    }

    #[test]
    fn the_same_frame_of_two_runs_stands_together() {
        let html = overlaid(SECTION.write);
        let rows: Vec<&str> =
            html.split("<tr>").filter(|row| row.contains("(uw-default ")).collect();
        assert!(
            rows.len() == 2 && rows[0].contains(">one<") && rows[1].contains(">two<"),
            "{rows:?}"
        );
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
        let html = written(SECTION.write, &records);
        let bars = written(overview::SECTION.write, &records);
        assert!(bars.contains("underwater, ") && !bars.contains("underwater, caustics/trace"));
        let row = html.split("<tr>").find(|row| row.contains("caustics/trace")).unwrap();
        assert_eq!(row.matches("&lt; ").count(), 2, "{row}");
    }
}

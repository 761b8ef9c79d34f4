//! What a run says in short: the answer to each question of a reader. The page has a card for each with a link to its section, the
//! summary has them one after the other, and the terminal the first three.

use itertools::Itertools;
use maud::{Markup, PreEscaped, html};

use super::{Fold, Page, PageRun, PageSection};
use crate::ceilings::{are_measured, bounds};
use crate::charts;
use crate::document::{self, Block, Line, Span, Table, Tone};
use crate::facts::{self, SlowStage};
use crate::format::{NS_PER_MS, percent, three};
use crate::noise;
use crate::{Report, Section, SkippedInput, trust};
use fathom_experiments::schema::{Plot, PlotKind};
use fathom_experiments::{ClaimOrigin, Measure, Verdict};
use fathom_record::{OVER_BUDGET, OutcomeCounts, Run};

pub const SECTION: PageSection = PageSection {
    id: "overview",
    title: "At a glance",
    question: "What came out, and can it be trusted?",
    fold: Fold::Open,
    write,
};

/// Lines of a card that has one for each stage, axis or pipeline.
const MAX_LINES: usize = 5;
const MAX_PIPELINES: usize = 10;
const MAX_PLOTS: usize = 3;

fn write(page: &Page<'_>) -> Option<Markup> {
    if page.runs.is_empty() && page.left_out.is_empty() {
        return None;
    }
    Some(html! {
        @for run in &page.runs { (run_cards(page, run)) }
        @if !page.left_out.is_empty() {
            (document::html(&[open("not shown", ""), Block::list(page.left_out.iter().map(SkippedInput::line))]))
        }
    })
}

fn run_cards(page: &Page<'_>, run: &PageRun<'_>) -> Markup {
    let cards = cards(run.view);
    html! {
        @if page.is_overlay() { h3 { (run.label) } }
        (document::html(&caveats(run.view)))
        div.cards {
            @for card in &cards {
                @if let Some(content) = content(page, run.view, card) {
                    article.card { h3 { a href={ "#" (card.section) } { (card.question) } } (content) }
                }
            }
        }
        @if let Some(table) = identity(run.view) {
            (document::html(&[Block::Fold("Device, program and command".into(), vec![Block::Table(table)])]))
        }
    }
}

/// A drawing where there is one of a single run, else words.
fn content(page: &Page<'_>, view: &Report<'_>, card: &Card) -> Option<Markup> {
    let drawing = match card.section {
        "time" if !page.is_overlay() => super::time::bars(page),
        "scaling" if !page.is_overlay() => scaling_plots(view),
        _ => None,
    };
    let words = (!card.parts.is_empty()).then(|| document::html(&card.parts));
    let marks = (card.section == "claims").then(|| claim_marks(view));
    drawing.or_else(|| Some(html! { (words?) @if let Some(marks) = marks { (marks) } }))
}

/// A mark for each claim of the papers, which leads to its experiment.
fn claim_marks(view: &Report<'_>) -> Markup {
    let sections = view.sections.iter();
    let all =
        sections.flat_map(|section| section.rulings().iter().map(|ruling| (section.id, ruling)));
    let claims = all.filter(|(_, ruling)| ruling.origin == ClaimOrigin::Publication);
    html! {
        ul.marks aria-label="Claims of the papers" {
            @for (id, ruling) in claims.sorted_by_key(|(_, ruling)| std::cmp::Reverse(ruling.verdict)) {
                @let [class, mark] = Tone::from_verdict(ruling.verdict).look();
                @let name = format!("{}: {} ({id})", ruling.verdict, ruling.text);
                li { a.(class) href={ "#plot-" (id) } aria-label=(name) data-tip=(name) { (mark) } }
            }
        }
    }
}

/// Sizes that readers ask for first, in the words of measures.
const FIRST_SIZES: [&str; 3] = ["photons", "voxels", "width of the picture"];

/// Plots of times over the sizes that readers ask for first, then of the exponents over the widest ranges.
fn scaling_plots(view: &Report<'_>) -> Option<Markup> {
    let is_timed =
        |plot: &&Plot| plot.kind == PlotKind::Scaling && plot.y.iter().all(Measure::is_time);
    let timed = view.sections.iter().flat_map(|section| {
        let experiment = section.experiment.iter().filter(|of| of.knee_share.is_none());
        let plots = experiment.flat_map(|experiment| &experiment.plot);
        plots.filter(is_timed).map(move |plot| (section, plot))
    });
    let timed = timed.collect_vec();
    let draw = |(section, plot)| Some((section, charts::small_plot(section, plot)?));
    let first = FIRST_SIZES.iter().filter_map(|size| {
        let over = |plot: &Plot| plot.x.iter().any(|x| x.to_string().contains(size));
        timed.iter().copied().filter(|(_, plot)| over(plot)).find_map(draw)
    });
    let grown = facts::growth(view).map(|one| (one.section, one.plot)).filter_map(draw);
    let plots = first.chain(grown).unique_by(|(section, _)| section.id);
    let plots = plots.take(MAX_PLOTS).collect_vec();
    let all = html! {
        div.plots {
            @for (section, svg) in &plots {
                div { a.source href={ "#plot-" (section.id) } { (section.id) } (PreEscaped(svg)) }
            }
        }
    };
    (!plots.is_empty()).then_some(all)
}

fn open(word: &str, words: &str) -> Block {
    let chip = Span::Chip(Tone::Open, word.to_owned());
    Block::paragraph(Line::from(chip).and(format!(": {words}")))
}

/// What a reader must know before any figure.
pub fn caveats(view: &Report<'_>) -> Vec<Block> {
    let mut doubts = Vec::new();
    if view.run().is_some_and(|run| run.adapter.software) {
        let words = "Absolute times and frame rates say little about a GPU; ratios, exponents and shares are what to read.";
        doubts.push(open("software driver", words));
    }
    let absent = facts::absent_shards(view);
    if !absent.is_empty() {
        let words = "is not there. Put the records of all shards into one file, and report that.";
        let words = format!("shard {} {words}", absent.iter().join(", "));
        doubts.push(open("part of a run", &words));
    }
    doubts.extend(facts::open_items(view).into_iter().map(|words| open("open", &words)));
    doubts.extend(facts::mixed(view).into_iter().map(|words| open("several runs", &words)));
    doubts
}

/// A question, its answer, and the section with the whole answer.
pub struct Card {
    section: &'static str,
    pub question: &'static str,
    pub parts: Vec<Block>,
}

pub fn cards(view: &Report<'_>) -> [Card; 5] {
    let card = |section, question, parts| Card { section, question, parts };
    [
        card("trust", "Can it be trusted?", how_far(view)),
        card("claims", "Which claims hold?", verdicts(view)),
        card(
            "time",
            "Where does the time go?",
            list("The slowest stage of each pipeline:", "No stage was timed.", slowest(view)),
        ),
        card("scaling", "How does it scale?", Vec::new()),
        card(
            if are_measured(view) { "ceilings" } else { "trust" },
            "How near to the limits?",
            limits(view),
        ),
    ]
}

/// In a few lines, for the terminal: the verdict on the run, the tally of verdicts and the slowest stages.
pub fn terminal_summary(view: &Report<'_>) -> Vec<String> {
    let claims = tallies(view).map(|(whose, tally)| format!("{whose}: {tally}"));
    let slowest = slowest(view).join("; ");
    let slowest =
        (!slowest.is_empty()).then(|| format!("slowest stage of each pipeline: {slowest}"));
    let of_run = view.verdict.as_ref().map_or_else(Vec::new, noise::lines);
    of_run.into_iter().chain(claims).chain(slowest).collect()
}

fn list(above: &str, none: &str, lines: Vec<String>) -> Vec<Block> {
    if lines.is_empty() {
        return vec![Block::paragraph(none)];
    }
    vec![Block::paragraph(above), Block::list(lines)]
}

/// Whether the machine was quiet enough, by what that is judged, and what to do; then the clocks.
fn how_far(view: &Report<'_>) -> Vec<Block> {
    let verdict = view.verdict.as_ref();
    let tone = verdict.map_or(Tone::Neutral, noise::tone);
    let headline = verdict.map(|verdict| Span::Chip(tone, noise::headline(verdict)).into());
    let to_do = verdict.and_then(noise::to_do).map(Line::from);
    let clocks = trust::worst(view).map(|run| trust::verdict(run).into());
    headline.into_iter().chain(to_do).chain(clocks).map(Block::Paragraph).collect()
}

fn verdicts(view: &Report<'_>) -> Vec<Block> {
    let line = |(whose, tally): (ClaimOrigin, String)| {
        Block::paragraph(Line::from(Span::Bold(whose.to_string())).and(format!(": {tally}")))
    };
    tallies(view).map(line).collect()
}

/// `65 supported, 17 contradicted, 10 not run, of 92. Verdicts by a bound of this project: 30; at the sizes of the quick profile: 86`
fn tallies(view: &Report<'_>) -> impl Iterator<Item = (ClaimOrigin, String)> {
    facts::tallies(view).map(|(whose, counts)| {
        let some = counts.iter().filter(|(_, count)| *count > 0);
        let each = some.map(|(verdict, count)| format!("{count} {verdict}")).join(", ");
        let all: usize = counts.iter().map(|(_, count)| count).sum();
        let ruled = view.sections.iter().flat_map(Section::rulings);
        let ruled = ruled.filter(|of| of.origin == whose && of.verdict != Verdict::NotRun);
        let own = (ruled.clone().filter(|r| r.has_own_bound).count(), "by a bound of this project");
        let quick = (ruled.filter(|r| r.is_quick).count(), "at the sizes of the quick profile");
        let rests = [own, quick].into_iter().filter(|(count, _)| *count > 0);
        let rests = rests.map(|(count, what)| format!("{what}: {count}")).join("; ");
        let rests = if rests.is_empty() { rests } else { format!(". Verdicts {rests}") };
        (whose, format!("{each}, of {all}{rests}"))
    })
}

/// `underwater: caustics/splat 41 % (39 – 43), 12.3 ms`
fn slowest(view: &Report<'_>) -> Vec<String> {
    let line = |SlowStage { frame, stage }: SlowStage<'_>| {
        let ms = three(stage.stage.time.median / NS_PER_MS);
        let share = facts::share(&stage.share);
        format!("{}: {} {share}, {ms} ms", frame.cell.pipeline, stage.stage.stage)
    };
    facts::slowest_stages(view).take(MAX_PIPELINES).map(line).collect()
}

fn limits(view: &Report<'_>) -> Vec<Block> {
    let bounds = bounds(view);
    let nearest = bounds.iter().unique_by(|bound| &bound.stage.stage).take(MAX_LINES);
    let lines = nearest.map(|bound| {
        let share = percent(bound.share.share);
        format!("{} {share} of {}", bound.stage.stage, bound.share.limit_name())
    });
    let none = "None of this version's limits was measured.";
    list("Best shares of the adapter's limits:", none, lines.collect())
}

/// What was run where, and what its records hold.
pub fn identity(view: &Report<'_>) -> Option<Table> {
    let run = view.run()?;
    let adapter = &run.adapter;
    let kind = if adapter.software { "software driver" } else { "hardware" };
    let Run { profile, shader_checks, started_at, .. } = run;
    let program = facts::program(run);
    let driver = format!("{} {}", adapter.driver, adapter.driver_info);
    let device = format!("{} ({kind}, {}, {driver})", adapter.title(), adapter.backend);
    let program =
        format!("{program}, profile {profile}, shaders {shader_checks}, started {started_at}");
    let machine = run.conditions.machine.as_ref();
    let clock = trust::worst(view).map(trust::conditions);
    let mut rows: Vec<(&str, Line)> = vec![("device", device.into()), ("run", program.into())];
    rows.extend(machine.map(|machine| ("machine", facts::machine(machine).into())));
    rows.push(("command", Span::Code(run.command.join(" ")).into()));
    rows.push(("cells", outcomes(view).into()));
    rows.extend(clock.map(|clock| ("clock", clock.into())));
    rows.extend(trust::facts(view).map(|(about, words)| (about, words.into())));
    let rows = rows.into_iter().map(|(about, words)| [about.into(), words]);
    Some(Table::new("The run", ["", ""]).with_rows(rows))
}

fn outcomes(view: &Report<'_>) -> String {
    let OutcomeCounts { measured, skipped, failed, over_budget } =
        OutcomeCounts::count(view.entries().map(|entry| entry.cell));
    format!("{measured} measured, {skipped} skipped, {failed} failed, {over_budget} {OVER_BUDGET}")
}

//! What a run says in short: verdicts, the slowest stages, how far to trust it, how it scales. Functions of a view; the
//! summary and the page show them.

use indexmap::{IndexMap, IndexSet};
use itertools::Itertools;

use super::charts::names;
use super::format::{self, percent};
use super::{Report, Section};
use fathom_base::visits;
use fathom_experiments as experiments;
use fathom_experiments::defaults::{self, CellSettings, Distance};
use fathom_experiments::schema::{FIXED_SHARE, Plot, PlotKind};
use fathom_experiments::{ClaimOrigin, Measure, Scaling, Verdict, groups, scaling};
use fathom_record::command;
use fathom_record::{
    Cell, Estimate, Interval, Machine, Measured, Outcome, Part, Run, RunProgress, StageRecord,
};

/// Digits of a commit's hash that a person reads.
const SHORT_HASH: usize = 12;

/// How many claims have each verdict.
pub fn tally(view: &Report<'_>, whose: ClaimOrigin) -> [(Verdict, usize); 5] {
    let rulings = view.sections.iter().flat_map(Section::rulings);
    let counts = rulings.filter(|ruling| ruling.origin == whose).counts_by(|ruling| ruling.verdict);
    use Verdict::{Contradicted, Inconclusive, NearBound, NotRun, Supported};
    let verdicts = [Supported, Contradicted, NearBound, Inconclusive, NotRun];
    verdicts.map(|verdict| (verdict, counts.get(&verdict).copied().unwrap_or(0)))
}

/// The tallies of the papers' claims and of own hypotheses, each where there are any.
pub fn tallies(view: &Report<'_>) -> impl Iterator<Item = (ClaimOrigin, [(Verdict, usize); 5])> {
    let tallies = ClaimOrigin::ALL.map(|whose| (whose, tally(view, whose)));
    tallies.into_iter().filter(|(_, counts)| counts.iter().any(|(_, count)| *count > 0))
}

/// The frame that stands for a pipeline. Of its timed cells the first by this order: those whose stages are all above the clock's
/// resolution; those nearest to the pipeline's defaults; the plan.
#[derive(Clone, Copy)]
pub struct Representative<'a> {
    pub cell: &'a Cell,
    pub measured: &'a Measured,
    /// Parameters that its plan sets; none where the plan does not know the cell.
    settings: Option<usize>,
    distance: Distance,
}

/// A stage's time in a frame, and its share of the sum of all stages, frame by frame.
#[derive(Clone, Copy)]
pub struct StageShare<'a> {
    pub stage: &'a StageRecord,
    /// 0 … 1. An upper bound where the stage is not resolved.
    pub share: Estimate,
}

impl<'a> Representative<'a> {
    /// Every stage in frame order.
    pub fn stages(&self) -> Vec<StageShare<'a>> {
        let Measured { stages, frame, .. } = self.measured;
        let visits = &frame.visits;
        let frames = stages.iter().map(|stage| stage.samples_ns.len()).min().unwrap_or(0);
        let sum = |frame: usize| stages.iter().map(|stage| stage.samples_ns[frame]).sum::<f64>();
        let sums = (0..frames).map(sum).collect_vec();
        let share = |stage: &'a StageRecord| {
            let shares = stage.samples_ns.iter().zip(&sums).map(|(ns, sum)| ns / sum).collect_vec();
            StageShare { stage, share: visits::estimate_of_samples(&shares, visits) }
        };
        stages.iter().map(share).collect()
    }

    /// The stage with the largest share.
    pub fn slowest(&self) -> Option<StageShare<'a>> {
        let stages = self.stages().into_iter().filter(|stage| stage.stage.is_resolved());
        stages.max_by(|a, b| a.share.median.total_cmp(&b.share.median))
    }

    /// Scene and size: `tank, 800 × 800`.
    pub fn conditions(&self) -> String {
        let side = |name| self.cell.params.lookup(name);
        match [side("view.width"), side("view.height")] {
            [Some(width), Some(height)] => format!("{}, {width} × {height} px", self.cell.scene),
            _ => self.cell.scene.clone(),
        }
    }
}

/// A frame for each pipeline, in the order in which the plan first has them.
pub(super) fn representatives<'a>(sections: &[Section<'a>]) -> Vec<Representative<'a>> {
    let frames = sections.iter().flat_map(|section| {
        section.timed().map(|(cell, measured)| {
            let settings = section.settings(cell);
            Representative { cell, measured, settings, distance: Distance::default() }
        })
    });
    let mut by_pipeline: IndexMap<&str, Vec<Representative<'a>>> = IndexMap::new();
    for frame in frames {
        by_pipeline.entry(&frame.cell.pipeline).or_default().push(frame);
    }
    by_pipeline.values_mut().for_each(|frames| measure_distances(frames));
    by_pipeline.values().filter_map(|frames| frames.iter().copied().min_by_key(rank)).collect()
}

/// The same cell in another run; none where that did not time it.
pub fn same_frame<'a>(view: &Report<'a>, frame: &Representative<'_>) -> Option<Representative<'a>> {
    let section = view.sections.iter().find(|section| section.id == frame.cell.experiment)?;
    let mut named = section.timed().filter(|(cell, _)| cell.cell == frame.cell.cell);
    let (cell, measured) = named.find(|of| of.0.has_same_sources(frame.cell) != Some(false))?;
    let Representative { settings, distance, .. } = *frame;
    Some(Representative { cell, measured, settings, distance })
}

fn measure_distances(frames: &mut [Representative<'_>]) {
    let choices = frames.iter().map(|frame| CellSettings {
        swept: !frame.cell.axes.is_empty(),
        settings: frame.settings,
        scene: &frame.cell.scene,
        params: frame.cell.params.to_map(),
    });
    let choices: Vec<CellSettings<'_>> = choices.collect();
    let distances = defaults::distances(&choices);
    for (frame, distance) in frames.iter_mut().zip(distances) {
        frame.distance = distance;
    }
}

/// See [`Representative`].
fn rank(frame: &Representative<'_>) -> (bool, Distance) {
    (!frame.measured.stages.iter().all(StageRecord::is_resolved), frame.distance)
}

/// Of the representative frames the first by the same order.
pub fn default_frame<'a>(view: &Report<'a>) -> Option<Representative<'a>> {
    view.representatives.iter().copied().min_by_key(rank)
}

/// A stage and the representative frame that it is of.
#[derive(Clone, Copy)]
pub struct SlowStage<'a> {
    pub frame: Representative<'a>,
    pub stage: StageShare<'a>,
}

/// The slowest stage of each representative frame, the frame nearest to the defaults first. Stages of different pipelines are not
/// ranked: their frames differ in scene and size.
pub fn slowest_stages<'a>(view: &Report<'a>) -> impl Iterator<Item = SlowStage<'a>> {
    let frames = view.representatives.iter().copied().sorted_by_key(rank);
    frames.filter_map(|frame| Some(SlowStage { frame, stage: frame.slowest()? }))
}

/// What of a run is open: how far it is while it goes on, and what its time budget left.
pub fn open_items(view: &Report<'_>) -> Vec<String> {
    let mut open = Vec::new();
    if let Some(RunProgress { used_s, budget_s, reached, cells }) = view.standing {
        open.push(format!(
            "The run goes on: {used_s:.0} of {budget_s:.0} s are used, {} of {cells} cells are not reached yet. \
             Figures and verdicts are so far: claims are read at the end.",
            cells.saturating_sub(reached)
        ));
    }
    let remaining =
        view.entries().filter(|entry| entry.cell.outcome == Outcome::OverBudget).count();
    if remaining > 0 {
        let all = view.entries().count();
        let shown = view.folder.as_deref().map_or_else(|| ".".to_owned(), command::shown);
        let place = if shown == "." { " in this folder" } else { "" };
        // Shards that were joined are not gone on with as one.
        let is_one = view.runs.iter().map(|run| run.shard).all_equal();
        let run = view.run().filter(|_| is_one);
        let command = run.and_then(|run| command::resuming(run, &shown));
        let command = command.map(|command| format!("; `{command}`{place} measures them"));
        open.push(format!(
            "{remaining} of {all} cells were not run, as the time budget ended{}.",
            command.unwrap_or_default()
        ));
    }
    let counts = tallies(view).flat_map(|(_, counts)| counts);
    let claims: usize = counts.filter(|(verdict, _)| !verdict.is_settled()).map(|(_, n)| n).sum();
    if !open.is_empty() && claims > 0 {
        open.push(format!("{claims} claims are open."));
    }
    open
}

/// The shards of a divided run whose records are not there.
pub fn absent_shards(view: &Report<'_>) -> Vec<Part> {
    let shards: Vec<Part> = view.runs.iter().filter_map(|run| run.shard).collect();
    let of = shards.last().map_or(0, |shard| shard.of);
    let all = (1..=of).map(|number| Part { number, of });
    all.filter(|shard| !shards.contains(shard)).collect()
}

/// The run neither came to its end nor goes on.
pub fn ended_early(view: &Report<'_>) -> Option<String> {
    let is_cut = view.standing.is_none() && view.ends.last().is_none_or(|end| end.interrupted);
    is_cut.then(|| "The run ended early. What was measured until then is shown.".to_owned())
}

/// `fathom 0.1.0 of commit 1c4666a with changed files`
pub fn program(run: &Run) -> String {
    let commit = run.build.as_ref().map(|build| match (&build.commit, build.dirty) {
        (None, _) => " built outside a repository".to_owned(),
        (Some(commit), dirty) => {
            let short = commit.get(..SHORT_HASH).unwrap_or(commit);
            format!(" of commit {short}{}", if dirty { " with changed files" } else { "" })
        }
    });
    format!("fathom {}{}", run.fathom_version, commit.unwrap_or_default())
}

/// `AMD EPYC 7R13, 2 cores, 3.81 GiB, Linux 6.18.44, governor performance`
pub fn machine(machine: &Machine) -> String {
    let Machine { cpu, cores, memory_bytes, kernel, governor } = machine;
    let gibibytes =
        |bytes: u64| format!("{} GiB", format::three(bytes as f64 / f64::from(1 << 30)));
    let parts = [
        cpu.clone(),
        cores.map(|cores| format!("{cores} cores")),
        memory_bytes.map(gibibytes),
        kernel.clone(),
        governor.as_ref().map(|governor| format!("governor {governor}")),
    ];
    parts.into_iter().flatten().join(", ")
}

/// In what the runs of the cells and the files of their scenes differ: their times do not go together.
pub fn mixed(view: &Report<'_>) -> Vec<String> {
    let build = |run: &Run| {
        let file = run.build.as_ref().and_then(|build| build.program.as_ref());
        file.into_iter().fold(program(run), |name, digest| format!("{name}, file {digest}"))
    };
    let facts = |run: &Run| {
        let adapter = format!("{}, {}", run.adapter.title(), run.adapter.driver_info);
        let (host, profile) = (run.conditions.host.clone(), run.profile.to_string());
        [Some(adapter), host, Some(build(run)), Some(profile)]
    };
    let kinds = ["adapters", "machines", "builds", "profiles"].into_iter().enumerate();
    let several = kinds.filter_map(|(place, kind)| {
        let runs = view.entries().filter_map(|entry| entry.run);
        let values: IndexSet<String> = runs.filter_map(|run| facts(run)[place].take()).collect();
        let names = Some(format!(" ({})", values.iter().join("; "))).filter(|_| values.len() < 4);
        let count = values.len();
        (count > 1).then(|| format!("{count} {kind}{}", names.unwrap_or_default()))
    });
    let several = several.collect::<Vec<_>>().join(", ");
    let outdated = view.outdated;
    [
        (!several.is_empty(), format!("The cells are of {several}. Times may differ for this alone.")),
        (outdated > 0, format!("{outdated} cells are left out: their scene, mesh or volume was another than that of the latest.")),
    ]
    .into_iter()
    .filter_map(|(is_so, words)| is_so.then_some(words))
    .collect()
}

/// A fitted exponent b of `y ∝ x^b`.
pub struct Exponent<'v, 'a> {
    pub section: &'v Section<'a>,
    pub plot: &'v Plot,
    pub y: &'v Measure,
    pub x: &'v Measure,
    /// Values of the other axes; empty where there are none.
    pub group: String,
    pub fit: Scaling,
}

/// The exponent that claims rest on, with its interval: `0.98 (0.95 – 1.01)`.
pub fn exponent(fit: &Scaling) -> String {
    // Without a minus before what is rounded to zero.
    let two = |value: f64| format!("{:.2}", if value.abs() < 0.005 { 0.0 } else { value });
    let value = two(fit.exponent());
    match fit.interval() {
        Some(Interval { low, high }) => format!("{value} ({} – {})", two(low), two(high)),
        None => value,
    }
}

/// The exponent over all sizes of a sweep, with the fixed part of the shortest time where that is much of it.
pub fn grown_exponent(fit: &Scaling, min_time: f64) -> String {
    let fixed_ms = format::three(fit.fixed / format::NS_PER_MS);
    let fixed = (fit.fixed > FIXED_SHARE * min_time).then(|| format!(", {fixed_ms} ms fixed"));
    exponent(fit) + &fixed.unwrap_or_default()
}

/// The exponents of all scaling plots, in the order of the plan. Plots over categories have none, and [`sizes`](super::sizes) has those
/// of sweeps.
pub fn exponents<'v, 'a>(view: &'v Report<'a>) -> Vec<Exponent<'v, 'a>> {
    view.sections.iter().flat_map(fit_section).collect()
}

fn fit_section<'v, 'a>(section: &'v Section<'a>) -> Vec<Exponent<'v, 'a>> {
    let Some(experiment) = &section.experiment else { return Vec::new() };
    let is_fitted = |plot: &&Plot| {
        plot.kind == PlotKind::Scaling
            && experiment.knee_share.is_none()
            && plot.over.as_ref().is_none_or(|over| !experiment.is_category(over))
    };
    experiment.plot.iter().filter(is_fitted).flat_map(|plot| fit_plot(section, plot)).collect()
}

fn fit_plot<'v, 'a>(section: &'v Section<'a>, plot: &'v Plot) -> Vec<Exponent<'v, 'a>> {
    let Some(x) = &plot.x else { return Vec::new() };
    let cells = section.cells();
    let cells: Vec<&Cell> =
        cells.into_iter().filter(|cell| experiments::fits(cell, &plot.filter)).collect();
    let groups = match &plot.over {
        Some(over) => groups(&cells, over),
        None => vec![(String::new(), cells)],
    };
    let fits = plot.y.iter().cartesian_product(groups).filter_map(|(y, (_, members))| {
        let fit = scaling(y, x, &members, FIXED_SHARE).ok()?;
        let group = names::group(plot, &members, section.experiment.as_ref()?);
        Some(Exponent { section, plot, y, x, group, fit })
    });
    fits.collect()
}

/// The exponents of times that grow, those that were fitted over the widest ranges first.
pub fn growth<'v, 'a>(view: &'v Report<'a>) -> impl Iterator<Item = Exponent<'v, 'a>> {
    let grows = |fit: &Scaling| fit.interval().is_some_and(|interval| interval.low > 0.0);
    let times = exponents(view).into_iter();
    let times = times.filter(move |exponent| exponent.y.is_time() && grows(&exponent.fit));
    times.sorted_by(|a, b| b.fit.decades.total_cmp(&a.fit.decades))
}

/// `41.2 % (39.1 – 43.0)`
pub fn share(share: &Estimate) -> String {
    let [low, high] = share.ends().map(|end| format::three(100.0 * end));
    match share.interval {
        Some(_) => format!("{} ({low} – {high})", percent(share.median)),
        None => percent(share.median),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::overview;
    use crate::{document, testing};
    use fathom_experiments::fixtures;
    use fathom_record::{Note, NoteKind, Profile, Record};

    #[test]
    fn the_tally_counts_every_claim_once() {
        let view = testing::view();
        let counts = ClaimOrigin::ALL.map(|whose| tally(&view, whose).map(|(_, count)| count));
        let all = view.sections.iter().map(|section| section.rulings().len()).sum::<usize>();
        assert_eq!(counts.as_flattened().iter().sum::<usize>(), all);
        let some = |verdict: usize| counts.iter().any(|counts| counts[verdict] > 0);
        assert!([0, 1, 4].into_iter().all(some), "{counts:?}");
    }

    /// Cells of the second half are of another run.
    #[test]
    fn a_report_of_unlike_runs_says_in_what_they_differ() {
        type Change = fn(&mut Run);
        let cases: [(Change, &str); 6] = [
            (|_| (), ""),
            (|run| run.adapter.name = "a".to_owned(), ", Mesa 22.3.6; a, Mesa 22.3.6). Times"),
            (|run| run.fathom_version = "9".to_owned(), "2 builds (fathom 0.1.0; fathom 9). Times"),
            (|run| run.profile = Profile::Paper, "of 2 profiles (quick; paper). Times may"),
            (|run| run.conditions.host = Some("b".to_owned()), "of 2 machines (a; b). Times may"),
            (
                |run| run.build.get_or_insert_default().program = Some("7f".to_owned()),
                "of 2 builds (fathom 0.1.0; fathom 0.1.0 built outside a repository, file 7f). Times",
            ),
        ];
        for (change, expected) in cases {
            let (mut records, mut run) = (fixtures::run(), fixtures::header(Profile::Quick));
            run.conditions.host = Some("a".to_owned());
            records[0] = Record::Run(Box::new(run.clone()));
            change(&mut run);
            records.insert(records.len() / 2, Record::Run(Box::new(run)));
            let text = document::terminal(&overview::caveats(&Report::new(&records, None)));
            assert!(text.contains(expected), "{text}");
            assert_eq!(text.contains("Times may differ"), !expected.is_empty(), "{text}");
        }
    }

    /// A sweep over a mesh that became another one after some sizes.
    #[test]
    fn cells_of_two_meshes_stand_in_no_figure_together() {
        for (first, outdated, words) in [
            ("a", 2, "2 cells are left out: their scene, mesh or volume was another"),
            ("b", 0, ""),
        ] {
            let mut records = fixtures::run();
            let cells = fixtures::cells(&mut records);
            let of_one_scene = cells.filter(|cell| cell.experiment == "spt-march-vs-lines");
            for (number, cell) in of_one_scene.enumerate() {
                let digest = if number < 2 { first } else { "b" };
                cell.sources.insert("own.glb".to_owned(), digest.to_owned());
            }
            let view = Report::new(&records, None);
            assert_eq!((view.outdated, mixed(&view).concat().contains(words)), (outdated, true));
            assert_eq!(mixed(&view).is_empty(), words.is_empty());
        }
    }

    #[test]
    fn a_run_that_goes_on_has_not_ended_early_and_its_cell_under_way_is_not_measured() {
        let going = RunProgress { used_s: 5.0, budget_s: 60.0, reached: 1, cells: 9 };
        for (standing, is_whole) in [(None, true), (None, false), (Some(going), false)] {
            let mut records = fixtures::run();
            if !is_whole {
                records.pop();
                let note = Note::new(NoteKind::Unfinished, "it goes on");
                let mut cells = fixtures::cells(&mut records);
                cells.find_map(Cell::measured_mut).unwrap().notes.push(note);
            }
            let view = Report { standing, ..Report::new(&records, None) };
            assert_eq!(ended_early(&view).is_some(), !is_whole && standing.is_none());
            let table = overview::identity(&view).map(document::Block::Table).unwrap();
            let text = document::terminal(&[table]);
            assert_eq!(text.contains(" 1 not run"), !is_whole, "{text}");
            assert_eq!(open_items(&view).join("").contains("8 of 9 cells"), standing.is_some());
        }
    }

    #[test]
    fn the_frame_nearest_to_the_defaults_stands_for_its_pipeline() {
        let view = testing::view();
        let frames = &view.representatives;
        let pipelines: Vec<&str> = frames.iter().map(|f| f.cell.pipeline.as_str()).collect();
        assert!(pipelines.iter().all_unique() && pipelines.len() > 5, "{pipelines:?}");
        let underwater = frames.iter().find(|f| f.cell.pipeline == "underwater").unwrap();
        assert_eq!(underwater.cell.experiment, "uw-default");
        assert_eq!(default_frame(&view).unwrap().cell.experiment, "uw-default");
    }

    #[test]
    fn shares_of_a_frame_add_up_and_have_intervals() {
        let view = testing::view();
        for frame in &view.representatives {
            let stages = frame.stages();
            let sum: f64 = stages.iter().map(|stage| stage.share.median).sum();
            assert!((sum - 1.0).abs() < 0.05, "{}: {sum}", frame.cell.pipeline);
            assert!(stages.iter().all(|stage| stage.share.interval.is_some()));
        }
    }

    #[test]
    fn each_pipeline_has_its_slowest_stage() {
        let view = testing::view();
        let slow: Vec<SlowStage<'_>> = slowest_stages(&view).collect();
        assert_eq!(slow.len(), view.representatives.len());
        assert_eq!(slow[0].frame.cell.experiment, "uw-default");
        for SlowStage { frame, stage } in slow {
            assert!(frame.stages().iter().all(|other| other.share.median <= stage.share.median));
        }
    }
}

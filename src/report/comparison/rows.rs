//! Texts that the terminal and Markdown reports of a comparison share.

use std::collections::BTreeSet;

use indexmap::IndexMap;
use itertools::{Itertools, chain};

use crate::document::Block;
use crate::format::{NS_PER_MS, count_noun, mebibytes, si, three};
use fathom_base::text;
use fathom_judge::adapters::AdapterRelation;
use fathom_judge::counts::{Change, CountChange};
use fathom_judge::exact::{Difference, DifferenceScope, FigureKind};
use fathom_judge::store::Comparison;
use fathom_judge::time::{CellTime, ThrottledLaunches, TimeVerdict};
use fathom_judge::verdict::{CellVerdict, GateState, JudgedCell, Status, Verdicts};
use fathom_record::comparison::{ChangedStage, ComparedBuild, Fault, Gate, Side, SideEnvironment};
use fathom_record::{Adapter, Interval, machine};

/// Columns of a table of cells.
pub const HEADER: [&str; 7] =
    ["cell", "verdict", "time, base", "change", "detectable", "instructions", "else"];

/// One cell of a table of cells.
pub fn cell(cell: &JudgedCell) -> [String; 7] {
    let time = cell.time.as_ref();
    let base = time.map(|time| format_ms(time.base_ns));
    let detectable = time.and_then(|time| time.detectable);
    let counted = cell.instructions.as_ref();
    let or_none = |text: Option<String>| text.unwrap_or_else(|| NONE.to_owned());
    let differences = cell.differences.iter().map(difference);
    let faults = cell.faults.iter().map(fault);
    let changed = cell.changed.iter().map(|changed| changed.differs.to_string());
    [
        cell.cell.to_string(),
        cell.verdict.to_string(),
        or_none(base),
        or_none(time.map(change)),
        or_none(detectable.map(|share| format!("{:.1} %", 100.0 * share))),
        or_none(counted.map(|counted| format!("{} {}", si(counted.base), more(counted)))),
        chain![differences, faults, time.and_then(throttled), changed].join("; "),
    ]
}

/// Of a comparison that was interrupted or killed.
pub const INCOMPLETE: &str = "measuring did not finish; continue it with --resume";
/// Digits of a commit.
const SHORT_COMMIT: usize = 12;
/// Cells that a line names.
const MAX_NAMED: usize = 5;
/// What stands where nothing was measured.
pub const NONE: &str = "–";

/// A share as `+5.1 %`: with a sign, but without one that only hides a zero, and without digits that say nothing.
fn signed(share: f64, digits: usize) -> String {
    let percent = 100.0 * share;
    let digits = if percent.abs() >= 100.0 { 0 } else { digits };
    format!("{:+.digits$} %", rounded(percent, digits))
}

/// Rounded to so many digits; never −0.
fn rounded(value: f64, digits: usize) -> f64 {
    let scale = 10_f64.powi(digits as i32);
    (value * scale).round() / scale + 0.0
}

/// `+5.1 % (4.2 … 6.0)`, with a remark where the times are of different adapters.
pub fn change(time: &CellTime) -> String {
    let interval = match time.change.interval {
        Some(Interval { low, high }) => {
            format!("{:.1} … {:.1}", rounded(100.0 * low, 1), rounded(100.0 * high, 1))
        }
        None => "too few launches for an interval".to_owned(),
    };
    let remark = match time.verdict {
        TimeVerdict::NotJudged => ", different adapters".to_owned(),
        TimeVerdict::Inconclusive if time.is_beyond_threshold => {
            format!(", not beyond chance among {}", count_noun(time.adjusted_for, "cell"))
        }
        _ => String::new(),
    };
    format!("{} ({interval}){remark}", signed(time.change.median, 1))
}

/// In which launches clocks were held down, and whether that may be the reason for a change.
fn throttled(time: &CellTime) -> Option<String> {
    let ThrottledLaunches { base, head, reasons } = time.throttled.as_ref()?;
    let doubt = if time.may_be_throttling() {
        ": more often on the slower side, so throttling may be the cause, not the build"
    } else {
        ""
    };
    Some(format!(
        "clocks throttled ({}) in {base} of {n} launches of the base and {head} of the head{doubt}",
        machine::words(reasons),
        n = time.launches.len()
    ))
}

fn format_ms(ns: f64) -> String {
    format!("{} ms", three(ns / NS_PER_MS))
}

/// How many more instructions the head takes.
fn more(counted: &CountChange) -> String {
    let unjudged = if counted.change == Change::NotJudged { ", different adapters" } else { "" };
    format!("{}{unjudged}", signed(counted.ratio - 1.0, 2))
}

/// The same, of a whole configuration with its name.
pub fn difference(difference: &Difference) -> String {
    match &difference.scope {
        DifferenceScope::Configuration(id) => format!("{id}: {}", format_change(difference)),
        DifferenceScope::Cell(_) | DifferenceScope::Stage(_) => format_change(difference),
    }
}

/// `fragments 100 → 120 (+20.0 %)`.
pub fn format_change(difference: &Difference) -> String {
    let Difference { figure, base, head, kind, .. } = difference;
    let value = |value: f64| match kind {
        FigureKind::Bytes => mebibytes(value as u64),
        FigureKind::Work | FigureKind::Counter => format!("{value:.0}"),
        FigureKind::Error | FigureKind::Quantity if value.is_finite() => three(value),
        FigureKind::Error | FigureKind::Quantity => "not a number".to_owned(),
    };
    let relative = *base != 0.0 && base.is_finite() && head.is_finite();
    let share = relative.then(|| format!(" ({})", signed((head - base) / base.abs(), 2)));
    let share = share.unwrap_or_default();
    format!("{figure} {} → {}{share}", value(*base), value(*head))
}

/// Who could not do what, and why.
pub fn fault(fault: &Fault) -> String {
    let side = fault.side.map_or(String::new(), |side| format!("{side} "));
    format!("{side}{}: {}", fault.gate, fault.reason)
}

/// `no regression; 48 cells: 40 same, 8 inconclusive`.
pub fn headline(verdicts: &Verdicts<'_>) -> String {
    format!("{}; {}", verdicts.status, count_words(verdicts))
}

/// `48 cells: 40 same, 8 inconclusive`.
pub fn count_words(verdicts: &Verdicts<'_>) -> String {
    let all = verdicts.count_verdicts();
    let counted = all.iter().map(|(verdict, count)| format!("{count} {verdict}")).join(", ");
    format!("{}: {counted}", count_noun(verdicts.cells.len(), "cell"))
}

/// Each regression in a sentence, the gravest first; then what concerns configurations as a whole.
pub fn regressions(verdicts: &Verdicts<'_>) -> Vec<String> {
    let cells = verdicts.regressions().into_iter().map(|cell| {
        let mut because = reasons(cell);
        let worse = cell.differences.iter().filter(|difference| difference.worse);
        because.extend(worse.map(difference));
        format!("{}: {}: {}", cell.cell, cell.verdict, because.join("; "))
    });
    let whole = verdicts.configurations.iter();
    let whole = whole.filter(|difference| difference.worse).map(difference);
    cells.chain(whole).collect()
}

/// Behind regressions what differs in them, each difference once: a fold for each.
pub fn differences_of_regressions(verdicts: &Verdicts<'_>, max: usize) -> Vec<Block> {
    let regressions = verdicts.regressions().into_iter().take(max);
    let changed = regressions.filter_map(|cell| cell.changed.as_ref());
    let told = changed.filter(|changed| !changed.diff.is_empty()).unique_by(|of| &of.diff);
    let fold = |changed: &ChangedStage| {
        let about = format!("{}: {}", changed.cell.stage(), changed.differs).into();
        // Its lines come from workers.
        let lines = changed.diff.lines().map(|line| text::line(line) + "\n").collect();
        Block::Fold(about, vec![Block::Diff(lines)])
    };
    told.map(fold).collect()
}

/// What a cell's time and instructions say.
pub fn reasons(cell: &JudgedCell) -> Vec<String> {
    let time = cell.time.iter();
    let time = time.flat_map(|time| [Some(format!("time {}", change(time))), throttled(time)]);
    let counted = cell.instructions.iter();
    let counted = counted.map(|counted| Some(format!("instructions {}", more(counted))));
    let changed = cell.changed.iter().map(|changed| Some(changed.differs.to_string()));
    time.chain(counted).chain(changed).flatten().collect()
}

/// What was compared, on what, by which gates; and everything else that is to be known.
pub fn notes(verdicts: &Verdicts<'_>) -> Vec<String> {
    let header = &verdicts.comparison.header;
    let mut notes: Vec<String> = verdicts
        .gates
        .iter()
        .map(|(gate, state)| match state {
            GateState::Ran => format!("{gate} gate: {}", rule(verdicts, *gate)),
            GateState::Skipped(reason) => format!("{gate} gate skipped: {reason}"),
            GateState::Void(reason) => format!("{gate} gate void: {reason}"),
        })
        .collect();
    let control = verdicts.control.iter();
    notes.extend(control.map(|control| {
        format!("control {} with one build on both sides: {}", control.cell, change(control))
    }));
    notes.extend(inconclusive(verdicts));
    notes.extend(on_two_adapters(verdicts));
    notes.extend(throttled_times(verdicts));
    let better = verdicts.configurations.iter();
    notes.extend(better.filter(|other| !other.worse).map(difference));
    notes.extend(verdicts.faults.iter().map(fault));
    notes.extend(configuration_notes(verdicts.comparison));
    let unknown = verdicts.comparison.unchanged.iter().filter_map(|line| {
        Some(format!("{}: all is measured: {}", line.configuration, line.reason.as_ref()?))
    });
    notes.extend(unknown);
    let conditions = verdicts.comparison.launches.iter().flat_map(|launch| &launch.notes);
    notes.extend(conditions.unique().map(|note| format!("time gate: {note}")));
    notes.extend(header.notes.iter().cloned());
    let damaged = &verdicts.comparison.damaged;
    notes.extend(damaged.iter().map(|line| format!("left out: {line}")));
    if let Some(end) = &verdicts.comparison.end {
        let cut = if end.interrupted { ", interrupted" } else { "" };
        notes.push(format!("measured in {:.0} s{cut}", end.wall_s));
    } else {
        notes.push(INCOMPLETE.to_owned());
    }
    notes
}

/// What inconclusive cells mean for the status.
fn inconclusive(verdicts: &Verdicts<'_>) -> Option<String> {
    let is_inconclusive = |cell: &&JudgedCell| cell.verdict == CellVerdict::Inconclusive;
    let all = verdicts.cells.iter().filter(is_inconclusive).count();
    let threshold = verdicts.comparison.header.settings.threshold;
    let cells = verdicts.cells.iter();
    let open = cells.filter(|cell| cell.may_be_slower(threshold)).count();
    (all > 0).then(|| {
        format!(
            "{open} of {all} inconclusive cells may be slower by more than {:.1} %: their intervals reach above it; only these make the status inconclusive",
            100.0 * threshold
        )
    })
}

/// What it means that the sides ran on two adapters, if they did.
fn on_two_adapters(verdicts: &Verdicts<'_>) -> Option<String> {
    let header = &verdicts.comparison.header;
    header.base_adapter.as_ref()?;
    let told = match AdapterRelation::from_header(header) {
        AdapterRelation::Same => "one device and driver under two settings: everything is judged",
        AdapterRelation::OtherVersion => {
            "one device under two versions of its driver: everything is judged"
        }
        AdapterRelation::Different => {
            "different adapters: exact figures are judged; times, instructions and counters are reported, but not judged"
        }
    };
    Some(told.to_owned())
}

fn throttled_times(verdicts: &Verdicts<'_>) -> Option<String> {
    let times = verdicts.cells.iter().filter_map(|cell| cell.time.as_ref());
    let held = times.clone().filter(|time| time.throttled.is_some()).count();
    let doubtful = times.clone().filter(|time| time.may_be_throttling());
    let slower = doubtful.filter(|time| time.verdict == TimeVerdict::Slower).count();
    (held > 0).then(|| {
        format!(
            "heat or power throttled clocks while {held} of {} were timed; {slower} of these are slower with more throttled launches on the head: measure them again",
            count_noun(times.count(), "cell")
        )
    })
}

/// What could not be computed of configurations, once where both sides say the same.
fn configuration_notes(comparison: &Comparison) -> Vec<String> {
    let lines = comparison.configurations.iter();
    let notes = lines.flat_map(|line| {
        line.notes.iter().map(|note| (format!("{}: {note}", line.configuration), line.side))
    });
    let mut sides: IndexMap<String, BTreeSet<Side>> = IndexMap::new();
    for (note, side) in notes {
        sides.entry(note).or_default().insert(side);
    }
    let told = sides.into_iter().map(|(note, sides)| match sides.into_iter().exactly_one() {
        Ok(side) => format!("{side}: {note}"),
        Err(_) => note,
    });
    told.collect()
}

fn rule(verdicts: &Verdicts<'_>, gate: Gate) -> String {
    let settings = &verdicts.comparison.header.settings;
    match gate {
        Gate::Time => format!(
            "{} launches of {} pairs{}; a change counts beyond {:.1} %, at a family-wise error of {:.0} %",
            verdicts.comparison.launches.len(),
            settings.pairs,
            decided_early(verdicts).unwrap_or_default(),
            100.0 * settings.threshold,
            100.0 * settings.alpha
        ),
        Gate::Instructions => format!(
            "under callgrind; a change counts beyond {:.2} %",
            100.0 * settings.instruction_threshold
        ),
        Gate::Exact => {
            "work, counters and bytes as they are; errors beyond 1 % of the base's".to_owned()
        }
    }
}

/// Cells that have fewer launches than there were, if any: ` (8 for 35 cells, 20 for 28 cells)`.
fn decided_early(verdicts: &Verdicts<'_>) -> Option<String> {
    let all = verdicts.comparison.launches.len();
    let times = verdicts.cells.iter().filter_map(|cell| cell.time.as_ref());
    let counts = times.map(|time| time.launches.len()).filter(|launches| *launches < all).counts();
    let counts = counts.into_iter().sorted();
    let told =
        counts.map(|(launches, n)| format!("{launches} for {}", count_noun(n, "cell"))).join(", ");
    (!told.is_empty()).then(|| format!(" ({told})"))
}

/// `origin/main (0.1.0, 1a2b3c4d5e6f)`, `fathom (0.1.0, 1a2b3c4d5e6f with changed files) with LP_NATIVE_VECTOR_WIDTH`.
pub fn build(build: &ComparedBuild) -> String {
    let commit = commit(build).map_or(String::new(), |commit| format!(", {commit}"));
    format!("{} ({}{commit}){}", build.label, build.version, given(&build.environment))
}

/// The commit that a program says it was built of.
fn commit(build: &ComparedBuild) -> Option<String> {
    let build = build.build.as_ref()?;
    let short: String = build.commit.as_ref()?.chars().take(SHORT_COMMIT).collect();
    Some(short + if build.dirty { " with changed files" } else { "" })
}

/// What the first line of each format says beside the verdict: the commits, how else the builds differ, and the cells of one side alone.
pub fn summary(verdicts: &Verdicts<'_>) -> String {
    let header = &verdicts.comparison.header;
    let commits = [&header.base, &header.head].map(commit);
    let is_known = commits.iter().any(Option::is_some);
    let [base, head] =
        commits.map(|commit| commit.unwrap_or_else(|| "an unknown commit".to_owned()));
    let commits = is_known.then(|| format!("{base} → {head}"));
    chain![commits, differences(verdicts)].join("; ")
}

/// `built differently: profile debug → release`, `removed: tank compose`, `new: …`.
pub fn differences(verdicts: &Verdicts<'_>) -> Vec<String> {
    let header = &verdicts.comparison.header;
    let builds = header.base.build.as_ref().zip(header.head.build.as_ref());
    let build_differences = builds.map_or_else(Vec::new, |(base, head)| base.differences(head));
    let [removed, new] = verdicts
        .cells_of_one_side()
        .map(|cells| cells.iter().map(|cell| cell.to_string()).collect());
    let parts = [("built differently", build_differences), ("removed", removed), ("new", new)];
    let parts = parts.into_iter().filter(|(_, all)| !all.is_empty());
    parts.map(|(what, all)| format!("{what}: {}", first_of(&all))).collect()
}

/// The first few, and how many there are more.
fn first_of(all: &[String]) -> String {
    let more = all.len().saturating_sub(MAX_NAMED);
    let more = (more > 0).then(|| format!("and {more} more"));
    chain![all.iter().take(MAX_NAMED).cloned(), more].join(", ")
}

fn given(environment: &SideEnvironment) -> String {
    let mut variables = environment.variables.iter().map(|(name, value)| match value {
        Some(value) => format!("{name}={value}"),
        None => name.clone(),
    });
    let all = variables.join(", ");
    if all.is_empty() { all } else { format!(" with {all}") }
}

/// `llvmpipe (LLVM 15.0.6, 256 bits), Mesa 22.3.6`.
fn adapter(adapter: &Adapter) -> String {
    let (title, driver_info) = (adapter.title(), &adapter.driver_info);
    if driver_info.is_empty() { title } else { format!("{title}, {driver_info}") }
}

/// `base … → head …`, and the adapter, or both.
pub fn sides(verdicts: &Verdicts<'_>) -> [String; 2] {
    let header = &verdicts.comparison.header;
    let [of_base, of_head] = Side::BOTH.map(|side| adapter(header.adapter_of(side)));
    let sides = format!("{} → {}", build(&header.base), build(&header.head));
    [
        chain![[sides], differences(verdicts)].join("; "),
        if of_base == of_head { of_head } else { format!("{of_base} → {of_head}") },
    ]
}

/// A mark that is seen at a glance.
pub fn mark(status: Status) -> &'static str {
    match status {
        Status::NoRegression => "✅",
        Status::Regression => "❌",
        Status::CouldNotMeasure => "⚠️",
        Status::Inconclusive | Status::TimesNotJudged => "❔",
    }
}

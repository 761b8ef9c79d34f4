//! How far a run can be trusted: what its clocks are worth and what timing costs. Functions of a view. The words for the verdict on
//! the whole run are in `noise`.

use std::collections::{BTreeMap, BTreeSet};

use itertools::Itertools;

use super::facts::share;
use super::{Report, Section, noise};
use fathom_base::statistics;
use fathom_base::visits::MIN_VISITS;
use fathom_experiments::{CHANCE, Verdict};
use fathom_judge::clocks::{ClockTrust, clocks};
use fathom_record::{
    Cell, Clock, Conditions, Estimate, Interval, PassKind, Run, SetUp, Throttling, machine,
};

/// Of several sessions the one with the clock that can be trusted least; the latest of equal ones.
pub fn worst<'a>(view: &Report<'a>) -> Option<&'a Run> {
    let trust = |run: &&Run| clocks(run).map(|(.., trust)| trust).max();
    view.runs.iter().copied().max_by_key(trust)
}

/// Whether the clocks can be trusted, in one sentence.
pub fn verdict(run: &Run) -> String {
    let of = |wanted: ClockTrust| {
        let kinds = clocks(run).filter(|(.., trust)| *trust == wanted);
        kinds.map(|(kind, ..)| kind).join(" and ")
    };
    let [unsound, unknown, host] =
        [ClockTrust::Unsound, ClockTrust::NotAudited, ClockTrust::Host].map(of);
    if !unsound.is_empty() {
        format!("The clock of {unsound} passes cannot be trusted: the audit found it unusable.")
    } else if !unknown.is_empty() {
        format!(
            "Whether the clock of {unknown} passes can be trusted is not known: the records hold no audit of it."
        )
    } else if !host.is_empty() {
        format!(
            "The clocks can be trusted: passes of the kind {host} were timed by the host clock around each of them, less the cost \
             of a submission, as the audit found no better clock."
        )
    } else {
        "The clocks can be trusted: the audit found the clock of every kind of pass sound."
            .to_owned()
    }
}

/// Which clock timed what, and under which conditions.
pub fn conditions(run: &Run) -> String {
    let all: Vec<(PassKind, Clock)> = clocks(run).map(|(kind, clock, _)| (kind, clock)).collect();
    let clocks = match all.iter().map(|(_, clock)| *clock).dedup().collect_vec().as_slice() {
        [clock] => format!("{} of every pass", clock.name()),
        _ => all.iter().map(|(kind, clock)| format!("{kind}: {}", clock.name())).join(", "),
    };
    let Conditions { cores, rasterizer_threads, randomized, .. } = &run.conditions;
    let mut conditions = Vec::new();
    if let [core] = cores.as_slice() {
        conditions.push(format!("driver on core {core} alone"));
    }
    if let Some(threads) = rasterizer_threads {
        conditions.push(format!("LP_NUM_THREADS={threads}"));
    }
    if *randomized == Some(false) {
        conditions.push("addresses not randomized".to_owned());
    }
    if conditions.is_empty() { clocks } else { format!("{clocks}; {}", conditions.join(", ")) }
}

/// Facts about the times, then about the verdicts, each with its name; [`verdict`] has the clocks. Unknown facts are left out.
pub fn facts(view: &Report<'_>) -> impl Iterator<Item = (&'static str, String)> {
    let all = [
        ("noise", view.verdict.as_ref().map(noise::figures)),
        ("visits", visits(view)),
        ("cost of timing", timing_cost(view)),
        ("throttled by heat or power", throttled(view)),
        ("verdicts by chance", false_alarms(view)),
    ];
    all.into_iter().filter_map(|(about, words)| Some((about, words?)))
}

/// Timed cells with fewer visits than an interval takes.
fn visits(view: &Report<'_>) -> Option<String> {
    let frames = || view.timed().map(|(_, cell)| &cell.frame);
    let all = frames().count();
    if all > 0 && frames().all(|frame| frame.visits.is_empty()) {
        let words = "not told: intervals are over samples of the same seconds, and claims are judged by the rule of that time. Another \
                     minute's figures lie outside such an interval more often than in 5 of 100";
        return Some(words.to_owned());
    }
    let fewest = frames().map(|frame| frame.untimed.n).min()?;
    let few = frames().filter(|frame| frame.untimed.n < MIN_VISITS).count();
    if few == 0 {
        return Some(format!("every cell has at least {fewest}; an interval takes {MIN_VISITS}"));
    }
    Some(format!(
        "{few} of {all} cells have fewer than the {MIN_VISITS} that an interval takes; the least is {fewest}"
    ))
}

/// The cost of timing, as timed over untimed frame time: over all cells, since the few pairs of one cell show mostly noise; and of the
/// cell where it is highest.
fn timing_cost(view: &Report<'_>) -> Option<String> {
    let costs = view.timed().map(|(cell, measured)| (cell, &measured.frame.timing_cost));
    let costs = costs.filter(|(_, cost)| cost.median.is_finite() && cost.n > 0).collect_vec();
    let (cell, worst) = costs.iter().max_by(|a, b| a.1.median.total_cmp(&b.1.median)).copied()?;
    let medians = costs.iter().map(|(_, cost)| cost.median).collect_vec();
    let all = statistics::estimate(&medians);
    Some(format!(
        "{} over {} cells; at worst {} ({}, n = {})",
        extra(&all),
        all.n,
        extra(worst),
        place(cell),
        worst.n
    ))
}

/// What a ratio is above 1: `1.2 % (1.1 – 1.3)`.
fn extra(ratio: &Estimate) -> String {
    let above = |ratio: f64| ratio - 1.0;
    let interval = ratio.interval.map(|i| Interval { low: above(i.low), high: above(i.high) });
    share(&Estimate { median: above(ratio.median), interval, n: ratio.n })
}

fn place(cell: &Cell) -> String {
    format!("{} {}", cell.experiment, cell.cell)
}

/// Cells that were measured while heat or power held clocks down, of those whose samples know the state of the machine: `2 of 9 cells:
/// power cap; at worst 12 of 40 samples (uw-photons 400x400)`.
fn throttled(view: &Report<'_>) -> Option<String> {
    let known = view.timed().filter(|(_, measured)| !measured.frame.machine.is_empty());
    let known =
        known.map(|(cell, measured)| (cell, Throttling::from_states(&measured.frame.machine)));
    let known = known.collect_vec();
    let held = known.iter().filter_map(|(cell, held)| Some((cell, held.as_ref()?))).collect_vec();
    let share = |held: &Throttling| held.throttled as f64 / held.samples as f64;
    let (cell, worst) = held.iter().max_by(|a, b| share(a.1).total_cmp(&share(b.1)))?;
    let reasons: BTreeSet<_> =
        held.iter().flat_map(|(_, held)| held.reasons.iter().cloned()).collect();
    Some(format!(
        "{} of {} cells: {}; at worst {} of {} samples ({})",
        held.len(),
        known.len(),
        machine::words(&reasons),
        worst.throttled,
        worst.samples,
        place(cell)
    ))
}

fn false_alarms(view: &Report<'_>) -> Option<String> {
    let rulings = view.sections.iter().flat_map(Section::rulings);
    let tested = rulings.filter(|ruling| ruling.verdict != Verdict::NotRun);
    let sampled = tested.filter(|ruling| ruling.n.is_some()).count();
    let expected = CHANCE * sampled as f64;
    (sampled > 0).then(|| {
        format!(
            "{sampled} claims rest on samples: at most {expected:.1} of them would be supported by chance, \
             and as many contradicted, if the figures of all lay exactly at their bounds"
        )
    })
}

/// What a run does besides rendering frames, seconds over all runs of the records, the longest first.
pub fn set_up_parts(view: &Report<'_>) -> Vec<(SetUp, f64)> {
    let mut parts = BTreeMap::<SetUp, f64>::new();
    for (part, s) in view.ends.iter().flat_map(|end| &end.set_up_parts_s) {
        *parts.entry(*part).or_default() += s;
    }
    parts.into_iter().sorted_by(|a, b| b.1.total_cmp(&a.1)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::{MachineState, ThrottleReason};

    #[test]
    fn cells_with_throttled_clocks_are_counted_with_the_reasons() {
        let mut records = fixtures::run();
        assert_eq!(throttled(&Report::new(&records, None)), None);
        let state = |throttle: &[ThrottleReason]| MachineState {
            throttle: throttle.to_vec(),
            ..MachineState::default()
        };
        let idle = state(&[ThrottleReason::GpuIdle]);
        let cells = fixtures::cells(&mut records).filter_map(Cell::measured_mut);
        let held = state(&[ThrottleReason::SwPowerCap, ThrottleReason::GpuIdle]);
        for (number, measured) in cells.take(3).enumerate() {
            let second = if number < 2 { held.clone() } else { idle.clone() };
            measured.frame.machine = vec![idle.clone(), second];
        }
        let words = throttled(&Report::new(&records, None)).unwrap();
        assert!(
            words.starts_with("2 of 3 cells: sw power cap; at worst 1 of 2 samples ("),
            "{words}"
        );
    }

    #[test]
    fn few_visits_are_counted_and_records_without_them_said_so() {
        let mut records = fixtures::run();
        let words = visits(&Report::new(&records, None)).unwrap();
        assert!(words.starts_with("every cell has at least 5;"), "{words}");
        let cells = fixtures::cells(&mut records).filter_map(Cell::measured_mut);
        cells.take(2).for_each(|measured| measured.frame.untimed.n = 3);
        let words = visits(&Report::new(&records, None)).unwrap();
        assert!(words.starts_with("2 of ") && words.ends_with("the least is 3"), "{words}");
        let cells = fixtures::cells(&mut records).filter_map(Cell::measured_mut);
        cells.for_each(|measured| measured.frame.visits.clear());
        assert!(visits(&Report::new(&records, None)).unwrap().starts_with("not told: "));
    }
}

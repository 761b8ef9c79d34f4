//! How far a run can be trusted: what its clocks are worth, what timing costs, how frame times moved while it ran. Functions of a
//! view.

use std::collections::{BTreeMap, BTreeSet};

use itertools::Itertools;

use super::ReportView;
use fathom_base::statistics;
use fathom_record::{
    Cell, Clock, Conditions, Estimate, FrameRecord, PassKind, Run, SetUp, ThrottleReason,
    Throttling, machine,
};

/// Samples of a cell that the drift is computed from, evenly taken: pairs grow with the square of them.
const MOST_OF_A_CELL: usize = 50;

/// What a kind of pass was timed by, and what the audit said of that clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ClockTrust {
    /// It agrees with the host clock wherever it was audited.
    Sound,
    /// The host clock around fenced submissions, which others are audited against.
    Host,
    /// The records hold no audit of it.
    NotAudited,
    /// The audit found it unusable, and it was used all the same.
    Unsound,
}

/// Of each kind of pass, the clock and what it is worth.
pub fn clocks(run: &Run) -> impl Iterator<Item = (PassKind, Clock, ClockTrust)> {
    let kinds = run.clocks.iter().filter(|(kind, _)| **kind != PassKind::Host);
    kinds.map(|(kind, clock)| (*kind, *clock, trust(run, *kind, *clock)))
}

fn trust(run: &Run, kind: PassKind, clock: Clock) -> ClockTrust {
    if matches!(clock, Clock::FencedHost | Clock::Host) {
        return ClockTrust::Host;
    }
    let rows = || run.audit.iter().filter(|row| row.pass == kind && row.clock == clock);
    match rows().next() {
        None => ClockTrust::NotAudited,
        Some(_) if rows().all(|row| row.sound) => ClockTrust::Sound,
        Some(_) => ClockTrust::Unsound,
    }
}

/// Of several sittings the one with the clock that can be trusted least; the latest of equal ones.
pub fn worst<'a>(view: &ReportView<'a>) -> Option<&'a Run> {
    let trust = |run: &&Run| clocks(run).map(|(.., trust)| trust).max();
    view.runs.iter().copied().max_by_key(trust)
}

/// Whether the clocks can be trusted, in one sentence.
pub fn verdict(run: &Run) -> String {
    let of = |wanted: ClockTrust| {
        let kinds = clocks(run).filter(|(.., trust)| *trust == wanted);
        kinds.map(|(kind, ..)| kind.name()).join(" and ")
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
        _ => {
            all.iter().map(|(kind, clock)| format!("{}: {}", kind.name(), clock.name())).join(", ")
        }
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

/// Cells that were measured while heat or power held clocks down.
#[derive(Clone, Debug, PartialEq)]
pub struct ThrottledCells<'a> {
    /// Cells whose samples know the state of the machine.
    pub of: usize,
    /// In the order of the records; at least one.
    pub cells: Vec<(&'a Cell, Throttling)>,
    /// All cells' reasons.
    pub reasons: BTreeSet<ThrottleReason>,
}

/// The throttled cells of a view, if there are any.
pub fn throttled<'a>(view: &ReportView<'a>) -> Option<ThrottledCells<'a>> {
    let known = view.timed().filter(|(_, measured)| !measured.frame.machine.is_empty());
    let known: Vec<_> = known.map(|(cell, measured)| (cell, &measured.frame.machine)).collect();
    let held = known.iter().filter_map(|(cell, states)| Some((*cell, Throttling::of(states)?)));
    let cells: Vec<(&Cell, Throttling)> = held.collect();
    let reasons = cells.iter().flat_map(|(_, held)| held.reasons.iter().cloned()).collect();
    (!cells.is_empty()).then_some(ThrottledCells { of: known.len(), cells, reasons })
}

/// `2 of 9 cells: power cap; at worst 12 of 40 samples (uw-photons 400x400)`.
pub fn throttled_words(throttled: &ThrottledCells<'_>) -> String {
    let ThrottledCells { of, cells, reasons } = throttled;
    let share = |held: &Throttling| held.throttled as f64 / held.samples as f64;
    let worst = cells.iter().max_by(|a, b| share(&a.1).total_cmp(&share(&b.1)));
    let worst = worst.map_or_else(String::new, |(cell, held)| {
        format!(
            "; at worst {} of {} samples ({} {})",
            held.throttled, held.samples, cell.experiment, cell.cell
        )
    });
    format!("{} of {of} cells: {}{worst}", cells.len(), machine::words(reasons))
}

/// Half widths of the frame times' 95 % intervals relative to the median, and their cells. Infinite where there is no interval.
pub fn half_widths<'a>(view: &ReportView<'a>) -> Vec<(f64, &'a Cell)> {
    let timed = view.timed();
    timed.map(|(cell, measured)| (measured.frame.untimed.relative_half_width(), cell)).collect()
}

/// What a run does besides rendering frames, seconds over all runs of the records, the longest first.
pub fn set_up_parts(view: &ReportView<'_>) -> Vec<(SetUp, f64)> {
    let mut parts = BTreeMap::<SetUp, f64>::new();
    for (part, s) in view.ends.iter().flat_map(|end| &end.set_up_parts_s) {
        *parts.entry(*part).or_default() += s;
    }
    parts.into_iter().sorted_by(|a, b| b.1.total_cmp(&a.1)).collect()
}

/// An untimed frame in the order of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedSample {
    /// Since the first sample of the view.
    pub at_s: f64,
    /// Frame time over the median of its cell.
    pub relative: f64,
}

/// The untimed frames of all cells by time.
pub fn samples_by_time(view: &ReportView<'_>) -> Vec<TimedSample> {
    let mut samples: Vec<TimedSample> = by_cell(view).into_iter().flatten().collect();
    samples.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    let start_s = samples.first().map_or(0.0, |first| first.at_s);
    samples.iter().map(|sample| TimedSample { at_s: sample.at_s - start_s, ..*sample }).collect()
}

fn by_cell(view: &ReportView<'_>) -> Vec<Vec<TimedSample>> {
    let of_frame = |frame: &FrameRecord| {
        let median = frame.untimed.median;
        let samples = frame.sampled_at_s.iter().zip(&frame.untimed_samples_ns);
        let relative = samples.map(|(at_s, ns)| TimedSample { at_s: *at_s, relative: ns / median });
        relative.filter(|sample| sample.relative.is_finite()).collect()
    };
    view.timed().map(|(_, measured)| of_frame(&measured.frame)).collect()
}

/// How fast frame times grew while the run measured, as a share of the cell's median in a minute. Only samples of one cell are
/// compared, so a change between cells that were not measured at the same time is not seen.
pub fn drift(view: &ReportView<'_>) -> Option<Estimate> {
    let thinned = |samples: Vec<TimedSample>| {
        let step = samples.len().div_ceil(MOST_OF_A_CELL).max(1);
        let taken = samples.iter().step_by(step);
        taken.map(|sample| (sample.at_s / 60.0, sample.relative)).collect_vec()
    };
    let cells = by_cell(view).into_iter().map(thinned).collect_vec();
    statistics::slope_within_groups(&cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::fixtures;
    use fathom_record::{MachineState, Record};

    /// The fixture's run with frame times that grow by a share of their median in a minute.
    fn drifting(per_minute: f64) -> Vec<Record> {
        let mut records = fixtures::run();
        for record in &mut records {
            let Record::Cell(cell) = record else { continue };
            let Some(measured) = cell.measured_mut() else { continue };
            let frame = &mut measured.frame;
            let start_s = frame.sampled_at_s[0];
            for (at_s, ns) in frame.sampled_at_s.iter().zip(&mut frame.untimed_samples_ns) {
                *ns *= 1.0 + per_minute * (at_s - start_s) / 60.0;
            }
        }
        records
    }

    #[test]
    fn cells_with_throttled_clocks_are_counted_with_the_reasons() {
        let mut records = fixtures::run();
        assert_eq!(throttled(&ReportView::new(&records, None)), None);
        let state = |throttle: &[ThrottleReason]| MachineState {
            throttle: throttle.to_vec(),
            ..MachineState::default()
        };
        let idle = state(&[ThrottleReason::GpuIdle]);
        let cells = records.iter_mut().filter_map(|record| match record {
            Record::Cell(cell) => cell.measured_mut(),
            _ => None,
        });
        let held = state(&[ThrottleReason::SwPowerCap, ThrottleReason::GpuIdle]);
        for (number, measured) in cells.take(3).enumerate() {
            let second = if number < 2 { held.clone() } else { idle.clone() };
            measured.frame.machine = vec![idle.clone(), second];
        }
        let view = ReportView::new(&records, None);
        let found = throttled(&view).unwrap();
        assert_eq!((found.of, found.cells.len()), (3, 2));
        assert_eq!(found.reasons, [ThrottleReason::SwPowerCap].into());
        let words = throttled_words(&found);
        assert!(words.starts_with("2 of 3 cells: power cap; at worst 1 of 2 samples ("), "{words}");
    }

    #[test]
    fn a_drift_is_found_and_none_where_there_is_none() {
        for truth in [0.0, 0.5, -0.3] {
            let records = drifting(truth);
            let found = drift(&ReportView::new(&records, None)).unwrap();
            let [low, high] = found.ends();
            // Three standard errors rather than two: three truths are tried.
            let reach = 0.75 * (high - low);
            assert!((found.median - truth).abs() < reach && reach < 0.05, "{truth}: {found:?}");
        }
    }

    #[test]
    fn samples_stand_in_the_order_of_time_about_their_median() {
        let records = fixtures::run();
        let samples = samples_by_time(&ReportView::new(&records, None));
        assert!(samples.is_sorted_by(|a, b| a.at_s <= b.at_s) && samples[0].at_s == 0.0);
        let relative = samples.iter().map(|sample| sample.relative).collect_vec();
        assert!((statistics::median(&relative) - 1.0).abs() < 0.01);
    }

    #[test]
    fn clocks_are_worth_what_the_audit_said() {
        let mut run = fixtures::header(fathom_record::Profile::Quick);
        let found = |run: &Run| clocks(run).map(|(_, _, trust)| trust).collect_vec();
        assert_eq!(
            found(&run),
            [ClockTrust::Sound, ClockTrust::Host].into_iter().rev().collect_vec()
        );
        run.clocks.insert(PassKind::Compute, Clock::Timestamp);
        assert_eq!(found(&run)[0], ClockTrust::Unsound);
        run.audit.clear();
        assert_eq!(found(&run), [ClockTrust::NotAudited; 2]);
    }
}

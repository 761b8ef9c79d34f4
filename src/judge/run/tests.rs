//! Verdicts on modelled runs: frame times, other processes and pauses by a clock that is made up.

use rand::rngs::StdRng;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};

use super::*;
use fathom_experiments::fixtures;
use fathom_record::{Cell, MachineState, Record};

fn verdict(records: &[Record]) -> RunVerdict {
    let run = records.iter().find_map(Record::try_as_run_ref).unwrap();
    let cells = records.iter().filter_map(|record| record.try_as_cell_ref()?.measured());
    let frames = cells.filter(|cell| cell.is_timed()).map(|cell| &cell.frame).collect_vec();
    RunVerdict::judge(run, &frames).unwrap()
}

fn criteria(verdict: &RunVerdict) -> Vec<Criterion> {
    verdict.exceeded().map(|figure| figure.criterion).collect()
}

const CELLS: usize = 24;
const VISIT_S: f64 = 0.25;

/// A machine at a moment.
#[derive(Clone, Copy)]
struct State {
    /// How many times longer than at rest frames take.
    slower: f64,
    others: Option<f32>,
}

const AT_REST: State = State { slower: 1.0, others: Some(0.03) };

/// A run in which cells are visited in turn, in an order drawn anew each round. At rest a frame's time scatters by this share.
struct MachineModel {
    minutes: f64,
    scatter: f64,
    seed: u64,
}

const QUIET: MachineModel = MachineModel { minutes: 4.0, scatter: 0.025, seed: 1 };

impl MachineModel {
    fn records(&self, mut state: impl FnMut(f64) -> State) -> Vec<Record> {
        let mut random = StdRng::seed_from_u64(self.seed);
        let mut cells = vec![FrameRecord::default(); CELLS];
        let mut order: Vec<usize> = (0..CELLS).collect();
        for visit in 0..(self.minutes * 60.0 / VISIT_S) as usize {
            if visit % CELLS == 0 {
                order.shuffle(&mut random);
            }
            let at_s = visit as f64 * VISIT_S;
            let State { slower, others } = state(at_s);
            let normal = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let frame = &mut cells[order[visit % CELLS]];
            frame.sampled_at_s.push(1.7e9 + at_s);
            frame.untimed_samples_ns.push(4e7 * slower * (self.scatter * normal).exp());
            frame.machine.extend(others.map(|others| MachineState {
                others_load: Some(others),
                steal: Some(0.0),
                ..MachineState::default()
            }));
        }
        let mut records = fixtures::run();
        let mut timed = 0;
        records.retain(|record| {
            let cell = record.try_as_cell_ref();
            timed += usize::from(cell.is_some());
            cell.is_none_or(|cell| timed <= CELLS && cell.measured().is_some())
        });
        let measured = fixtures::cells(&mut records).filter_map(Cell::measured_mut);
        for (measured, mut frame) in measured.zip(cells) {
            frame.untimed = statistics::estimate(&frame.untimed_samples_ns);
            measured.frame = frame;
        }
        records
    }

    fn verdict(&self, state: impl FnMut(f64) -> State) -> RunVerdict {
        verdict(&self.records(state))
    }
}

/// A process on another core works and rests in turns of 0.1 to 2 s; while it works, frames take so many times longer.
fn beside(slower: f64, told: bool, seed: u64) -> impl FnMut(f64) -> State {
    let mut random = StdRng::seed_from_u64(seed);
    let (mut works, mut phase_ends_s) = (false, 0.0);
    move |at_s| {
        while phase_ends_s <= at_s {
            phase_ends_s += random.random_range(0.1..2.0);
            works = !works;
        }
        let others = told.then_some(if works { 1.03 } else { 0.03 });
        State { slower: if works { slower } else { 1.0 }, others }
    }
}

#[test]
fn a_run_on_a_machine_at_rest_is_quiet() {
    for seed in 0..10 {
        let verdict = MachineModel { seed, ..QUIET }.verdict(|_| AT_REST);
        assert_eq!(verdict.noise, Noise::Quiet, "{seed}: {verdict:?}");
        assert_eq!((verdict.cells, verdict.with_interval, verdict.is_short()), (24, 24, false));
    }
}

/// By its load where records hold it, though frames do not become longer; else by what it does to them.
#[test]
fn a_run_beside_a_process_that_works_and_rests_is_noisy() {
    for seed in 0..10 {
        let by_load = QUIET.verdict(beside(1.0, true, seed));
        assert_eq!(by_load.noise, Noise::Noisy, "{seed}: {by_load:?}");
        assert_eq!(criteria(&by_load), [Criterion::OtherProcesses]);
        let by_times = QUIET.verdict(beside(1.2, false, seed));
        assert_eq!(by_times.noise, Noise::Noisy, "{seed}: {by_times:?}");
        assert_eq!(criteria(&by_times)[0], Criterion::Scatter);
        assert_eq!(by_times.load, None);
    }
}

#[test]
fn fixed_kernels_beside_the_frames_decide_where_they_were_run() {
    for (scatter, slower, noise) in [(0.01, 1.15, Noise::Noisy), (0.2, 1.0, Noise::Quiet)] {
        let mut records = MachineModel { scatter, ..QUIET }.records(|_| AT_REST);
        for measured in fixtures::cells(&mut records).filter_map(Cell::measured_mut) {
            let frame = &mut measured.frame;
            let in_odd_minutes = |at_s: &f64| (at_s / 60.0) as u64 % 2 == 1;
            let ns = |at_s| if in_odd_minutes(at_s) { [1e6, 2e6 * slower] } else { [1e6, 2e6] };
            frame.pacer_ns = frame.sampled_at_s.iter().map(ns).collect();
        }
        let verdict = verdict(&records);
        assert_eq!(verdict.noise, noise, "{verdict:?}");
    }
}

#[test]
fn stolen_time_makes_a_run_noisy() {
    let mut records = QUIET.records(|_| AT_REST);
    for measured in fixtures::cells(&mut records).filter_map(Cell::measured_mut) {
        measured.frame.machine.iter_mut().for_each(|state| state.steal = Some(0.02));
    }
    let verdict = verdict(&records);
    assert_eq!(verdict.noise, Noise::Noisy);
    assert_eq!(criteria(&verdict), [Criterion::Steal]);
}

/// A cell that has too few samples is no sign of noise.
#[test]
fn a_short_run_is_quiet_and_asks_for_visits() {
    let verdict = MachineModel { minutes: 0.7, ..QUIET }.verdict(|_| AT_REST);
    assert_eq!(verdict.noise, Noise::Quiet, "{verdict:?}");
    assert!(verdict.is_short() && !verdict.has_intervals());
}

#[test]
fn a_pause_is_no_time_of_measuring() {
    let mut records = QUIET.records(|_| AT_REST);
    for measured in fixtures::cells(&mut records).filter_map(Cell::measured_mut) {
        let times_s = &mut measured.frame.sampled_at_s;
        times_s.iter_mut().filter(|at_s| **at_s >= 1.7e9 + 30.0).for_each(|at_s| *at_s += 3_600.0);
        times_s.retain(|at_s| *at_s < 1.7e9 + 3_650.0);
    }
    let verdict = verdict(&records);
    assert!((49.0..51.0).contains(&verdict.seconds) && verdict.is_short(), "{verdict:?}");
}

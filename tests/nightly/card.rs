//! The order of a run on a card, on a modelled clock: the paper profile with the step times of the first run on an H100.

use std::collections::BTreeMap;
use std::path::Path;

use fathom::Catalog;
use fathom::experiments::schema::Pictures;
use fathom::gpu::Capacity;
use fathom::harness::beside::backlog_s;
use fathom::harness::executor::CellProgress;
use fathom::harness::plan::{PlannedCell, PlannedExperiment, Request, plan};
use fathom::harness::run::schedule;
use fathom::harness::sample::CostForecast;
use fathom::harness::schedule::{CellCosts, Next};
use fathom::record::{Profile, Record, SetUp, read};
use fathom::visits::VISIT_S;

const WORKERS: usize = 15;
const VISITS: usize = 6;
const BUDGET_S: f64 = 600.0;
/// Shares of errors and of pictures that are read-backs, which wait for the card: on lavapipe 0.12 of 7.2 s and 0.37 of 1.34 s.
const READ_BACK: [f64; 2] = [0.02, 0.28];
/// What a pipeline takes to make whose shaders are compiled, over the mean of the first: on lavapipe 20 of 47 ms.
const MADE_AGAIN: f64 = 0.43;

/// What a cell takes on the card, and on another core after it, seconds.
type StepTimes = (CostForecast, f64);

/// Of all cells, and what precedes them. A frame that was never measured follows from its declared work, as the schedule foresees it.
fn step_times(planned: &[PlannedExperiment]) -> (Vec<Vec<StepTimes>>, f64) {
    let records = read(Path::new("reports/nvidia-h100/records.jsonl.gz")).unwrap().records;
    let set_up_s = &records.iter().find_map(Record::try_as_end_ref).unwrap().set_up_parts_s;
    let cells = records.iter().filter_map(Record::try_as_cell_ref);
    let seen: Vec<_> = cells.filter_map(|cell| Some((cell, cell.measured()?))).collect();
    // An axis that came later stands at the end of a name.
    let seen_s = |of: &PlannedCell| {
        let is_same = |name: &str| of.plan.cell.starts_with(name);
        let same = seen.iter().filter(|(cell, _)| cell.experiment == of.plan.experiment);
        let same = same.filter(|(cell, _)| is_same(&cell.cell)).max_by_key(|(of, _)| of.cell.len());
        let frame = &same?.1.frame;
        let frame_s = frame.untimed.median * 1e-9;
        (frame.untimed.n > 0).then_some(frame_s + frame_s * frame.timing_cost.median)
    };
    let mut ratios = BTreeMap::<&str, Vec<f64>>::new();
    for cell in planned.iter().flat_map(|of| &of.cells).filter(|cell| !cell.plan.errors_only) {
        let ratio = seen_s(cell).map(|pair_s| pair_s / cell.declared_s);
        for of in ["", &cell.plan.pipeline] {
            ratios.entry(of).or_default().extend(ratio);
        }
    }
    ratios.retain(|_, ratios| !ratios.is_empty());
    let mean = |of: &Vec<f64>| of.iter().sum::<f64>() / of.len() as f64;
    let is_compared =
        |of: &PlannedCell| of.reference.is_some() || of.views.is_some() || of.repetitions.is_some();
    let compared = planned.iter().flat_map(|of| &of.cells).filter(|cell| is_compared(cell)).count();
    let pictured = seen.iter().filter(|(_, measured)| !measured.pictures.is_empty()).count();
    let each_s =
        |part, of: usize, is_done| f64::from(u8::from(is_done)) * set_up_s[&part] / of as f64;
    let steps = |of: &PlannedExperiment| {
        let step = |(index, cell): (usize, &PlannedCell)| {
            let is_pictured = index == 0 || of.experiment.pictures == Pictures::All;
            let foreseen_s = || {
                let own = ratios.get(&*cell.plan.pipeline).unwrap_or(&ratios[""]);
                cell.declared_s * mean(own)
            };
            let parts_s = [
                each_s(SetUp::Errors, seen.len(), true),
                each_s(SetUp::Pictures, pictured, is_pictured),
            ];
            let read_s: f64 = parts_s.iter().zip(READ_BACK).map(|(s, share)| s * share).sum();
            let on_card = CostForecast {
                prepare_s: each_s(SetUp::Pipelines, seen.len(), true)
                    + each_s(SetUp::Counting, seen.len(), !cell.plan.errors_only),
                pair_s: seen_s(cell).unwrap_or_else(foreseen_s),
                finish_s: each_s(SetUp::Quantities, seen.len(), true)
                    + each_s(SetUp::Comparisons, compared, is_compared(cell))
                    + read_s,
            };
            (on_card, parts_s.iter().sum::<f64>() - read_s)
        };
        of.cells.iter().enumerate().map(step).collect()
    };
    let before = [SetUp::Device, SetUp::Scenes, SetUp::Audit, SetUp::Ceilings];
    (planned.iter().map(steps).collect(), before.iter().map(|part| set_up_s[part]).sum())
}

#[test]
fn a_card_measures_most_of_the_time_and_all_papers_are_done_in_ten_minutes() {
    let (catalog, request) = (Catalog::builtin(), Request::default());
    let limits = wgpu::Limits {
        max_texture_dimension_2d: 32_768,
        max_texture_dimension_3d: 16_384,
        max_buffer_size: 1 << 40,
        max_storage_buffer_binding_size: 1 << 31,
        ..wgpu::Limits::default()
    };
    let capacity = Capacity { limits, threads: WORKERS + 1, ..Capacity::default() };
    let experiments = request.load(&catalog).unwrap();
    let planned = plan(experiments, &request, Profile::Paper, &capacity, &catalog, &|| Ok(()));
    let planned = planned.unwrap();
    let known: Vec<_> = planned.iter().map(|_| CellProgress::default()).collect();
    let mut schedule = schedule(&planned, &known, VISITS);
    let (steps, mut now_s) = step_times(&planned);
    let (mut free_s, mut seen, mut measured_s) = (vec![now_s; WORKERS], (0, 0.0_f64), 0.0);
    let mut made = 0;
    loop {
        let left_s: f64 = free_s.iter().map(|free_s| (free_s - now_s).max(0.0)).sum();
        let pending = (left_s * seen.0.max(1) as f64 / seen.1.max(0.01)).ceil() as usize;
        let budget_s = BUDGET_S - backlog_s(pending, WORKERS, seen);
        let batch = match schedule.next(now_s, budget_s - now_s) {
            Next::Visit(batch) => batch,
            Next::Wait(wait_s) => {
                now_s += wait_s;
                continue;
            }
            Next::End => break,
        };
        schedule.begin(&batch);
        for cell in &batch.cells {
            let (mut takes, beside_s) = steps[batch.experiment][*cell];
            let state = &mut schedule.cells[batch.experiment][*cell];
            if state.recorded {
                (takes.prepare_s, takes.finish_s) = (MADE_AGAIN * takes.prepare_s, 0.0);
            }
            // One frame, untimed, of a cell whose errors count alone.
            let frames_s = if state.untimed {
                0.5 * takes.pair_s
            } else {
                takes.visit_s() - takes.prepare_s - takes.finish_s
            };
            (now_s, measured_s) =
                (now_s + takes.prepare_s + frames_s + takes.finish_s, measured_s + frames_s);
            if !state.recorded {
                let worker = free_s.iter_mut().min_by(|a, b| a.total_cmp(b)).unwrap();
                *worker = worker.max(now_s) + beside_s;
                seen = (seen.0 + 1, seen.1 + beside_s);
                state.costs.finish_s = Some(takes.finish_s);
            }
            let of_frames = CellCosts {
                prepare_s: Some(takes.prepare_s),
                pair_s: Some(takes.pair_s),
                ..state.costs
            };
            state.costs =
                if state.untimed { CellCosts { pair_s: None, ..of_frames } } else { of_frames };
            let is_apart = now_s - state.visited_s >= VISIT_S;
            state.visits += usize::from(!state.untimed && is_apart);
            (state.recorded, state.visited_s) = (true, now_s);
            made += usize::from(!state.untimed);
        }
    }
    let end_s = free_s.into_iter().fold(now_s, f64::max);
    let timed: Vec<_> = schedule.all().filter(|cell| !cell.untimed).collect();
    let lacking = timed.iter().map(|cell| VISITS.saturating_sub(cell.visits)).sum::<usize>();
    println!(
        "{} cells, {made} visits, {lacking} lacking, {end_s:.0} s, {measured_s:.0} s of frames",
        timed.len()
    );
    assert!(schedule.all().all(|cell| cell.recorded) && end_s <= BUDGET_S);
    // The cells that a page shows first are visited alone, and then beside those that they are compared with.
    assert!(lacking == 0 && made <= VISITS * timed.len() + schedule.first.len());
    assert!(measured_s >= 0.6 * end_s);
}

//! The order of a run on a card, on a modelled clock: the paper profile with the step times of the first run on an H100.

use std::collections::BTreeMap;
use std::path::Path;

use fathom::Catalog;
use fathom::gpu::Capacity;
use fathom::harness::beside::backlog_s;
use fathom::harness::cell_progress::CellProgress;
use fathom::harness::plan::{PlannedCell, PlannedExperiment, Request, plan};
use fathom::harness::run::schedule;
use fathom::harness::sample::CostForecast;
use fathom::harness::schedule::{CellCosts, Next};
use fathom::record::{Profile, Record, SetUp, read};
use fathom::visits::VISIT_S;

const WORKERS: usize = 15;
const VISITS: usize = 6;
const BUDGET_S: f64 = 600.0;
/// Share of errors and of pictures that is read-backs, which wait for the card: on lavapipe 0.49 of 8.5 s.
const READ_BACK: f64 = 0.06;
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
        let same = seen.iter().filter(|(cell, _)| cell.experiment == of.plan.experiment);
        let same = same.filter(|(cell, _)| of.plan.cell.starts_with(&cell.cell));
        let frame = &same.max_by_key(|(cell, _)| cell.cell.len())?.1.frame;
        let frame_s = frame.untimed.median * 1e-9;
        (frame.untimed.n > 0).then_some(frame_s + frame_s * frame.timing_cost.median)
    };
    let mut ratios = BTreeMap::<&str, Vec<f64>>::new();
    for cell in planned.iter().flat_map(|of| &of.cells).filter(|cell| !cell.plan.errors_only) {
        if let Some(pair_s) = seen_s(cell) {
            ratios.entry(&cell.plan.pipeline).or_default().push(pair_s / cell.declared_s);
        }
    }
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len() as f64;
    let of_all: Vec<f64> = ratios.values().flatten().copied().collect();
    let each_s = |part| set_up_s[&part] / seen.len() as f64;
    let step = |cell: &PlannedCell| {
        let ratio = mean(ratios.get(&*cell.plan.pipeline).unwrap_or(&of_all));
        let counting_s = if cell.plan.errors_only { 0.0 } else { each_s(SetUp::Counting) };
        let judging_s = each_s(SetUp::Errors) + each_s(SetUp::Pictures);
        let on_card = CostForecast {
            prepare_s: each_s(SetUp::Pipelines) + counting_s,
            pair_s: seen_s(cell).unwrap_or(cell.declared_s * ratio),
            finish_s: each_s(SetUp::Quantities) + READ_BACK * judging_s,
        };
        (on_card, judging_s * (1.0 - READ_BACK))
    };
    let steps = planned.iter().map(|of| of.cells.iter().map(step).collect());
    // Comparisons are those of the same few cells.
    let parts = [SetUp::Device, SetUp::Scenes, SetUp::Audit, SetUp::Ceilings, SetUp::Comparisons];
    (steps.collect(), parts.iter().map(|part| set_up_s[part]).sum())
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
    let (mut free_s, mut done, mut beside_s) = (vec![now_s; WORKERS], 0, 0.0_f64);
    let (mut made, mut measured_s) = (0, 0.0);
    loop {
        let left_s: f64 = free_s.iter().map(|free_s| (free_s - now_s).max(0.0)).sum();
        let pending = (left_s * f64::from(done) / beside_s.max(1e-9)).ceil() as usize;
        let budget_s = BUDGET_S - backlog_s(pending, WORKERS, (done as usize, beside_s));
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
            let (mut takes, task_s) = steps[batch.experiment][*cell];
            let state = &mut schedule.cells[batch.experiment][*cell];
            let pair_s = (!state.untimed).then_some(takes.pair_s);
            if state.recorded {
                (takes.prepare_s, takes.finish_s) = (MADE_AGAIN * takes.prepare_s, 0.0);
            }
            let around_s = takes.prepare_s + takes.finish_s;
            // One frame, untimed, of a cell whose errors count alone.
            let frames_s = pair_s.map_or(0.5 * takes.pair_s, |_| takes.visit_s() - around_s);
            (now_s, measured_s) = (now_s + around_s + frames_s, measured_s + frames_s);
            let mut finish_s = state.costs.finish_s;
            if !state.recorded {
                let worker = free_s.iter_mut().min_by(|a, b| a.total_cmp(b)).unwrap();
                *worker = worker.max(now_s) + task_s;
                (done, beside_s, finish_s) = (done + 1, beside_s + task_s, Some(takes.finish_s));
            }
            state.costs = CellCosts { prepare_s: Some(takes.prepare_s), pair_s, finish_s };
            made += usize::from(!state.untimed);
            state.visits += usize::from(!state.untimed && now_s - state.visited_s >= VISIT_S);
            (state.recorded, state.visited_s) = (true, now_s);
        }
    }
    let end_s = free_s.into_iter().fold(now_s, f64::max);
    println!("{made} visits in {end_s:.0} s, {measured_s:.0} s of frames");
    let timed: Vec<_> = schedule.all().filter(|cell| !cell.untimed).collect();
    assert!(schedule.all().all(|cell| cell.recorded) && end_s <= BUDGET_S);
    assert!(timed.iter().all(|cell| cell.visits >= VISITS) && measured_s >= 0.6 * end_s);
    // Cells that a page shows first are visited alone, and then beside those that they are compared with.
    assert!(made <= VISITS * timed.len() + schedule.first.len());
}

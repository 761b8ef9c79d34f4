//! The scheduler over a mock executor whose clock moves only when a frame is rendered.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::*;
use fathom_base::statistics;
use fathom_base::visits::VISIT_S;
use fathom_clock::{MAX_WARM_UP_FRAMES, StageTime};
use fathom_record::{Clock, FaultKind};
use rand::RngExt;

/// Nanoseconds of a frame, from the cell's frame count (warm-up included) and the clock in seconds.
type FrameTime = fn(frame: usize, now_s: f64) -> f64;

struct MockCell {
    time: FrameTime,
    /// Of preparing it and of reading its figures, seconds.
    prepare_s: f64,
    finish_s: f64,
    bytes: u64,
    /// Timed frames of these numbers carry a fault.
    faulty: fn(frame: usize) -> bool,
    refuses: bool,
    untimed_only: bool,
    /// The device is lost at this frame.
    loses_device_at: Option<usize>,
    /// The device is lost when its figures are read.
    loses_device_at_finish: bool,
    /// Rendered so far.
    frames: usize,
}

const STEADY: MockCell = MockCell {
    time: |_, _| 1e7,
    prepare_s: 0.0,
    finish_s: 0.0,
    bytes: 1,
    faulty: |_| false,
    refuses: false,
    untimed_only: false,
    loses_device_at: None,
    loses_device_at_finish: false,
    frames: 0,
};

fn cell(time: FrameTime) -> MockCell {
    MockCell { time, ..STEADY }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum MockStep {
    Prepare,
    Timed,
    Untimed,
    Release,
}
use MockStep::*;

/// What was done, and to which cell.
type Call = (MockStep, usize);

#[derive(Default)]
struct Mock {
    cells: Vec<MockCell>,
    /// Cells that a claim compares.
    compared: Vec<usize>,
    calls: Vec<Call>,
    results: BTreeMap<usize, Result<Samples, String>>,
    /// What an earlier run has left, by cell.
    earlier: BTreeMap<usize, Samples>,
    /// In the order in which it was kept or finished, with the moment.
    kept: Vec<(f64, usize, Samples)>,
    now_s: f64,
    next_round: u32,
    lost: Option<String>,
    /// The device was opened anew, which works once.
    recovered: bool,
    disk_full: bool,
    /// All steps take longer than is foreseen.
    unforeseen: bool,
    /// When the last step was begun.
    last_step_s: f64,
    interrupt_at_s: Option<f64>,
    interrupted: Arc<AtomicBool>,
    /// What was uploaded waits for whoever submits next.
    holds_uploads: bool,
}

impl Mock {
    fn new(cells: Vec<MockCell>) -> Self {
        Self { cells, ..Self::default() }
    }

    /// Samples one visit of all cells.
    fn run(self, settings: &Settings) -> Self {
        self.run_visits(1, settings)
    }

    /// Visits that lie apart.
    fn run_visits(mut self, visits: usize, settings: &Settings) -> Self {
        for visit in 0..visits {
            self.now_s += if visit > 0 { VISIT_S } else { 0.0 };
            self.results.clear();
            let first_round = self.next_round;
            let settings =
                Settings { first_round: settings.first_round + first_round, ..*settings };
            self.try_run(&settings).expect("the mock never ends a run");
        }
        self
    }

    fn try_run(&mut self, settings: &Settings) -> Result<(), String> {
        let mut cells: Vec<usize> = (0..self.cells.len()).collect();
        let (interrupted, mut settings) = (Arc::clone(&self.interrupted), *settings);
        let before = settings.first_round;
        settings.first_round = sample(self, &cells, &settings, &interrupted)?;
        self.next_round += settings.first_round - before;
        // As a run does, once.
        if self.lost.take().is_some() {
            self.recovered = true;
            self.cells.iter_mut().for_each(|cell| cell.loses_device_at = None);
            cells.retain(|cell| !self.results.contains_key(cell));
            sample(self, &cells, &settings, &interrupted)?;
        }
        Ok(())
    }

    fn frame(&mut self, cell: usize) -> Result<(f64, usize), Failure> {
        assert!(!self.holds_uploads || self.cells[cell].untimed_only, "an upload in a visit");
        self.last_step_s = self.now_s;
        let cell = &mut self.cells[cell];
        let frame = cell.frames;
        cell.frames += 1;
        if cell.loses_device_at == Some(frame) {
            self.lost = Some("gone".to_owned());
            return Err(Failure::DeviceLost("gone".into()));
        }
        let ns = (cell.time)(frame, self.now_s);
        self.now_s += ns * 1e-9;
        if self.interrupt_at_s.is_some_and(|at_s| self.now_s >= at_s) {
            self.interrupted.store(true, Ordering::Relaxed);
        }
        Ok((ns, frame))
    }

    fn samples(&self, cell: usize) -> &Samples {
        self.results[&cell].as_ref().expect("it has samples")
    }

    fn reason(&self, cell: usize) -> &str {
        self.results[&cell].as_ref().expect_err("it failed")
    }

    fn count(&self, wanted: MockStep) -> usize {
        self.calls.iter().filter(|(did, _)| *did == wanted).count()
    }
}

impl Executor for Mock {
    type Fatal = String;

    fn prepare(&mut self, cell: usize) -> Result<u64, Failure> {
        self.calls.push((Prepare, cell));
        self.holds_uploads = true;
        self.last_step_s = self.now_s;
        self.now_s += self.cells[cell].prepare_s;
        if self.cells[cell].refuses {
            Err(Failure::Cell("out of GPU memory".into()))
        } else {
            Ok(self.cells[cell].bytes)
        }
    }

    fn wake(&mut self) -> Result<(), Failure> {
        self.holds_uploads = false;
        Ok(())
    }

    fn time_frame(&mut self, cell: usize) -> Result<FrameSample, Failure> {
        self.calls.push((Timed, cell));
        let (ns, frame) = self.frame(cell)?;
        let a = StageTime { clock: Clock::Timestamp, ns: 0.3 * ns, ..StageTime::zero("a") };
        // Less than nothing is left where a cost was taken off that scatters, which is no fault.
        let (b, submit_cost_ns) = (StageTime::zero("b"), 0.7 * ns);
        let b = StageTime { clock: Clock::FencedHost, ns: -0.1 * ns, submit_cost_ns, ..b };
        Ok(FrameSample {
            stages: vec![a, b],
            gaps_ns: 0.1 * ns,
            envelope_ns: if (self.cells[cell].faulty)(frame) { 0.0 } else { ns },
            faults: Vec::new(),
        })
    }

    fn run_frame(&mut self, cell: usize) -> Result<f64, Failure> {
        self.calls.push((Untimed, cell));
        self.frame(cell).map(|(ns, _)| ns)
    }

    fn earlier_samples(&mut self, cell: usize) -> Samples {
        self.earlier.get(&cell).cloned().unwrap_or_default()
    }

    fn save(&mut self, cell: usize, samples: &Samples) -> Result<(), String> {
        self.kept.push((self.now_s, cell, samples.clone()));
        self.earlier.insert(cell, samples.clone());
        Ok(())
    }

    fn chains(&self, cells: &[usize]) -> Vec<Vec<usize>> {
        let rest =
            cells.iter().filter(|cell| !self.compared.contains(cell)).map(|cell| vec![*cell]);
        rest.chain([self.compared.clone()]).collect()
    }

    fn untimed_only(&self, cell: usize) -> bool {
        self.cells[cell].untimed_only
    }

    fn forecast(&self, cell: usize) -> CostForecast {
        if self.unforeseen {
            return CostForecast::default();
        }
        let MockCell { prepare_s, time, finish_s, .. } = self.cells[cell];
        CostForecast { prepare_s, pair_s: 2e-9 * time(100, self.now_s), finish_s }
    }

    fn finish(&mut self, cell: usize, result: Result<Samples, String>) -> Result<(), String> {
        if self.disk_full {
            return Err("disk full".to_owned());
        }
        if let Ok(samples) = &result {
            self.save(cell, samples)?;
        }
        self.last_step_s = self.now_s;
        // Further frames are built for its figures.
        self.holds_uploads |= result.is_ok();
        self.now_s += self.cells[cell].finish_s;
        let is_lost = std::mem::take(&mut self.cells[cell].loses_device_at_finish);
        let result = if is_lost {
            self.lost = Some("gone".to_owned());
            result.and(Err(device_lost("gone")))
        } else {
            result
        };
        assert!(self.results.insert(cell, result).is_none(), "cell {cell} finished twice");
        Ok(())
    }

    fn release(&mut self, cell: usize) {
        self.calls.push((Release, cell));
    }

    fn loss_reason(&self) -> Option<String> {
        self.lost.clone()
    }

    fn now_s(&self) -> f64 {
        self.now_s
    }

    fn unix_s(&self) -> f64 {
        1.7e9 + self.now_s
    }
}

const SETTINGS: Settings =
    Settings { deadline_s: 1e3, at_least_one: false, group_bytes: 1_000, seed: 7, first_round: 0 };

/// Whatever cells cost, fail at, or have room for.
#[test]
fn no_upload_runs_within_a_visit() {
    let mut random = Pcg64::seed_from_u64(5);
    for _ in 0..1_000 {
        let cell = |random: &mut Pcg64| MockCell {
            prepare_s: random.random_range(0.0..1.0),
            finish_s: random.random_range(0.0..1.0),
            bytes: random.random_range(1..800),
            refuses: random.random_bool(0.1),
            untimed_only: random.random_bool(0.3),
            faulty: if random.random_bool(0.1) { |_| true } else { |_| false },
            loses_device_at: random.random_bool(0.05).then(|| random.random_range(0..6)),
            ..STEADY
        };
        let cells: Vec<_> = (0..random.random_range(1..8)).map(|_| cell(&mut random)).collect();
        let compared = (0..cells.len()).filter(|_| random.random_bool(0.5)).collect();
        let deadline_s = random.random_range(1.0..30.0);
        let mock = Mock { compared, ..Mock::new(cells) };
        mock.run_visits(3, &Settings { deadline_s, seed: random.random(), ..SETTINGS });
    }
}

/// Whatever its cells cost; where that is not foreseen, the step that the deadline meets is the last.
#[test]
fn nothing_is_begun_that_does_not_fit_before_the_deadline() {
    let mut random = Pcg64::seed_from_u64(3);
    for unforeseen in [false, true].repeat(100) {
        let mut cells: Vec<MockCell> = (0..6)
            .map(|_| MockCell {
                prepare_s: random.random_range(0.0..1.0),
                finish_s: random.random_range(0.0..1.0),
                ..STEADY
            })
            .collect();
        cells[2].time = |_, _| 3e8;
        let deadline_s = random.random_range(0.0..20.0);
        let settings = Settings { deadline_s, at_least_one: unforeseen, ..SETTINGS };
        let mock = Mock { unforeseen, ..Mock::new(cells) }.run(&settings);
        let last_s = if unforeseen { mock.last_step_s } else { mock.now_s - 1e-6 };
        assert!(last_s <= deadline_s, "{last_s} of {deadline_s}, {unforeseen}");
        assert_eq!(mock.count(Prepare), mock.count(Release));
        assert!(mock.results.keys().all(|cell| mock.samples(*cell).pairs() > 0));
    }
}

#[test]
fn one_pair_of_one_cell_is_begun_whatever_is_foreseen_while_there_is_time() {
    let run = |deadline_s, at_least_one| {
        // Both together are not prepared in the time.
        let slow = || MockCell { prepare_s: 0.6, finish_s: 9.0, ..STEADY };
        Mock::new(vec![slow(), slow()]).run(&Settings { deadline_s, at_least_one, ..SETTINGS })
    };
    let mock = run(1.0, true);
    assert_eq!(mock.results.len(), 1);
    assert_eq!(mock.results.values().next().unwrap().as_ref().unwrap().pairs(), 1);
    assert!([run(1.0, false), run(0.0, true)].iter().all(|mock| mock.calls.is_empty()));
}

/// Deterministic noise of ±`share`, different for each frame.
fn noise(frame: usize, share: f64) -> f64 {
    let phase = (frame as f64 * 0.618_033_988_749_895).fract();
    1.0 + share * (2.0 * phase - 1.0)
}

#[test]
fn cells_whose_times_nobody_asks_for_render_one_frame() {
    let errors = || MockCell { untimed_only: true, bytes: 900, ..STEADY };
    let mock = Mock::new(vec![errors(), STEADY, errors()]).run(&SETTINGS);
    for cell in [0, 2] {
        let frames =
            mock.calls.iter().filter(|(did, of)| matches!(did, Timed | Untimed) && *of == cell);
        assert_eq!(frames.collect::<Vec<_>>(), [&(Untimed, cell)]);
        assert_eq!(mock.samples(cell).pairs(), 0);
    }
    assert_eq!(mock.samples(1).pairs(), VISIT_PAIRS);
}

#[test]
fn samples_name_their_round_and_their_time_and_groups_share_no_round() {
    let sized = || MockCell { bytes: 600, ..STEADY };
    let mock = Mock::new(vec![STEADY, STEADY, sized(), sized()]);
    let mock = mock.run(&Settings { first_round: 40, ..SETTINGS });
    let rounds = |cell: usize| mock.samples(cell).each(|pair| pair.round);
    assert_eq!(rounds(0), (40..40 + VISIT_PAIRS as u32).collect::<Vec<_>>());
    assert_eq!(rounds(0), rounds(1));
    assert!(rounds(3).iter().all(|round| !rounds(0).contains(round)));
    let times = mock.samples(0).each(|pair| pair.sampled_at_s);
    assert!(times.is_sorted() && times[0] > 1.7e9 && times.len() == VISIT_PAIRS);
}

#[test]
fn warm_up_ends_when_frames_no_longer_get_faster() {
    let compiles = cell(|f, _| [9e7, 5e7, 2e7].get(f).copied().unwrap_or(1e7));
    let never_steady = cell(|f, _| 1e9 * 0.8f64.powi(f as i32));
    let mock = Mock::new(vec![STEADY, compiles, never_steady]).run(&SETTINGS);
    assert_eq!(mock.samples(0).warm_up_frames, 2);
    assert_eq!(mock.samples(1).warm_up_frames, 5);
    let taken = &mock.samples(1).pairs;
    assert!(taken.iter().all(|pair| pair.envelope_ns == 1e7), "no compiling frame is a sample");
    assert!(!mock.samples(1).unsteady);
    assert_eq!(mock.samples(2).warm_up_frames, MAX_WARM_UP_FRAMES);
    assert!(mock.samples(2).unsteady);
}

#[test]
fn drift_affects_all_cells_alike() {
    // The machine slows down by half over the run; the second cell does twice the first one's work.
    let one = cell(|_, now| 1e7 * (1.0 + now / 20.0));
    let two = cell(|_, now| 2e7 * (1.0 + now / 20.0));
    let mock = Mock::new(vec![one, two]).run(&SETTINGS);
    let n = mock.samples(0).pairs().min(mock.samples(1).pairs());
    let envelopes = |cell: usize| mock.samples(cell).each(|pair| pair.envelope_ns);
    let median = |cell: usize| statistics::median(&envelopes(cell)[..n]);
    let ratio = median(1) / median(0);
    assert!((ratio - 2.0).abs() < 0.02, "{ratio}");
}

#[test]
fn timed_and_untimed_frames_alternate_in_random_order() {
    let noisy = || cell(|f, _| 2e7 * noise(f, 0.9));
    let mock = Mock::new(vec![noisy(), noisy(), noisy()]).run_visits(12, &SETTINGS);
    // The second round of each visit: the first begins with warm-ups.
    let whole: Vec<&[Call]> = mock.calls.split(|(did, _)| *did == Release).collect();
    let whole = whole.iter().filter(|calls| calls.len() > 6);
    let frames: Vec<Call> = whole.flat_map(|calls| calls[calls.len() - 6..].to_vec()).collect();
    let visits: Vec<&[Call]> = frames.chunks_exact(2).collect();
    let timed_first = visits.iter().filter(|visit| visit[0].0 == Timed).count();
    let share = timed_first as f64 / visits.len() as f64;
    assert!((0.3..=0.7).contains(&share), "{share}");
    assert!(visits.iter().all(|visit| visit[0].0 != visit[1].0 && visit[0].1 == visit[1].1));
    let orders: BTreeSet<Vec<usize>> = visits
        .chunks_exact(3)
        .map(|round| round.iter().map(|visit| visit[0].1).collect())
        .collect();
    assert!(orders.len() > 3, "rounds are shuffled: {orders:?}");
}

/// In which orders is tested in `visit`.
#[test]
fn cells_that_a_claim_compares_are_visited_together_and_their_frames_alternate() {
    let noisy = || cell(|f, _| 2e7 * noise(f, 0.9));
    let cells = vec![noisy(), noisy(), noisy(), noisy()];
    let mock = Mock { compared: vec![3, 1], ..Mock::new(cells) }.run(&SETTINGS);
    let frames = mock.calls.iter().filter(|(did, _)| matches!(did, Timed | Untimed)).enumerate();
    let compared: Vec<_> = frames.filter(|(_, (_, cell))| [1, 3].contains(cell)).collect();
    // From the end: the first visits begin with warm-ups.
    for visit in compared.rchunks_exact(4).take(mock.samples(1).pairs() - 1) {
        assert_eq!(visit[3].0 - visit[0].0, 3, "nothing comes between");
        let [a, b, ..] = visit[..] else { panic!("four frames") };
        assert!(a.1.0 == b.1.0 && a.1.1 != b.1.1, "{visit:?}");
    }
    let rounds = |cell: usize| mock.samples(cell).each(|pair| pair.round);
    assert_eq!(rounds(1), rounds(3));
}

#[test]
fn a_device_that_is_lost_within_a_visit_leaves_no_frame_without_its_other() {
    for at in 3..6 {
        let loses = MockCell { loses_device_at: Some(at), ..STEADY };
        let noisy = || cell(|f, _| 1e7 * noise(f, 0.5));
        let cells = vec![noisy(), loses, noisy()];
        let mock = Mock { compared: vec![0, 1, 2], ..Mock::new(cells) }.run(&SETTINGS);
        assert_eq!(mock.reason(1), "device lost: gone");
        for cell in [0, 2] {
            let rounds = mock.samples(cell).each(|pair| pair.round);
            assert!(rounds.windows(2).all(|pair| pair[0] < pair[1]), "{rounds:?}");
            assert!(mock.samples(cell).warm_up_frames >= 3, "warmed up on both devices");
            let prepared = mock.calls.iter().filter(|call| **call == (Prepare, cell)).count();
            assert_eq!(prepared, 2, "the device is opened once more");
        }
    }
}

#[test]
fn the_seed_decides_the_order() {
    let calls = |seed| {
        let cells = (0..4).map(|_| cell(|f, _| 5e7 * noise(f, 0.5)));
        Mock::new(cells.collect()).run(&Settings { seed, ..SETTINGS }).calls
    };
    assert_eq!(calls(1), calls(1));
    assert_ne!(calls(1), calls(2));
}

#[test]
fn faulty_frames_are_counted_and_never_used() {
    let sometimes = MockCell { faulty: |f| f % 8 == 5, ..STEADY };
    let mock = Mock::new(vec![sometimes]).run(&SETTINGS);
    let samples = mock.samples(0);
    assert_eq!(samples.rejected.keys().collect::<Vec<_>>(), [&FaultKind::FrameNotPositive.into()]);
    assert!(samples.pairs.iter().all(|pair| pair.envelope_ns > 0.0));
}

#[test]
fn a_cell_with_too_many_faults_fails_with_the_reason() {
    let always = MockCell { faulty: |_| true, ..STEADY };
    let mock = Mock::new(vec![always, STEADY]).run(&SETTINGS);
    assert_eq!(mock.reason(0), "6 of 6 timed frames rejected: frame time not positive (6 times)");
    assert_eq!(mock.samples(1).pairs(), VISIT_PAIRS);
}

#[test]
fn a_cell_that_cannot_be_prepared_leaves_the_others_alone() {
    let refuses = MockCell { refuses: true, ..STEADY };
    let mock = Mock::new(vec![STEADY, refuses, STEADY]).run(&SETTINGS);
    assert_eq!(mock.reason(1), "out of GPU memory");
    assert!(mock.calls.contains(&(Release, 1)));
    assert_eq!(mock.results.len(), 3);
    assert!(!mock.calls.contains(&(Timed, 1)));
}

#[test]
fn groups_fit_into_memory_and_are_released() {
    let sized = |bytes| MockCell { bytes, ..STEADY };
    let mock = Mock::new([400, 400, 300, 5_000, 100].map(sized).into()).run(&SETTINGS);
    let (mut alive, mut max_alive) = (BTreeSet::new(), 0);
    let mut groups: Vec<usize> = Vec::new();
    for call in &mock.calls {
        match call {
            (Prepare, cell) => {
                if alive.is_empty() {
                    groups.push(0);
                }
                *groups.last_mut().expect("a group") += 1;
                alive.insert(*cell);
            }
            (Release, cell) => {
                alive.remove(cell);
            }
            _ => {}
        }
        max_alive = max_alive.max(alive.len());
    }
    assert!(alive.is_empty());
    assert_eq!((groups, max_alive), (vec![2, 2, 1], 2));
    assert_eq!(mock.results.len(), 5);
}

#[test]
fn a_device_that_is_lost_while_figures_are_read_is_opened_once_more() {
    let loses = MockCell { loses_device_at_finish: true, ..STEADY };
    let noisy = cell(|f, _| 1e7 * noise(f, 0.5));
    let mock = Mock::new(vec![loses, noisy]).run(&SETTINGS);
    assert_eq!(mock.reason(0), "device lost: gone");
    assert!(mock.recovered && mock.samples(1).pairs() >= VISIT_PAIRS);
    assert_eq!(mock.calls.iter().filter(|call| **call == (Prepare, 1)).count(), 2);
}

#[test]
fn an_interruption_keeps_what_is_done_and_drops_what_has_hardly_begun() {
    let alone = |time| MockCell { time, bytes: 900, ..STEADY };
    let cells = vec![alone(|_, _| 1e7), alone(|_, _| 1e9), alone(|_, _| 1e7)];
    // The slow cell warms up for two seconds, and a pair takes two more.
    let mock = Mock { interrupt_at_s: Some(3.0), ..Mock::new(cells) }.run(&SETTINGS);
    assert_eq!(mock.results.keys().copied().collect::<Vec<_>>(), [0]);
    assert!(mock.now_s < 5.0, "it ends after the pair that is under way: {}", mock.now_s);
    assert_eq!(mock.count(Prepare), 2);
    assert_eq!(mock.count(Release), 2);
}

#[test]
fn an_error_of_the_caller_ends_the_run() {
    let mut mock = Mock { disk_full: true, ..Mock::new(vec![STEADY]) };
    assert_eq!(mock.try_run(&SETTINGS), Err("disk full".to_owned()));
}

mod resumed;

//! The verdict on a run itself: whether the machine was quiet enough for the times that it gave. A function of records.

use std::collections::BTreeMap;

use itertools::Itertools;

use crate::shift::excludes_zero;
use fathom_base::statistics::{self, PairSlope};
use fathom_base::visits::{self, MIN_SPAN_S, MIN_VISITS, Scale, VISIT_S};
use fathom_record::{Estimate, FrameRecord, Run};

/// Scatter between visits beyond which a run is noisy: six visits then give ±5 %. It is that of two fixed kernels beside the frames. In records that tell no visits it is that of one frame's
/// time, which was 2.5 % on llvmpipe in the median cell of a quiet run, and 12 % on a machine that shares its host.
const SCATTER: f64 = 0.05;
/// Change of frame times over a run beyond which it drifts.
const DRIFT: f64 = 0.02;
/// Share of the machine's cores that others keep busy, beyond which a run is noisy: on two cores a process that works a fifth of
/// the time. Of a machine at rest its services take 1 to 3 %.
const OTHERS: f64 = 0.1;
/// Stolen time beyond which a run is noisy, in cores. If all of it is taken from the core that measures, times are longer by half
/// of the ±2 % that are asked.
const STEAL: f64 = 0.01;
/// Medians of spans of time are taken for independent, as visits are.
const SPAN_S: f64 = VISIT_S;
/// Spans at most, as pairs grow with the square of them.
const MAX_SPANS: f64 = 120.0;
/// A run without a sample for so long was interrupted and resumed. Changes over the pause are not drift.
const PAUSE_S: f64 = 300.0;

/// The noisiest last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum Noise {
    Quiet,
    /// Frame times became longer or shorter while the run went on.
    Drifting,
    /// Samples of a cell scatter, or others used the machine.
    Noisy,
}

/// What a run is judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    OtherProcesses,
    Steal,
    Scatter,
    Drift,
}

/// A figure of a run, and the bound beyond which it is noisy, or drifting.
#[derive(Clone, Copy, Debug)]
pub struct BoundedFigure {
    pub criterion: Criterion,
    pub value: f64,
    pub bound: f64,
}

/// What a run's records say of the machine while it measured.
#[derive(Clone, Debug)]
pub struct RunVerdict {
    pub noise: Noise,
    /// Timed cells.
    pub cells: usize,
    /// Those of them whose frame time has an interval.
    pub with_interval: usize,
    /// Of the median cell; infinite where it has too few visits for an interval.
    pub half_width: f64,
    /// Standard deviation of the logarithm of a visit's time: of the fixed kernels, where none were run of the median cell's frame.
    pub scatter: f64,
    /// From the first sample to the last, without pauses.
    pub seconds: f64,
    pub load: Option<MeanLoad>,
    pub drift: Option<Drift>,
}

/// Mean over the samples, in cores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanLoad {
    pub others: f64,
    pub steal: f64,
    /// That the machine has.
    pub cores: usize,
}

/// How frame times changed while the run measured.
#[derive(Clone, Copy, Debug)]
pub struct Drift {
    /// Change of a frame's time in a minute, as a share of it; its `n` counts spans of time.
    pub per_minute: Estimate,
    /// The longest time without a pause.
    pub minutes: f64,
}

impl Drift {
    /// The interval excludes zero, and the change over the run exceeds this share.
    fn exceeds(&self, share: f64) -> bool {
        self.per_minute.interval.is_some_and(excludes_zero) && self.change().abs() > share
    }

    /// Over the whole run.
    fn change(&self) -> f64 {
        (self.per_minute.median * self.minutes).exp_m1()
    }
}

impl RunVerdict {
    /// Of the frames of all timed cells; none where there are none.
    pub fn judge(run: &Run, frames: &[&FrameRecord]) -> Option<Self> {
        let widths = frames.iter().map(|frame| frame.untimed.relative_half_width()).collect_vec();
        let with_interval = widths.iter().filter(|width| width.is_finite()).count();
        let drift = drift(frames);
        let per_minute = drift.map_or(0.0, |drift| drift.per_minute.median);
        let scatters = frames.iter().filter_map(|frame| scatter(frame, per_minute));
        let of_cells = || statistics::median(&scatters.collect_vec());
        let scatter = pacer_scatter(frames).unwrap_or_else(of_cells);
        let machine = run.conditions.machine.as_ref();
        let cores = machine.and_then(|machine| machine.cores).unwrap_or(run.adapter.host_threads);
        let load = load(frames, cores);
        let (cells, half_width) = (frames.len(), statistics::median(&widths));
        let (noise, seconds) = (Noise::Quiet, sessions(frames).iter().map(|samples| lasts_s(samples)).sum());
        let mut verdict =
            Self { noise, cells, with_interval, half_width, scatter, seconds, load, drift };
        verdict.noise = match verdict.exceeded().next().map(|figure| figure.criterion) {
            None => Noise::Quiet,
            Some(Criterion::Drift) => Noise::Drifting,
            Some(_) => Noise::Noisy,
        };
        (cells > 0).then_some(verdict)
    }

    /// What it was judged by. A drift whose interval contains zero counts as zero.
    pub fn figures(&self) -> [BoundedFigure; 4] {
        let load = self.load.map(|load| [load.others / load.cores as f64, load.steal]);
        let [others, steal] = load.unwrap_or_default();
        let drift = self.drift.filter(|drift| drift.exceeds(0.0)).map_or(0.0, |d| d.change());
        [
            (Criterion::OtherProcesses, others, OTHERS),
            (Criterion::Steal, steal, STEAL),
            (Criterion::Scatter, self.scatter, SCATTER),
            (Criterion::Drift, drift, DRIFT),
        ]
        .map(|(criterion, value, bound)| BoundedFigure { criterion, value, bound })
    }

    /// The figures beyond their bounds.
    pub fn exceeded(&self) -> impl Iterator<Item = BoundedFigure> + use<> {
        self.figures().into_iter().filter(|figure| figure.value.abs() > figure.bound)
    }

    /// Half of the cells or more have an interval that settles something.
    pub fn has_intervals(&self) -> bool {
        2 * self.with_interval >= self.cells && !self.is_short()
    }

    /// It measured for too short a time: its intervals are of these seconds alone.
    pub fn is_short(&self) -> bool {
        self.seconds < MIN_SPAN_S
    }
}

/// Of the logarithms of visits; where these are not told by the quartiles of samples, which outliers hardly move. None below four.
fn scatter(frame: &FrameRecord, drift_per_minute: f64) -> Option<f64> {
    /// Between the quartiles of a normal distribution, in standard deviations.
    const QUARTILES: f64 = 1.349;
    let start_s = frame.sampled_at_s.first()?;
    let samples = frame.untimed_samples_ns.iter().zip(&frame.sampled_at_s);
    let log = |(ns, at_s): (&f64, &f64)| ns.ln() - drift_per_minute * (at_s - start_s) / 60.0;
    let logs = samples.map(log).collect_vec();
    if !frame.visits.is_empty() {
        let visits = visits::medians(&frame.visits, &logs, Scale::Sums);
        return (visits.len() >= MIN_VISITS).then(|| statistics::deviation(&visits));
    }
    let quartile = |share| statistics::quantile(&logs, share);
    (logs.len() >= 4).then(|| (quartile(0.75) - quartile(0.25)) / QUARTILES)
}

/// Of the fixed kernels between spans of time, the larger of both; none where they were not run or spans are too few.
fn pacer_scatter(frames: &[&FrameRecord]) -> Option<f64> {
    let readings = frames.iter().flat_map(|frame| frame.sampled_at_s.iter().zip(&frame.pacer_ns));
    let scatter = |kernel: usize| {
        let of = readings.clone().map(|(at_s, ns)| ((at_s / SPAN_S) as u64, ns[kernel].ln()));
        let spans = of.into_group_map().into_values().map(|logs| statistics::median(&logs));
        let spans = spans.collect_vec();
        (spans.len() >= MIN_VISITS).then(|| statistics::deviation(&spans))
    };
    Some(scatter(0)?.max(scatter(1)?))
}

fn load(frames: &[&FrameRecord], cores: usize) -> Option<MeanLoad> {
    let states = frames.iter().flat_map(|frame| &frame.machine);
    let loads = states.filter_map(|state| Some((state.others_load?, state.steal?))).collect_vec();
    let mean = |of: fn(&(f32, f32)) -> f32| statistics::mean(loads.iter().map(of).map(f64::from));
    (!loads.is_empty()).then(|| MeanLoad {
        others: mean(|load| load.0),
        steal: mean(|load| load.1),
        cores: cores.max(1),
    })
}

struct UntimedFrame {
    at_s: f64,
    /// Number of its cell.
    cell: usize,
    /// Logarithm of its time.
    log: f64,
}

/// A span of time, with the median of each cell's log times in it by the number of the cell.
struct TimeSpan {
    at_s: f64,
    cells: BTreeMap<usize, f64>,
}

/// The median slope between spans of time; none where they are too few for its interval. Between two spans it is that of the median of the cells that both have: only samples of
/// one cell are compared, so cells need not be measured at the same time.
fn drift(frames: &[&FrameRecord]) -> Option<Drift> {
    let sessions = sessions(frames);
    let longest_s = sessions.iter().map(|samples| lasts_s(samples)).fold(0.0, f64::max);
    let (mut pairs, mut first) = (Vec::new(), 0);
    for spans in sessions.iter().map(|samples| spans(samples)) {
        pairs.extend(slopes(&spans, first));
        first += spans.len();
    }
    let per_minute = statistics::slope_of_pairs(&pairs)?;
    per_minute.interval?;
    Some(Drift { per_minute, minutes: longest_s / 60.0 })
}

fn lasts_s(samples: &[UntimedFrame]) -> f64 {
    let ends = samples.first().zip(samples.last());
    ends.map_or(0.0, |(first, last)| last.at_s - first.at_s)
}

/// All samples in the order of time, divided at pauses.
fn sessions(frames: &[&FrameRecord]) -> Vec<Vec<UntimedFrame>> {
    let of_cell = |(cell, frame): (usize, &&FrameRecord)| {
        let samples = frame.sampled_at_s.iter().zip(&frame.untimed_samples_ns);
        samples.map(|(at_s, ns)| UntimedFrame { at_s: *at_s, cell, log: ns.ln() }).collect_vec()
    };
    let samples = frames.iter().enumerate().flat_map(of_cell);
    let samples = samples.filter(|sample| sample.log.is_finite());
    let mut sessions = Vec::<Vec<UntimedFrame>>::new();
    for sample in samples.sorted_by(|a, b| a.at_s.total_cmp(&b.at_s)) {
        let before = sessions.last_mut();
        let goes_on =
            |before: &Vec<UntimedFrame>| sample.at_s - before[before.len() - 1].at_s < PAUSE_S;
        match before.filter(|before| goes_on(before)) {
            Some(before) => before.push(sample),
            None => sessions.push(vec![sample]),
        }
    }
    sessions
}

fn spans(samples: &[UntimedFrame]) -> Vec<TimeSpan> {
    let [Some(first), Some(last)] = [samples.first(), samples.last()] else { return Vec::new() };
    let span_s = ((last.at_s - first.at_s) / MAX_SPANS).max(SPAN_S);
    let number = |sample: &&UntimedFrame| ((sample.at_s - first.at_s) / span_s) as usize;
    let mut spans = Vec::new();
    for (_, samples) in &samples.iter().chunk_by(number) {
        let samples = samples.collect_vec();
        let by_cell = samples.iter().map(|sample| (sample.cell, sample.log)).into_group_map();
        let cells = by_cell.into_iter().map(|(cell, logs)| (cell, statistics::median(&logs)));
        let at_s = statistics::median(&samples.iter().map(|sample| sample.at_s).collect_vec());
        spans.push(TimeSpan { at_s, cells: cells.collect() });
    }
    spans
}

/// Between all pairs of spans with a cell in common, per minute; `first` is the number of the first span.
fn slopes(spans: &[TimeSpan], first: usize) -> Vec<PairSlope> {
    let pairs = spans.iter().zip(first..).array_combinations();
    let slopes = pairs.filter_map(|[(a, earlier), (b, later)]| {
        let common = a.cells.iter().filter_map(|(cell, log)| Some(b.cells.get(cell)? - log));
        let changes = common.collect_vec();
        let minutes = (b.at_s - a.at_s) / 60.0;
        (!changes.is_empty()).then(|| PairSlope {
            earlier,
            later,
            slope: statistics::median(&changes) / minutes,
        })
    });
    slopes.collect()
}

#[cfg(test)]
mod tests;

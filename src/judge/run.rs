//! The verdict on a run itself: whether the machine was quiet enough for the times that it gave. A function of records.

use itertools::Itertools;

use fathom_base::statistics;
use fathom_base::visits::{self, MIN_SPAN_S, MIN_VISITS, Scale, VISIT_S};
use fathom_record::{FrameRecord, Run};

/// Scatter between visits beyond which a run is noisy: six visits then give ±5 %. It is that of two fixed kernels beside the frames. In records that tell no visits it is that of one frame's
/// time, which was 2.5 % on llvmpipe in the median cell of a quiet run, and 12 % on a machine that shares its host.
const SCATTER: f64 = 0.05;
/// Share of the machine's cores that others keep busy, beyond which a run is noisy: on two cores a process that works a fifth of
/// the time. Of a machine at rest its services take 1 to 3 %.
const OTHERS: f64 = 0.1;
/// Stolen time beyond which a run is noisy, in cores. If all of it is taken from the core that measures, times are longer by half
/// of the ±2 % that are asked.
const STEAL: f64 = 0.01;
/// A run without a sample for so long was interrupted and resumed.
const PAUSE_S: f64 = 300.0;

/// The noisiest last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum Noise {
    Quiet,
    /// Samples of a cell scatter, or others used the machine.
    Noisy,
}

/// What a run is judged by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    OtherProcesses,
    Steal,
    Scatter,
}

/// A figure of a run, and the bound beyond which it is noisy.
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
}

/// Mean over the samples, in cores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanLoad {
    pub others: f64,
    pub steal: f64,
    /// That the machine has.
    pub cores: usize,
}

impl RunVerdict {
    /// Of the frames of all timed cells; none where there are none.
    pub fn judge(run: &Run, frames: &[&FrameRecord]) -> Option<Self> {
        let widths = frames.iter().map(|frame| frame.untimed.relative_half_width()).collect_vec();
        let with_interval = widths.iter().filter(|width| width.is_finite()).count();
        let scatters = frames.iter().filter_map(|frame| scatter(frame));
        let of_cells = || statistics::median(&scatters.collect_vec());
        let scatter = pacer_scatter(frames).unwrap_or_else(of_cells);
        let machine = run.conditions.machine.as_ref();
        let cores = machine.and_then(|machine| machine.cores).unwrap_or(run.adapter.host_threads);
        let load = load(frames, cores);
        let (cells, half_width) = (frames.len(), statistics::median(&widths));
        let (noise, seconds) = (Noise::Quiet, seconds(frames));
        let mut verdict = Self { noise, cells, with_interval, half_width, scatter, seconds, load };
        if verdict.exceeded().next().is_some() {
            verdict.noise = Noise::Noisy;
        }
        (cells > 0).then_some(verdict)
    }

    /// What it was judged by.
    pub fn figures(&self) -> [BoundedFigure; 3] {
        let load = self.load.map(|load| [load.others / load.cores as f64, load.steal]);
        let [others, steal] = load.unwrap_or_default();
        [
            (Criterion::OtherProcesses, others, OTHERS),
            (Criterion::Steal, steal, STEAL),
            (Criterion::Scatter, self.scatter, SCATTER),
        ]
        .map(|(criterion, value, bound)| BoundedFigure { criterion, value, bound })
    }

    /// The figures beyond their bounds.
    pub fn exceeded(&self) -> impl Iterator<Item = BoundedFigure> + use<> {
        self.figures().into_iter().filter(|figure| figure.value > figure.bound)
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
fn scatter(frame: &FrameRecord) -> Option<f64> {
    /// Between the quartiles of a normal distribution, in standard deviations.
    const QUARTILES: f64 = 1.349;
    let logs = frame.untimed_samples_ns.iter().map(|ns| ns.ln()).collect_vec();
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
        let of = readings.clone().map(|(at_s, ns)| ((at_s / VISIT_S) as u64, ns[kernel].ln()));
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

/// From the first sample to the last, without pauses.
fn seconds(frames: &[&FrameRecord]) -> f64 {
    let all = frames.iter().flat_map(|frame| &frame.sampled_at_s).copied();
    let steps = all.sorted_by(f64::total_cmp).tuple_windows().map(|(before, at_s)| at_s - before);
    steps.filter(|step_s| *step_s < PAUSE_S).sum()
}

#[cfg(test)]
mod tests;

//! From samples to the figures of a record.

use std::collections::BTreeMap;

use super::samples::{Samples, StageSamples, Stopped};
use fathom_base::statistics;
use fathom_record::{Estimate, Fenced, FrameRecord, Note, NoteKind, StageRecord, Throttling, Work};

/// Share of outliers among the frame times from which on the record says so: one in twenty.
const NOTED_OUTLIER_SHARE: f64 = 0.05;

/// Of whole frames.
pub fn frame_record(samples: &Samples) -> FrameRecord {
    if samples.pairs() == 0 {
        return FrameRecord::default();
    }
    FrameRecord {
        rounds: samples.rounds.clone(),
        sampled_at_s: samples.sampled_at_s.clone(),
        machine: samples.machine.clone(),
        accounting_error: accounting_error(samples),
        untimed: statistics::estimate(&samples.untimed_ns),
        timing_cost: timing_cost(samples),
        envelope_samples_ns: samples.envelope_ns.clone(),
        gap_samples_ns: samples.gaps_ns.clone(),
        untimed_samples_ns: samples.untimed_ns.clone(),
    }
}

/// Timed over untimed frames, pair by pair.
fn timing_cost(samples: &Samples) -> Estimate {
    let pairs = samples.envelope_ns.iter().copied().zip(samples.untimed_ns.iter().copied());
    statistics::ratio_estimate(&pairs.collect::<Vec<_>>())
}

/// Median over the frames of |stages + gaps − envelope| / envelope.
pub fn accounting_error(samples: &Samples) -> f64 {
    let frames = samples.envelope_ns.iter().zip(&samples.gaps_ns).enumerate();
    let errors: Vec<f64> = frames
        .map(|(frame, (envelope, gaps))| {
            let stages: f64 = samples.stages.iter().map(|stage| stage.ns[frame]).sum();
            (stages + gaps - envelope).abs() / envelope
        })
        .collect();
    statistics::median(&errors)
}

/// Of one stage, which declares this work and at least that.
pub fn stage_record(
    stage: &StageSamples,
    (work, least): (Work, Work),
    counters: BTreeMap<String, u64>,
) -> StageRecord {
    let fenced = fenced(stage);
    let samples_ns = match &fenced {
        Some(fenced) => fenced.samples_ns(),
        None => stage.ns.clone(),
    };
    StageRecord {
        stage: stage.name.as_str().into(),
        clock: stage.clock,
        time: statistics::estimate(&samples_ns),
        samples_ns,
        fenced,
        work,
        least_work: (least != work).then_some(least),
        counters: counters.into(),
        ceiling: None,
    }
}

/// What was read and taken off; none where nothing was.
fn fenced(stage: &StageSamples) -> Option<Fenced> {
    let taken_off = stage.submit_cost_ns.iter().any(|ns| *ns > 0.0);
    let pairs = stage.ns.iter().zip(&stage.submit_cost_ns);
    taken_off.then(|| Fenced {
        wall_samples_ns: pairs.map(|(ns, cost_ns)| ns + cost_ns).collect(),
        submit_cost_samples_ns: stage.submit_cost_ns.clone(),
        resolution_ns: statistics::median(&stage.resolution_ns),
    })
}

/// What there is to know of the samples. `precision` is the one asked for, of the frame time, a share.
pub fn sampling_notes(samples: &Samples, frame: &Estimate, precision: f64) -> Vec<Note> {
    let mut notes = Vec::new();
    let mut note = |kind, text: String| notes.push(Note::new(kind, text));
    if samples.earlier_pairs > 0 {
        let (earlier, all) = (samples.earlier_pairs, samples.pairs());
        let text =
            format!("{earlier} of {all} pairs of frames were measured before the run was resumed");
        note(NoteKind::Resumed, text);
    }
    if samples.unsteady {
        let frames = samples.warm_up_frames;
        let text = format!("the frame time still fell after {frames} warm-up frames");
        note(NoteKind::Unsteady, text);
    }
    let stopped = match samples.stopped {
        Stopped::Precise | Stopped::UntimedOnly => None,
        Stopped::OutOfTime => Some("stopped by the time budget"),
        Stopped::EnoughPairs => Some("stopped at the most frames"),
        Stopped::Interrupted => Some("interrupted"),
    };
    if let Some(stopped) = stopped.filter(|_| frame.relative_half_width() > precision) {
        let reached = 100.0 * frame.relative_half_width();
        let asked = 100.0 * precision;
        let text = format!("{stopped} at ±{reached:.1} % where ±{asked:.1} % was asked");
        note(NoteKind::Imprecise, text);
    }
    let outliers = statistics::outliers(&samples.untimed_ns);
    if outliers.share() > NOTED_OUTLIER_SHARE {
        let text = format!(
            "{} of {} frames were far slower and {} far faster than the median",
            outliers.slow, outliers.n, outliers.fast
        );
        note(NoteKind::Outliers, text);
    }
    if let Some(held) = Throttling::of(&samples.machine) {
        note(NoteKind::Throttled, format!("heat or power held the clocks down in {held}"));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_record::{MachineState, ThrottleReason};

    #[test]
    fn a_throttled_cell_has_a_note_with_share_and_reasons() {
        let state = |reason| MachineState { throttle: vec![reason], ..MachineState::default() };
        let texts = |machine: Vec<MachineState>| {
            let samples = Samples { machine, ..Samples::default() };
            let notes = sampling_notes(&samples, &statistics::estimate(&[1.0; 20]), 0.02);
            let held = notes.into_iter().filter(|note| note.kind == NoteKind::Throttled);
            held.map(|note| note.text).collect::<Vec<_>>()
        };
        let (idle, hot) = (ThrottleReason::GpuIdle, ThrottleReason::HwThermalSlowdown);
        let expected = "heat or power held the clocks down in 1 of 2 samples (thermal slowdown by the hardware)";
        assert_eq!(texts(vec![state(idle.clone()), state(hot)]), [expected]);
        assert_eq!(texts(vec![state(idle)]), Vec::<String>::new());
    }
}

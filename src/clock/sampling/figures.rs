//! From samples to the figures of a record.

use super::samples::Samples;
use crate::StageTime;
use fathom_base::statistics;
use fathom_base::visits;
use fathom_record::{Clock, Fenced, FrameRecord, Note, NoteKind, StageRecord, Throttling};

/// Share of outliers among the frame times from which on the record says so: one in twenty.
const NOTED_OUTLIER_SHARE: f64 = 0.05;

/// Of whole frames.
pub fn frame_record(samples: &Samples) -> FrameRecord {
    if samples.pairs() == 0 {
        return FrameRecord::default();
    }
    let untimed_samples_ns = samples.each(|pair| pair.frame_ns);
    let visits = samples.visits();
    let costs = samples.each(|pair| pair.envelope_ns / pair.frame_ns);
    FrameRecord {
        rounds: samples.each(|pair| pair.round),
        sampled_at_s: samples.each(|pair| pair.sampled_at_s),
        machine: samples.machine(),
        pacer_ns: samples.pairs.iter().filter_map(|pair| pair.pacer_ns).collect(),
        accounting_error: accounting_error(samples),
        untimed: visits::estimate_of_samples(&untimed_samples_ns, &visits),
        timing_cost: visits::estimate_of_samples(&costs, &visits),
        visits,
        envelope_samples_ns: samples.each(|pair| pair.envelope_ns),
        gap_samples_ns: samples.each(|pair| pair.gaps_ns),
        untimed_samples_ns,
    }
}

/// Median over the frames of |stages + gaps − envelope| / envelope.
pub fn accounting_error(samples: &Samples) -> f64 {
    let errors = samples.each(|pair| {
        let stages: f64 = pair.stages.iter().map(|stage| stage.ns).sum();
        (stages + pair.gaps_ns - pair.envelope_ns).abs() / pair.envelope_ns
    });
    statistics::median(&errors)
}

/// The times of the stage of this name, whose index is this among the stages of each frame.
pub fn stage_record(samples: &Samples, index: usize, name: &str) -> StageRecord {
    let times = samples.each(|pair| pair.stages[index].clone());
    let fenced = fenced(&times);
    let samples_ns = match &fenced {
        Some(fenced) => fenced.samples_ns(),
        None => times.iter().map(|time| time.ns).collect(),
    };
    let clock = times.first().map_or(Clock::Host, |time| time.clock);
    StageRecord { fenced, ..StageRecord::new(name, clock, samples_ns, &samples.visits()) }
}

/// What was read and taken off; none where nothing was.
fn fenced(times: &[StageTime]) -> Option<Fenced> {
    let of = |figure: fn(&StageTime) -> f64| times.iter().map(figure).collect::<Vec<_>>();
    let submit_cost_samples_ns = of(|time| time.submit_cost_ns);
    submit_cost_samples_ns.iter().any(|ns| *ns > 0.0).then(|| Fenced {
        wall_samples_ns: of(|time| time.ns + time.submit_cost_ns),
        submit_cost_samples_ns,
        resolution_ns: statistics::median(&of(|time| time.resolution_ns)),
    })
}

/// What there is to know of the samples.
pub fn sampling_notes(samples: &Samples) -> Vec<Note> {
    let mut notes = Vec::new();
    let mut note = |kind, text: String| notes.push(Note::new(kind, text));
    if samples.earlier_pairs > 0 {
        let (earlier, all) = (samples.earlier_pairs, samples.pairs());
        let text =
            format!("the run was extended: {earlier} of {all} pairs of frames are of before");
        note(NoteKind::Resumed, text);
    }
    if samples.unsteady {
        let frames = samples.warm_up_frames;
        let text = format!("the frame time still fell after {frames} warm-up frames");
        note(NoteKind::Unsteady, text);
    }
    let outliers = statistics::outliers(&samples.each(|pair| pair.frame_ns));
    if outliers.share() > NOTED_OUTLIER_SHARE {
        let text = format!(
            "{} of {} frames were far slower and {} far faster than the median",
            outliers.slow, outliers.n, outliers.fast
        );
        note(NoteKind::Outliers, text);
    }
    if let Some(held) = Throttling::from_states(&samples.machine()) {
        note(NoteKind::Throttled, format!("heat or power held the clocks down in {held}"));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FramePair;
    use fathom_record::{MachineState, Measured, ThrottleReason};

    /// A resumed run goes on with what a record holds.
    #[test]
    fn samples_are_read_from_a_record_as_they_were() {
        let stage = |name: &str, clock, number: f64, cost_ns| StageTime {
            clock,
            ns: 1e6 * number,
            submit_cost_ns: cost_ns,
            resolution_ns: cost_ns / 2.0,
            ..StageTime::zero(name)
        };
        for has_machine in [true, false] {
            let pair = |number: u32| FramePair {
                round: 3 * number,
                sampled_at_s: f64::from(number),
                machine: has_machine.then(MachineState::default),
                pacer_ns: has_machine.then_some([1e6, f64::from(number)]),
                stages: vec![
                    stage("a", Clock::Timestamp, f64::from(number), 0.0),
                    stage("b", Clock::FencedHost, f64::from(number) - 4.0, 64.0),
                ],
                envelope_ns: 5e6 * f64::from(number),
                gaps_ns: 7.0,
                frame_ns: 4e6 * f64::from(number),
            };
            let samples = Samples {
                pairs: (1..9).map(pair).collect(),
                warm_up_frames: 3,
                unsteady: true,
                rejected: [(fathom_record::FaultKind::Zero.into(), 2)].into(),
                earlier_pairs: 8,
            };
            let frame = frame_record(&samples);
            let stage = |(index, name)| stage_record(&samples, index, name);
            let mut measured = Measured {
                stages: ["a", "b"].into_iter().enumerate().map(stage).collect(),
                notes: sampling_notes(&samples),
                frame,
                warm_up_frames: samples.warm_up_frames,
                rejected: samples.rejected_frames(),
                ..Measured::default()
            };
            assert_eq!(Samples::recorded(&measured), samples);
            // Anyone may have written it: what lacks a figure is no sample.
            measured.stages[1].fenced.as_mut().unwrap().wall_samples_ns.truncate(5);
            assert_eq!(Samples::recorded(&measured).pairs, samples.pairs[..5]);
        }
    }

    #[test]
    fn a_throttled_cell_has_a_note_with_share_and_reasons() {
        let state = |reason| MachineState { throttle: vec![reason], ..MachineState::default() };
        let texts = |machine: Vec<MachineState>| {
            let pair = |state| FramePair { machine: Some(state), ..FramePair::default() };
            let pairs = machine.into_iter().map(pair).collect();
            let samples = Samples { pairs, ..Samples::default() };
            let notes = sampling_notes(&samples);
            let held = notes.into_iter().filter(|note| note.kind == NoteKind::Throttled);
            held.map(|note| note.text).collect::<Vec<_>>()
        };
        let (idle, hot) = (ThrottleReason::GpuIdle, ThrottleReason::HwThermalSlowdown);
        let expected = "heat or power held the clocks down in 1 of 2 samples (hw thermal slowdown)";
        assert_eq!(texts(vec![state(idle.clone()), state(hot)]), [expected]);
        assert_eq!(texts(vec![state(idle)]), Vec::<String>::new());
    }
}

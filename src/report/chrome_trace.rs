//! One frame in the Trace Event Format of Chrome, in its JSON object form; Perfetto and `chrome://tracing` open it.
//! <https://docs.google.com/document/d/1CvAClvFfyA5R-PhYUmn5OOQtYMH4h6I0nSsKchNAySU>
//!
//! Durations are as measured. Places are not measured: each stage stands where the one before it in frame order ends, and all
//! gaps stand together at the frame's end. Places and durations are whole nanoseconds, so that neighbours meet and nothing
//! overlaps.

use serde_json::{Map, Value, json};

use super::timed::cell_name;
use super::{ChosenFrame, Exporter, OfRun, RunExporter, Written};
use fathom_base::statistics::median;
use fathom_record::{Clock, PassKind, StageRecord};

pub const EXPORTER: RunExporter = Exporter {
    name: "chrome-trace",
    about: "one frame of a cell for Perfetto and chrome://tracing; --cell and --frame choose it",
    file: "trace.json",
    written: Written::OnRequest,
    export: OfRun::Frame(export),
};

const PROCESS: u32 = 1;
const NS_PER_US: f64 = 1e3;
const LAYOUT: &str = "Durations are measured. Places are not: stages stand one after the other in frame order, all gaps at the end.";

/// A row of the trace; its number is the thread's.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Track {
    Frame = 1,
    Host = 2,
    Gpu = 3,
}

impl Track {
    const ALL: [Self; 3] = [Self::Frame, Self::Host, Self::Gpu];

    fn of(stage: &StageRecord) -> Self {
        if stage.clock == Clock::Host { Self::Host } else { Self::Gpu }
    }

    /// For people.
    fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Host => "host stages",
            Self::Gpu => "GPU stages",
        }
    }

    /// Something on this row that took time.
    fn event(self, name: &str, cat: &str, begin: u64, end: u64, args: Value) -> Value {
        let us = |ns: u64| ns as f64 / NS_PER_US;
        let (ts, dur) = (us(begin), us(end - begin));
        json!({ "ph": "X", "name": name, "cat": cat, "pid": PROCESS, "tid": self as u32, "ts": ts, "dur": dur, "args": args })
    }
}

fn export(frame: &ChosenFrame<'_>) -> String {
    let mut events = vec![metadata("process_name", 0, json!({ "name": process(frame) }))];
    for track in Track::ALL {
        let tid = track as u32;
        events.push(metadata("thread_name", tid, json!({ "name": track.name() })));
        events.push(metadata("thread_sort_index", tid, json!({ "sort_index": tid })));
    }
    events.extend(envelope(frame));
    events.extend(stages(frame));
    let (unit, other) = ("ms", other_data(frame));
    format!("{:#}\n", json!({ "traceEvents": events, "displayTimeUnit": unit, "otherData": other }))
}

fn metadata(name: &str, tid: u32, args: Value) -> Value {
    json!({ "ph": "M", "name": name, "pid": PROCESS, "tid": tid, "args": args })
}

fn process(frame: &ChosenFrame<'_>) -> String {
    let adapter = frame.entry.run.map_or_else(String::new, |run| run.adapter.title());
    format!("{} · {adapter}", cell_name(frame.entry.cell))
}

/// The whole frame, and within it, at its end, the gaps. Gaps that are none or no part of the frame are in its arguments only.
fn envelope(frame: &ChosenFrame<'_>) -> Vec<Value> {
    let (whole, gaps) = (frame.envelope_ns(), frame.gaps_ns());
    let end = whole_ns(whole);
    let args = json!({ "envelope_ns": whole, "gaps_ns": gaps, "stages_ns": stages_ns(frame) });
    let mut events = vec![Track::Frame.event("frame", "frame", 0, end, args)];
    if 0.0 < gaps && gaps <= whole {
        let begin = whole_ns(whole - gaps);
        let args = json!({ "ns": gaps, "share": gaps / whole });
        events.push(Track::Frame.event("gaps", "gap", begin, end, args));
    }
    events
}

fn stages(frame: &ChosenFrame<'_>) -> Vec<Value> {
    let mut begin_ns = 0.0;
    let place = |stage: &StageRecord| {
        let end_ns = begin_ns + frame.stage_ns(stage).max(0.0);
        let (begin, end) = (whole_ns(begin_ns), whole_ns(end_ns));
        begin_ns = end_ns;
        Track::of(stage).event(&stage.stage, "stage", begin, end, stage_args(frame, stage))
    };
    frame.measured.stages.iter().map(place).collect()
}

/// What a click on a stage shows.
fn stage_args(frame: &ChosenFrame<'_>, stage: &StageRecord) -> Value {
    let work = stage.work.fields().into_iter().filter(|(_, count)| *count > 0);
    let work: Map<String, Value> = work.map(|(name, n)| (name.to_owned(), n.into())).collect();
    json!({
        "clock": stage.clock.name(),
        "ns": frame.stage_ns(stage),
        "share": frame.stage_ns(stage) / frame.envelope_ns(),
        "median_ns": stage.time.median,
        "resolution_ns": stage.resolution_ns(),
        "work": work,
        "counters": stage.counters,
    })
}

fn stages_ns(frame: &ChosenFrame<'_>) -> f64 {
    frame.measured.stages.iter().map(|stage| frame.stage_ns(stage)).sum()
}

fn whole_ns(ns: f64) -> u64 {
    ns.max(0.0).round() as u64
}

/// What the trace is of.
fn other_data(frame: &ChosenFrame<'_>) -> Value {
    let cell = frame.entry.cell;
    let mut data = json!({
        "experiment": cell.experiment,
        "cell": cell.cell,
        "pipeline": cell.pipeline,
        "scene": cell.scene,
        "frame": frame.index,
        "frames": frame.frames,
        "envelope_median_ns": median(&frame.measured.frame.envelope_samples_ns),
        "layout": LAYOUT,
    });
    if let Some(run) = frame.entry.run {
        let clock = |(pass, clock): (&PassKind, &Clock)| (pass.to_string(), clock.name());
        data["adapter"] = json!(run.adapter.title());
        data["driver"] = json!(format!("{} {}", run.adapter.driver, run.adapter.driver_info));
        data["software"] = json!(run.adapter.software);
        data["clocks"] = run.clocks.iter().map(clock).collect();
        data["profile"] = json!(run.profile);
        data["started_at"] = json!(run.started_at);
        data["fathom_version"] = json!(run.fathom_version);
    }
    data
}

#[cfg(test)]
mod tests;

use super::*;
use crate::{FrameChoice, ReportView};
use fathom_experiments::fixtures;
use fathom_record::{Measured, Record};

/// What the format documents.
fn schema() -> Value {
    let named = json!({ "required": ["name"], "properties": { "name": { "type": "string" } } });
    let ordered = json!({ "required": ["sort_index"], "properties": { "sort_index": { "type": "integer" } } });
    let time = json!({ "type": "number", "minimum": 0 });
    let complete = json!({
        "required": ["ts", "dur", "cat"],
        "properties": { "ph": { "const": "X" }, "ts": time, "dur": time, "cat": { "type": "string" } },
    });
    let metadata = |name: &str, args: &Value| json!({ "required": ["args"], "properties": { "ph": { "const": "M" }, "name": { "const": name }, "args": args } });
    let kinds = [
        complete,
        metadata("process_name", &named),
        metadata("thread_name", &named),
        metadata("thread_sort_index", &ordered),
    ];
    let id = json!({ "type": "integer", "minimum": 0 });
    let event = json!({
        "required": ["name", "ph", "pid", "tid"],
        "properties": { "name": { "type": "string" }, "pid": id, "tid": id, "args": { "type": "object" } },
        "oneOf": kinds,
    });
    json!({
        "required": ["traceEvents", "displayTimeUnit"],
        "properties": {
            "traceEvents": { "type": "array", "items": event },
            "displayTimeUnit": { "enum": ["ms", "ns"] },
        },
    })
}

/// What is wrong where a trace does not keep to the format.
fn check(trace: &Value) -> Result<(), String> {
    let schema = jsonschema::draft7::new(&schema()).unwrap();
    schema.validate(trace).map_err(|error| error.to_string())?;
    let events = trace["traceEvents"].as_array().unwrap();
    let complete = || events.iter().filter(|event| event["ph"] == "X");
    for event in complete() {
        let named = |other: &&Value| other["name"] == "thread_name" && other["tid"] == event["tid"];
        events.iter().find(named).ok_or_else(|| format!("a track without a name: {event}"))?;
    }
    complete().try_for_each(|a| complete().try_for_each(|b| check_nesting(a, b)))
}

/// On one track an event lies within another or beside it.
fn check_nesting(a: &Value, b: &Value) -> Result<(), String> {
    let span = |event: &Value| {
        let ns = |field: &str| (event[field].as_f64().unwrap() * NS_PER_US).round() as u64;
        (ns("ts"), ns("ts") + ns("dur"))
    };
    let ((a_begin, a_end), (b_begin, b_end)) = (span(a), span(b));
    let crossed = a_begin < b_begin && b_begin < a_end && a_end < b_end;
    if a["tid"] == b["tid"] && crossed { Err(format!("{a} and {b} overlap")) } else { Ok(()) }
}

/// A run whose frames add up: the envelope is the sum of stages and gaps.
fn records() -> Vec<Record> {
    let mut records = fixtures::run();
    for record in &mut records {
        let Record::Cell(cell) = record else { continue };
        let Some(Measured { stages, frame, .. }) = cell.measured_mut() else { continue };
        stages[0].clock = Clock::Host;
        for (index, envelope_ns) in frame.envelope_samples_ns.iter_mut().enumerate() {
            let sum: f64 = stages.iter().map(|stage| stage.samples_ns[index]).sum();
            *envelope_ns = sum + frame.gap_samples_ns[index];
        }
    }
    records
}

fn trace(records: &[Record], choice: &FrameChoice) -> Value {
    let view = ReportView::new(records, None);
    serde_json::from_str(&export(&view.frame(choice).unwrap())).unwrap()
}

fn of_cell(cell: &str) -> FrameChoice {
    FrameChoice { cell: Some(cell.to_owned()), frame: None }
}

#[test]
fn traces_keep_to_the_documented_format() {
    let records = records();
    let view = ReportView::new(&records, None);
    for (cell, _) in view.timed().step_by(7) {
        check(&trace(&records, &of_cell(&cell_name(cell)))).unwrap();
    }
    // Frames that do not add up: gaps within an envelope that has nothing to do with the stages.
    check(&trace(&fixtures::run(), &FrameChoice::default())).unwrap();
}

#[test]
fn the_check_of_the_format_refuses_damaged_traces() {
    let sound = trace(&records(), &of_cell("uw-default"));
    let stage = sound["traceEvents"].as_array().unwrap().iter().rposition(|e| e["ph"] == "X");
    let place = |field: &str| format!("/traceEvents/{}/{field}", stage.unwrap());
    let early = sound.pointer(&place("ts")).unwrap().as_f64().unwrap() - 1.0;
    let damages = [
        ("/displayTimeUnit", json!("s")),
        ("/traceEvents", json!({})),
        (&place("ph"), json!("Y")),
        (&place("ts"), json!("0")),
        (&place("ts"), json!(early)),
        (&place("dur"), json!(-1.0)),
        (&place("dur"), Value::Null),
        (&place("pid"), json!("one")),
        (&place("tid"), json!(9)),
        (&place("name"), Value::Null),
        ("/traceEvents/0/args", json!({ "name": 3 })),
        ("/traceEvents/0/name", json!("nickname")),
    ];
    for (pointer, value) in damages {
        let mut damaged = sound.clone();
        *damaged.pointer_mut(pointer).unwrap() = value.clone();
        assert!(check(&damaged).is_err(), "{pointer} = {value}");
    }
}

#[test]
fn stages_and_gaps_fill_the_frame() {
    let trace = trace(&records(), &of_cell("uw-default"));
    let events = trace["traceEvents"].as_array().unwrap();
    let us = |event: &Value, field: &str| event[field].as_f64().unwrap();
    let of = |category: &str| {
        let category = category.to_owned();
        events.iter().filter(move |event| event["cat"] == category.as_str())
    };
    let [frame, gaps] = ["frame", "gap"].map(|category| of(category).next().unwrap());
    let stages: f64 = of("stage").map(|stage| us(stage, "dur")).sum();
    // Rounding to whole nanoseconds.
    assert!((stages + us(gaps, "dur") - us(frame, "dur")).abs() < 2e-3);
    let last = of("stage").next_back().unwrap();
    assert!((us(last, "ts") + us(last, "dur") - us(gaps, "ts")).abs() < 2e-3);
    let shares: f64 = of("stage").chain([gaps]).map(|e| e["args"]["share"].as_f64().unwrap()).sum();
    assert!((shares - 1.0).abs() < 1e-9, "{shares}");
    let tracks = of("stage").map(|stage| stage["tid"].as_u64().unwrap()).collect::<Vec<_>>();
    assert_eq!(tracks[0], Track::Host as u64);
    assert!(tracks[1..].iter().all(|track| *track == Track::Gpu as u64));
}

#[test]
fn the_trace_says_what_it_is_of() {
    let records = records();
    let view = ReportView::new(&records, None);
    let frame = view.frame(&of_cell("uw-default")).unwrap();
    let data = &trace(&records, &of_cell("uw-default"))["otherData"];
    assert_eq!(data["experiment"], "uw-default");
    assert_eq!(data["frame"], frame.index);
    assert_eq!(data["adapter"], "llvmpipe (LLVM 15.0.6, 256 bits)");
    assert_eq!(data["clocks"]["compute"], "fenced host");
    let median_ns = median(&frame.measured.frame.envelope_samples_ns);
    assert_eq!(data["envelope_median_ns"], json!(median_ns));
}

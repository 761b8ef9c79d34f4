use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use itertools::Itertools;
use jsonschema::Validator;
use serde::Deserialize;
use serde_json::{Value, json};

use fathom_experiments::fixtures;
use fathom_record::comparison::{
    CellId, Compared, ComparedBuild, ComparisonEnd, ComparisonHeader, Fault, Gate, Launch, Side,
    SideEnvironment, Skip,
};
use fathom_record::protocol::{Reply, WorkerRequest};
use fathom_record::schema::*;
use fathom_record::{
    Adapter, Addition, Clock, ClockPlan, ErrorFigure, ErrorSpan, FaultKind, Fenced, FramePair,
    MachineState, Note, NoteKind, PassKind, Picture, PictureKind, PictureScale, Profile, Record,
    RejectedFrames, SAMPLES_SCHEMA, SampleLine, StageTime, SubmitCost,
};

fn validator(kind: LineKind) -> Validator {
    jsonschema::draft202012::new(&kind.schema()).unwrap()
}

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

const KINDS: [LineKind; 3] = [LineKind::Record, LineKind::Sample, LineKind::Worker];

fn committed(kind: LineKind) -> PathBuf {
    let name = match kind {
        LineKind::Record => "record",
        LineKind::Sample => "sample",
        LineKind::Worker => "worker-protocol",
    };
    root().join(format!("docs/{name}.schema.json"))
}

/// `FATHOM_BLESS=1` writes them.
#[test]
fn the_committed_schemas_are_those_of_the_types() {
    for kind in KINDS {
        let made = kind.text();
        if std::env::var_os("FATHOM_BLESS").is_some() {
            std::fs::write(committed(kind), &made).unwrap();
        }
        let found = std::fs::read_to_string(committed(kind)).unwrap();
        assert!(found == made, "{}: write it again", committed(kind).display());
        assert_eq!(kind.schema()["$schema"], "https://json-schema.org/draft/2020-12/schema");
        jsonschema::draft202012::meta::validate(&kind.schema()).unwrap();
    }
}

/// Every property says what it is, or its type does.
#[test]
fn every_field_is_described_for_readers_without_the_code() {
    fn undescribed(path: &str, schema: &Value, root: &Value, found: &mut Vec<String>) {
        let Some(members) = schema.as_object() else { return };
        for (name, property) in schema["properties"].as_object().into_iter().flatten() {
            let of_type = property["$ref"].as_str().and_then(|r| root.pointer(&r[1..]));
            let described = [Some(property), of_type].into_iter().flatten();
            let tag = property.get("const").is_some();
            if !tag && described.clone().all(|s| s.get("description").is_none()) {
                found.push(format!("{path}/{name}"));
            }
        }
        for (name, inner) in members {
            let of_lists = inner.as_array().into_iter().flatten();
            for schema in of_lists.chain([inner]) {
                undescribed(&format!("{path}/{name}"), schema, root, found);
            }
        }
    }
    for kind in KINDS {
        let schema = kind.schema();
        let mut found = Vec::new();
        undescribed("", &schema, &schema, &mut found);
        assert_eq!(found, Vec::<String>::new());
        assert!(!schema.to_string().contains("[`"), "a link means nothing outside the code");
    }
}

/// One record of each kind, with every optional part.
fn full() -> Vec<Value> {
    let mut records = fixtures::run();
    for record in &mut records {
        let Record::Cell(cell) = record else { continue };
        let Some(measured) = cell.measured_mut() else { continue };
        measured.errors = vec![ErrorFigure::new("error", 0.5, "%", "compose").after("before")];
        measured.rejected.push(RejectedFrames { rejection: FaultKind::Stale.into(), frames: 2 });
        measured.pictures = vec![Picture {
            path: "a.png".into(),
            shows: PictureKind::Error,
            scale: Some(PictureScale::OcclusionError(ErrorSpan { full_at: 0.5, largest: 0.75 })),
        }];
        measured.notes = vec![Note::new(NoteKind::Outliers, "two frames")];
        measured.repeated.insert("error".into(), vec![0.5, 0.6]);
        measured.frame.machine = vec![MachineState { clock_mhz: Some(1e3), ..Default::default() }];
        let stage = &mut measured.stages[0];
        stage.counters.insert("vertex_invocations".into(), 3);
        stage.fenced = Some(Fenced {
            wall_samples_ns: vec![2e5],
            submit_cost_samples_ns: vec![1e5],
            resolution_ns: 2e3,
        });
    }
    let mut kinds = BTreeSet::new();
    let mut lines =
        records.iter().map(|record| serde_json::to_value(record).unwrap()).collect_vec();
    lines.retain(|line| {
        kinds.insert([&line["record"], &line["outcome"]["status"]].map(Value::to_string))
    });
    assert_eq!(lines.len(), 6, "{kinds:?}");
    lines.into_iter().chain(compared()).collect()
}

/// The same of comparisons.
fn compared() -> Vec<Value> {
    let environment = SideEnvironment {
        variables: [("A".into(), Some("1".into())), ("B".into(), None)].into(),
        values_digest: Some("0123".into()),
    };
    let header = ComparisonHeader {
        base_adapter: Some(Default::default()),
        head: ComparedBuild { environment, ..ComparedBuild::default() },
        skipped: vec![Skip { gate: Gate::Time, reason: "no core".into() }],
        cells: vec![cell()],
        ..ComparisonHeader::default()
    };
    let fault = Fault {
        launch: Some(3),
        ..Fault::new(Gate::Exact, Some(Side::Head), Some(cell()), "lost")
    };
    let lines = [
        Compared::Header(Box::new(header)),
        Compared::Launch(Launch { core: Some(1), ..Launch::default() }),
        Compared::Fault(fault),
        Compared::End(ComparisonEnd { wall_s: 2.0, interrupted: false }),
    ];
    let figures = [
        json!({"kind": "configuration", "side": "base", "configuration": "tank", "allocated_bytes": 8,
            "errors": {"e": null, "f": 0.5}, "quantities": {"q": null}, "judged": [], "notes": ["n"]}),
        json!({"kind": "exact", "side": "head", "cell": "tank compose", "work": {"photons": 3}}),
        json!({"kind": "check", "side": "head", "stage": "compose", "what": "w", "unit": "%",
            "measured": null, "tolerance": 0.1, "sound": false}),
        json!({"kind": "instructions", "side": "base", "cell": "tank compose", "counts": [7, 8]}),
        json!({"kind": "pair", "launch": 0, "round": 1, "cell": "tank compose", "control": true,
            "second": true, "first": "head", "base_ns": 1.5, "head_ns": 2.5,
            "machine": {"base": {"clock_mhz": 900.0}, "head": {"throttle": ["hw_slowdown", "a later word"]}}}),
    ];
    let written = lines.into_iter().map(|line| serde_json::to_value(Record::from(line)).unwrap());
    let figures = figures.into_iter().map(|mut figure| {
        figure["record"] = json!("comparison");
        figure
    });
    written.chain(figures).collect()
}

/// Each request with a reply that has every optional part.
fn exchanges() -> Vec<Value> {
    let clock = ClockPlan::fenced(SubmitCost::default());
    let adapter = json!(Adapter::default());
    let greeting = json!({"message": "hello", "protocol": 1, "fathom_version": "0", "adapter": adapter,
        "parts": ["time"], "cores": [0], "randomized": true, "notes": ["n"]});
    let exact = json!({"message": "exact", "stages": [{"name": "a", "work": {"photons": 3}, "counters": {"c": 1}}],
        "allocated_bytes": 8, "errors": {"e": null}, "quantities": {"q": 0.5}, "notes": ["n"],
        "judged": [{"name": "e", "value": 0.5, "unit": "m", "stage": "a"}]});
    let check = json!({"stage": "a", "what": "w", "unit": "%", "measured": null, "tolerance": 0.1, "sound": false});
    let [of_stage, fault] = [
        json!({"config": "a", "stage": "b", "frames": 3}),
        json!({"message": "fault", "reason": "r", "fatal": true, "absent": false}),
    ];
    let of_stage = |message: &str| {
        let mut request = of_stage.clone();
        request["message"] = message.into();
        request
    };
    let pairs = [
        (json!({"message": "hello", "protocol": 1, "clock": clock}), greeting),
        (json!({"message": "clock"}), json!({"message": "clock", "clock": clock})),
        (
            json!({"message": "prepare", "id": "a", "pipeline": "p", "scene": "s", "params": {"b.c": [1]}}),
            json!({"message": "prepared", "stages": [{"name": "b", "kind": "compute"}]}),
        ),
        (
            of_stage("sample"),
            json!({"message": "sample", "ns": [1.5], "machine": {"clock_mhz": 900.0}}),
        ),
        (json!({"message": "exact", "config": "a"}), exact),
        (
            json!({"message": "checks", "stages": ["a"]}),
            json!({"message": "checks", "checks": [check]}),
        ),
        (of_stage("instructions"), json!({"message": "instructions", "frames": 3})),
        (json!({"message": "quit"}), json!(null)),
        (json!({"message": "clock"}), fault),
        (json!({"message": "clock"}), json!({"message": "unsupported", "request": "clock"})),
    ];
    pairs.map(|(request, reply)| json!({"request": request, "reply": reply})).into()
}

fn cell() -> CellId {
    CellId::new("tank", "compose")
}

fn sample_line() -> Value {
    let pair = FramePair {
        round: 3,
        sampled_at_s: 1.7e9,
        machine: Some(MachineState::default()),
        stages: vec![StageTime { ns: 1e6, ..StageTime::none("compose") }],
        envelope_ns: 2e6,
        gaps_ns: 1e6,
        untimed_ns: 2e6,
    };
    let line = SampleLine {
        schema: SAMPLES_SCHEMA,
        id: SampleLine::id(&fixtures::header(Profile::Quick), "key"),
        experiment: "e".into(),
        cell: "a=1".into(),
        clocks: [(PassKind::Copy, Clock::Timestamp)].into(),
        added: Addition { warm_up_frames: 2, pair: Some(pair), ..Addition::default() },
    };
    serde_json::to_value(line).unwrap()
}

#[track_caller]
fn valid(validator: &Validator, line: &Value) {
    if let Err(error) = validator.validate(line) {
        panic!("{error} at {}: {line}", error.instance_path());
    }
}

#[test]
fn records_that_are_written_are_valid() {
    let records = validator(LineKind::Record);
    for record in fixtures::run() {
        valid(&records, &serde_json::to_value(record).unwrap());
    }
    for record in full() {
        serde_json::from_value::<Record>(record.clone()).unwrap();
        valid(&records, &record);
    }
    valid(&validator(LineKind::Sample), &sample_line());
    let worker = validator(LineKind::Worker);
    exchanges().iter().for_each(|exchange| valid(&worker, exchange));
}

#[test]
fn records_of_the_reference_run_are_valid() {
    let records = validator(LineKind::Record);
    let text = std::fs::read_to_string(root().join("tests/golden/run/records.jsonl")).unwrap();
    assert!(text.lines().count() > 30);
    for line in text.lines() {
        valid(&records, &serde_json::from_str(line).unwrap());
    }
}

/// Every value below this one, of a list the first, by its JSON pointer.
fn pointers(value: &Value, at: &str, all: &mut Vec<String>) {
    let of_object = value.as_object().into_iter().flatten();
    let of_list = value.get(0).map(|first| ("0", first));
    for (name, inner) in of_object.map(|(name, inner)| (name.as_str(), inner)).chain(of_list) {
        let pointer = format!("{at}/{}", name.replace('~', "~0").replace('/', "~1"));
        all.push(pointer.clone());
        pointers(inner, &pointer, all);
    }
}

/// The line with each of its values left out, and replaced by a value of each other type.
fn damaged(line: &Value) -> Vec<(String, Value)> {
    let mut places = Vec::new();
    pointers(line, "", &mut places);
    let mut all = Vec::new();
    for place in places {
        let (parent, name) = place.rsplit_once('/').unwrap();
        let mut without = line.clone();
        if let Some(map) = without.pointer_mut(parent).and_then(Value::as_object_mut) {
            map.shift_remove(&name.replace("~1", "/").replace("~0", "~"));
            all.push((format!("{place} left out"), without));
        }
        for other in [json!(null), json!("?!"), json!(-1.5), json!(true), json!([]), json!({})] {
            let mut replaced = line.clone();
            *replaced.pointer_mut(&place).unwrap() = other.clone();
            all.push((format!("{place} = {other}"), replaced));
        }
    }
    all
}

/// The schema refuses what the reader refuses. It is stricter in two places: the reader takes half an interval for none, and
/// a list for an object.
#[test]
fn the_schema_refuses_what_the_reader_refuses() {
    use fathom_record::Line;
    fn is_read<T: Line>(line: Value) -> bool {
        let schema = line.get("schema").and_then(Value::as_u64);
        let other_format = schema.is_some_and(|schema| schema != u64::from(T::SCHEMA));
        let read = serde_json::from_value::<T>(line);
        read.is_ok_and(|read| read.check().is_ok()) && !other_format
    }
    fn agree(kind: LineKind, lines: &[Value], is_read: fn(Value) -> bool) -> [usize; 2] {
        let validator = validator(kind);
        let mut counts = [0; 2];
        for (what, line) in lines.iter().flat_map(damaged) {
            let read = is_read(line.clone());
            let valid = validator.is_valid(&line);
            let half = ["/low", "/high"].iter().any(|bound| what.contains(bound));
            let stricter = half || what.ends_with("= []");
            assert!(
                valid == read || stricter && read,
                "{what}: valid {valid}, read {read}: {line}"
            );
            counts[usize::from(valid)] += 1;
        }
        counts
    }
    let [refused, accepted] = agree(LineKind::Record, &full(), is_read::<Record>);
    assert!(refused > 1000 && accepted > 100, "{refused} refused, {accepted} accepted");
    let [refused, accepted] = agree(LineKind::Sample, &[sample_line()], is_read::<SampleLine>);
    assert!(refused > 50 && accepted > 10, "{refused} refused, {accepted} accepted");
    let exchanged = |line: Value| {
        let request = WorkerRequest::deserialize(&line["request"]).is_ok();
        request && Option::<Reply>::deserialize(&line["reply"]).is_ok()
    };
    let [refused, accepted] = agree(LineKind::Worker, &exchanges(), exchanged);
    assert!(refused > 200 && accepted > 20, "{refused} refused, {accepted} accepted");
}

#[test]
fn an_unknown_kind_of_record_is_not_valid() {
    let records = validator(LineKind::Record);
    for line in [json!({"record": "rum"}), json!({}), json!({"record": "comparison", "kind": "x"})]
    {
        assert!(!records.is_valid(&line), "{line}");
    }
}

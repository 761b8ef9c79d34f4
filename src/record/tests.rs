use std::fs;

use serde_json::{Map, json};

use super::*;

fn cell(name: &str, outcome: Outcome) -> Record {
    Record::Cell(Box::new(Cell {
        experiment: "e".to_owned(),
        cell: name.to_owned(),
        axes: Map::new(),
        pipeline: "p".to_owned(),
        scene: "tank".to_owned(),
        stand_ins: Vec::new(),
        params: json!({ "b": 1, "a": { "y": 0.1, "x": [1, 2] } }),
        outcome,
    }))
}

fn skipped(name: &str) -> Record {
    let reason = "too large, \"by far\"\nindeed".to_owned();
    cell(name, Outcome::Skipped { reason })
}

fn run(profile: &str) -> Run {
    Run {
        schema: SCHEMA,
        fathom_version: "1".to_owned(),
        started_at: "now".to_owned(),
        profile: profile.to_owned(),
        command: Vec::new(),
        adapter: Adapter::default(),
        shader_checks: "checked".to_owned(),
        audit: Vec::new(),
        submit_cost_ns: Default::default(),
        notes: Vec::new(),
    }
}

fn definition() -> Record {
    Record::Experiment(Definition {
        id: "e".to_owned(),
        toml: "id = \"e\"\n".to_owned(),
    })
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records.jsonl");
    let records = [
        Record::Run(Box::new(run("quick"))),
        definition(),
        skipped("a"),
    ];
    let mut writer = Writer::create(&path).unwrap();
    for record in &records {
        writer.write(record).unwrap();
    }
    let mut writer = Writer::append(&path).unwrap();
    writer.write(&skipped("b")).unwrap();
    let reading = read(&path).unwrap();
    assert_eq!(reading.records[..3], records);
    assert_eq!(reading.records[3], skipped("b"));
    assert!(reading.damaged.is_empty());
}

#[test]
fn a_torn_last_line_is_named_and_cut_off_on_appending() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records.jsonl");
    let whole = serde_json::to_string(&skipped("a")).unwrap();
    fs::write(&path, format!("{whole}\n{}", &whole[..whole.len() / 2])).unwrap();
    let reading = read(&path).unwrap();
    assert_eq!(reading.records, [skipped("a")]);
    assert_eq!(reading.damaged.len(), 1);
    assert_eq!(reading.damaged[0].line, 2);
    let told = reading.damaged[0].to_string();
    assert!(
        told.starts_with("line 2: torn off while it was written"),
        "{told}"
    );

    Writer::append(&path).unwrap().write(&skipped("b")).unwrap();
    let reading = read(&path).unwrap();
    assert_eq!(reading.records, [skipped("a"), skipped("b")]);
    assert!(reading.damaged.is_empty());
}

#[test]
fn a_whole_last_line_without_its_end_is_kept_on_appending() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records.jsonl");
    fs::write(&path, serde_json::to_string(&skipped("a")).unwrap()).unwrap();
    Writer::append(&path).unwrap().write(&skipped("b")).unwrap();
    assert_eq!(read(&path).unwrap().records, [skipped("a"), skipped("b")]);
}

#[test]
fn damaged_lines_are_named_one_by_one_and_the_rest_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records.jsonl");
    let good = serde_json::to_string(&skipped("a")).unwrap();
    let mut bytes = format!("{good}\nnonsense\n\n{{\"record\":\"cell\"}}\n").into_bytes();
    bytes.extend(b"\xff\xfe\n");
    bytes.extend(good.bytes());
    bytes.push(b'\n');
    fs::write(&path, bytes).unwrap();
    let reading = read(&path).unwrap();
    assert_eq!(reading.records.len(), 2);
    let lines: Vec<usize> = reading.damaged.iter().map(|damage| damage.line).collect();
    assert_eq!(lines, [2, 4, 5]);
    assert!(reading.damaged[1].reason.contains("missing field"));
}

#[test]
fn another_format_is_an_error_that_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records.jsonl");
    fs::write(&path, "{\"record\":\"run\",\"schema\":99,\"new\":true}\n").unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("line 1: record format 99"), "{error}");
}

#[test]
fn a_number_that_is_not_finite_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records.jsonl");
    let mut writer = Writer::create(&path).unwrap();
    writer.write(&skipped("a")).unwrap();
    let mut bad = run("quick");
    bad.submit_cost_ns.insert(PassKind::Render, f64::NAN);
    let error = writer.write(&Record::Run(Box::new(bad))).unwrap_err();
    assert!(matches!(error, RecordError::Unreadable { .. }));
    assert_eq!(read(&path).unwrap().records.len(), 1);
}

#[test]
fn a_full_disk_is_an_error_that_names_the_file() {
    // Linux's always-full device; elsewhere there is none to try.
    let path = std::path::Path::new("/dev/full");
    if !path.exists() {
        return;
    }
    let mut writer = Writer::create(path).unwrap();
    let error = writer.write(&skipped("a")).unwrap_err().to_string();
    assert!(error.starts_with("cannot write /dev/full"), "{error}");
}

#[test]
fn a_missing_file_is_named() {
    let error = read(std::path::Path::new("no/such/file")).unwrap_err();
    assert!(error.to_string().starts_with("cannot read no/such/file"));
}

#[test]
fn only_cells_under_the_same_conditions_are_finished() {
    let failed = cell(
        "failed",
        Outcome::Failed {
            reason: "device lost".to_owned(),
        },
    );
    let records = [
        Record::Run(Box::new(run("paper"))),
        skipped("other profile"),
        Record::Run(Box::new(run("quick"))),
        skipped("same"),
        failed,
    ];
    let keys = finished(&records, &run("quick"));
    let same = match skipped("same") {
        Record::Cell(cell) => cell.resume_key(),
        _ => unreachable!(),
    };
    assert_eq!(keys.into_iter().collect::<Vec<_>>(), [same]);
}

#[test]
fn resume_keys_ignore_the_order_of_parameters_but_not_their_values() {
    let key = |params| resume_key("e", "c", "p", "s", &[], &params);
    let one = json!({ "a": { "x": 1, "y": 2 }, "b": 3 });
    let turned = json!({ "b": 3, "a": { "y": 2, "x": 1 } });
    let other = json!({ "b": 3, "a": { "y": 2, "x": 9 } });
    assert_eq!(key(one.clone()), key(turned));
    assert_ne!(key(one), key(other));
}

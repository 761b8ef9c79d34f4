use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
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
        params: json!({ "b": 1, "a": { "y": 0.1, "x": [1, 2] } }).into(),
        outcome,
    }))
}

fn skipped(name: &str) -> Record {
    let reason = "too large, \"by far\"\nindeed".to_owned();
    cell(name, Outcome::Skipped { reason })
}

fn run(profile: Profile) -> Run {
    Run { schema: SCHEMA, profile, ..Run::default() }
}

fn header(profile: Profile) -> Record {
    Record::Run(Box::new(run(profile)))
}

/// A folder, and the path of the records in it.
fn file() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records.jsonl");
    (folder, path)
}

fn open(path: &Path) -> Opened<Record> {
    Writer::open(path, |_| Ok::<(), RecordError>(())).unwrap()
}

fn append(path: &Path, record: &Record) {
    open(path).writer.write(record).unwrap();
}

#[test]
fn what_is_written_is_read() {
    let (_folder, path) = file();
    let definition = Definition { id: "e".to_owned(), toml: "id = \"e\"\n".to_owned() };
    let records = [header(Profile::Quick), Record::Experiment(definition), skipped("a")];
    let mut writer = Writer::create(&path).unwrap();
    for record in &records {
        writer.write(record).unwrap();
    }
    append(&path, &skipped("b"));
    let reading = read(&path).unwrap();
    assert_eq!(reading.records[..3], records);
    assert_eq!(reading.records[3], skipped("b"));
    assert!(reading.damaged.is_empty());
}

#[test]
fn a_torn_last_line_is_named_and_kept_aside_on_appending() {
    let (_folder, path) = file();
    let whole = serde_json::to_string(&skipped("a")).unwrap();
    fs::write(&path, format!("{whole}\n{}", &whole[..whole.len() / 2])).unwrap();
    let reading = read(&path).unwrap();
    assert_eq!(reading.records, [skipped("a")]);
    assert_eq!(reading.damaged.len(), 1);
    assert_eq!(reading.damaged[0].line, 2);
    let told = reading.damaged[0].to_string();
    assert!(told.starts_with("line 2: torn off while it was written"), "{told}");

    let torn = fs::read(&path).unwrap();
    append(&path, &skipped("b"));
    let reading = read(&path).unwrap();
    assert_eq!(reading.records, [skipped("a"), skipped("b")]);
    assert!(reading.damaged.is_empty());
    let aside = kept_aside(&path);
    assert_eq!(aside.len(), 1);
    assert_eq!(fs::read(&aside[0]).unwrap(), torn);
    // A whole line that only lacks its end is no damage.
    fs::write(&path, whole).unwrap();
    append(&path, &skipped("b"));
    assert_eq!(read(&path).unwrap().records, [skipped("a"), skipped("b")]);
    assert_eq!(kept_aside(&path).len(), 1);
}

#[test]
fn damaged_lines_are_named_one_by_one_and_the_rest_is_read() {
    let (_folder, path) = file();
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

/// A line of a run and one of a cell, as they are written.
fn lines(records: &[Record]) -> Vec<String> {
    let line = |record| serde_json::to_string(record).unwrap() + "\n";
    records.iter().map(line).collect()
}

#[test]
fn cells_after_a_header_that_may_be_lost_are_given_to_no_other_run() {
    let (_folder, path) = file();
    let written =
        lines(&[header(Profile::Quick), skipped("a"), header(Profile::Paper), skipped("b")]);
    let [first, a, second, b] = written.as_slice() else { panic!() };
    let torn = |line: &str, bytes: usize| format!("{}\n", &line[..bytes]);
    let read_with = |damaged: &str| {
        fs::write(&path, [first, a, damaged, b, second, b].map(String::from).concat()).unwrap();
        read(&path).unwrap()
    };
    let merged = format!("{}{}", &a[..30], &second[..second.len() - 9]) + "\n";
    for damaged in [&torn(second, 60), &torn(second, 5), &merged] {
        let reading = read_with(damaged);
        let whole = [header(Profile::Quick), skipped("a"), header(Profile::Paper), skipped("b")];
        assert_eq!(reading.records, whole, "{damaged}");
        let told: Vec<String> = reading.damaged.iter().map(ToString::to_string).collect();
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told[0].starts_with("line 3: not JSON"), "{told:?}");
        let expected = "line 4: it belongs to a run whose header, line 3, could not be read";
        assert_eq!(told[1], expected);
    }
    // A torn cell was no header.
    let reading = read_with(&torn(a, 40));
    assert_eq!(reading.records.len(), 5);
    assert_eq!(reading.damaged.len(), 1);
}

/// Records over which a block of zeros lies, from a byte on, and what is read of them.
fn read_under_zeros(written: &[String], at: usize, zeros: usize) -> Reading {
    let (_folder, path) = file();
    let mut bytes = written.concat().into_bytes();
    bytes[at..at + zeros].fill(0);
    fs::write(&path, bytes).unwrap();
    read(&path).unwrap()
}

#[test]
fn after_a_block_of_zeros_the_next_records_are_read() {
    let header = header(Profile::Quick);
    let cells: Vec<Record> = (0..9).map(|n| skipped(&n.to_string())).collect();
    let written = lines(&[std::slice::from_ref(&header), &cells].concat());
    let (first, length) = (written[0].len(), written[1].len());
    for (at, zeros, lost, lines) in [
        // Within a line; over the end of one; whole lines, with their ends and without.
        (first + length + 9, 20, vec![1], 1),
        (first + 2 * length - 9, 20, vec![1, 2], 1),
        (first + length, 3 * length, vec![1, 2, 3], 1),
        (first + length, 3 * length - 1, vec![1, 2, 3], 1),
    ] {
        let reading = read_under_zeros(&written, at, zeros);
        let kept = cells.iter().enumerate().filter(|(n, _)| !lost.contains(n));
        let kept: Vec<Record> = kept.map(|(_, cell)| cell.clone()).collect();
        assert_eq!(reading.records[1..], kept, "{at}, {zeros}");
        assert_eq!(reading.damaged.count(), lines);
        let told = reading.damaged[0].to_string();
        assert!(told.contains(&format!("{zeros} zero bytes lie over")), "{told}");
    }
}

/// What is left of a header at either end of the zeros says that there was one.
#[test]
fn zeros_over_a_part_of_a_header_lose_its_cells() {
    let written =
        lines(&[header(Profile::Quick), skipped("a"), header(Profile::Paper), skipped("b")]);
    let start = written[0].len() + written[1].len();
    for at in [start + 12, start] {
        let reading = read_under_zeros(&written, at, 30);
        assert_eq!(reading.records, [header(Profile::Quick), skipped("a")]);
        assert_eq!(reading.damaged.count(), 2, "{:?}", reading.damaged);
    }
}

#[test]
fn a_file_that_is_removed_or_replaced_while_it_is_written_to_is_rescued() {
    let (folder, path) = file();
    for (number, replaced) in [(1, false), (2, true)] {
        let mut writer = Writer::create(&path).unwrap();
        writer.write(&skipped("a")).unwrap();
        fs::remove_file(&path).unwrap();
        if replaced {
            fs::write(&path, "another's").unwrap();
        }
        let error = writer.write(&skipped("b")).unwrap_err().to_string();
        let rescued = folder.path().join(format!("records.rescued-{number}.jsonl"));
        assert!(error.contains("was removed or replaced"), "{error}");
        assert!(error.contains(&rescued.display().to_string()), "{error}");
        let records = read(&rescued).unwrap().records;
        assert_eq!(records, [skipped("a"), skipped("b")]);
        assert_eq!(path.exists(), replaced);
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), "another's");
}

#[test]
fn what_two_writers_append_stays_whole() {
    let (_folder, path) = file();
    let mut writers = [open(&path).writer, open(&path).writer];
    for n in 0..6 {
        writers[n % 2].write(&skipped(&n.to_string())).unwrap();
    }
    let expected: Vec<Record> = (0..6).map(|n| skipped(&n.to_string())).collect();
    assert_eq!(read(&path).unwrap().records, expected);
}

#[test]
fn a_missing_file_and_another_format_are_named() {
    let (_folder, path) = file();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.starts_with(&format!("cannot read {}", path.display())), "{error}");
    fs::write(&path, "{\"record\":\"run\",\"schema\":99,\"new\":true}\n").unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("line 1: record format 99"), "{error}");
}

#[test]
fn a_number_that_is_not_finite_is_not_written() {
    let (_folder, path) = file();
    let mut writer = Writer::create(&path).unwrap();
    writer.write(&skipped("a")).unwrap();
    let mut bad = run(Profile::Quick);
    bad.submit_cost_ns.insert(PassKind::Render, f64::NAN);
    let error = writer.write(&Record::Run(Box::new(bad))).unwrap_err();
    assert!(matches!(error, RecordError::Unreadable { .. }));
    assert_eq!(read(&path).unwrap().records.len(), 1);
}

fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn a_compressed_file_is_read_where_there_is_no_other() {
    let (folder, path) = file();
    let compressed = folder.path().join("records.jsonl.gz");
    fs::write(&compressed, packed(lines(&[skipped("a")])[0].as_bytes())).unwrap();
    assert_eq!(read(&path).unwrap().records, [skipped("a")]);
    assert_eq!(read(&compressed).unwrap().records, [skipped("a")]);
    append(&path, &skipped("b"));
    assert_eq!(read(&path).unwrap().records, [skipped("b")]);
    let whole = fs::read(&compressed).unwrap();
    fs::write(&compressed, &whole[..whole.len() / 2]).unwrap();
    let error = read(&compressed).unwrap_err().to_string();
    assert!(error.starts_with(&format!("cannot read {}", compressed.display())), "{error}");
}

#[test]
fn only_cells_under_the_same_conditions_are_finished() {
    let failed = cell("failed", Outcome::Failed { reason: "device lost".to_owned() });
    let records = [
        header(Profile::Paper),
        skipped("other profile"),
        header(Profile::Quick),
        skipped("same"),
        failed,
    ];
    let keys = finished(&records, &run(Profile::Quick));
    let Record::Cell(same) = skipped("same") else { panic!() };
    let same = same.resume_key();
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

#[test]
fn a_stage_that_was_renamed_is_read_under_its_new_name() {
    let named = |name: &str| {
        let written = StageRecord::of(name, Clock::Host, vec![1.0, 2.0]);
        let text = serde_json::to_string(&written).unwrap();
        serde_json::from_str::<StageRecord>(&text).unwrap().stage
    };
    assert_eq!([named("frame").as_str(), named("compose").as_str()], ["uniforms", "compose"]);
}

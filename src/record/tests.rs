use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::json;

use super::*;

fn cell(name: &str, outcome: Outcome) -> Record {
    Record::Cell(Box::new(Cell {
        experiment: "e".to_owned(),
        cell: name.to_owned(),
        params: json!({ "b": 1, "a": { "y": 0.1, "x": [1, 2] } }).into(),
        outcome,
        ..Cell::default()
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

fn open(path: &Path) -> Writer {
    Writer::open(path, |_| Ok::<(), RecordError>(())).unwrap().0
}

fn append(path: &Path, record: &Record) {
    open(path).write(record).unwrap();
}

#[test]
fn a_torn_last_line_is_skipped_counted_and_cut_off_on_appending() {
    let (_folder, path) = file();
    let whole = serde_json::to_string(&skipped("a")).unwrap();
    fs::write(&path, format!("{whole}\n{}", &whole[..whole.len() / 2])).unwrap();
    let reading = read(&path).unwrap();
    assert_eq!(reading.records, [skipped("a")]);
    let message = reading.damaged.to_string();
    assert!(message.starts_with("line 2: torn off while it was written"), "{message}");
    append(&path, &skipped("b"));
    let both = RecordFile { records: vec![skipped("a"), skipped("b")], ..RecordFile::default() };
    assert_eq!(read(&path).unwrap(), both);
    // A whole line that only lacks its end is no damage.
    fs::write(&path, whole).unwrap();
    append(&path, &skipped("b"));
    assert_eq!(read(&path).unwrap(), both);
}

#[test]
fn damaged_and_unknown_lines_are_counted_and_the_rest_is_read() {
    let (_folder, path) = file();
    let [good, other] = ["a", "c"].map(|name| serde_json::to_vec(&skipped(name)).unwrap());
    let (long, deep) = ("9".repeat(9 << 20), "[".repeat(1 << 20));
    let lines: [&[u8]; 9] = [
        &good,
        b"nonsense",
        b"",
        b"{\"record\":\"cell\"}",
        b"{\"record\":\"of a later version\"}",
        b"\xff\xfe\0\0",
        long.as_bytes(),
        deep.as_bytes(),
        &other,
    ];
    fs::write(&path, [lines.join(&b'\n'), b"\n".repeat(2)].concat()).unwrap();
    let reading = read(&path).unwrap();
    assert_eq!((reading.records.len(), reading.damaged.count()), (2, 6));
    let notice = reading.damaged.notice(Path::new("records.jsonl")).unwrap();
    let message =
        "records.jsonl, line 2: not JSON: expected ident at line 1 column 2 (and 5 more): skipped";
    assert_eq!(notice, message);
    append(&path, &skipped("b"));
    assert_eq!(read(&path).unwrap().records.len(), 3);
}

#[test]
fn the_limit_of_a_line_is_the_last_length_that_is_read() {
    let padded = |name: &str, bytes: usize| {
        let mut line = serde_json::to_vec(&skipped(name)).unwrap();
        line.resize(bytes, b' ');
        line
    };
    let lines = [padded("a", 8 << 20), padded("b", (8 << 20) + 1), padded("c", 1 << 10)];
    let (read, torn_bytes) = lines::sift(Path::new("-"), &*lines.join(&b'\n')).unwrap();
    assert_eq!((read.records, torn_bytes), (vec![skipped("a"), skipped("c")], 0));
    assert_eq!(read.damaged.to_string(), "line 2: longer than 8 MiB");
}

#[test]
fn a_number_that_is_not_finite_is_not_written() {
    let (_folder, path) = file();
    let mut writer = open(&path);
    writer.write(&skipped("a")).unwrap();
    let mut bad = run(Profile::Quick);
    bad.submit_cost_ns.insert(PassKind::Render, f64::NAN);
    let error = writer.write(&Record::Run(Box::new(bad))).unwrap_err();
    assert!(matches!(error, RecordError::Unreadable(_)));
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
    fs::write(&compressed, packed(&serde_json::to_vec(&skipped("a")).unwrap())).unwrap();
    assert_eq!(read(&path).unwrap().records, [skipped("a")]);
    assert_eq!(read(&compressed).unwrap().records, [skipped("a")]);
    append(&path, &skipped("b"));
    assert_eq!(read(&path).unwrap().records, [skipped("b")]);
    let whole = fs::read(&compressed).unwrap();
    fs::write(&compressed, &whole[..whole.len() / 2]).unwrap();
    let error = read(&compressed).unwrap_err().to_string();
    assert!(error.starts_with(&format!("cannot read {}", compressed.display())), "{error}");
}

fn begun(cell: &str) -> Record {
    let [id, experiment] = [cell, "e"].map(str::to_owned);
    Record::Begun(Begun { id, experiment, cell: cell.to_owned() })
}

/// A measured cell with so many samples, of which the figures were read or were not.
fn measured(name: &str, samples: u32, is_finished: bool) -> Record {
    let note = Note::new(NoteKind::Unfinished, "it goes on");
    let notes = if is_finished { Vec::new() } else { vec![note] };
    let frame = FrameRecord { rounds: (0..samples).collect(), ..FrameRecord::default() };
    cell(name, Outcome::Measured(Box::new(Measured { frame, notes, ..Measured::default() })))
}

#[test]
fn the_latest_record_of_a_cell_counts_and_the_others_go_when_the_run_ends() {
    let (_folder, path) = file();
    let mut writer = open(&path);
    let first = [header(Profile::Quick), begun("a"), measured("a", 1, false), begun("b")];
    let later = [header(Profile::Quick), measured("b", 1, false), measured("a", 2, true)];
    writer
        .write_all(&[&first[..], &later, &[measured("b", 2, true), begun("c")]].concat())
        .unwrap();
    let expected = [
        header(Profile::Quick),
        begun("b"),
        header(Profile::Quick),
        measured("a", 2, true),
        measured("b", 2, true),
        begun("c"),
    ];
    let before = read(&path).unwrap();
    assert_eq!((&before.records[..], before.superseded), (&expected[..], 3));
    let torn = "{\"record\":";
    fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(torn.as_bytes()).unwrap();
    assert_eq!(read(&path).unwrap().records, expected, "a kill in the midst of a line");
    assert_eq!(open(&path).compact().unwrap(), expected);
    assert_eq!(
        read(&path).unwrap(),
        RecordFile { records: expected.clone().into(), ..RecordFile::default() }
    );
    // A cell of other conditions is no newer version.
    let other = [header(Profile::Paper), measured("a", 1, true)];
    open(&path).write_all(&other).unwrap();
    assert_eq!(open(&path).compact().unwrap(), [&expected[..], &other].concat());
}

/// What a resumed run takes from each record: nothing, that the cell needs no second measurement, or its samples too.
#[test]
fn what_is_finished_under_the_same_conditions_stays_and_samples_of_the_same_build_are_continued() {
    let other = |change: fn(&mut Run)| {
        let mut other = run(Profile::Quick);
        change(&mut other);
        Record::Run(Box::new(other))
    };
    let failed = cell("failed", Outcome::Failed { reason: "device lost".to_owned() });
    let clocks = |run: &mut Run| {
        run.clocks.insert(PassKind::Copy, Clock::FencedHost);
    };
    let (finished, sampled, nothing) = (Some((true, true)), Some((false, true)), None);
    for (header, cell, expected) in [
        (header(Profile::Quick), skipped("a"), finished),
        (header(Profile::Quick), measured("a", 1, true), finished),
        (header(Profile::Quick), measured("a", 1, false), sampled),
        (header(Profile::Quick), failed, nothing),
        (header(Profile::Quick), cell("a", Outcome::OverBudget), nothing),
        (header(Profile::Paper), measured("a", 1, true), nothing),
        (other(|run| run.adapter.name = "b".into()), measured("a", 1, true), nothing),
        (other(|run| run.shader_checks = ShaderChecks::Unchecked), skipped("a"), nothing),
        (other(|run| run.build = Some(Build::default())), skipped("a"), Some((true, false))),
        (other(|run| run.conditions.host = Some("b".into())), skipped("a"), Some((true, false))),
        (other(|run| run.fathom_version = "9".into()), skipped("a"), Some((true, false))),
        (other(clocks), measured("a", 1, false), Some((false, false))),
    ] {
        let records = [header, cell];
        let found = earlier(&records, &run(Profile::Quick));
        let found = found.into_values().next().map(|of| (of.is_finished(), of.is_continued));
        assert_eq!(found, expected, "{records:?}");
    }
}

#[test]
fn resume_keys_ignore_the_order_of_parameters_but_not_their_values() {
    let key = |params: serde_json::Value| {
        let Record::Cell(cell) = skipped("a") else { panic!() };
        Cell { params: params.into(), ..*cell }.resume_key()
    };
    let one = json!({ "a": { "x": 1, "y": 2 }, "b": 3 });
    let reordered = json!({ "b": 3, "a": { "y": 2, "x": 1 } });
    let other = json!({ "b": 3, "a": { "y": 2, "x": 9 } });
    assert_eq!(key(one.clone()), key(reordered));
    assert_ne!(key(one), key(other));
}

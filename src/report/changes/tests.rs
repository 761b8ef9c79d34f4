use std::path::PathBuf;

use super::*;
use fathom_experiments::fixtures;
use fathom_record::{Clock, ErrorFigure, Measured, Outcome, Record, RecordFile};

fn file(name: &str, records: Vec<Record>) -> RunFile {
    let path = PathBuf::from(name).join("records.jsonl");
    RunFile { path, reading: RecordFile { records, ..RecordFile::default() } }
}

fn changes(base: Vec<Record>, head: Vec<Record>) -> RunChanges {
    RunChanges::from_files([&file("base", base), &file("head", head)], &Gate::ALL).unwrap()
}

fn cells_of<'r>(records: &'r mut [Record], experiment: &str) -> Vec<&'r mut Cell> {
    fixtures::cells(records).filter(|cell| cell.experiment == experiment).collect()
}

fn default(records: &mut [Record]) -> &mut Measured {
    let cell = fixtures::cells(records).find(|cell| cell.experiment == "uw-default").unwrap();
    cell.measured_mut().unwrap()
}

/// Adds the default cell under another name.
fn renamed(records: &mut Vec<Record>, name: &str) {
    let mut cell = cells_of(records, "uw-default")[0].clone();
    cell.cell = name.to_owned();
    records.push(Record::Cell(Box::new(cell)));
}

fn changed_runs() -> [Vec<Record>; 2] {
    let [mut base, mut head] = [fixtures::run(), fixtures::run()];
    for (records, error) in [(&mut base, 0.1), (&mut head, 0.2)] {
        let measured = default(records);
        measured.errors.push(ErrorFigure::new("irradiance_error", error, "1", "caustics/filter"));
    }
    for cell in cells_of(&mut head, "uw-waves") {
        let is_directional = cell.axes["water"] == "directional";
        let falling = 0.1 - cell.axes["water.amplitude_m"].as_f64().unwrap() / 10.0;
        if let Some(measured) = cell.measured_mut().filter(|_| is_directional) {
            measured.quantities.insert("caustics_unconverged_rate".to_owned(), falling);
        }
    }
    head[0].try_as_run_mut().unwrap().adapter.driver_info = "Mesa 23.0.0".to_owned();
    renamed(&mut base, "gone");
    renamed(&mut head, "added");
    [base, head]
}

#[test]
fn known_changes_stand_in_the_first_lines_of_their_blocks() {
    let [base, head] = changed_runs();
    let text = changes(base, head).into_text();
    // Each block from its title on.
    let lines: Vec<&str> = text.lines().collect();
    let holds = |title: &str, line: usize, words: &[&str]| {
        let block = lines.iter().position(|line| line.starts_with(title)).expect(&text);
        let found = lines[block + line];
        assert!(words.iter().all(|word| found.contains(word)), "{words:?} in {found}: {text}");
    };
    holds(
        "regression (status 1): exact figures of",
        0,
        &["1 worse", "not judged: two runs share no pairs"],
    );
    holds("Claims", 4, &["supported → contradicted", "uw-waves", "the higher the waves are"]);
    holds("Errors", 1, &["in some cell another value of 1 figure"]);
    let error = "irradiance_error 0.100 → 0.200 (+100 %)";
    holds("Errors", 4, &["worse", error, "uw-default:base caustics/filter"]);
    holds("Machine", 4, &["driver", "llvmpipe Mesa 22.3.6", "llvmpipe Mesa 23.0.0"]);
    holds("Cells", 4, &["missing", "1 cell", "uw-default gone"]);
    holds("Cells", 5, &["new", "1 cell", "uw-default added"]);
}

#[test]
fn every_time_stands_beside_its_like_with_the_intervals_of_both_runs() {
    let [mut base, mut head] = [fixtures::run(), fixtures::run()];
    let measured = default(&mut head);
    measured.frame.untimed = measured.frame.untimed.scaled(3.0);
    measured.stages[0].clock = Clock::ProcessCpu;
    let text = changes(base.clone(), head.clone()).into_text();
    let table = text.split("\nTimes\n").nth(1).expect(&text);
    let row = |name: &str| -> Vec<&str> {
        let place = ["uw-default base", name];
        let rows = table.lines().map(|line| line.split("  ").map(str::trim));
        let mut rows = rows.map(|fields| fields.filter(|field| !field.is_empty()).collect_vec());
        rows.find(|fields| fields.starts_with(&place)).expect(table).split_off(2)
    };
    let [before, after] = [default(&mut base), default(&mut head)];
    let frames = [&before.frame, &after.frame].map(|frame| ms(&frame.untimed));
    assert_eq!(row("frame"), [&frames[0], &frames[1], "3.00"]);
    let [first, second, ..] = &after.stages[..] else { panic!() };
    assert_eq!(row(&first.stage), [&stage_ms(first), &stage_ms(first), "–"], "another clock");
    assert_eq!(row(&second.stage), [&stage_ms(second), &stage_ms(second), "1.00"]);
    let frames = table.lines().filter(|line| line.contains("  frame  ")).count();
    assert_eq!(frames, facts::representatives(&Report::new(&head, None).sections).len(), "{table}");
    head[0].try_as_run_mut().unwrap().adapter.name = "Another".to_owned();
    let text = changes(base, head).into_text();
    assert!(
        text.starts_with("times not judged (status 4): exact figures of ")
            && !text.contains("\nTimes\n"),
        "{text}"
    );
    assert!(text.contains("; times not compared: ") && text.contains("Claims\n0 of "), "{text}");
}

#[test]
fn what_is_not_measured_in_the_same_way_is_told_and_not_compared() {
    let mut head = fixtures::run();
    let mut cells = cells_of(&mut head, "uw-photons");
    let scene = std::mem::replace(&mut cells[0].scene, "elsewhere".to_owned());
    cells[1].outcome = Outcome::Failed { reason: "device lost".to_owned() };
    let text = changes(fixtures::run(), head).into_text();
    let line = |words: &str| text.lines().find(|line| line.contains(words)).expect(&text);
    assert!(line("no longer measured").contains("(failed: device lost)"));
    assert!(line("measured in another way").contains(&format!("scene {scene} → elsewhere")));
}

use std::path::PathBuf;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use fathom_base::statistics::estimate;
use fathom_experiments::fixtures;
use fathom_record::{Clock, ErrorFigure, Measured, Outcome, Record, RecordFile};

/// How many times as long each time takes in the second run.
const DRIFT: f64 = 1.4;
/// Standard deviation of log ratios of stages, and of cells within a stage, between runs of one build.
const BETWEEN: f64 = 0.04;

fn file(name: &str, records: Vec<Record>) -> RunFile {
    let path = PathBuf::from(name).join("records.jsonl");
    RunFile { path, reading: RecordFile { records, ..RecordFile::default() } }
}

fn changes(base: Vec<Record>, head: Vec<Record>) -> RunChanges {
    RunChanges::from_files([&file("base", base), &file("head", head)], &Gate::ALL).unwrap()
}

/// A number about 0 with a standard deviation of [`BETWEEN`], that of this name always the same.
fn noise(name: &str) -> f64 {
    let seed = name.bytes().fold(17, |seed: u64, byte| seed.wrapping_mul(31) + u64::from(byte));
    let mut random = Pcg64::seed_from_u64(seed);
    BETWEEN * ((0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0)
}

/// A second run: every time drifts alike and scatters; stages take so many times as long beyond that.
fn again(factor: impl Fn(&str) -> f64) -> Vec<Record> {
    let mut records = fixtures::run();
    for cell in fixtures::cells(&mut records) {
        let place = cell_name(cell);
        let Some(measured) = cell.measured_mut() else { continue };
        for stage in &mut measured.stages {
            let name = stage.stage.to_string();
            let of_stage = match factor(&name) {
                1.0 => noise(&name).exp(),
                factor => factor,
            };
            let all = DRIFT * of_stage * noise(&format!("{place} {name}")).exp();
            stage.samples_ns.iter_mut().for_each(|ns| *ns *= all);
            stage.time = estimate(&stage.samples_ns);
        }
        let frame = &mut measured.frame;
        frame.untimed_samples_ns.iter_mut().for_each(|ns| *ns *= DRIFT * noise(&place).exp());
        frame.untimed = estimate(&frame.untimed_samples_ns);
    }
    records
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
    let factor = |stage: &str| match stage {
        "caustics/trace" => 1.3,
        "water/reflection" => 1.05,
        _ => 1.0,
    };
    let [mut base, mut head] = [fixtures::run(), again(factor)];
    for (records, error) in [(&mut base, 0.1), (&mut head, 0.2)] {
        let measured = default(records);
        measured.errors.push(ErrorFigure::new("irradiance_error", error, "1", "caustics/filter"));
    }
    for cell in cells_of(&mut head, "uw-waves") {
        let directional = cell.axes["water"] == "directional";
        let amplitude_m = cell.axes["water.amplitude_m"].as_f64().unwrap();
        let measured = cell.measured_mut().filter(|_| directional);
        let falling = [("caustics_unconverged_rate".to_owned(), 0.1 - amplitude_m / 10.0)];
        if let Some(measured) = measured {
            let mut all = measured.quantities.clone();
            all.extend(falling);
            measured.quantities = all;
        }
    }
    head[0].try_as_run_mut().unwrap().adapter.driver_info = "Mesa 23.0.0".to_owned();
    renamed(&mut base, "gone");
    renamed(&mut head, "added");
    [base, head]
}

#[test]
fn noise_comes_first_and_a_change_that_it_says_can_be_seen_is_listed() {
    let listed = |share: f64| {
        let [base, head] = [
            file("base", fixtures::run()),
            file("head", again(|stage| if stage == "caustics/trace" { share } else { 1.0 })),
        ];
        let changes = RunChanges::from_files([&base, &head], &Gate::ALL).unwrap();
        let noise = changes.noise.clone();
        let first = changes.into_text().lines().next().unwrap().to_owned();
        assert_eq!(Some(&first), noise.as_ref());
        let views = [&base, &head].map(|file| Report::new(&file.reading.records, None));
        let times =
            TimeChanges::compare(&CellMatches::match_runs([&views[0], &views[1]].map(cells)).both);
        let is_listed = times.changed.iter().any(|change| change.name == "caustics/trace");
        (times.scatter.unwrap(), is_listed, first)
    };
    let (scatter, is_listed, first) = listed(1.0);
    assert!(!is_listed && (BETWEEN / 2.0..BETWEEN * 2.0).contains(&scatter.between), "{scatter:?}");
    assert!(first.contains(&format!("below {} cannot", percent(scatter.visible))), "{first}");
    let (_, is_listed, _) = listed(1.0 + 1.2 * scatter.visible);
    assert!(is_listed, "{scatter:?}");
}

#[test]
fn no_stage_is_called_slower_where_a_run_is_noisy() {
    let mut head = again(|stage| if stage == "caustics/trace" { 1.5 } else { 1.0 });
    let compare = |head: &[Record]| changes(fixtures::run(), head.to_vec()).into_text();
    assert!(compare(&head).contains("caustics/trace slower"));
    for measured in fixtures::cells(&mut head).filter_map(Cell::measured_mut) {
        let samples = measured.frame.untimed_samples_ns.iter_mut().enumerate();
        samples.for_each(|(at, ns)| *ns *= if at % 2 == 0 { 0.7 } else { 1.4 });
    }
    let text = compare(&head);
    assert!(text.contains("cannot be judged") && !text.contains("caustics/trace slower"), "{text}");
}

#[test]
fn known_changes_stand_in_the_first_lines_of_their_blocks_and_no_other_stage_does() {
    let [base, head] = changed_runs();
    let text = changes(base, head).into_text();
    // Each block from its title on. What scatters between runs also settles some claims that were open.
    let lines: Vec<&str> = text.lines().collect();
    let holds = |title: &str, line: usize, words: &[&str]| {
        let block = lines.iter().position(|line| line.starts_with(title)).expect(&text);
        let found = lines[block + line];
        assert!(words.iter().all(|word| found.contains(word)), "{words:?} in {found}: {text}");
    };
    holds("exact figures of", 0, &["1 worse", "not judged: two runs share no pairs"]);
    holds("exact figures of", 2, &["two versions of the driver", "Mesa 22.3.6 →", "Mesa 23.0.0"]);
    holds("Claims", 4, &["supported → contradicted", "uw-waves", "the higher the waves are"]);
    holds("Times", 1, &["the median stage takes 1.40 times as long", "the machine's state"]);
    holds("Times", 2, &["default frame (uw-default base): ", " ms, × 1.39 ("]);
    holds("Times", 6, &["caustics/trace slower", "88 of 88 cells", "× 1.3"]);
    let times = text.split("\nTimes\n").nth(1).unwrap().split("\nErrors").next().unwrap();
    assert_eq!(times.matches(" slower ").count() + times.matches(" faster ").count(), 1, "{text}");
    holds("Errors", 1, &["in some cell another value of 1 figure"]);
    let error = "irradiance_error 0.100 → 0.200 (+100 %)";
    holds("Errors", 4, &["worse", error, "uw-default:base caustics/filter"]);
    holds("Machine", 4, &["driver", "llvmpipe Mesa 22.3.6", "llvmpipe Mesa 23.0.0"]);
    holds("Cells", 4, &["missing", "1 cell", "uw-default gone"]);
    holds("Cells", 5, &["new", "1 cell", "uw-default added"]);
}

#[test]
fn a_change_in_one_cell_is_found_where_the_stage_as_a_whole_did_not_change() {
    let mut head = again(|_| 1.0);
    let measured = default(&mut head);
    let stage = measured.stages.iter_mut().find(|stage| stage.stage == "compose").unwrap();
    stage.samples_ns.iter_mut().for_each(|ns| *ns *= 3.0);
    stage.time = estimate(&stage.samples_ns);
    let text = changes(fixtures::run(), head).into_text();
    let line = text.lines().find(|line| line.contains("compose slower")).expect(&text);
    assert!(line.contains(" 1 of ") && line.contains("uw-default base: "), "{line}");
}

#[test]
fn equal_runs_have_no_change_and_few_stages_none_either() {
    let text = changes(fixtures::run(), fixtures::run()).into_text();
    assert!(text.contains("Claims\n0 of ") && !text.contains("slower"), "{text}");
    assert!(text.contains("the median stage takes 1.00 times as long"), "{text}");
    let few = |records: Vec<Record>| {
        let keep = |record: &Record| match record {
            Record::Cell(cell) => cell.experiment == "vao-guard",
            _ => true,
        };
        records.into_iter().filter(keep).collect::<Vec<_>>()
    };
    let text = changes(few(fixtures::run()), few(again(|_| 1.0))).into_text();
    assert!(text.contains("too few to judge"), "{text}");
}

#[test]
fn what_is_not_measured_in_the_same_way_is_told_and_not_compared() {
    let mut head = fixtures::run();
    let mut cells = cells_of(&mut head, "uw-photons");
    let scene = std::mem::replace(&mut cells[0].scene, "elsewhere".to_owned());
    cells[1].outcome = Outcome::Failed { reason: "device lost".to_owned() };
    let stages = &mut cells[2].measured_mut().unwrap().stages;
    stages.iter_mut().for_each(|stage| stage.clock = Clock::ProcessCpu);
    let text = changes(fixtures::run(), head).into_text();
    let line = |words: &str| text.lines().find(|line| line.contains(words)).expect(&text);
    assert!(line("no longer measured").contains("(device lost)"));
    assert!(line("measured in another way").contains(&format!("scene {scene} → elsewhere")));
    assert!(line("not compared: another clock").contains("(13 not compared"), "{text}");
}

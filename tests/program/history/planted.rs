//! Planted steps in recorded noise: what fathom finds and what Apache Otava finds in the same series. Makes the table of
//! `docs/history.md`, which says how to run it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use fathom::history::otava::{CONFIGURATION, GROUP};
use fathom::history::run::NANOSECONDS;
use fathom::history::{
    self, Findings, History, Location, NewFigure, NewRun, Origin, Selection, StoredRuns,
};
use jiff::Timestamp;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::Value;

/// Runs of a history.
const RUNS: usize = 60;
/// Runs before the first place of a step, and after the last.
const MARGIN: usize = 15;
/// A change so many runs from the step counts as that step.
const NEAR: usize = 2;
/// Orders of the runs: as recorded, then shuffled, so that the noise has no drift.
const SHUFFLES: u64 = 2;
const SHARES: [f64; 4] = [0.0, 0.01, 0.02, 0.05];
const DAY_S: i64 = 86_400;

#[derive(Clone, Copy, Default)]
struct Count {
    found: usize,
    elsewhere: usize,
}

impl Count {
    fn add(&mut self, changes: &[usize], step: Option<usize>) {
        let near = |at: &&usize| step.is_some_and(|step| at.abs_diff(step) <= NEAR);
        let hits = changes.iter().filter(near).count();
        self.found += usize::from(hits > 0);
        self.elsewhere += changes.len() - hits;
    }
}

#[test]
#[ignore = "needs recorded runs in the folder FATHOM_NOISE and Apache Otava as the program FATHOM_OTAVA: see docs/history.md"]
fn planted_steps() {
    let folder = PathBuf::from(std::env::var("FATHOM_NOISE").unwrap());
    let mut folders: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    folders.retain(|path| path.join("records.jsonl").exists());
    folders.sort();
    let runs: Vec<NewRun> =
        folders.iter().map(|f| NewRun::read(f, "records.jsonl").unwrap()).collect();
    println!(
        "| order | step | series | fathom, sure | fathom, all | Otava | Otava, -P 0.05 |\n|---|---|---|---|---|---|---|"
    );
    for (order, seeds) in [("as recorded", 0..1), ("shuffled", 1..1 + SHUFFLES)] {
        for share in SHARES {
            let (mut series, mut counts) = (0, [Count::default(); 4]);
            for (window, seed) in
                runs.chunks_exact(RUNS).flat_map(|w| seeds.clone().map(move |s| (w, s)))
            {
                series += one_history(window, seed, share, &mut counts);
            }
            let told = counts.map(|c| format!("{} + {}", c.found, c.elsewhere)).join(" | ");
            println!("| {order} | {} % | {series} | {told} |", 100.0 * share);
        }
    }
}

/// Adds to the counts what was found in a history of these runs, and gives its number of series.
fn one_history(runs: &[NewRun], seed: u64, share: f64, counts: &mut [Count; 4]) -> usize {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut order: Vec<&NewRun> = runs.iter().collect();
    if seed > 0 {
        order.shuffle(&mut random);
    }
    let names =
        runs[0].figures.iter().map(|NewFigure { key, .. }| format!("{} {}", key.cell, key.figure));
    let steps: BTreeMap<String, usize> =
        names.map(|name| (name, random.random_range(MARGIN..=RUNS - MARGIN))).collect();
    let folder = tempfile::tempdir().unwrap();
    let stored = planted(folder.path(), &order, &steps, share);
    let findings = Findings::of(&stored);
    let of_otava = [None, Some("0.05")].map(|level| otava(folder.path(), &stored, level));
    for (place, series) in stored.series.iter().enumerate() {
        let step = Some(steps[&series.key.name()]).filter(|_| share > 0.0);
        let changes = findings.of_series(place);
        let sure: Vec<usize> = changes.iter().filter(|c| c.is_sure()).map(|c| c.at).collect();
        let all: Vec<usize> = changes.iter().map(|c| c.at).collect();
        for (count, changes) in
            counts.iter_mut().zip([&sure, &all, &of_otava[0][place], &of_otava[1][place]])
        {
            count.add(changes, step);
        }
    }
    stored.series.len()
}

/// A history of the runs' times in this order, each series raised by a share from a run of its own on.
fn planted(
    folder: &Path,
    runs: &[&NewRun],
    steps: &BTreeMap<String, usize>,
    share: f64,
) -> StoredRuns {
    let place = Location::File(folder.join("history.sqlite"));
    let mut history = History::open_or_make(&place).unwrap();
    let start = Timestamp::now().as_second() - (RUNS as i64 + 1) * DAY_S;
    for (number, run) in runs.iter().enumerate() {
        let times = run.figures.iter().filter(|figure| &*figure.key.unit == NANOSECONDS);
        let figures = times.map(|figure| {
            let step = steps.get(&format!("{} {}", figure.key.cell, figure.key.figure));
            let raised = step.is_some_and(|step| number >= *step);
            let value = if raised { figure.value.scaled(1.0 + share) } else { figure.value };
            NewFigure { value, ..figure.clone() }
        });
        let planted = NewRun {
            figures: figures.collect(),
            digest: format!("{number:064}"),
            ..(*run).clone()
        };
        let origin = Origin {
            commit: format!("{number:040}"),
            committed_at: Some(start + number as i64 * DAY_S),
            branch: "main".to_owned(),
            machine: Some("m".to_owned()),
            host: None,
        };
        history.add(&planted, &origin).unwrap();
    }
    let mut stored = history.stored(&Selection::default()).unwrap();
    // A stage that is not above the clock's resolution in every run is left out.
    stored.series.retain(|series| series.points.len() == runs.len());
    stored
}

/// The change points that Otava finds in each series.
fn otava(folder: &Path, stored: &StoredRuns, level: Option<&str>) -> Vec<Vec<usize>> {
    for file in history::otava::files(stored, folder.to_str().unwrap()).unwrap() {
        std::fs::write(folder.join(file.name), file.bytes).unwrap();
    }
    let mut analyze = Command::new(std::env::var("FATHOM_OTAVA").unwrap());
    analyze
        .env("OTAVA_CONFIG", folder.join(CONFIGURATION))
        .args(["analyze", GROUP, "--output", "json"]);
    if let Some(level) = level {
        analyze.args(["-P", level]);
    }
    let output = analyze.output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    let tests = text.lines().filter(|line| line.starts_with('{'));
    let found: Vec<Vec<usize>> = tests.map(change_points).collect();
    assert_eq!(found.len(), stored.series.len(), "{text}");
    found
}

fn change_points(line: &str) -> Vec<usize> {
    let tests: Value = serde_json::from_str(line).unwrap();
    let groups = tests.as_object().unwrap().values().flat_map(|groups| groups.as_array().unwrap());
    groups.map(|group| group["changes"][0]["index"].as_u64().unwrap() as usize).collect()
}

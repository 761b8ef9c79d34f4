//! Runs with faults of hardware that are made up: each ends as `docs/faults.md` says, and the next run goes on with what was measured.
//! `FATHOM_FAULT_CASES=200 cargo test --test program faults` tries so many.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::{Ends, HANGS, Place, cells, holds, own_experiment};
use fathom::record::Outcome;
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// How many random faults are tried, where the usual dozen is not enough.
const CASES: &str = "FATHOM_FAULT_CASES";
/// About as many submissions as a run of two cells makes, and as many of its allocations and of its shaders. The first cell begins after
/// 400 to 600 submissions and 50 to 60 allocations.
const SUBMISSIONS: f64 = 1_300.0;
const ALLOCATIONS: f64 = 150.0;
const SHADERS: f64 = 40.0;
/// Measuring the adapter's limits takes longer than all else: one of so many runs does.
const WITH_LIMITS: u64 = 8;

/// One of so many runs is gone on with though nothing is left of it.
const WHOLE_AND_RESUMED: u64 = 5;
/// Faults of the clock, not of the device.
const CLOCKS: [&str; 5] = ["period", "zero", "equal", "backwards", "step"];

/// The rows of the table: what makes a fault up, and with which statuses a run may end.
fn documented() -> Vec<(String, Vec<i32>)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/faults.md");
    let page = std::fs::read_to_string(path).unwrap();
    let rows = page.lines().filter_map(|line| {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [_, made_up, _, statuses] = cells[..] else { return None };
        let statuses = statuses.split(", ").map(|text| text.parse().ok());
        let statuses: Option<Vec<i32>> = statuses.collect();
        Some((made_up.trim_matches('`').to_owned(), statuses?))
    });
    rows.collect()
}

/// A number from 1 on. Half of them are among the first, by their logarithm; the others are anywhere in the run.
fn number(random: &mut impl Rng, most: f64) -> u64 {
    let logarithm = random.random_range(0.0..most.ln());
    if random.random() { logarithm.exp() as u64 } else { random.random_range(1.0..most) as u64 }
}

/// A fault of this row of the table.
fn fault(row: &str, random: &mut impl Rng) -> String {
    let (name, value) = row.split_once('=').unwrap_or((row, ""));
    let number = match (name, value) {
        ("period", _) => return format!("period={:.2}", random.random_range(1.0..83.34)),
        ("bits", _) => {
            let bits = [36, 40].choose(random).unwrap();
            return format!("period={:.2},bits={bits}", random.random_range(1.0..83.34));
        }
        ("memory", _) => number(random, ALLOCATIONS),
        ("shader", _) => number(random, SHADERS),
        (_, "N") => number(random, SUBMISSIONS),
        _ => return row.to_owned(),
    };
    format!("{name}={number}")
}

fn run(place: &Place, options: &str) -> Command {
    place.fathom(format!("run own.toml --out out --precision 10 --budget 1h {options}"))
}

fn output(command: Command) -> Output {
    assert_cmd::Command::from_std(command).timeout(HANGS).output().unwrap()
}

/// A run with a random fault, and one that goes on without it.
fn judge(seed: u64, rows: &[(String, Vec<i32>)]) {
    let mut random = Pcg64::seed_from_u64(seed);
    let (row, statuses) = &rows[seed as usize % rows.len()];
    let fault = fault(row, &mut random);
    let place = Place::new();
    place.write("own.toml", own_experiment(1));
    let limits = if seed.is_multiple_of(WITH_LIMITS) { "" } else { "--no-ceilings" };
    let mut command = run(&place, limits);
    command.env("FATHOM_FAULTS", &fault);
    let Output { status, stdout, stderr } = output(command);
    let [told, err] = [stdout, stderr].map(|text| String::from_utf8(text).unwrap());
    if err.contains(" timed frames rejected: ") {
        // So busy that most frames were impossible.
        return;
    }
    let about = format!("seed {seed}, {fault}: {status}\n{told}{err}");
    let status = status.code().unwrap_or_else(|| panic!("{about}"));
    assert!(statuses.contains(&status) && !err.contains("panicked"), "{about}");
    let is_error = |line: &&str| line.starts_with("error: ") && !line.contains("XDG_RUNTIME_DIR");
    assert_eq!(err.lines().filter(is_error).count(), usize::from(status == 2), "{about}");
    println!("seed {seed}, {fault}: {status}");
    let records = place.path("out/records.jsonl");
    let before = std::fs::read(&records).unwrap_or_default();
    let finished = if before.is_empty() { Vec::new() } else { cells(&place.path("out")) };
    let measured = finished.iter().filter(|cell| cell.measured().is_some()).count();
    for cell in &finished {
        if let Outcome::Failed { reason } = &cell.outcome {
            assert!(!reason.contains('\n') && err.contains(&cell.cell), "{about}");
        }
    }
    assert_eq!(measured == 2, status == 0, "{about}");
    if status == 0 && !seed.is_multiple_of(WHOLE_AND_RESUMED) {
        return;
    }
    let resume = if before.is_empty() { "--no-ceilings" } else { "--no-ceilings --resume" };
    let mut resume = run(&place, resume);
    // A clock stays as it is.
    let stays = CLOCKS.iter().any(|name| fault.starts_with(name));
    resume.env("FATHOM_FAULTS", if stays { &fault } else { "" });
    let told = resume.ends(0).out;
    holds(&told, &[&format!("{} cells measured", 2 - measured), &format!("{measured} kept")]);
    let after = std::fs::read(&records).unwrap();
    assert!(after.starts_with(&before), "{about}");
    assert!(cells(&place.path("out")).iter().all(|cell| cell.measured().is_some()), "{about}");
}

#[test]
fn a_run_ends_as_documented_whatever_fails_and_the_next_one_goes_on() {
    let mut rows = documented();
    // No run ends by itself where a call of the driver does not return.
    rows.retain(|(made_up, _)| made_up != "hang=N");
    assert_eq!(rows.len(), 11);
    let cases = std::env::var(CASES).map_or(12, |text| text.parse().unwrap());
    (0..cases).into_par_iter().for_each(|seed| judge(seed, &rows));
}

#[test]
fn a_fault_that_is_not_there_is_refused() {
    let place = Place::new();
    place.write("own.toml", own_experiment(1));
    run(&place, "").env("FATHOM_FAULTS", "lost=x").refused("there is no fault `lost=x`");
}

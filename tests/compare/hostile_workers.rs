//! Workers that misbehave at every step and in every way (`hostile_worker.py`): each way at the step where it is a fault, each step with
//! a few ways, and some replies with changed bytes. `FATHOM_FUZZ_CASES=1000` tries so many of these.

use std::path::Path;

use fathom::compare::store::Comparison;
use fathom::record::comparison::Side;
use rayon::prelude::*;

use super::common::{CommandOutput, Ends, Place, by_shell};

const CELLS: &str = "id = \"toy\"\ntitle = \"t\"\nsource = \"s\"\npipeline = \"p\"\nscene = \"s\"\nstages = [\"a\", \"b\"]\n[[sweep]]\nid = \"one\"\n";
/// Kilobytes of address space that fathom may have.
const MEMORY: u32 = 600_000;
/// Characters of the longest line that a worker can make fathom tell: what is kept of its standard error has 10 KiB.
const LONGEST: usize = 12_000;

/// Steps, the ways to misbehave at each, and what the fault then holds.
const CASES: [(&str, &str, &str); 13] = [
    ("start", "rubbish endless", "garbage"),
    ("hello", "rubbish other overflow null", "garbage"),
    ("prepare", "deep twice flood", "garbage"),
    ("exact", "bytes negative words", "garbage"),
    ("checks", "rubbish overflow", "garbage"),
    ("clock", "other null", "garbage"),
    // Times that cannot be are tested in `compare::launch`, damaged replies in `tests/readers`.
    ("sample", "rubbish endless negative many none-of-it", "garbage"),
    ("sample", "refused fatal", "red"),
    ("sample", "unsupported", "it does not know"),
    ("sample", "killed", "it ended with signal: 9"),
    ("sample", "failed", "it ended with exit status: 1"),
    ("sample", "ended orphan", "it ended with exit status: 0"),
    ("sample", "mute", "its output closed"),
];

/// Compares in little memory. What it tells is short, what it stores can be told again, and no process is left.
fn compare(step: &str, way: &str, seed: u64) -> (Place, CommandOutput, i32) {
    let place = Place::new();
    place.write("cells.toml", CELLS);
    // The base is asked for the clock and to quit, the head for all else.
    let side = if ["clock", "quit"].contains(&step) { Side::Base } else { Side::Head };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/compare/hostile_worker.py");
    let (script, log) = (script.display(), place.path("log"));
    let [base, head] = Side::BOTH.map(|of| {
        let way = if of == side { way } else { "usual" };
        format!("exec python3 -S -E '{script}' '{}' {step} {way} 1 {seed}", log.display())
    });
    let mut compare = place.fathom(
        "compare --gates exact,time --launches 1 --pairs 1 --seed 1 --cells-file cells.toml --out out",
    );
    compare.args(["--base-cmd", &base, "--head-cmd", &head]);
    let mut limited = by_shell(&format!("ulimit -v {MEMORY}; exec \"$0\" \"$@\""), &compare);
    let output = limited.env("MALLOC_ARENA_MAX", "1").output().unwrap();
    let status = output.status.code().unwrap_or(-1);
    let result = CommandOutput::check(output, status);
    assert!((0..=4).contains(&status), "{step} {way} {seed}: {}", result.err);
    for line in result.out.lines().chain(result.err.lines()) {
        let is_short = line.chars().count() <= LONGEST;
        assert!(is_short && !line.contains(char::is_control), "{step} {way} {seed}: {line:.1000}");
    }
    let numbers = place.read("log.processes");
    let is_left = |number: &str| Path::new("/proc").join(number).exists();
    assert!(!numbers.lines().any(is_left), "{step} {way} {seed}");
    // What is stored is read again by the other test.
    if way == "garbled" && place.path("out").exists() {
        let again = place.fathom("compare --replay out").ends(status);
        assert_eq!(again.out, result.out, "{step} {way} {seed}");
    }
    (place, result, status)
}

#[test]
fn whatever_a_worker_does_is_told_in_a_line_and_costs_nothing_else() {
    let cases = CASES
        .into_iter()
        .flat_map(|(step, ways, reason)| ways.split(' ').map(move |way| (step, way, reason)));
    cases.collect::<Vec<_>>().into_par_iter().for_each(|(step, way, reason)| {
        let (place, told, status) = compare(step, way, 0);
        assert_eq!(status, 2, "{step} {way}: {}{}", told.out, told.err);
        if ["start", "hello"].contains(&step) {
            assert!(told.error("the head build: ").contains(reason), "{way}: {}", told.err);
            return assert!(!place.path("out").exists());
        }
        let stored = Comparison::read(&place.path("out")).unwrap();
        assert!(!stored.faults.is_empty(), "{step} {way}");
        for fault in &stored.faults {
            assert!(fault.reason.contains(reason), "{step} {way}: {}", fault.reason);
        }
        // What was measured before.
        let has_exact = stored.exact.len() == 4;
        assert_eq!(has_exact, !["prepare", "exact"].contains(&step), "{step} {way}");
    });
}

/// Some of these are replies like any other.
#[test]
fn garbled_replies_and_immense_names_do_no_harm() {
    let steps = ["hello", "prepare", "exact", "checks", "clock", "sample"];
    let seeds = std::env::var("FATHOM_FUZZ_CASES").map_or(6, |text| text.parse().unwrap());
    (0..seeds).into_par_iter().for_each(|seed| {
        let step = steps[seed as usize % steps.len()];
        compare(step, "garbled", seed);
    });
    steps.into_par_iter().for_each(|step| drop(compare(step, "named", 0)));
    // At its end a worker is not waited for.
    compare("quit", "silent", 0);
}

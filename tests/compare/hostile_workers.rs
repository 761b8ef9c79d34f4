//! Workers that misbehave at every step in every way (`hostile_worker.py`): a fifth of the cases, and some replies with changed bytes.
//! `FATHOM_FUZZ_CASES=1000` tries all of them, and so many such replies.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use fathom::Catalog;
use fathom::compare::flow::{self, CompareOptions, Program};
use fathom::compare::launch::WorkerStart;
use fathom::compare::protocol::RequestKind;
use fathom::compare::store::StoredComparison;
use fathom::record::comparison::{Fault, Gate, GateSettings, Side};
use itertools::Itertools;
use rayon::prelude::*;

use super::common::{Ends, Place, Told, by_shell};

const CELLS: &str = r#"
id = "toy"
title = "t"
source = "s"
pipeline = "p"
scene = "s"
stages = ["a", "b"]
[[sweep]]
id = "one"
"#;
/// Kilobytes of address space that fathom may have.
const MEMORY: u32 = 600_000;
/// Characters of the longest line that a worker can make fathom tell: what is kept of its standard error has 10 KiB.
const LONGEST: usize = 12_000;
const EVERY: &str = "start hello prepare exact checks clock sample";

/// Steps, and which time the workers of a side are asked for one misbehaviour begins. The second `hello` is in the first launch, the
/// seventh sample in the second.
const STEPS: [(&str, u32); 10] = [
    ("start", 1),
    ("hello", 1),
    ("hello", 2),
    ("prepare", 1),
    ("exact", 1),
    ("checks", 1),
    ("clock", 1),
    ("sample", 1),
    ("sample", 7),
    ("quit", 1),
];

/// The way to misbehave, what its fault holds, and at which steps it is one; at others it is a reply like any other, or there is another
/// fault for it.
const WAYS: [(&str, &str, &str); 25] = [
    ("rubbish", "garbage", EVERY),
    ("bytes", "garbage", EVERY),
    ("endless", "garbage", EVERY),
    ("deep", "garbage", EVERY),
    ("other", "garbage", EVERY),
    ("overflow", "garbage", "start hello exact checks clock sample"),
    ("negative", "garbage", "start hello exact sample"),
    ("zero", "garbage", "sample"),
    ("great", "garbage", "hello exact sample"),
    ("small", "garbage", "hello exact sample"),
    ("words", "garbage", "hello exact checks clock sample"),
    ("null", "garbage", "hello exact checks clock sample"),
    ("many", "garbage", "sample"),
    ("none-of-it", "garbage", "sample"),
    ("named", "", ""),
    ("refused", "red", EVERY),
    ("fatal", "red", EVERY),
    ("unsupported", "it does not know", "start hello prepare exact checks sample"),
    ("killed", "it ended with signal: 9", EVERY),
    ("failed", "it ended with exit status: 1", EVERY),
    ("ended", "it ended with exit status: 0", EVERY),
    ("mute", "its output closed", EVERY),
    ("orphan", "it ended with exit status: 0", EVERY),
    ("twice", "garbage", "prepare"),
    ("flood", "garbage", "prepare"),
];

#[derive(Clone, Copy, Debug)]
struct Case {
    step: &'static str,
    at: u32,
    way: &'static str,
    seed: u64,
    /// What each fault holds; none if there need not be any.
    reason: Option<&'static str>,
}

fn cases() -> Vec<Case> {
    let all = STEPS.into_iter().enumerate().cartesian_product(WAYS.into_iter().enumerate());
    let chosen = all.filter(|((step, _), (way, _))| more().is_some() || (step + way) % 5 == 0);
    let case = |((_, (step, at)), (_, (way, reason, steps))): (
        (_, (&'static str, u32)),
        (_, (_, _, &str)),
    )| {
        let is_fault = steps.split(' ').contains(&step);
        Case { step, at, way, seed: 0, reason: is_fault.then_some(reason) }
    };
    chosen.map(case).collect()
}

fn more() -> Option<u64> {
    std::env::var("FATHOM_FUZZ_CASES").ok().map(|text| text.parse().unwrap())
}

impl Case {
    /// The base is asked for the clock and to quit, the head for all else.
    fn side(&self) -> Side {
        if ["clock", "quit"].contains(&self.step) { Side::Base } else { Side::Head }
    }

    /// The gate that the step belongs to.
    fn gate(&self) -> Gate {
        match (self.step, self.at) {
            ("clock" | "sample", _) | ("hello", 2) => Gate::Time,
            _ => Gate::Exact,
        }
    }

    /// What starts the workers of base and head.
    fn commands(&self, place: &Place) -> [String; 2] {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/compare/hostile_worker.py");
        Side::BOTH.map(|side| {
            let (script, log) = (script.display(), place.path("log"));
            let Self { step, at, seed, .. } = self;
            let way = if side == self.side() { self.way } else { "usual" };
            format!("exec python3 -S -E '{script}' '{}' {step} {way} {at} {seed}", log.display())
        })
    }

    /// Compares in little memory. What it tells is short, what it stores can be told again, and no process is left.
    fn run(&self) -> (Place, Told, i32) {
        let place = Place::new();
        place.write("cells.toml", CELLS);
        let mut compare = place.fathom(
            "compare --gates exact,time --launches 2 --pairs 2 --seed 1 --cells-file cells.toml --out out",
        );
        let [base, head] = self.commands(&place);
        compare.args(["--base-cmd", &base, "--head-cmd", &head]);
        let mut limited = by_shell(&format!("ulimit -v {MEMORY}; exec \"$0\" \"$@\""), &compare);
        let output = limited.env("MALLOC_ARENA_MAX", "1").output().unwrap();
        let status = output.status.code().unwrap_or(-1);
        let told = Told::of(output, status);
        assert!((0..=4).contains(&status), "{self:?}: {}", told.err);
        for line in told.out.lines().chain(told.err.lines()) {
            let short: String = line.chars().take(LONGEST).collect();
            assert!(short == line && !line.contains(char::is_control), "{self:?}: {short}");
        }
        assert!(!is_any_left(&place), "{self:?}");
        if place.path("out").exists() {
            let again = place.fathom("compare --replay out").ends(status);
            assert_eq!(again.out, told.out, "{self:?}");
        }
        (place, told, status)
    }

    fn check(&self) {
        let (place, told, status) = self.run();
        let Some(reason) = self.reason else { return };
        assert_eq!(status, 2, "{self:?}: {}{}", told.out, told.err);
        if self.step == "start" || (self.step, self.at) == ("hello", 1) {
            assert!(told.error("the head build: ").contains(reason), "{self:?}: {}", told.err);
            return assert!(!place.path("out").exists());
        }
        let stored = StoredComparison::read(&place.path("out")).unwrap();
        self.check_faults(&stored.faults, reason);
        self.check_kept(&stored);
    }

    fn check_faults(&self, faults: &[Fault], reason: &str) {
        assert!(faults.iter().any(|fault| fault.gate == self.gate()), "{self:?}: {faults:?}");
        for fault in faults {
            assert_eq!(fault.side, Some(self.side()), "{self:?}");
            assert!(fault.reason.contains(reason), "{self:?}: {}", fault.reason);
        }
    }

    /// What was measured before, and what does not depend on the step.
    fn check_kept(&self, stored: &StoredComparison) {
        let of_exact = ["prepare", "exact"].contains(&self.step);
        let exact = stored.exact.iter().map(|of| (of.side, &of.cell)).collect::<BTreeSet<_>>();
        assert_eq!(exact.len() == 4, !of_exact, "{self:?}: {exact:?}");
        let launches = match (self.step, self.at) {
            ("exact" | "checks", _) => 2,
            ("sample", 7) => 1,
            _ => 0,
        };
        // Without its cells a launch goes on with the control.
        let goes_on = self.step == "sample" && ["refused", "unsupported"].contains(&self.way);
        let launches = launches + usize::from(goes_on);
        assert_eq!(stored.launches.len(), launches, "{self:?}");
        assert_eq!(stored.pairs.is_empty(), launches == 0, "{self:?}");
    }
}

fn is_any_left(place: &Place) -> bool {
    let numbers = place.read("log.processes");
    numbers.lines().any(|number| Path::new("/proc").join(number).exists())
}

#[test]
fn whatever_a_worker_does_is_told_in_a_line_and_costs_nothing_else() {
    cases().par_iter().for_each(Case::check);
}

#[test]
fn garbled_replies_do_no_harm() {
    let steps = ["hello", "prepare", "exact", "checks", "clock", "sample"];
    (0..more().unwrap_or(12)).into_par_iter().for_each(|seed| {
        let step = steps[seed as usize % steps.len()];
        Case { step, at: 1, way: "garbled", seed, reason: None }.run();
    });
}

/// A worker that hangs is asked for no other reply of this kind, as its patience would be short for that too.
fn hung(step: &'static str, asked: RequestKind) {
    let case = Case { step, at: 1, way: "silent", seed: 0, reason: Some("no answer") };
    let place = Place::new();
    let patience = Duration::from_secs(1);
    let programs = case.commands(&place).map(|command| {
        let patience = command.contains("silent").then_some((asked, patience));
        let usual = WorkerStart::of_command(&command);
        Program { label: "worker".into(), start: WorkerStart { patience, ..usual } }
    });
    let options = CompareOptions {
        catalog: Catalog::builtin(),
        programs,
        cells_file: Some(place.write("cells.toml", CELLS)),
        filter: None,
        env_values: false,
        settings: GateSettings {
            launches: 2,
            pairs: 2,
            gates: vec![Gate::Exact, Gate::Time],
            ..Default::default()
        },
        out: Some(place.path("out")),
        resume: false,
        checkout: None,
    };
    let measured = flow::measure(&options, &AtomicBool::new(false), &|_| ());
    assert!(!is_any_left(&place), "{step}");
    if asked == RequestKind::Hello {
        let reason = measured.unwrap_err().to_string();
        return assert!(reason.contains("no answer to `hello` within 1 s"), "{reason}");
    }
    let stored = StoredComparison::read(&measured.unwrap()).unwrap();
    case.check_faults(&stored.faults, "no answer");
    case.check_kept(&stored);
}

#[test]
fn a_worker_that_hangs_at_any_step_is_ended() {
    use RequestKind::{Checks, Clock, Exact, Hello, Prepare, Sample};
    let steps = [
        ("hello", Hello),
        ("prepare", Prepare),
        ("exact", Exact),
        ("checks", Checks),
        ("clock", Clock),
        ("sample", Sample),
    ];
    steps.into_par_iter().for_each(|(step, asked)| hung(step, asked));
    // At its end it is not waited for.
    Case { step: "quit", at: 1, way: "silent", seed: 0, reason: None }.run();
}

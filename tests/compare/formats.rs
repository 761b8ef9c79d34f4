//! What is told of comparisons that were stored before: nothing here opens a device. The reports are compared with files
//! in `tests/golden/compare`, which `FATHOM_BLESS=1 cargo test --test compare` writes anew.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use fathom::compare::store::Comparison;
use fathom::exporters;
use fathom::judge::verdict::Verdicts;
use fathom::record::comparison::{Compared, Differs, Gate, PairStates, Side, Skip};
use fathom::record::{MachineState, Record, ThrottleReason};

use super::common::{CommandOutput, Ends, Place, fathom, holds, names};
use super::stored::*;

/// One cell for each verdict.
fn mixed() -> Stored {
    let (slow, fast, cost) = (TRACE, "tank godrays/lines", "tank shadow/depth");
    let (vague, gone, new) = (COMPOSE, "tank water/refraction", "new voxel/clear");
    let (same, wrong) = ("tank caustics/splat", "tank caustics/filter");
    let mut stored = Stored::new(&[slow, same, wrong, fast, cost, vague, gone, new])
        .configuration(1_100_000, 0.01)
        .work(slow, 100, 120)
        .counts(slow, 1.061)
        .times(slow, false, 1.05, 0.004)
        .changed(slow, Differs::Shader, "--- a/caustics/trace.wgsl\n+++ b/caustics/trace.wgsl\n@@ -7,1 +7,1 @@\n-    return 1.0; // ``` <b>\n+    return 2.0;\n")
        .same(same)
        .work(wrong, 100, 100)
        .counts(wrong, 0.98)
        .check(("caustics/filter", "rounding"), 1e-7, 2e-7)
        .check(("caustics/filter", "energy"), 0.05, 0.01)
        .times(wrong, false, 1.0, 0.004)
        .changed(wrong, Differs::Inputs, "")
        .counts(fast, 0.8)
        .check(("godrays/lines", "intensity"), 0.01, 0.2)
        .times(fast, false, 0.85, 0.01)
        .counts(cost, 1.02)
        .times(cost, false, 1.002, 0.004)
        .counted(vague)
        .times(vague, false, 1.03, 0.08)
        .fault(Gate::Time, Side::Head, Some(gone), false)
        .fault(Gate::Exact, Side::Base, Some(new), true);
    stored.header.notes.push("no timestamps".to_owned());
    stored
}

fn quiet() -> Stored {
    Stored::new(&[TRACE, COMPOSE]).same(TRACE).same(COMPOSE)
}

/// A folder `stored` with this comparison.
fn stored(comparison: Stored) -> Place {
    let place = Place::new();
    comparison.write(&place.path("stored"));
    place
}

#[track_caller]
fn replayed(place: &Place, status: i32) -> String {
    place.fathom("compare --replay stored").ends(status).out
}

/// The exit status of a comparison, and what is told of it in this format.
fn render(format: &str, stored: Stored) -> (i32, String) {
    let records = stored.lines().into_iter().map(Record::from);
    let comparison = Comparison::from_records(records).unwrap();
    let verdicts = Verdicts::judge(&comparison);
    let exporter = exporters::OF_COMPARISONS.iter().find(|exporter| exporter.name == format);
    (verdicts.status as i32, (exporter.unwrap().export)(&verdicts))
}

/// What is told of a comparison, which ends with this status.
#[track_caller]
fn replay(comparison: Stored, status: i32, printed: &[&str]) {
    let (found, text) = render("text", comparison);
    assert_eq!(found, status, "{text}");
    holds(&text, printed);
}

#[track_caller]
fn replay_all<const N: usize>(cases: [(&str, Stored, i32, &str); N]) {
    for (name, comparison, status, printed) in cases {
        println!("{name}");
        replay(comparison, status, &[printed]);
    }
}

/// Replaying, `fathom report` and `--format` give the same bytes each time.
#[test]
fn the_reports_of_a_stored_comparison_are_as_they_were() {
    let place = stored(mixed());
    // A line that a crash tore.
    let torn = "{\"record\":\"comparison\",\"kind\":\"pair\",\"laun";
    place.write("stored/records.jsonl", place.read("stored/records.jsonl") + torn);
    let first = replayed(&place, 1);
    place.write("stored/terminal.txt", &first);
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/compare");
    for name in ["terminal.txt", "summary.md", "comment.md", "junit.xml"] {
        let found = place.read(format!("stored/{name}"));
        let known = golden.join(name);
        if std::env::var_os("FATHOM_BLESS").is_some() {
            fs::write(&known, &found).unwrap();
        }
        let expected = fs::read_to_string(&known).unwrap();
        assert_eq!(found, expected, "{name}");
    }
    let files = || -> BTreeMap<String, String> {
        let names = names(&place.path("stored")).into_iter();
        names.map(|name| (name.clone(), place.read(format!("stored/{name}")))).collect()
    };
    let before = files();
    assert_eq!(before.len(), 6);
    assert_eq!(replayed(&place, 1), first);
    assert_eq!(files(), before);

    for (format, file) in [
        ("markdown", "summary.md"),
        ("comment", "comment.md"),
        ("page", "index.html"),
        ("junit", "junit.xml"),
    ] {
        let output = place.fathom(format!("compare --format {format} --replay stored")).ends(1);
        assert_eq!(output.out, before[file], "{format}");
        fs::remove_file(place.path("stored").join(file)).unwrap();
    }
    // A job's page gets the Markdown of a fresh comparison only.
    place.fathom("report stored").env("GITHUB_STEP_SUMMARY", place.path("page.md")).ends(0);
    assert!(files() == before && !place.path("page.md").exists());
    place.fathom("run --resume --out stored").refused("holds no run but other records");
}

/// The comment of a comparison, which has lines for one of a job's and a link of at most 15, beside at most five folded blocks.
fn comment(stored: Stored) -> String {
    let (_, comment) = render("comment", stored);
    let mut parts = comment.split("<details>");
    assert!(parts.next().unwrap().trim_end().lines().count() <= 13, "{comment}");
    for (number, part) in parts.enumerate() {
        assert!(number < 5 && part.trim_end().ends_with("</details>"), "{comment}");
    }
    comment
}

#[test]
fn a_comment_stays_short_and_begins_with_what_is_worst() {
    let names: Vec<String> = (0..40).map(|number| format!("tank stage-{number}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let all = names.iter().zip(0..).fold(Stored::new(&names), |stored, (name, number)| {
        let stored = stored.same(name).counts(name, 1.05 + 0.01 * f64::from(number));
        stored.changed(name, Differs::Shader, &format!("-{}\n+b\u{1b}[2J\n", number / 2))
    });
    let comment = comment(all);
    let lines: Vec<&str> = comment.lines().collect();
    assert_eq!(lines[0], "### ❌ fathom compare: regression");
    assert!(lines[2].starts_with("quiet: launches of the median cell scatter by "), "{comment}");
    assert!(lines[2].ends_with(". 40 cells: 40 costlier"), "{comment}");
    assert!(lines[4].starts_with("- `tank stage-39`: costlier: "), "{comment}");
    assert!(lines[4].ends_with("; instructions +44.00 %; its shader differs"), "{comment}");
    // Five cells of three shaders.
    assert_eq!(comment.matches("```diff\n").count(), 3);
    assert!(comment.contains("</summary>\n\n```diff\n-19\n+b�[2J\n```\n"), "{comment}");
    assert_eq!(lines[9], "- and 35 more");
}

/// What scatters is told before what follows from it, in each form.
#[test]
fn noise_is_told_before_the_verdicts() {
    let vague = |spread| {
        let stored = Stored::new(&[TRACE, COMPOSE]).counted(TRACE).counted(COMPOSE);
        stored.times(TRACE, false, 1.0, spread).times(COMPOSE, false, 1.06, spread)
    };
    let moved = vague(0.004).without(|line| matches!(line, Compared::Pair(pair) if pair.control));
    for (comparison, status, noise) in [
        (
            vague(0.004),
            1,
            "quiet: launches of the median cell scatter by 0.3 %; in half of the cells a slowdown below 2.2 % can go unseen",
        ),
        (vague(0.1), 3, "noisy: launches of the median cell scatter by 6."),
        (moved.times(TRACE, true, 1.06, 0.004), 2, "times cannot be used: the control "),
    ] {
        for format in ["text", "markdown", "comment"] {
            let (found, text) = render(format, comparison.clone());
            assert_eq!(found, status, "{text}");
            let (before, after) = text.split_once(noise).unwrap_or_else(|| panic!("{text}"));
            assert!(!before.contains("tank ") && after.contains("tank "), "{text}");
        }
    }
}

#[test]
fn the_exit_status_tells_how_it_ended() {
    let two = || Stored::new(&[TRACE, COMPOSE]).same(TRACE);
    let faster = Stored::new(&[TRACE, COMPOSE]).same(COMPOSE).counted(TRACE);
    let faster = faster.times(TRACE, false, 0.9, 0.004).configuration(BYTES, 0.02);
    let slower = two().counts(COMPOSE, 1.0).times(COMPOSE, false, 1.05, 0.004);
    let vague = |ratio| two().counted(COMPOSE).times(COMPOSE, false, ratio, 0.08);
    let faster_if_anything = "0 of 1 inconclusive cells may be slower by more than 2.0 %";
    let failed = two().fault(Gate::Time, Side::Head, Some(COMPOSE), false);
    let new = two().fault(Gate::Exact, Side::Base, Some(COMPOSE), true);
    replay_all([
        ("same", quiet(), 0, "no regression; 2 cells: 2 same"),
        ("slower", slower, 1, "tank compose: slower: time +5.0 %"),
        ("more bytes", quiet().configuration(BYTES + 1, 0.01), 1, "allocated_bytes"),
        ("larger error", quiet().configuration(BYTES, 0.02), 1, "caustics/trace: less accurate"),
        ("faster", faster, 1, "tank caustics/trace: faster but less accurate"),
        ("smaller error", quiet().configuration(BYTES, 0.005), 0, "0.0100 → 0.0050"),
        ("inconclusive", vague(1.03), 3, "1 inconclusive"),
        ("faster if anything", vague(0.96), 0, faster_if_anything),
        ("failed", failed, 2, "could not measure"),
        ("new", new, 0, "1 same, 1 new"),
    ]);
}

#[test]
fn a_change_that_one_of_many_cells_shows_by_chance_is_called_so() {
    let names: Vec<String> = (0..65).map(|number| format!("tank stage/{number}")).collect();
    let cells: Vec<&str> = names.iter().map(String::as_str).collect();
    let stored = Stored::new(&cells).gates(&[Gate::Time]);
    let ratio = |name: &str| if name == cells[0] { 1.06 } else { 1.001 };
    let stored = cells.iter().fold(stored, |all, name| all.times(name, false, ratio(name), 0.004));
    replay(stored, 3, &["), not beyond chance among 65 cells", "1 inconclusive, 64 same"]);
}

#[test]
fn a_gate_without_usable_figures_is_void() {
    let is_control = |line: &Compared| matches!(line, Compared::Pair(pair) if pair.control);
    let is_time = |line: &Compared| matches!(line, Compared::Pair(_) | Compared::Launch(_));
    let moved = |stored: Stored| {
        let stored = stored.without(is_control).times(TRACE, true, 1.06, 0.004);
        stored.times(TRACE, false, 1.06, 0.004)
    };
    let one = || Stored::new(&[TRACE]);
    let mut skipped = quiet().gates(&[Gate::Exact, Gate::Time]);
    let reason = "valgrind is not installed".to_owned();
    skipped.header.skipped.push(Skip { gate: Gate::Instructions, reason });
    let skipped = skipped.without(|line| matches!(line, Compared::Instructions(_)));
    let lost = quiet().time_fault(Some(TRACE), LAUNCHES);
    let unmeasured = quiet().without(is_control);
    let no_time = quiet().fault(Gate::Time, Side::Base, None, false).without(is_time);
    // The other gates hold.
    let control_moved = &["time gate void: the control", "1 cell: 1 same"];
    replay(moved(one().counted(TRACE)), 2, control_moved);
    replay_all([
        ("no other gate", moved(one().gates(&[Gate::Time])), 2, "1 cell: 1 not measured"),
        ("control lost", lost, 2, "time gate void: the control was lost: it ended with signal"),
        ("no control", unmeasured, 2, "time gate void: the control was not measured"),
        ("nothing timed", no_time, 2, "time gate void: it ended with signal"),
        // What is not possible here is no failure.
        ("not possible", skipped, 0, "instructions gate skipped: valgrind is not installed"),
    ]);
}

#[test]
fn what_was_not_measured_is_not_the_same_and_what_was_overcome_or_cut_short_does_not_count() {
    let one = || Stored::new(&[TRACE]).work(TRACE, 1, 1);
    let uncounted = one().times(TRACE, false, 1.0, 0.004).counts(COMPOSE, 1.0);
    let ended = |interrupted| Stored { interrupted, ..quiet() };
    let overcome = quiet()
        .fault(Gate::Time, Side::Base, None, false)
        .fault(Gate::Instructions, Side::Head, Some(COMPOSE), false)
        .fault(Gate::Exact, Side::Head, None, false)
        .check(("compose", "energy"), 0.01, 0.01);
    let mut cut_short = quiet();
    let torn = (0..500).map(|round| Compared::Pair(pair(LAUNCHES, round, COMPOSE, 2.0)));
    cut_short.lines.extend(torn);
    replay_all([
        ("uncounted", uncounted, 2, "1 not measured"),
        ("killed", ended(None), 2, "could not measure; 2 cells: 2 same"),
        ("interrupted", ended(Some(true)), 2, "could not measure; 2 cells: 2 same"),
        ("asked for less", one().gates(&[Gate::Exact]), 0, "1 same"),
        ("overcome", overcome, 0, "no regression; 2 cells: 2 same"),
        ("cut short", cut_short, 0, "no regression; 2 cells: 2 same"),
    ]);
}

#[test]
fn figures_that_vanish_are_faults_and_notes_are_printed_once() {
    let mut comparison = quiet();
    for line in &mut comparison.lines {
        match line {
            Compared::Configuration(figures) if figures.side == Side::Head => {
                figures.errors.clear();
                figures.notes.push("errors not computed: no reference".to_owned());
            }
            Compared::Launch(launch) => launch.notes.push("on any core: no Linux".to_owned()),
            _ => {}
        }
    }
    let (status, text) = render("text", comparison.clone());
    assert_eq!(status, 2);
    for part in [
        "the head does not give caustics_photon_error_median_m of tank",
        "head: tank: errors not computed: no reference",
        "time gate: on any core: no Linux",
    ] {
        assert_eq!(text.matches(part).count(), 1, "{part}: {text}");
    }
    holds(
        &render("junit", comparison).1,
        &["<testcase name=\"exact fault 1\" classname=\"gate\">"],
    );
}

#[test]
fn damaged_and_foreign_files_are_named() {
    let place = stored(quiet());
    let whole = place.read("stored/records.jsonl");
    let damaged = whole.replacen("\"kind\":\"exact\"", "\"kind\":\"exotic\"", 1);
    place.write("stored/records.jsonl", damaged);
    holds(&replayed(&place, 2), &["left out: line ", "1 not measured, 1 same"]);

    let schema = format!("\"schema\":{}", fathom::record::SCHEMA);
    let other_format = whole.replacen(&schema, "\"schema\":9", 1);
    let (_, headless) = whole.split_once('\n').unwrap();
    for (text, reason) in [(other_format.as_str(), "format 9"), (headless, "no readable header")] {
        place.write("stored/records.jsonl", text);
        place.fathom("compare --replay stored").refused(reason);
    }
    fs::remove_file(place.path("stored/records.jsonl")).unwrap();
    place.fathom("compare --replay stored").refused("no comparison in ");
}

#[test]
fn bad_input_is_one_clear_line_and_status_2() {
    for (options, reason) in [
        ("", "nothing to compare with"),
        ("--base no-such-revision", "unknown revision `no-such-revision`"),
        ("--head-env LP_NUM_THREADS=2", "LP_NUM_THREADS is fathom's own"),
        ("--base-bin no/such/program", "no/such/program"),
        ("--base-bin x --gates exakt", "gates are exact, instructions, time"),
        ("--base-bin x --threshold 2", "a share lies between 0 and 1"),
        ("--base-bin x --cells nosuchcell", "no gate cell matches"),
        ("--base-bin x --launches 0", "0 is not in 1..=200"),
        ("--base-bin x --resume", "--out"),
        ("one.jsonl", "2 values required"),
        ("one.jsonl two.jsonl", "one.jsonl"),
    ] {
        fathom(format!("compare {options}")).refused(reason);
    }
}

/// On a software driver neither exact figures nor times are of what the host does; of stages they are.
#[test]
fn cells_that_no_gate_measures_are_refused_before_anything_is_written() {
    let place = Place::new();
    let base = ["--base-bin", env!("CARGO_BIN_EXE_fathom")];
    let mut compare = place.fathom("compare --gates exact,time --cells create --out out");
    compare.args(base).refused("none of the gates that run here measures that");
    assert!(!place.path("out").exists());
    let mut compare = place.fathom("compare --gates exact --cells voxel/alpha --out out");
    let CommandOutput { out, .. } = compare.args(base).ends(0);
    assert!(out.contains("alpha voxel/alpha") && !out.contains("encode:"), "{out}");
}

/// The law itself is tested in `judge::time`.
#[test]
fn a_slowdown_while_the_head_was_throttled_is_a_regression_that_says_so() {
    let stored = Stored::new(&[TRACE, COMPOSE]).same(TRACE).counted(COMPOSE);
    let mut stored = stored.times(COMPOSE, false, 1.05, 0.004);
    let throttle = vec![ThrottleReason::SwThermalSlowdown];
    let head = Some(MachineState { throttle, ..MachineState::default() });
    for line in &mut stored.lines {
        if let Compared::Pair(pair) = line
            && pair.cell.as_str() == COMPOSE
            && pair.launch < 4
        {
            pair.machine = PairStates { base: None, head: head.clone() };
        }
    }
    let of_head = [
        "clocks throttled (sw thermal slowdown) in 0 of 10 launches of the base and 4 of the head",
        "of the head: more often on the slower side, so throttling may be the cause",
        "while 1 of 2 cells were timed; 1 of these are slower with more throttled launches",
    ];
    let junit = render("junit", stored.clone()).1;
    holds(&junit, &["more often on the slower side"]);
    replay(stored, 1, &of_head);
}

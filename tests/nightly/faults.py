#!/usr/bin/env python3
"""Puts faults into the sources, one at a time, and runs a test that must find each: `tests/nightly/faults.py [NUMBER …]`.

The sources must be as they were committed. Each is put back, whatever happens. A fault in Rust builds what depends on it.
"""
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIB = ["--lib"]
PIPELINES, PROGRAM = ["--test", "pipelines"], ["--test", "program"]

# Area, file, what stands there, what is put there, targets that are tested, the test's name or a part of it.
FAULTS = [
    ("scene: a box with a side turned inwards", "src/scene/shapes.rs",
     "[p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)]", "[p(0, 0, 1), p(1, 0, 1), p(1, 0, 0), p(0, 0, 0)]", LIB, "solids_are_closed"),
    ("scene: waves slope the wrong way", "src/scene/water.rs",
     "let wave = -phase.sin()", "let wave = phase.sin()", LIB, "water::tests::gradient_matches_differences"),
    ("stages: a slice in the wrong bit", "shaders/voxel/slicemap.wgsl",
     "1u << (slice & 31u)", "1u << (slice & 15u)", PIPELINES, "every_check_is_sound"),
    ("stages: slices in half of their bits", "shaders/voxel/slice.wgsl",
     "word |= 1u << bit;", "word |= 1u << (bit & 15u);", PIPELINES, "every_check_is_sound"),
    ("gates: no correction for many cells", "src/judge/rank.rs",
     "(left * probabilities[*index])", "(left.signum() * probabilities[*index])", LIB, "false_alarms_anywhere_in_a_gate"),
    ("gates: a threshold nine times as high", "src/judge/counts.rs",
     "if ratio > 1.0 + threshold &&", "if ratio > 1.0 + 9.0 * threshold &&", LIB, "two_percent_more_is_a_change"),
    ("report: the interval's end for the median", "src/report/bencher.rs",
     '"value": time.median', '"value": time.ends()[0]', LIB, "it_is_as_documented_and_holds_medians"),
    ("report: per mille called per cent", "src/report/format.rs",
     "three(share * 100.0)", "three(share * 1000.0)", LIB, "shares_are_told_in_percent"),
    ("compare: a resumed comparison takes any settings", "src/compare/settings.rs",
     "before.get(*name) != asked.get(*name)", "asked.get(*name).is_some_and(Value::is_null)", LIB, "whatever_differs_is_refused"),
    ("compare: pairs that name the wrong side as first", "src/compare/launches.rs",
     "first: if base_first { Side::Base }", "first: if !base_first { Side::Base }", LIB, "the_two_samples_of_a_pair"),
    ("history: change points where there are none", "src/judge/change_points.rs",
     "split.p <= LEVEL)", "split.p <= 5.0 * LEVEL)", LIB, "stable_series_have_few_false_points"),
    ("command line: an interrupt passes for success", "src/cli/commands.rs",
     "_ if summary.end.interrupted => ExitCode::from(INTERRUPTED),", "_ if summary.end.interrupted => ExitCode::SUCCESS,",
     PROGRAM, "a_kill_at_any_moment"),
]


def finds(targets, tests):
    """Whether a test fails; it must be built and run."""
    command = ["cargo", "test", "--locked", "--workspace", *targets]
    built = subprocess.run([*command, "--no-run"], cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    ran = subprocess.run([*command, "--no-fail-fast", "--", *tests.split()], cwd=ROOT, capture_output=True, text=True)
    assert "running 1 test" in ran.stdout or "running 2 tests" in ran.stdout, f"no test is named {tests}"
    return ran.returncode != 0


def put(fault):
    area, name, before, after, targets, tests = fault
    path = ROOT / name
    text = path.read_text()
    assert text.count(before) == 1, f"{name} holds `{before}` {text.count(before)} times"
    try:
        path.write_text(text.replace(before, after))
        found = finds(targets, tests)
    finally:
        path.write_text(text)
    print(f"{'found' if found else 'MISSED'}  {area}: {tests}", flush=True)
    return found


chosen = [FAULTS[int(number) - 1] for number in sys.argv[1:]] or FAULTS
sys.exit(0 if all([put(fault) for fault in chosen]) else 1)

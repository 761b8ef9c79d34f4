//! The adapter's limits as users see them: the law of doubled work, a software driver's copies beside the CPU's, and the shares of
//! a run's stages.

mod common;

use std::path::Path;
use std::process::Command;
use std::sync::{Mutex, PoisonError};

use common::{cells, fathom, measured, records, small};
use fathom::record::{Ceiling, Record, Run};
use serde_json::Value;

/// Two measurements at once would disturb each other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
/// A busy machine may spoil a measurement, and another one may be better.
const ATTEMPTS: usize = 3;
/// Half the width of the interval around 1 in which the adapter's copies and the CPU's agree.
const AGREEMENT: f64 = 0.10;
/// From here on copying takes much longer than the command that asks for it.
const LEAST_SET_BYTES: u64 = 1 << 20;

fn answer() -> (Vec<Ceiling>, Vec<Value>) {
    let output = fathom().args(["ceilings", "--json"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let ceilings = serde_json::from_value(answer["ceilings"].clone()).unwrap();
    (ceilings, answer["copies"].as_array().unwrap().clone())
}

/// The median over the working sets of the adapter's rate over the CPU's; none on a GPU.
fn agreement(copies: &[Value]) -> Option<f64> {
    let large = |copy: &&Value| copy["working_set_bytes"].as_u64() >= Some(LEAST_SET_BYTES);
    let ratios = copies.iter().filter(large).filter_map(|copy| copy["ratio"]["median"].as_f64());
    let ratios: Vec<f64> = ratios.collect();
    (!ratios.is_empty()).then(|| fathom::statistics::median(&ratios))
}

#[test]
fn doubled_work_takes_twice_the_time_and_copies_are_as_fast_as_the_cpu() {
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let mut unsound = Vec::new();
    let mut agreements = Vec::new();
    for _ in 0..ATTEMPTS {
        let (ceilings, copies) = answer();
        assert!(ceilings.iter().all(|ceiling| ceiling.rate.interval.is_some()));
        let of_try = ceilings.iter().filter(|ceiling| !ceiling.is_sound());
        let of_try: Vec<String> = of_try.map(|ceiling| ceiling.limit.name()).collect();
        // What was sound once obeys the law.
        if agreements.is_empty() {
            unsound = of_try;
        } else {
            unsound.retain(|name| of_try.contains(name));
        }
        agreements.push(agreement(&copies));
        let agrees = |ratio: &Option<f64>| ratio.is_none_or(|r| (r - 1.0).abs() <= AGREEMENT);
        if unsound.is_empty() && agreements.iter().any(agrees) {
            return;
        }
    }
    panic!("doubled work does not take twice the time: {unsound:?}; adapter / CPU: {agreements:?}");
}

fn run(out: &Path) -> Command {
    let mut command = fathom();
    command.args(["run", "uw-default", "--budget", "2", "--out"]).arg(out).args(small());
    command
}

fn header(record: Record) -> Option<Run> {
    if let Record::Run(run) = record { Some(*run) } else { None }
}

#[test]
fn stages_have_shares_and_a_resumed_run_keeps_the_ceilings() {
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    assert!(run(&out).status().unwrap().success());
    let cells = cells(&out);
    let stages: Vec<_> = cells.iter().flat_map(|cell| &measured(cell).stages).collect();
    let shares: Vec<f64> =
        stages.iter().filter_map(|stage| Some(stage.ceiling.as_ref()?.share)).collect();
    assert!(shares.len() > stages.len() / 2, "{} of {} stages", shares.len(), stages.len());
    assert!(shares.iter().all(|share| *share > 0.0));
    assert!(stages.iter().all(|stage| stage.ceiling.as_ref().is_none_or(|c| !c.is_impossible())));
    assert!(
        run(&out).args(["--resume", "--set", "water.amplitude_m=0"]).status().unwrap().success()
    );
    let runs: Vec<Run> = records(&out).into_iter().filter_map(header).collect();
    let [first, .., last] = &runs[..] else { panic!("{} runs", runs.len()) };
    assert!(!first.ceilings.is_empty());
    // The processes may have been put on different cores, whose limits are measured anew.
    if first.conditions == last.conditions && first.clocks == last.clocks {
        assert_eq!(first.ceilings, last.ceilings);
    }
}

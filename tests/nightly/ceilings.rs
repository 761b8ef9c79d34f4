//! The adapter's limits as users see them. What is tested here holds on a machine of any speed and load: that an answer agrees with
//! itself. The laws themselves are tested on modelled clocks (`gpu::ceilings::tests`, `harness::ceilings`).

use super::common::{CommandOutput, Place, SMALL, cells, records};
use fathom::record::{Outcome, Record};

/// All cells are measured, or what failed is told: a stage beyond a ceiling that a busy machine made too low.
#[track_caller]
fn run(place: &Place, options: &str) {
    let words = format!(
        "run uw-default --cell base --budget 10m --precision 1 --out run {SMALL} {options}"
    );
    let output = place.fathom(words).output().unwrap();
    let beyond = |outcome: &Outcome| match outcome {
        Outcome::Failed { reason } => reason.contains(" of what the adapter can do ("),
        _ => false,
    };
    let cells = cells(&place.path("run"));
    let failed = cells.iter().filter(|cell| cell.measured().is_none());
    let reasons: Vec<&Outcome> = failed.map(|cell| &cell.outcome).collect();
    assert!(reasons.iter().all(|outcome| beyond(outcome)), "{reasons:?}");
    CommandOutput::check(output, i32::from(!reasons.is_empty()));
}

#[test]
fn stages_have_shares_and_a_resumed_run_keeps_the_ceilings() {
    let place = Place::new();
    run(&place, "");
    run(&place, "--resume --set water.amplitude_m=0");
    let out = place.path("run");
    let runs: Vec<_> = records(&out).into_iter().filter_map(Record::try_as_run).collect();
    let [first, last] = &runs[..] else { panic!("{} runs", runs.len()) };
    assert!(runs.iter().all(|run| !run.ceilings.is_empty()));
    // The processes may have been put on different cores, whose limits are measured anew.
    if first.conditions == last.conditions && first.clocks == last.clocks {
        assert_eq!(first.ceilings, last.ceilings);
    }
    let cells = cells(&out);
    assert_eq!(cells.len(), 2);
    let measured = cells.iter().filter_map(|cell| cell.measured());
    let mut shares =
        measured.flat_map(|measured| &measured.stages).filter_map(|stage| stage.ceiling.as_ref());
    assert!(shares.all(|share| share.share > 0.0 && !share.is_impossible()));
}

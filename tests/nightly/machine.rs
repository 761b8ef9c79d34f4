//! The adapter's limits, which take half a minute, and the doctor. What is tested here holds on a machine of any speed and
//! load: that an answer agrees with itself.

use fathom::record::Ceiling;
use fathom::record::ceilings::Bounded;
use serde_json::Value;

use super::common::{Place, fathom, names};

/// Bounds of a sound doubling, as `docs/ceilings.md` has them.
const DOUBLING: std::ops::Range<f64> = 1.7..2.4;

#[test]
fn what_breaks_its_law_is_named_and_makes_the_status() {
    let output = fathom("ceilings --json").output().unwrap();
    let answer: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{output:?}"));
    let ceilings: Vec<Ceiling> = serde_json::from_value(answer["ceilings"].clone()).unwrap();
    for ceiling in &ceilings {
        let [low, high] = ceiling.rate.ends();
        assert!(ceiling.rate.interval.is_some() && ceiling.rate.n == 7, "{ceiling:?}");
        assert!(0.0 < low && low <= ceiling.rate.median && ceiling.rate.median <= high);
    }
    let bounds = |kind| move |ceiling: &Ceiling| ceiling.limit.bounds(kind, 1);
    assert!(Bounded::ALL.into_iter().all(|kind| ceilings.iter().any(bounds(kind))));
    let broken = ceilings.iter().filter(|ceiling| !DOUBLING.contains(&ceiling.doubling));
    let expected: Vec<String> = broken.map(|ceiling| ceiling.limit.name()).collect();
    let unsound: Vec<String> = serde_json::from_value(answer["unsound"].clone()).unwrap();
    assert_eq!(unsound, expected);
    assert_eq!(output.status.code(), Some(i32::from(!unsound.is_empty())));
}

/// How fit this machine is changes from hour to hour; that the status follows from the findings does not.
#[test]
fn a_doctor_tells_what_it_found_and_its_status_follows() {
    let place = Place::new();
    let output = place.fathom("doctor --json --quiet").output().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let findings = report["findings"].as_array().unwrap();
    for subject in ["adapter", "clock", "asset", "valgrind"] {
        assert!(
            findings.iter().any(|finding| finding["subject"] == subject),
            "{subject}: {report}"
        );
    }
    let has = |level: &str| findings.iter().any(|finding| finding["level"] == level);
    let status = if has("fault") { 2 } else { i32::from(has("warning")) };
    assert_eq!(output.status.code(), Some(status), "{report}");
    assert!(names(&place.path("")).is_empty());
}

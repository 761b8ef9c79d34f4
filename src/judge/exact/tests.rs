use super::*;
use fathom_record::Record;
use fathom_record::comparison::{CheckFigure, Compared};

fn figures(side: Side, errors: &[(&str, f64)]) -> Compared {
    let named = |(name, error): &(&str, f64)| ((*name).to_owned(), *error);
    Compared::Configuration(ConfigurationFigures {
        side,
        configuration: "c".to_owned(),
        allocated_bytes: 1,
        errors: errors.iter().map(named).collect(),
        judged: errors.iter().filter_map(|(name, error)| judged(name, *error)).collect(),
        quantities: BTreeMap::new(),
        notes: Vec::new(),
    })
}

/// What each known error judges.
fn judged(name: &str, value: f64) -> Option<ErrorFigure> {
    let error = |stage| ErrorFigure::new(name, value, "1", stage);
    match name {
        "caustics_photon_error_median_m" => Some(error("caustics/trace")),
        "ao_rmse" => Some(error("hsao/march")),
        "ao_filtered_rmse" => Some(error("hsao/filter").with_prefix("ao_rmse")),
        _ => None,
    }
}

fn check(side: Side, what: &str) -> Compared {
    let check = CheckReading {
        stage: "hsao/march".to_owned(),
        what: what.to_owned(),
        unit: "1".to_owned(),
        measured: 0.0,
        tolerance: 1.0,
        sound: true,
    };
    Compared::Check(CheckFigure { side, check })
}

fn counters(side: Side, counters: &[(&str, u64)]) -> Compared {
    let named = |(name, count): &(&str, u64)| ((*name).to_owned(), *count);
    Compared::Exact(ExactFigures {
        side,
        cell: CellId::new("c", "hsao/march"),
        work: fathom_record::Work::default(),
        counters: counters.iter().map(named).collect(),
    })
}

/// The lines, as their file gives them back.
fn comparison(lines: Vec<Compared>) -> Comparison {
    let header = Compared::Header(Box::default());
    let records = std::iter::once(header).chain(lines).map(Record::from);
    let stored = records.map(|record| {
        let text = serde_json::to_string(&record).unwrap();
        serde_json::from_str(&text).unwrap()
    });
    Comparison::from_records(stored.collect::<Vec<_>>()).unwrap()
}

/// What a configuration's errors are on both sides.
fn errors(base: &[(&str, f64)], head: &[(&str, f64)]) -> Vec<Compared> {
    vec![figures(Side::Base, base), figures(Side::Head, head)]
}

/// Who is charged with the errors that grew, in a pipeline of these stages.
fn charged_with(stages: &[&str], base: &[(&str, f64)], head: &[(&str, f64)]) -> Vec<String> {
    let mut comparison = comparison(errors(base, head));
    comparison.header.cells = stages.iter().map(|stage| CellId::new("c", stage)).collect();
    let charged = |difference: Difference| {
        assert!(difference.worse, "{difference:?}");
        match difference.scope {
            DifferenceScope::Cell(cell) => cell.stage().to_owned(),
            other => format!("{other:?}"),
        }
    };
    judge(&comparison).into_iter().map(charged).collect()
}

#[test]
fn an_error_is_charged_to_the_stage_whose_output_it_judges() {
    let name = "caustics_photon_error_median_m";
    let (base, head) = ([(name, 0.001)], [(name, 0.003)]);
    let stages = ["caustics/trace", "caustics/splat", "caustics/filter"];
    assert_eq!(charged_with(&stages, &base, &head), ["caustics/trace"]);
    let whole = ["Configuration(\"c\")"];
    assert_eq!(charged_with(&stages[1..], &base, &head), whole);
    let unknown = charged_with(&stages, &[("new_rmse", 0.1)], &[("new_rmse", 0.2)]);
    assert_eq!(unknown, whole);
}

#[test]
fn what_a_filter_is_handed_is_not_its_error() {
    let stages = ["hsao/march", "hsao/filter"];
    let errors = |raw, filtered| [("ao_rmse", raw), ("ao_filtered_rmse", filtered)];
    let base = errors(0.10, 0.05);
    let charged = |raw, filtered| charged_with(&stages, &base, &errors(raw, filtered));
    assert_eq!(charged(0.12, 0.06), ["hsao/march", "hsao/march"]);
    assert_eq!(charged(0.10, 0.06), ["hsao/filter"]);
    assert_eq!(charged(0.12, 0.05), ["hsao/march"]);
}

#[test]
fn an_error_that_is_no_number_is_worse_than_any() {
    let of = |base: f64, head: f64| {
        let found = judge(&comparison(errors(&[("a_error", base)], &[("a_error", head)])));
        found.first().map(|difference| difference.worse)
    };
    assert_eq!(of(0.1, f64::NAN), Some(true));
    assert_eq!(of(f64::NAN, 0.1), Some(false));
    assert_eq!(of(f64::NAN, f64::INFINITY), None);
}

#[test]
fn what_the_head_lacks_is_its_fault_and_what_the_base_lacks_is_new() {
    let mut lines = errors(&[("a_error", 0.1)], &[("b_error", 0.1)]);
    use Side::{Base, Head};
    for (side, what) in [(Base, "kept"), (Base, "gone"), (Head, "kept"), (Head, "new")] {
        lines.push(check(side, what));
    }
    let mut comparison = comparison(lines);
    let reasons = |comparison: &Comparison| {
        let faults = missing(comparison).into_iter();
        faults.map(|fault| fault.reason).collect::<Vec<_>>()
    };
    let head = ["the head does not give a_error of c", "the head does not give gone of hsao/march"];
    assert_eq!(reasons(&comparison), head);
    comparison.damaged.push("line 3".to_owned());
    assert_eq!(reasons(&comparison)[2..], ["the base does not give new of hsao/march"]);
}

#[test]
fn a_counter_that_one_side_lacks_is_0_where_that_side_counts() {
    let found = |head: &[(&str, u64)]| {
        let base = counters(Side::Base, &[("vertices", 3), ("clips", 2)]);
        let found = judge(&comparison(vec![base, counters(Side::Head, head)])).into_iter();
        found.map(|change| (change.figure, change.base, change.head)).collect::<Vec<_>>()
    };
    assert_eq!(found(&[]), []);
    let expected = [("clips".to_owned(), 2.0, 0.0), ("fragments".to_owned(), 0.0, 9.0)];
    assert_eq!(found(&[("vertices", 3), ("fragments", 9)]), expected);
}

#[test]
fn of_lines_that_were_stored_twice_the_last_holds() {
    let lines = [0.3, 0.2].map(|head| errors(&[("a_error", 0.1)], &[("a_error", head)]));
    let found = judge(&comparison(lines.concat()));
    assert_eq!(found.iter().map(|difference| difference.head).collect::<Vec<_>>(), [0.2]);
}

#[test]
fn counters_of_another_driver_are_reported_and_not_judged() {
    let lines = || {
        [(Side::Base, 100), (Side::Head, 120)].map(|(side, n)| counters(side, &[("fragments", n)]))
    };
    let mut stored = comparison(lines().to_vec());
    let worse = |stored: &Comparison| judge(stored).iter().map(|d| d.worse).collect::<Vec<_>>();
    assert_eq!(worse(&stored), [true]);
    let other = |driver: &str, driver_info: &str| {
        let (driver, driver_info) = (driver.to_owned(), driver_info.to_owned());
        Some(fathom_record::Adapter { driver, driver_info, ..Default::default() })
    };
    stored.header.base_adapter = other("", "another version");
    assert_eq!(worse(&stored), [true]);
    stored.header.base_adapter = other("another", "");
    assert_eq!(worse(&stored), [false]);
}

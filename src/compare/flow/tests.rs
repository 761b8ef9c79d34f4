use super::super::store::{Launch, Pair};
use super::*;
use crate::record::Lines;

fn fault(launch: u32, cell: &CellId, control: bool) -> Line {
    Line::Fault(Fault {
        gate: Gate::Time,
        side: Some(Side::Head),
        cell: Some(cell.clone()),
        launch: Some(launch),
        control,
        absent: false,
        reason: "gone".to_owned(),
    })
}

fn pair(launch: u32, cell: &CellId) -> Line {
    Line::Pair(Pair {
        launch,
        round: 0,
        cell: cell.clone(),
        control: false,
        second: false,
        first: Side::Base,
        base_ns: 1.0,
        head_ns: 1.0,
    })
}

fn launch(launch: u32) -> Line {
    Line::Launch(Launch { launch, wall_s: 1.0, second: false, notes: Vec::new() })
}

fn end(interrupted: bool) -> Line {
    Line::End(End { wall_s: 20.0, interrupted })
}

fn comparison(lines: Vec<Line>) -> Comparison {
    let header = include_str!("../tests/header.json");
    let header = serde_json::from_str(header).unwrap();
    Comparison::from_lines(Lines {
        lines: std::iter::once(header).chain(lines).collect(),
        damaged: Vec::new(),
    })
    .unwrap()
}

#[test]
fn a_torn_launch_keeps_its_number() {
    let cell = CellId::new("c", "s");
    let torn = vec![pair(0, &cell), launch(0), pair(1, &cell)];
    let comparison = comparison(torn);
    assert_eq!(comparison.pairs.len(), 1);
    let before = timed_before(&comparison, false);
    assert_eq!((before.complete, before.last), (1, Some(1)));
}

#[test]
fn what_failed_before_an_interruption_is_tried_again() {
    let [first, second] = ["a", "b"].map(|stage| CellId::new("c", stage));
    let lines = vec![
        fault(0, &first, false),
        fault(0, &first, true),
        end(true),
        fault(1, &second, false),
        end(false),
    ];
    let comparison = comparison(lines);
    let before = timed_before(&comparison, false);
    assert_eq!(before.lost.into_iter().collect::<Vec<_>>(), [second]);
    assert!(!before.control_lost);
    assert_eq!(comparison.end.unwrap().wall_s, 40.0);
}

#[test]
fn launches_of_the_second_measurement_are_counted_apart() {
    let second = |number| match launch(number) {
        Line::Launch(launch) => Line::Launch(Launch { second: true, ..launch }),
        other => other,
    };
    let comparison = comparison(vec![launch(0), launch(1), launch(2), second(3), second(4)]);
    for (of_second, complete) in [(false, 3), (true, 2)] {
        let before = timed_before(&comparison, of_second);
        assert_eq!((before.complete, before.last), (complete, Some(4)));
    }
}

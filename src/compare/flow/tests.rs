use super::*;
use fathom_record::comparison::{Launch, Pair};

fn fault(launch: u32, cell: &CellId, control: bool) -> Compared {
    let fault = Fault::new(Gate::Time, Some(Side::Head), Some(cell.clone()), "gone");
    Compared::Fault(Fault { launch: Some(launch), control, ..fault })
}

fn pair(launch: u32, cell: &CellId) -> Compared {
    Compared::Pair(Pair {
        launch,
        round: 0,
        cell: cell.clone(),
        control: false,
        second: false,
        first: Side::Base,
        base_ns: 1.0,
        head_ns: 1.0,
        machine: Default::default(),
    })
}

fn launch(launch: u32) -> Compared {
    Compared::Launch(Launch { launch, ..Launch::default() })
}

fn end(interrupted: bool) -> Compared {
    Compared::End(ComparisonEnd { wall_s: 20.0, interrupted })
}

fn comparison(lines: Vec<Compared>) -> Comparison {
    let header = Compared::Header(Box::default());
    Comparison::from_records(std::iter::once(header).chain(lines).map(Into::into)).unwrap()
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
    assert_eq!(before.given_up.into_iter().collect::<Vec<_>>(), [second]);
    assert!(!before.control_lost);
    assert_eq!(comparison.end.unwrap().wall_s, 40.0);
}

#[test]
fn launches_of_the_second_measurement_are_counted_apart() {
    let second = |number| match launch(number) {
        Compared::Launch(launch) => Compared::Launch(Launch { second: true, ..launch }),
        other => other,
    };
    let comparison = comparison(vec![launch(0), launch(1), launch(2), second(3), second(4)]);
    for (of_second, complete) in [(false, 3), (true, 2)] {
        let before = timed_before(&comparison, of_second);
        assert_eq!((before.complete, before.last), (complete, Some(4)));
    }
}

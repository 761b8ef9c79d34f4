//! What a cell costs the CPU beside its frames.

use crate::common::{Ends, Place, SMALL, cells};

#[test]
fn one_cell_of_a_pipeline_tells_what_it_costs_the_cpu() {
    let place = Place::new();
    let axes = "--axis water=circular --axis water.amplitude_m=0.0,0.1";
    let run = "run uw-waves --budget 10m --precision 1 --no-ceilings --out run";
    place.fathom(format!("{run} {axes} {SMALL}")).ends(0);
    let cells = cells(&place.path("run"));
    let timed = cells.iter().filter_map(|cell| cell.measured().filter(|it| it.host.is_some()));
    let timed: Vec<_> = timed.collect();
    let [measured] = &timed[..] else { panic!("{} of {} cells", timed.len(), cells.len()) };
    let host = measured.host.as_ref().unwrap();
    let names: Vec<&str> = measured.stages.iter().map(|stage| stage.stage.as_str()).collect();
    let encoded: Vec<&str> = host.stages.iter().map(|stage| stage.stage.as_str()).collect();
    assert_eq!(encoded, names);
    let mut spent =
        host.stages.iter().map(|stage| &stage.encode).chain([&host.encode, &host.submit]);
    assert!(spent.all(|spent| spent.median > 0.0 && spent.interval.is_some()), "{host:?}");
    let creation = host.creation.as_ref().expect("no cell before it has made its pipelines");
    assert!(creation.pipelines > 0 && creation.first_ns > 0.0 && creation.again_ns > 0.0);
    let page = std::fs::read_to_string(place.path("run/index.html")).unwrap();
    assert!(page.contains("What it costs the CPU"));
}

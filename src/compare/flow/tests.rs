use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;
use fathom_record::Adapter;
use fathom_record::comparison::{ChangedStage, Launch, Pair};

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
    let before = timed_before(&comparison);
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
    let before = timed_before(&comparison);
    assert_eq!(before.given_up.into_iter().collect::<Vec<_>>(), [second]);
    assert!(!before.control_lost);
    assert_eq!(comparison.end.unwrap().wall_s, 40.0);
}

/// What differs in a way that is not known comes before what is known to differ in its inputs alone, and the host's part last.
#[test]
fn cells_are_measured_in_the_order_of_suspicion() {
    let changed = |stage: &str, differs| {
        let cell = CellId::new("c", stage);
        Compared::Changed(ChangedStage { cell, differs, diff: String::new() })
    };
    let of = comparison(vec![
        changed("inputs", Differs::Inputs),
        changed("states", Differs::Commands),
        changed("shader", Differs::Shader),
    ]);
    let mut stages = ["encode:shader", "inputs", "states", "shader", "unknown", "create"];
    stages.sort_by_key(|stage| suspicion(&of, &CellId::new("c", stage)));
    assert_eq!(stages, ["unknown", "shader", "states", "inputs", "encode:shader", "create"]);
}

/// What a comparison is asked for, by a number for each program, setting and scene.
fn asked(world: &[u32; 14]) -> Value {
    let [a, b, c, d, e, f, g, h, i, j, k, l, m, _] = world.map(|number| number.to_string());
    let side = |digest: &String, version: &String, commit: &String| ComparedBuild {
        digest: digest.clone(),
        version: version.clone(),
        build: Some(Build::described(commit)),
        ..ComparedBuild::default()
    };
    let program = |value: &String, adapter: &String| {
        let mut start = WorkerStart::default();
        start.environment.insert("A".to_owned(), value.clone());
        start.gpu.adapter = Some(adapter.clone());
        Program { label: String::new(), start }
    };
    let adapter = Adapter { driver_info: g, ..Adapter::default() };
    let header = ComparisonHeader {
        base: side(&a, &b, &c),
        head: side(&d, &e, &f),
        adapter,
        ..ComparisonHeader::default()
    };
    let sweep = format!("[[sweep]]\nid = \"one\"\nparams.n = {h}\n");
    let head = "id = \"own\"\ntitle = \"t\"\nsource = \"s\"\npipeline = \"p\"\nscene = \"s\"\nstages = [\"x\"]\n";
    let options = CompareOptions {
        catalog: Catalog::default(),
        programs: [program(&i, &j), program(&k, &l)],
        cells_file: None,
        base_cells: None,
        filter: None,
        env_values: false,
        settings: GateSettings { seed: u64::from(world[13]), ..GateSettings::default() },
        resume: true,
        checkout: None,
    };
    let gates = Gates::parse("own", &format!("{head}{sweep}")).unwrap();
    settings(&options, &gates, &header, json!({ "mesh": m }))
}

/// Comparisons are killed and resumed with what is there then: a folder never holds figures of two programs, settings or scenes.
#[test]
fn no_sequence_of_kills_and_resumes_mixes_what_is_compared() {
    for sequence in 0..1000 {
        let mut random = Pcg64::seed_from_u64(sequence);
        let folder = tempfile::tempdir().unwrap();
        let begun = [0; 14];
        settings::store(folder.path(), &asked(&begun)).unwrap();
        let mut now = begun;
        for _ in 0..random.random_range(1..6) {
            let place = random.random_range(0..now.len());
            now[place] = random.random_range(0..2);
            let resumed = settings::check(folder.path(), &asked(&now));
            assert_eq!(resumed.is_ok(), now == begun, "{sequence}: {now:?}: {resumed:?}");
        }
    }
}

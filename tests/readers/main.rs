//! Every reader against damaged input: no panic, an error of one line, and memory below 1 GiB. A hundred inputs of each with a
//! fixed seed; `FATHOM_FUZZ_CASES=10000 cargo test --test readers -- --nocapture` tries so many others and tells what they took.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/files.rs"]
mod files;
mod growth;
mod hostile;
mod memory;
mod mutator;
mod seeds;
#[allow(dead_code, reason = "a seed needs few of its lines")]
#[path = "../compare/stored.rs"]
mod stored;

use std::path::Path;
use std::time::{Duration, Instant};

use common::{HANGS, Place};
use fathom::compare::protocol::{Reply, parse_request};
use fathom::compare::{cells::Gates, driver, store::StoredComparison, verdict::Verdicts};
use fathom::experiments::{Experiment, parse_axis, parse_set};
use fathom::harness::query;
use fathom::harness::subject::Subjects;
use fathom::history::{Findings, History, Selection, on_page, tables};
use fathom::record::Profile;
use fathom::record::comparison::Side;
use fathom::report::ReportView;
use fathom::scene::{Mesh, Scene, SceneFile};
use fathom::{exporters, pipelines, record};
use memory::peak_of;
use mutator::{Input, extreme, mesh_words, mutated, mutated_or_packed};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};

#[global_allocator]
static COUNTING: memory::Counting = memory::Counting;

/// Most memory that any input may take, bytes.
const MOST_MEMORY: usize = 1 << 30;

/// How many inputs of each reader, where the usual hundred are not enough.
const CASES: &str = "FATHOM_FUZZ_CASES";

type Answer = Result<(), String>;
type Reader = fn(&Path) -> Answer;

/// Runs a reader on inputs that `strategy` makes. A fixed seed, unless more cases are asked for.
fn fuzz<T: std::fmt::Debug>(
    name: &str,
    strategy: impl Strategy<Value = T>,
    reader: impl Fn(&T) -> Answer,
) {
    let cases = std::env::var(CASES).ok().map(|text| text.parse().unwrap());
    let config = Config {
        cases: cases.unwrap_or(100),
        failure_persistence: None,
        max_shrink_time: 60_000,
        ..Config::default()
    };
    let mut runner = match cases {
        Some(_) => TestRunner::new(config),
        None => {
            let random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
            TestRunner::new_with_rng(config, random)
        }
    };
    let most = std::cell::Cell::new((0, Duration::ZERO, 0));
    let run = runner.run(&strategy, |input| {
        let start = Instant::now();
        let (answer, peak) = peak_of(|| reader(&input));
        let took = start.elapsed();
        let (memory, time, refused) = most.get();
        let refused = refused + usize::from(answer.is_err());
        most.set((memory.max(peak), time.max(took), refused));
        judged(answer, peak, took)
    });
    let (memory, time, refused) = most.get();
    println!(
        "{name}: {refused} refused, at most {:.1} MiB and {:.2} s for one",
        memory as f64 / f64::from(1 << 20),
        time.as_secs_f64()
    );
    run.unwrap_or_else(|fault| panic!("{name}: {fault}"));
}

fn judged(answer: Answer, peak: usize, took: Duration) -> Result<(), TestCaseError> {
    if let Err(text) = answer {
        prop_assert_eq!(text.lines().count(), 1, "not one line: {:?}", text);
    }
    prop_assert!(peak < MOST_MEMORY, "{} bytes of memory", peak);
    prop_assert!(took < HANGS, "{took:?}");
    Ok(())
}

fn told<T, E: std::fmt::Display>(result: Result<T, E>) -> Result<T, String> {
    result.map_err(|error| error.to_string())
}

fn fuzz_file(name: &str, seeds: Vec<Vec<u8>>, reader: Reader) {
    let place = Place::new();
    fuzz(name, mutated(seeds), |Input(bytes)| reader(&place.write(name, bytes)));
}

/// The same, sometimes compressed.
fn fuzz_packed(name: &str, seeds: Vec<Vec<u8>>, reader: Reader) {
    let place = Place::new();
    fuzz(name, mutated_or_packed(seeds), |(Input(bytes), packed)| {
        let ending = if *packed { ".gz" } else { "" };
        reader(&place.write(format!("{name}{ending}"), bytes))
    });
}

/// The table of all readers of a file: a test of each on damaged files, and [`READERS`] for inputs of other kinds.
macro_rules! readers {
    ($($test:ident: $fuzz:ident($name:literal, $seeds:expr, $reader:ident);)*) => {
        /// Names that files have, with what reads them.
        const READERS: &[(&str, Reader)] = &[$(($name, $reader)),*];
        $(
            #[test]
            fn $test() {
                $fuzz($name, $seeds, $reader);
            }
        )*
    };
}

readers! {
    scene_files: fuzz_file("a.toml", seeds::scenes(), scene);
    experiment_files: fuzz_file("e.toml", seeds::experiments(), experiment);
    files_of_points: fuzz_file("points.csv", seeds::points(), points);
    records: fuzz_file("records.jsonl", seeds::records(), run);
    comparison_lines: fuzz_file("records.jsonl", seeds::comparisons(), comparison);
    driver_manifests: fuzz_file("icd.json", seeds::manifests(), manifest);
    gates_files: fuzz_file("gates.toml", seeds::gates(), gates);
    obj_files: fuzz_packed("a.obj", seeds::objs(), mesh);
    ply_files: fuzz_packed("a.ply", seeds::plys(), mesh);
    raw_volumes: fuzz_packed("a.raw", seeds::raws(), raw);
}

/// More cells of a generated volume take long to fill, which is no fault: they were asked for.
const MOST_CELLS: u64 = 1 << 18;

fn scene(path: &Path) -> Answer {
    let file = told(SceneFile::load(&path.to_string_lossy()))?;
    let cells = file.volume.as_ref().map_or([0; 3], |volume| volume.cells);
    if cells.map(u64::from).iter().product::<u64>() > MOST_CELLS {
        return Ok(());
    }
    told(Scene::build(&file)).map(drop)
}

fn experiment(path: &Path) -> Answer {
    let experiment = told(Experiment::load(&path.to_string_lossy()))?;
    for profile in Profile::ALL {
        told(experiment.cells(profile, &[], &[]))?;
    }
    Ok(())
}

#[test]
fn axis_arguments() {
    let experiment = Experiment::load("uw-photons").unwrap();
    fuzz("--axis", mutated(seeds::axes()), |Input(bytes)| {
        let (name, values) = told(parse_axis(&String::from_utf8_lossy(bytes)))?;
        told(experiment.cells(Profile::Quick, &[(name, values)], &[])).map(drop)
    });
}

fn points(path: &Path) -> Answer {
    told(query::read(path)).map(drop)
}

fn run(path: &Path) -> Answer {
    let read = told(record::read(path))?;
    let view = ReportView::new(&read.records, None);
    for exporter in fathom::report::OF_RUNS {
        exporter.run(&view);
    }
    match read.damaged.first() {
        Some(damage) => Err(damage.to_string()),
        None => Ok(()),
    }
}

fn comparison(path: &Path) -> Answer {
    let comparison = told(StoredComparison::read(path.parent().unwrap()))?;
    let verdicts = Verdicts::of(&comparison);
    for format in exporters::OF_COMPARISONS {
        (format.export)(&verdicts);
    }
    Ok(())
}

fn manifest(path: &Path) -> Answer {
    told(driver::environment(Side::Head, &[], Some(path))).map(drop)
}

fn gates(path: &Path) -> Answer {
    let gates = told(Gates::load(Some(path), ("", "")))?;
    told(gates.filtered("caustics")).map(drop)
}

/// What is read can be used.
fn mesh(path: &Path) -> Answer {
    told(Mesh::read(path)).map(|mesh| mesh.validate().unwrap())
}

#[test]
fn words_of_meshes_in_any_order() {
    let place = Place::new();
    fuzz("words", mesh_words(), |Input(bytes)| {
        let paths = ["a.obj", "a.ply"].map(|name| place.write(name, bytes));
        mesh(&paths[0]).and(mesh(&paths[1]))
    });
}

/// A scene whose volume is a file with these keys.
fn volume(path: &Path, keys: &str) -> Answer {
    let file = told(SceneFile::parse(&path.to_string_lossy(), &seeds::volume_scene(path, keys)))?;
    told(Scene::build(&file)).map(|scene| scene.volume.unwrap().validate().unwrap())
}

fn raw(path: &Path) -> Answer {
    volume(path, "cells = [2, 3, 2]\nformat = \"u16\"\nwindow = [0, 44000]")
}

#[test]
fn keys_of_raw_volumes() {
    let place = Place::new();
    let path = place.write("a.raw", [0; 24]);
    fuzz("raw keys", mutated(seeds::raw_keys()), |Input(bytes)| {
        volume(&path, &String::from_utf8_lossy(bytes))
    });
}

#[test]
fn messages_of_workers() {
    fuzz("messages", mutated(seeds::messages()), |Input(bytes)| {
        let line = String::from_utf8_lossy(bytes);
        let reply = told(serde_json::from_str::<Reply>(&line)).map(drop);
        match parse_request(&line) {
            Ok(_) => Ok(()),
            Err(Reply::Fault { reason, .. }) => reply.map_err(|_| reason),
            Err(_) => reply,
        }
    });
}

/// All that is asked of a history: its runs, its series, what changed in them, and the records of a run.
fn history(path: &Path) -> Answer {
    let mut history = told(History::open(path))?;
    let runs = told(history.runs(&Selection::default()))?;
    tables::runs(&runs);
    let records = runs.first().map(|run| told(history.records(&run.digest)));
    let stored = told(history.stored(&Selection::default()))?;
    let findings = Findings::of(&stored);
    tables::series(&stored, &findings);
    tables::changes(&stored, &findings);
    tables::changes_json(&stored, &findings);
    on_page::on_page(&stored, &findings);
    records.unwrap_or(Ok(Default::default())).map(drop)
}

#[test]
fn files_of_histories() {
    fuzz_file("history.sqlite", vec![seeds::history()], history);
}

/// Columns, and what something else may have written there.
const COLUMNS: &str = "run.id run.digest run.commit_name run.committed_at run.started_at run.cells run.records \
    series.id series.cell series.unit figure.median figure.low figure.high figure.n";
const STORED: &str = "-9223372036854775808 9223372036854775807 9e999 -9e999 1e-320 0 -1.5 'text' '' x'00ff' \
    hex(zeroblob(100000)) zeroblob(1000)";

#[test]
fn values_of_histories() {
    let place = Place::new();
    let whole = seeds::history();
    let of = |words: &'static str| prop::sample::select(words.split(' ').collect::<Vec<_>>());
    let change = (of(COLUMNS), of(STORED), 0..4usize);
    fuzz("values", prop::collection::vec(change, 1..4), |changes| {
        let path = place.write("history.sqlite", &whole);
        let connection = rusqlite::Connection::open(&path).unwrap();
        connection.execute_batch("PRAGMA synchronous = OFF; PRAGMA journal_mode = OFF").unwrap();
        for (column, value, part) in changes {
            let (table, name) = column.split_once('.').unwrap();
            let some = ["1", "abs(random()) % 2 = 0", "rowid = 1", "abs(random()) % 9 = 0"];
            let some = some[if table == "figure" { part % 2 } else { *part }];
            // What breaks a key is not stored.
            let _ = connection.execute(
                &format!("UPDATE OR IGNORE fathom_{table} SET {name} = {value} WHERE {some}"),
                [],
            );
        }
        drop(connection);
        history(&path)
    });
}

#[test]
fn parameters() {
    let place = Place::new();
    let scene = place.write("a.toml", seeds::small_scene());
    let scene = scene.to_string_lossy();
    let kinds: Vec<&str> = pipelines::KINDS.iter().map(|kind| kind.name).collect();
    // A number of the default made extreme, or any text.
    let any_text = prop::option::weighted(0.2, mutated(seeds::values()));
    let change = (any::<usize>(), any::<usize>(), any::<usize>(), any_text);
    let strategy = (prop::sample::select(kinds), prop::collection::vec(change, 1..3));
    fuzz("--set", strategy, |(kind, changes)| {
        let params = told(Subjects::default().subject(kind, &scene, &[]))?.params;
        let leaves = fathom::parameter::leaves(&params);
        let set = |(leaf, which, by, text): &(usize, usize, usize, Option<Input>)| {
            let leaf = &leaves[leaf % leaves.len()];
            let default = fathom::parameter::get(&params, leaf).unwrap().to_string();
            let value = match text {
                Some(Input(text)) => String::from_utf8_lossy(text).into_owned(),
                None => extreme(&default, *which, *by),
            };
            told(parse_set(&format!("{leaf}={value}")))
        };
        let sets: Vec<_> = changes.iter().map(set).collect::<Result<_, _>>()?;
        let subject = told(Subjects::default().subject(kind, &scene, &sets))?;
        match told(subject.beyond(&wgpu::Limits::default().into()))? {
            Some(reason) => Err(reason),
            None => Ok(()),
        }
    });
}

//! Every reader against damaged and immense input: no panic, an error of one line, and memory below a limit. A hundred inputs of each
//! with a fixed seed; `FATHOM_FUZZ_CASES=10000 cargo test --test readers` tries so many others.

#[path = "../common/mod.rs"]
mod common;
#[allow(dead_code, reason = "no volume is made")]
#[path = "../common/files.rs"]
mod files;
mod memory;
mod mutator;
mod seeds;
#[allow(dead_code, reason = "a seed needs few of its lines")]
#[path = "../compare/stored.rs"]
mod stored;

use std::fs::{self, File};
use std::path::Path;
use std::process::Command;

use common::{Place, lines, reference_of, skipped_cell};
use fathom::compare::protocol::{Reply, parse_request};
use fathom::compare::{cells::Gates, store::Comparison, verdict::Verdicts};
use fathom::experiments::{Experiment, parse_set};
use fathom::harness::subject::Subjects;
use fathom::history::{History, HistoryChanges, NewRun, Selection, document, tables};
use fathom::record::comparison::Compared;
use fathom::record::{Definition, Profile, Record};
use fathom::report::{self, Report};
use fathom::scene::{Mesh, Scene, SceneFile};
use fathom::{exporters, parameter, pipelines, record};
use files::gzip;
use memory::counted;
use mutator::{Input, extreme, mutated};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use serde_json::json;

#[global_allocator]
static COUNTING: memory::Counting = memory::Counting;

/// Most memory that any input may take, bytes.
const MAX_MEMORY: usize = 1 << 30;
/// More cells of a generated volume take long to fill, which is no fault: they were asked for.
const MAX_CELLS: u64 = 1 << 18;

type ReadResult = Result<(), String>;
type Reader = fn(&Path) -> ReadResult;

fn with_text<T, E: std::fmt::Display>(result: Result<T, E>) -> Result<T, String> {
    result.map_err(|error| format!("{error:#}"))
}

/// Runs a reader on inputs that `strategy` makes. A fixed seed, unless more cases are asked for.
fn fuzz<T: std::fmt::Debug>(
    name: &str,
    strategy: impl Strategy<Value = T>,
    reader: impl Fn(&T) -> ReadResult,
) {
    let asked = std::env::var("FATHOM_FUZZ_CASES").ok().map(|text| text.parse().unwrap());
    let cases = asked.unwrap_or(100);
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let mut runner = match asked {
        Some(_) => TestRunner::new(config),
        None => {
            let random = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
            TestRunner::new_with_rng(config, random)
        }
    };
    let run = runner.run(&strategy, |input| {
        let (answer, peak, _) = counted(|| reader(&input));
        if let Err(text) = answer {
            prop_assert_eq!(text.lines().count(), 1, "not one line: {:?}", text);
        }
        prop_assert!(peak < MAX_MEMORY, "{} bytes of memory", peak);
        Ok(())
    });
    run.unwrap_or_else(|fault| panic!("{name}: {fault}"));
}

/// The table of all readers of a file: a test of each on damaged files, some of them compressed, and [`READERS`] for other inputs.
macro_rules! readers {
    ($($seeds:ident: $name:literal, $reader:ident;)*) => {
        /// Names that files have, with what reads them.
        const READERS: &[(&str, Reader)] = &[$(($name, $reader)),*];
        $(
            #[test]
            fn $seeds() {
                let place = Place::new();
                place.write("a.raw", seeds::RAW);
                fuzz($name, (mutated(seeds::$seeds()), prop::bool::weighted(0.2)), |(Input(bytes), packed)| {
                    let _ = fs::remove_file(place.path($name));
                    if !packed {
                        return $reader(&place.write($name, bytes));
                    }
                    let path = place.write(concat!($name, ".gz"), gzip(bytes));
                    let answer = $reader(&path);
                    fs::remove_file(path).unwrap();
                    answer
                });
            }
        )*
    };
}

readers! {
    scenes: "a.toml", scene;
    raw_volumes: "a.raw", raw_volume;
    experiments: "e.toml", experiment;
    gates: "gates.toml", gates_file;
    records: "records.jsonl", run;
    comparisons: "records.jsonl", comparison;
    objs: "a.obj", mesh;
    plys: "a.ply", mesh;
    stls: "a.stl", mesh;
    glbs: "a.glb", mesh;
    gltfs: "a.gltf", mesh;
    histories: "history.sqlite", history;
}

fn scene(path: &Path) -> ReadResult {
    let file = with_text(SceneFile::load(&path.to_string_lossy()))?;
    let cells = file.volume.as_ref().map_or([0; 3], |volume| volume.cells);
    if cells.map(u64::from).iter().product::<u64>() > MAX_CELLS {
        return Ok(());
    }
    with_text(Scene::build(&file)).map(drop)
}

fn raw_volume(path: &Path) -> ReadResult {
    let name = path.file_name().unwrap().to_string_lossy();
    let text = String::from_utf8(seeds::scenes().remove(1)).unwrap().replace("a.raw", &name);
    let file = with_text(SceneFile::parse(&path.to_string_lossy(), &text))?;
    with_text(Scene::build(&file)).map(|scene| scene.volume.unwrap().validate().unwrap())
}

fn experiment(path: &Path) -> ReadResult {
    let experiment = with_text(Experiment::load(&path.to_string_lossy()))?;
    Profile::ALL
        .into_iter()
        .try_for_each(|profile| with_text(experiment.cells(profile, &[], &[])).map(drop))
}

fn gates_file(path: &Path) -> ReadResult {
    let gates = with_text(Gates::load(Some(path), ("", "")))?;
    with_text(gates.filtered(Some("caustics"))).map(drop)
}

fn run(path: &Path) -> ReadResult {
    let read = with_text(record::read_good(path))?;
    let view = Report::new(&read.records, None);
    report::OF_RUNS.iter().for_each(|exporter| drop(exporter.run(&view)));
    with_text(NewRun::read(path.parent().unwrap(), "records.jsonl")).map(drop)
}

fn comparison(path: &Path) -> ReadResult {
    let comparison = with_text(Comparison::read(path.parent().unwrap()))?;
    let verdicts = Verdicts::judge(&comparison);
    exporters::OF_COMPARISONS.iter().for_each(|format| drop((format.export)(&verdicts)));
    Ok(())
}

/// What is read can be used.
fn mesh(path: &Path) -> ReadResult {
    with_text(Mesh::read(path)).map(|mesh| mesh.validate().unwrap())
}

fn gltf(path: &Path) -> ReadResult {
    let path = path.with_extension("gltf");
    fs::rename(path.with_extension("toml"), &path).unwrap();
    mesh(&path)
}

/// All that is asked of a history: its runs, its series, and what changed in them.
fn history(path: &Path) -> ReadResult {
    let history = with_text(History::open(path))?;
    let runs = with_text(history.runs(&Selection::default()))?;
    tables::runs(&runs);
    let stored = with_text(history.load(&Selection::default()))?;
    let findings = HistoryChanges::find(&stored);
    tables::changes_json(&stored, &findings);
    document::on_page(&stored, &findings);
    Ok(())
}

#[test]
fn messages_of_workers() {
    fuzz("messages", mutated(seeds::messages()), |Input(bytes)| {
        let line = String::from_utf8_lossy(bytes);
        let reply = with_text(serde_json::from_str::<Reply>(&line)).map(drop);
        match parse_request(&line) {
            Err(Reply::Fault { reason, .. }) => reply.map_err(|_| reason),
            _ => reply,
        }
    });
}

/// Numbers of the defaults made extreme.
#[test]
fn parameters() {
    let place = Place::new();
    let scene = place.write("a.toml", seeds::SCENE).display().to_string();
    let kinds: Vec<&str> = pipelines::KINDS.iter().map(|kind| kind.name).collect();
    let change = (any::<usize>(), any::<usize>(), any::<usize>());
    let strategy = (prop::sample::select(kinds), prop::collection::vec(change, 1..3));
    fuzz("--set", strategy, |(kind, changes)| {
        let params = with_text(Subjects::default().subject(kind, &scene, &[]))?.params;
        let leaves = parameter::leaves(&params);
        let set = |(leaf, which, by): &(usize, usize, usize)| {
            let leaf = &leaves[leaf % leaves.len()];
            let default = parameter::get(&params, leaf).unwrap().to_string();
            let value = extreme(default.as_bytes(), *which, *by);
            with_text(parse_set(&format!("{leaf}={}", String::from_utf8(value).unwrap())))
        };
        let sets: Vec<_> = changes.iter().map(set).collect::<Result<_, _>>()?;
        let subject = with_text(Subjects::default().subject(kind, &scene, &sets))?;
        with_text(subject.limits_exceeded(&wgpu::Limits::default().into()))?.map_or(Ok(()), Err)
    });
}

/// The error of a reader that must refuse what it is given, in one line that holds one of these, and little memory.
#[track_caller]
fn refused(what: &str, reasons: &[&str], reader: impl FnOnce() -> ReadResult) {
    let (answer, peak, _) = counted(reader);
    let text = answer.expect_err(what);
    assert_eq!(text.lines().count(), 1, "{what}: {text}");
    assert!(reasons.iter().any(|reason| text.contains(reason)), "{what}: {text}");
    assert!(peak < MAX_MEMORY, "{what}: {peak} bytes of memory");
}

/// What is said of any file that SQLite did not make.
#[cfg(unix)]
const NO_DATABASE: &str = "file is not a database";

/// A file of a terabyte takes no space on a disk that stores no zeros.
#[test]
#[cfg(unix)]
fn what_is_no_file_or_immense_is_refused_and_not_waited_for() {
    let pipe = |path: &Path| assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
    let device = |path: &Path| std::os::unix::fs::symlink("/dev/zero", path).unwrap();
    type Kind<'a> = (&'a dyn Fn(&Path), &'a [&'a str]);
    let kinds: [Kind<'_>; 4] = [
        // A folder's own file is no link at all.
        (&device, &["a device", "a symbolic link", "no regular file"]),
        (&pipe, &["a pipe", "no regular file"]),
        (&|path| fs::create_dir(path).unwrap(), &["a folder", "no regular file"]),
        (
            &|path| File::create(path).unwrap().set_len(1 << 40).unwrap(),
            &["more than", NO_DATABASE],
        ),
    ];
    for (make, reasons) in kinds {
        for (name, reader) in READERS {
            let place = Place::new();
            let path = place.path(name);
            make(&path);
            refused(name, reasons, || reader(&path));
        }
    }
}

const EXPERIMENT: &str =
    "id = \"e\"\ntitle = \"t\"\nsource = \"s\"\npipeline = \"underwater\"\nscene = \"tank\"\n";

/// Small files that are immense or deep once they are read.
#[test]
fn immense_content_is_refused() {
    let of = |rest: String| format!("{EXPERIMENT}{rest}");
    let values = format!("name = \"a\"\nvalues = {:?}\n", (0..300).collect::<Vec<_>>());
    let axes = format!("[[sweep]]\n{}", format!("[[sweep.axis]]\n{values}").repeat(3));
    let turns = format!("[views]\nquantity = \"q\"\nturns_deg = [{}]\n", "1,".repeat(400_000));
    let knot = "[[object]]\nname = \"k\"\ngenerator = \"knot\"\nparams = { segments = 700, sides = 160 }\n";
    let corners = |rest: String| format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{rest}");
    // A polygon has as many triangles as corners, less two.
    let polygons = format!("f{}\n", " 1 2 3".repeat(10_000)).repeat(134);
    let no_faces = "f 1 2\nl 1 1 1\no\ng a\n";
    let rows: [(String, Reader, &str); 11] = [
        (of(axes), experiment, "counted too: at most 20000"),
        (of(turns), experiment, "at most 72"),
        (format!("{}{}", seeds::SCENE, knot.repeat(2000)), scene, "of 4000000"),
        (format!("a = {}", "[".repeat(200_000)), scene, ""),
        (of(format!("a = {}", "{a=".repeat(200_000))), experiment, ""),
        (of(format!("[params]\na{} = 1", ".a".repeat(200_000))), experiment, ""),
        (corners("f 1 2 3\no\n".repeat(100_001)), mesh, "more than 100000 objects"),
        ("v 0 0 0\n".repeat(3_600_001), mesh, "more than 3600000 vertices"),
        (corners(polygons), mesh, "more than 4000000 triangles"),
        (corners(no_faces.repeat(1 << 18)), mesh, "no triangles"),
        (
            format!("{{\"nodes\":[{}{{}}]}}", "{},".repeat(1_000_000)),
            gltf,
            "more than 2000000 values",
        ),
    ];
    // Each in a thread of its own, whose memory is counted.
    let refuse = |(text, reader, reason): (String, Reader, &str)| {
        let place = Place::new();
        let is_mesh = text.starts_with('v');
        let text = if is_mesh { gzip(text.as_bytes()) } else { text.into_bytes() };
        let path = place.write(if is_mesh { "a.obj.gz" } else { "a.toml" }, text);
        refused(reason, &[reason], || reader(&path));
    };
    std::thread::scope(|scope| rows.map(|row| drop(scope.spawn(move || refuse(row)))));
}

#[test]
fn launches_beyond_what_a_comparison_may_have_do_not_count() {
    let place = Place::new();
    let launches = (10..5000).map(|launch| {
        Compared::Launch(record::comparison::Launch { launch, ..Default::default() })
    });
    let more = lines(launches.map(Record::from));
    place.write("records.jsonl", [seeds::comparisons().remove(0), more.into_bytes()].concat());
    let read = Comparison::read(&place.path("")).unwrap();
    assert_eq!(read.launches.len(), 400);
    assert!(read.damaged[0].contains("4600 launches"), "{:?}", read.damaged);
}

const ALONG: &str = "id = \"own\"\ntitle = \"Own\"\nsource = \"none\"\npipeline = \"underwater\"\nscene = \"tank\"\n\
    [[sweep]]\n[[sweep.axis]]\nname = \"caustics.grid\"\nvalues = VALUES\n\
    [[plot]]\ntitle = \"Frames\"\nkind = \"bars\"\nover = \"caustics.grid\"\ny = [\"frame\"]\n\
    [[claim]]\nid = \"rising\"\ntext = \"It rises\"\n\
    test.monotone = { y = \"frame\", x = \"axis:caustics.grid\", over = \"caustics.grid\", direction = \"rising\" }\n";

/// Cells of one experiment that the records define, of one that they do not, or of one each, from the last to the first.
fn cells(count: usize, kind: &str) -> Vec<Record> {
    let toml = ALONG.replace("VALUES", &format!("{:?}", (0..count).collect::<Vec<_>>()));
    let definition = Record::Experiment(Definition { id: "own".to_owned(), toml });
    let cell = |number: usize| {
        let mut record = skipped_cell(&format!("caustics.grid={number}"));
        if let Record::Cell(cell) = &mut record {
            if kind == "scattered" {
                cell.experiment = format!("own-{number}");
            }
            cell.axes.insert("caustics.grid".to_owned(), json!(number));
            cell.stand_ins.push(format!("note {number}"));
        }
        record
    };
    let run = reference_of("none").into_iter().filter(|record| matches!(record, Record::Run(_)));
    run.chain((kind == "defined").then_some(definition)).chain((0..count).rev().map(cell)).collect()
}

/// Quadratic work grows 16-fold from n to 4 n, linear work 4-fold. `make test-all` takes twice as many cells.
#[test]
fn what_a_report_allocates_grows_with_its_cells_and_not_with_their_square() {
    for kind in ["defined", "undefined", "scattered"] {
        let times = 1 + usize::from(std::env::var_os("FATHOM_FUZZ_CASES").is_some());
        let [few, many] = [1_000, 4_000].map(|count| {
            let records = cells(times * count, kind);
            let (files, _, bytes) = counted(|| report::report_files(&records, None));
            let summary = String::from_utf8_lossy(&files.last().unwrap().bytes).into_owned();
            assert_eq!(summary.contains(" It rises "), kind == "defined", "{summary}");
            bytes
        });
        assert!(many < 8 * few, "{kind}: {few} bytes, then {many}");
    }
}

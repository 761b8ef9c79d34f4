//! Inputs made to take more than there is: endless, immense, deep, or small and immense once they are read.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use fathom::compare::{cells::Gates, store::StoredComparison, verdict::Verdicts};
use fathom::experiments::Experiment;
use fathom::harness::query;
use fathom::history::{History, Location, NewRun, Selection};
use fathom::record;
use fathom::scene::{Mesh, Scene};

use super::files::gzip;
use super::memory::peak_of;
use super::{Answer, HANGS, MOST_MEMORY, seeds, told, volume};

/// The error of a reader that must refuse what it is given, in one line and little memory.
fn refused(what: &str, reader: impl FnOnce() -> Answer) -> String {
    let (answer, peak) = peak_of(reader);
    let text = answer.expect_err(what);
    assert_eq!(text.lines().count(), 1, "{what}: {text}");
    assert!(peak < MOST_MEMORY, "{what}: {peak} bytes of memory");
    text
}

fn scene(path: &Path) -> Answer {
    told(Scene::load(&path.to_string_lossy())).map(drop)
}

fn experiment(path: &Path) -> Answer {
    let experiment = told(Experiment::load(&path.to_string_lossy()))?;
    told(experiment.cells(record::Profile::Quick, &[], &[])).map(drop)
}

fn mesh(path: &Path) -> Answer {
    told(Mesh::read(path)).map(drop)
}

type Reader = fn(&Path) -> Answer;

/// Every reader of a file, with the name that its files have.
const READERS: &[(&str, Reader)] = &[
    ("a.toml", scene),
    ("e.toml", experiment),
    ("points.csv", |path| told(query::read(path)).map(drop)),
    ("records.jsonl", |path| told(record::read(path)).map(drop)),
    ("records.jsonl", |path| told(StoredComparison::read(path.parent().unwrap())).map(drop)),
    ("gates.toml", |path| told(Gates::load(Some(path), ("", ""))).map(drop)),
    ("a.obj", mesh),
    ("a.ply", mesh),
    ("a.obj.gz", mesh),
    ("a.nii", |path| volume(path, "")),
    ("a.raw", |path| volume(path, "cells = [2, 2, 2]\nformat = \"u8\"")),
];

/// Puts `made` at the place of each reader's file, and gives what the reader says of it.
fn each(made: impl Fn(&Path)) -> Vec<String> {
    let read = |(name, reader): &(&str, Reader)| {
        let folder = tempfile::tempdir().unwrap();
        let path: PathBuf = folder.path().join(name);
        made(&path);
        refused(name, || reader(&path))
    };
    READERS.iter().map(read).collect()
}

#[test]
#[cfg(unix)]
fn endless_devices_are_refused() {
    let texts = each(|path| std::os::unix::fs::symlink("/dev/zero", path).unwrap());
    // A folder's own file is no link at all.
    let refused = |text: &String| text.contains("a device") || text.contains("a symbolic link");
    assert!(texts.iter().all(refused), "{texts:?}");
}

#[test]
#[cfg(unix)]
fn pipes_are_refused_and_not_waited_for() {
    let texts = each(|path| {
        assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
    });
    assert!(texts.iter().all(|text| text.contains("a pipe")), "{texts:?}");
}

#[test]
fn folders_are_refused() {
    let texts = each(|path| std::fs::create_dir(path).unwrap());
    assert!(texts.iter().all(|text| text.contains("a folder")), "{texts:?}");
}

/// A file of a terabyte takes no space on a disk that stores no zeros.
#[test]
fn immense_files_are_refused() {
    let texts = each(|path| std::fs::File::create(path).unwrap().set_len(1 << 40).unwrap());
    assert!(texts.iter().all(|text| text.contains("more than")), "{texts:?}");
}

/// The program itself ends with status 2 and one line where it would wait for ever.
#[test]
#[cfg(unix)]
fn the_program_says_so_too() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe.toml");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let pipe = pipe.to_string_lossy();
    for arguments in [
        vec!["list", "parameters", "--scene", &pipe],
        vec!["list", "parameters", "--scene", "/dev/zero"],
        vec!["query", "ao", "--scene", "plane", "--points", &pipe],
        vec!["report", "/dev"],
    ] {
        let mut command = assert_cmd::Command::new(env!("CARGO_BIN_EXE_fathom"));
        let ended = command.args(&arguments).timeout(HANGS).assert();
        let output = ended.code(2).get_output().clone();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(text.lines().count(), 1, "{arguments:?}: {text}");
    }
    // A pipe as standard input is no file either.
    let mut child = Command::new(env!("CARGO_BIN_EXE_fathom"))
        .args(["list", "parameters", "--scene", "/dev/stdin"])
        .stdin(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(2));
}

/// An archive of one line many times over, as a mesh.
fn packed_lines(head: &str, line: &str, times: usize) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj.gz");
    let text = format!("{head}{}", line.repeat(times));
    std::fs::write(&path, gzip(text.as_bytes())).unwrap();
    drop(text);
    refused(line, || mesh(&path))
}

#[test]
fn lines_that_hold_no_triangle_take_no_memory() {
    let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for line in ["f 1\n", "l 1 1 1\n", "f 1 2\n", "o\n", "g a\n", "p 1\n"] {
        let text = packed_lines(head, line, 1 << 20);
        assert!(text.contains("no triangles"), "{text}");
    }
}

#[test]
fn vertices_and_triangles_are_counted() {
    let head = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let text = packed_lines("", "v 0 0 0\n", 3_600_001);
    assert!(text.contains("more than 3600000 vertices"), "{text}");
    let text = packed_lines("", "vn 0 0 1\n", 3_600_001);
    assert!(text.contains("more than 3600000 normals"), "{text}");
    let text = packed_lines(head, "f 1 2 3\n", 4_000_001);
    assert!(text.contains("more than 4000000 triangles"), "{text}");
}

/// Writes a scene or an experiment and gives why it is refused.
fn refused_text(text: &str, reader: Reader) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.toml");
    std::fs::write(&path, text).unwrap();
    refused("text", || reader(&path))
}

#[test]
fn a_scene_of_thousands_of_knots_is_refused() {
    let knot = "[[object]]\nname = \"k\"\ngenerator = \"knot\"\nparams = { segments = 700, sides = 160 }\n";
    let text = refused_text(&(seeds::small_scene() + &knot.repeat(2000)), scene);
    assert!(text.contains("of 4000000"), "{text}");
}

const EXPERIMENT: &str =
    "id = \"e\"\ntitle = \"t\"\nsource = \"s\"\npipeline = \"underwater\"\nscene = \"tank\"\n";

#[test]
fn axes_that_multiply_to_millions_of_cells_are_refused() {
    let axis = "[[sweep.axis]]\nname = \"a\"\nvalues = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n";
    for axes in [7, 30] {
        let text = format!("{EXPERIMENT}[[sweep]]\n{}", axis.repeat(axes));
        let text = refused_text(&text, experiment);
        assert!(text.contains("cells") && text.contains("at most 20000"), "{text}");
    }
    let experiment = Experiment::load("uw-photons").unwrap();
    let name = experiment.axis_names()[0].to_owned();
    let values = (1..30_000).map(|n| n.to_string()).collect();
    let text = refused("--axis", || {
        told(experiment.cells(record::Profile::Quick, &[(name, values)], &[])).map(drop)
    });
    assert!(text.contains("at most 20000"), "{text}");
}

#[test]
fn long_values_times_many_cells_are_refused() {
    let values = (0..300).map(|n| n.to_string()).collect::<Vec<_>>().join(", ");
    let long = "x".repeat(300_000);
    let text = format!(
        "{EXPERIMENT}[params]\nlong = \"{long}\"\n[[sweep]]\n[[sweep.axis]]\nname = \"a\"\nvalues = [{values}]\n"
    );
    let text = refused_text(&text, experiment);
    assert!(text.contains("MiB are planned"), "{text}");
}

#[test]
fn two_million_turns_are_refused() {
    let turns = "1,".repeat(400_000);
    let text = format!("{EXPERIMENT}[views]\nquantity = \"q\"\nturns_deg = [{turns}]\n");
    assert!(refused_text(&text, experiment).contains("at most 72"));
}

/// What nests deeper than any stack.
#[test]
fn deep_nesting_is_refused() {
    let deep = [
        format!("a = {}", "[".repeat(200_000)),
        format!("a = {}", "{a=".repeat(200_000)),
        format!("a{} = 1", ".a".repeat(200_000)),
        format!("[a{}]", ".a".repeat(200_000)),
        format!("a = {{ a{} = 1 }}", ".a".repeat(200_000)),
    ];
    for text in &deep {
        refused_text(text, scene);
        refused_text(text, experiment);
        refused_text(&format!("{EXPERIMENT}[params]\n{text}"), experiment);
    }
}

#[test]
fn long_and_deep_lines_of_records_are_damage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("records.jsonl");
    let long = "9".repeat(9 << 20);
    let deep = "[".repeat(1 << 20);
    std::fs::write(&path, format!("{long}\n{deep}\n{{}}\n")).unwrap();
    let (read, peak) = peak_of(|| record::read(&path).unwrap());
    assert_eq!(read.damaged.len(), 3);
    assert!(read.damaged[0].to_string().contains("longer than 8 MiB"));
    assert!(peak < 64 << 20, "{peak}");
}

/// A comparison whose text is changed, or whose lines are followed by others.
fn comparison(change: impl Fn(String) -> String) -> Result<StoredComparison, String> {
    let folder = tempfile::tempdir().unwrap();
    let text = String::from_utf8(seeds::comparisons().remove(0)).unwrap();
    std::fs::write(folder.path().join("records.jsonl"), change(text)).unwrap();
    told(StoredComparison::read(folder.path()))
}

#[test]
fn shares_of_a_comparison_lie_between_0_and_1() {
    for key in ["alpha", "threshold", "instruction_threshold"] {
        for share in ["1.5", "1", "0", "-0.1", "1e308"] {
            let start = format!("\"{key}\":0");
            let changed =
                comparison(|text| text.replacen(&start, &format!("\"{key}\":{share},\"x\":0"), 1));
            let fault = changed.unwrap_err();
            assert!(fault.contains("no sound header"), "{fault}");
        }
    }
    assert!(comparison(|text| text).is_ok());
}

#[test]
fn thousands_of_launches_and_pairs_are_judged_by_those_that_count() {
    let launch = |n: usize| {
        let times = "\"cell\":\"tank caustics/trace\",\"base_ns\":1e6,\"head_ns\":2e6";
        format!(
            "{{\"record\":\"comparison\",\"kind\":\"launch\",\"launch\":{n},\"wall_s\":1,\"notes\":[]}}\n{{\"record\":\"comparison\",\"kind\":\"pair\",\"launch\":{n},\"round\":0,\"first\":\"base\",{times}}}\n"
        )
    };
    let (read, peak) = peak_of(|| {
        let read = comparison(|text| text + &(10..5000).map(launch).collect::<String>()).unwrap();
        Verdicts::of(&read);
        read
    });
    assert_eq!(read.launches.len(), 200);
    assert!(read.damaged[0].contains("4796 launches"), "{:?}", read.damaged);
    assert!(peak < 64 << 20, "{peak}");
    let pair = |n: usize| {
        let first = ["base", "head"][n % 2];
        format!(
            "{{\"record\":\"comparison\",\"kind\":\"pair\",\"launch\":0,\"round\":{n},\"first\":\"{first}\",\"cell\":\"tank caustics/trace\",\"base_ns\":1e6,\"head_ns\":{n}e3}}\n"
        )
    };
    let (_, peak) = peak_of(|| {
        let read = comparison(|text| text + &(1..40_000).map(pair).collect::<String>()).unwrap();
        Verdicts::of(&read);
    });
    assert!(peak < 256 << 20, "{peak}");
}

/// Records of a run, then so many lines that are none, then a cell.
fn damaged_run(folder: &Path, lines: usize) {
    let text = String::from_utf8(seeds::records().remove(0)).unwrap();
    let text: Vec<&str> = text.lines().collect();
    let torn = format!("{}\n", &text[2][..30]).repeat(lines);
    let text = format!("{}\n{torn}{}\n", text[..3].join("\n"), text[2]);
    std::fs::write(folder.join("records.jsonl"), text).unwrap();
}

/// At most twenty lines are told one by one, then a count.
#[test]
fn hundred_thousand_damaged_lines_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    damaged_run(folder.path(), 100_001);
    let path = folder.path().join("records.jsonl");
    let (read, peak) = peak_of(|| record::read(&path).unwrap());
    assert_eq!((read.damaged.count(), read.damaged.len()), (100_001, 20));
    assert_eq!(read.records.len(), 4);
    assert!(peak < 16 << 20, "{peak}");
    let fathom = |arguments: &[&str], more: &str| {
        let mut fathom = Command::new(env!("CARGO_BIN_EXE_fathom"));
        let output = fathom.args(arguments).arg(folder.path()).output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(text.lines().count() < 25, "{arguments:?}: {text}");
        assert!(text.contains(more), "{arguments:?}: {text}");
    };
    fathom(&["report"], "99981 more lines");
    fathom(&["export", "csv"], "99981 more lines");
    let db = folder.path().join("h.sqlite");
    let add = ["history", "add", "--commit", "c", "--branch", "b", "--db", db.to_str().unwrap()];
    fathom(&add, "(and 100000 more)");
    let page = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
    assert!(page.contains("99981 more lines"));
}

/// The file is never in memory as a whole, nor are all of its records.
#[test]
fn a_history_reads_a_run_record_by_record() {
    let folder = tempfile::tempdir().unwrap();
    let text = String::from_utf8(seeds::records().remove(0)).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let cells = 3000;
    let of_cell =
        |n: usize| lines[2].replacen("\"cell\":\"", &format!("\"cell\":\"n={n},"), 1) + "\n";
    let cells: String = (0..cells).map(of_cell).collect();
    let records = format!("{}\n{}\n{cells}{}\n", lines[0], lines[1], lines[3]);
    std::fs::write(folder.path().join("records.jsonl"), &records).unwrap();
    let (run, peak) = peak_of(|| NewRun::read(folder.path(), "records.jsonl").unwrap());
    assert_eq!(run.cells, 3000);
    assert!(peak < records.len(), "{peak} for {}", records.len());
}

/// An archive of 64 MiB in the place of a run's records.
#[test]
fn an_archive_in_a_history_is_not_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("history.sqlite");
    std::fs::write(&path, seeds::history()).unwrap();
    let bomb = gzip(&vec![0; 64 << 20]);
    let connection = rusqlite::Connection::open(&path).unwrap();
    connection.execute("UPDATE fathom_run SET records = $1", [bomb]).unwrap();
    drop(connection);
    let mut history = History::open(&Location::File(path)).unwrap();
    let run = history.runs(&Selection::default()).unwrap().remove(0);
    let (got, peak) = peak_of(|| history.records(&run.digest));
    assert!(got.unwrap_err().to_string().contains("the database is damaged"));
    assert!(peak < 8 << 20, "{peak}");
}

//! Inputs made to take more than there is: endless, immense, deep, or small and immense once they are read.

use std::path::Path;
use std::process::{Command, Stdio};

use fathom::compare::{store::StoredComparison, verdict::Verdicts};
use fathom::experiments::Experiment;
use fathom::history::{History, NewRun, Selection};
use fathom::record::comparison::{Compared, Launch};
use fathom::record::{self, Record};

use super::common::{Place, ended, fathom, holds, lines};
use super::files::gzip;
use super::memory::peak_of;
use super::stored::{TRACE, pair};
use super::{Answer, MOST_MEMORY, READERS, Reader, experiment, mesh, scene, seeds, told};

/// The error of a reader that must refuse what it is given, in one line and little memory.
fn refused(what: &str, reader: impl FnOnce() -> Answer) -> String {
    let (answer, peak) = peak_of(reader);
    let text = answer.expect_err(what);
    assert_eq!(text.lines().count(), 1, "{what}: {text}");
    assert!(peak < MOST_MEMORY, "{what}: {peak} bytes of memory");
    text
}

/// Puts `made` at the place of each reader's file; what the reader says of it must hold one of these.
fn each(made: impl Fn(&Path), reasons: &[&str]) {
    for (name, reader) in READERS.iter().chain(&[("a.obj.gz", mesh as Reader)]) {
        let place = Place::new();
        let path = place.path(name);
        made(&path);
        let text = refused(name, || reader(&path));
        assert!(reasons.iter().any(|reason| text.contains(reason)), "{name}: {text}");
    }
}

#[test]
#[cfg(unix)]
fn endless_devices_are_refused() {
    let device = |path: &Path| std::os::unix::fs::symlink("/dev/zero", path).unwrap();
    // A folder's own file is no link at all.
    each(device, &["a device", "a symbolic link"]);
}

#[cfg(unix)]
fn pipe(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

#[test]
#[cfg(unix)]
fn pipes_are_refused_and_not_waited_for() {
    each(pipe, &["a pipe"]);
}

#[test]
fn folders_are_refused() {
    each(|path| std::fs::create_dir(path).unwrap(), &["a folder"]);
}

/// A file of a terabyte takes no space on a disk that stores no zeros.
#[test]
fn immense_files_are_refused() {
    each(|path| std::fs::File::create(path).unwrap().set_len(1 << 40).unwrap(), &["more than"]);
}

/// The program itself ends with status 2 and one line where it would wait for ever.
#[test]
#[cfg(unix)]
fn the_program_says_so_too() {
    let place = Place::new();
    pipe(&place.path("pipe.toml"));
    for words in [
        "list parameters --scene pipe.toml",
        "list parameters --scene /dev/zero",
        "query ao --scene plane --points pipe.toml",
        "report /dev",
    ] {
        let text = ended(place.fathom(words), 2).err;
        assert_eq!(text.lines().count(), 1, "{words}: {text}");
    }
    // A pipe as standard input is no file either.
    let mut child = fathom("list parameters --scene /dev/stdin")
        .stdin(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(2));
}

/// Why an archive of one line many times over is no mesh.
fn packed_lines(head: &str, line: &str, times: usize, reason: &str) {
    let place = Place::new();
    let path = place.write("a.obj.gz", gzip(format!("{head}{}", line.repeat(times)).as_bytes()));
    holds(&refused(line, || mesh(&path)), &[reason]);
}

const CORNERS: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

#[test]
fn lines_that_hold_no_triangle_take_no_memory() {
    for line in ["f 1\n", "l 1 1 1\n", "f 1 2\n", "o\n", "g a\n", "p 1\n"] {
        packed_lines(CORNERS, line, 1 << 20, "no triangles");
    }
}

#[test]
fn objects_vertices_and_triangles_are_counted() {
    for (head, line, most, what) in [
        (CORNERS, "f 1 2 3\no\n", 100_000, "objects"),
        ("", "v 0 0 0\n", 3_600_000, "vertices"),
        ("", "vn 0 0 1\n", 3_600_000, "normals"),
        (CORNERS, "f 1 2 3\n", 4_000_000, "triangles"),
    ] {
        packed_lines(head, line, most + 1, &format!("more than {most} {what}"));
    }
}

/// Writes a scene or an experiment, which must be refused for this.
#[track_caller]
fn refused_text(text: &str, reader: Reader, reason: &str) {
    let place = Place::new();
    let path = place.write("a.toml", text);
    holds(&refused("text", || reader(&path)), &[reason]);
}

#[test]
fn a_scene_of_thousands_of_knots_is_refused() {
    let knot = "[[object]]\nname = \"k\"\ngenerator = \"knot\"\nparams = { segments = 700, sides = 160 }\n";
    refused_text(&(seeds::small_scene() + &knot.repeat(2000)), scene, "of 4000000");
}

const EXPERIMENT: &str =
    "id = \"e\"\ntitle = \"t\"\nsource = \"s\"\npipeline = \"underwater\"\nscene = \"tank\"\n";

#[test]
fn axes_that_multiply_to_millions_of_cells_are_refused() {
    let axis = "[[sweep.axis]]\nname = \"a\"\nvalues = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]\n";
    for axes in [7, 30] {
        let text = format!("{EXPERIMENT}[[sweep]]\n{}", axis.repeat(axes));
        refused_text(&text, experiment, "counted too: at most 20000");
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
fn two_million_turns_are_refused() {
    let turns = "1,".repeat(400_000);
    let text = format!("{EXPERIMENT}[views]\nquantity = \"q\"\nturns_deg = [{turns}]\n");
    refused_text(&text, experiment, "at most 72");
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
        refused_text(text, scene, "");
        refused_text(text, experiment, "");
        refused_text(&format!("{EXPERIMENT}[params]\n{text}"), experiment, "");
    }
}

#[test]
fn long_and_deep_lines_of_records_are_damage() {
    let place = Place::new();
    let long = "9".repeat(9 << 20);
    let deep = "[".repeat(1 << 20);
    let path = place.write("records.jsonl", format!("{long}\n{deep}\n{{}}\n"));
    let (read, peak) = peak_of(|| record::read(&path).unwrap());
    assert_eq!(read.damaged.len(), 3);
    assert!(read.damaged[0].to_string().contains("longer than 8 MiB"));
    assert!(peak < 64 << 20, "{peak}");
}

/// A comparison whose text is changed, or whose lines are followed by others.
fn changed(change: impl Fn(String) -> String) -> Result<StoredComparison, String> {
    let place = Place::new();
    let text = String::from_utf8(seeds::comparisons().remove(0)).unwrap();
    place.write("records.jsonl", change(text));
    told(StoredComparison::read(&place.path("")))
}

#[test]
fn shares_of_a_comparison_lie_between_0_and_1() {
    for key in ["alpha", "threshold", "instruction_threshold"] {
        for share in ["1.5", "1", "0", "-0.1", "1e308"] {
            let start = format!("\"{key}\":0");
            let other = format!("\"{key}\":{share},\"x\":0");
            let fault = changed(|text| text.replacen(&start, &other, 1)).unwrap_err();
            holds(&fault, &["no readable header"]);
        }
    }
    assert!(changed(|text| text).is_ok());
}

#[test]
fn thousands_of_launches_and_pairs_are_judged_by_those_that_count() {
    let launches = (10..5000).flat_map(|launch| {
        let pair = Compared::Pair(pair(launch, 0, TRACE, 2.0));
        [Compared::Launch(Launch { launch, ..Launch::default() }), pair]
    });
    let more = lines(launches.map(Record::from));
    let (read, peak) = peak_of(|| {
        let read = changed(|text| text + &more).unwrap();
        Verdicts::of(&read);
        read
    });
    assert_eq!(read.launches.len(), 200);
    assert!(read.damaged[0].contains("4800 launches"), "{:?}", read.damaged);
    assert!(peak < 64 << 20, "{peak}");
    let pairs = (1..40_000).map(|round| pair(0, round, TRACE, 5e-4 * f64::from(round)));
    let more = lines(pairs.map(|pair| Compared::Pair(pair).into()));
    let (_, peak) = peak_of(|| {
        let read = changed(|text| text + &more).unwrap();
        Verdicts::of(&read);
    });
    assert!(peak < 256 << 20, "{peak}");
}

/// Of the lines that are none between the records of a run, at most twenty are told one by one, then a count.
#[test]
fn hundred_thousand_damaged_lines_are_counted() {
    let text = String::from_utf8(seeds::records().remove(0)).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let torn = format!("{}\n", &lines[2][..30]).repeat(100_001);
    let text = format!("{}\n{torn}{}\n", lines[..3].join("\n"), lines[2]);
    let place = Place::new();
    let path = place.write("run/records.jsonl", text);
    let (read, peak) = peak_of(|| record::read(&path).unwrap());
    assert_eq!((read.damaged.count(), read.damaged.len()), (100_001, 20));
    assert_eq!(read.records.len(), 4);
    assert!(peak < 16 << 20, "{peak}");
    for (words, more) in [
        ("report run", "99981 more lines"),
        ("export csv run", "99981 more lines"),
        ("history add run --commit c --branch b --db h.sqlite", "(and 100000 more)"),
    ] {
        let output = place.fathom(words).output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(text.lines().count() < 25, "{words}: {text}");
        holds(&text, &[more]);
    }
    holds(&place.read("run/index.html"), &["99981 more lines"]);
}

/// The file is never in memory as a whole, nor are all of its records.
#[test]
fn a_history_reads_a_run_record_by_record() {
    let text = String::from_utf8(seeds::records().remove(0)).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let of_cell =
        |n: usize| lines[2].replacen("\"cell\":\"", &format!("\"cell\":\"n={n},"), 1) + "\n";
    let cells: String = (0..3000).map(of_cell).collect();
    let records = format!("{}\n{}\n{cells}{}\n", lines[0], lines[1], lines[3]);
    let place = Place::new();
    place.write("records.jsonl", &records);
    let (run, peak) = peak_of(|| NewRun::read(&place.path(""), "records.jsonl").unwrap());
    assert_eq!(run.cells, 3000);
    assert!(peak < records.len(), "{peak} for {}", records.len());
}

/// An archive of 64 MiB in the place of a run's records.
#[test]
fn an_archive_in_a_history_is_not_kept() {
    let place = Place::new();
    let path = place.write("history.sqlite", seeds::history());
    let bomb = gzip(&vec![0; 64 << 20]);
    let connection = rusqlite::Connection::open(&path).unwrap();
    connection.execute("UPDATE fathom_run SET records = $1", [bomb]).unwrap();
    drop(connection);
    let mut history = History::open(&path).unwrap();
    let run = history.runs(&Selection::default()).unwrap().remove(0);
    let (got, peak) = peak_of(|| history.records(&run.digest));
    assert!(got.unwrap_err().to_string().contains("the database is damaged"));
    assert!(peak < 8 << 20, "{peak}");
}

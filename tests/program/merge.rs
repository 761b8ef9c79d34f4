//! Shards of a run, measured and merged, against the run.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::common::{cells, experiment_files, fathom, hostile, measured};
use fathom::experiments::Experiment;
use fathom::harness::plan::{self, Request};
use fathom::harness::shard;
use fathom::record::{self, Cell, End, Part, Record, Run};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use tempfile::TempDir;

/// The committed reference run.
fn reference() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("reports/llvmpipe")
}

/// A run's records as shards would have written them, with the run's header and in sum its end.
struct Split {
    experiments: Vec<Experiment>,
    header: Run,
    cells: Vec<Cell>,
    end: End,
}

impl Split {
    fn of(records: Vec<Record>) -> Self {
        let (mut experiments, mut header, mut cells, mut end) =
            (Vec::new(), None, Vec::new(), None);
        for record in records {
            match record {
                Record::Run(run) => header = Some(*run),
                Record::Experiment(definition) => {
                    experiments.push(Experiment::parse(&definition.id, &definition.toml).unwrap());
                }
                Record::Cell(cell) => cells.push(*cell),
                Record::End(ended) => end = Some(ended),
                Record::Comparison(_) => unreachable!(),
            }
        }
        Self { experiments, header: header.unwrap(), cells, end: end.unwrap() }
    }

    fn write(&self, part: Part, folder: &Path) {
        let request = Request::default();
        let profile = self.header.profile;
        let shard = shard::of(part, &self.experiments, &request, profile).unwrap();
        let mut mine = plan::expand(&self.experiments, &request, profile).unwrap();
        shard::keep(part, &self.experiments, &mut mine);
        let mine: BTreeSet<(&str, &str)> = mine
            .iter()
            .flatten()
            .map(|plan| (plan.experiment.as_str(), plan.cell.as_str()))
            .collect();
        let header = Run { shard: Some(shard), ..self.header.clone() };
        let definition = |experiment: &Experiment| {
            let (id, toml) = (experiment.id.clone(), experiment.text.clone());
            Record::Experiment(record::Definition { id, toml })
        };
        let is_mine = |cell: &&Cell| mine.contains(&(cell.experiment.as_str(), cell.cell.as_str()));
        let mut records = vec![Record::Run(Box::new(header))];
        records.extend(self.experiments.iter().map(definition));
        let mine = self.cells.iter().filter(is_mine);
        records.extend(mine.map(|cell| Record::Cell(Box::new(cell.clone()))));
        if part.number == 1 {
            records.push(Record::End(self.end.clone()));
        }
        fs::create_dir_all(folder).unwrap();
        record::Writer::create(&folder.join("records.jsonl")).unwrap().write_all(&records).unwrap();
    }

    fn folders(&self, of: u32, parent: &Path) -> Vec<PathBuf> {
        let folder = |number: u32| {
            let folder = parent.join(format!("shard-{number}"));
            self.write(Part { number, of }, &folder);
            folder
        };
        (1..=of).map(folder).collect()
    }
}

/// The reference run's records of the experiments `uw-…`.
fn underwater() -> Vec<Record> {
    let mut records = record::read(&reference().join("records.jsonl")).unwrap().records;
    records.retain(|record| match record {
        Record::Cell(cell) => cell.experiment.starts_with("uw-"),
        Record::Experiment(definition) => definition.id.starts_with("uw-"),
        _ => true,
    });
    records
}

fn merge(folders: &[PathBuf], out: &Path) -> Command {
    let mut command = fathom();
    command.arg("merge").args(folders).arg("--out").arg(out);
    command
}

/// Names and contents of all files in a folder.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .flatten()
        .filter(|entry| entry.path().is_file())
        .map(|entry| {
            let name = entry.file_name().into_string().unwrap();
            (name, fs::read(entry.path()).unwrap())
        })
        .collect();
    files.sort();
    files
}

/// Reports of merged shards are those of the run of the same samples, byte for byte, however many shards there were.
#[test]
fn merged_shards_give_the_reports_of_the_run() {
    let temporary = TempDir::new().unwrap();
    let whole = temporary.path().join("whole");
    fs::create_dir(&whole).unwrap();
    fs::copy(reference().join("records.jsonl"), whole.join("records.jsonl")).unwrap();
    assert!(fathom().arg("report").arg(&whole).output().unwrap().status.success());
    let split = Split::of(record::read(&whole.join("records.jsonl")).unwrap().records);
    for of in [1, 7, 64] {
        let parent = temporary.path().join(of.to_string());
        let mut folders = split.folders(of, &parent);
        // The order in which folders are named does not matter.
        folders.rotate_left(of as usize / 2);
        let out = parent.join("merged");
        let merged = merge(&folders, &out).output().unwrap();
        assert!(merged.status.success(), "{merged:?}");
        for ((name, bytes), (other, whole)) in files(&out).into_iter().zip(files(&whole)) {
            assert_eq!(name, other);
            // Records stand in another order.
            if name != "records.jsonl" {
                assert!(bytes == whole, "{name} of {of} shards");
            }
        }
    }
}

/// A run that went on elsewhere has cells of two machines. A claim that speaks of both is not judged.
#[test]
fn no_verdict_rests_on_two_machines() {
    let records = record::read(&reference().join("records.jsonl")).unwrap().records;
    let mut split = Split::of(records);
    split.experiments.retain(|experiment| experiment.id == "uw-photons");
    split.cells.retain(|cell| cell.experiment == "uw-photons");
    let summary = |hosts: [&str; 2]| {
        let folder = TempDir::new().unwrap();
        let mut records = Vec::new();
        for (number, host) in hosts.into_iter().enumerate() {
            // Every second cell, so that each claim speaks of both machines.
            let cells = split.cells.iter().skip(number).step_by(hosts.len());
            let mut header = split.header.clone();
            header.conditions.host = Some(host.to_owned());
            records.push(Record::Run(Box::new(header)));
            records.extend(cells.map(|cell| Record::Cell(Box::new(cell.clone()))));
        }
        records.push(Record::End(split.end.clone()));
        let path = folder.path().join("records.jsonl");
        record::Writer::create(&path).unwrap().write_all(&records).unwrap();
        assert!(fathom().arg("report").arg(folder.path()).output().unwrap().status.success());
        fs::read_to_string(folder.path().join("summary.md")).unwrap()
    };
    let (one, two) = (summary(["a", "a"]), summary(["a", "b"]));
    let told = "its cells were measured on a and b";
    assert!(one.contains("### Supported") && !one.contains(told), "{one}");
    assert!(two.contains(told) && !two.contains("### Supported"), "{two}");
}

/// Two shards on this machine, one of them in two sittings, and the run that they make.
#[test]
fn shards_that_were_measured_make_a_run() {
    let temporary = TempDir::new().unwrap();
    let experiments = experiment_files(temporary.path(), 3);
    let run = |part: &str, folder: &Path| {
        let mut run = fathom();
        run.arg("run").args(&experiments).args(["--budget", "0.5", "--no-ceilings"]);
        run.args(["--shard", part, "--out"]).arg(folder);
        run
    };
    let folders = [1, 2].map(|number| temporary.path().join(format!("shard-{number}")));
    for (number, folder) in (1..).zip(&folders) {
        let ran = run(&format!("{number}/2"), folder).output().unwrap();
        assert!(ran.status.success(), "{ran:?}");
    }
    let again = run("1/2", &folders[0]).arg("--resume").output().unwrap();
    assert!(again.status.success(), "{again:?}");
    let other = run("2/2", &folders[0]).arg("--resume").output().unwrap();
    let told = String::from_utf8_lossy(&other.stderr).into_owned();
    assert_eq!(other.status.code(), Some(2), "{told}");
    assert!(told.contains("holds shard 1/2 of the plan"), "{told}");
    let out = temporary.path().join("merged");
    let merged = merge(&folders, &out).output().unwrap();
    assert!(merged.status.success(), "{merged:?}");
    let all: Vec<Cell> = folders.iter().flat_map(|folder| cells(folder)).collect();
    assert!(folders.iter().all(|folder| !cells(folder).is_empty()));
    let joined = cells(&out);
    assert_eq!(joined.len(), all.len());
    assert!(joined.iter().all(|cell| all.contains(cell)));
    // No round is of two shards.
    let rounds = |folder: &PathBuf| -> BTreeSet<u32> {
        cells(folder).iter().flat_map(|cell| measured(cell).frame.rounds.clone()).collect()
    };
    assert!(rounds(&folders[0]).is_disjoint(&rounds(&folders[1])));
    for (_, bytes) in files(&out) {
        assert!(!bytes.is_empty());
    }
    assert!(out.join("index.html").is_file() && out.join("renders").is_dir());
}

/// Wherever it is killed, merging leaves its input as it was, and all of its output or none. The first kills fall into the writing
/// of its files, whatever the machine. The others come at random times, and wherever they fall, the law holds.
#[cfg(unix)]
#[test]
fn killed_at_any_moment_it_leaves_all_or_nothing() {
    const MOMENTS: u64 = 15;
    let temporary = TempDir::new().unwrap();
    let folders = Split::of(underwater()).folders(4, temporary.path());
    let before: Vec<_> = folders.iter().map(|folder| files(folder)).collect();
    let out = temporary.path().join("merged");
    assert!(merge(&folders, &out).output().unwrap().status.success());
    let whole = files(&out);
    fs::remove_dir_all(&out).unwrap();
    let inputs_are_left = || {
        for (folder, before) in folders.iter().zip(&before) {
            assert!(files(folder) == *before);
        }
    };
    let largest = whole.iter().map(|(_, bytes)| bytes.len() as u64).max().unwrap();
    for moment in 0..MOMENTS {
        let blocks = largest * moment / MOMENTS / 512;
        let killed = crate::common::killed_beyond(blocks, &merge(&folders, &out)).output().unwrap();
        assert_eq!(killed.status.code(), None, "{killed:?}");
        assert!(!out.exists(), "moment {moment}");
        inputs_are_left();
    }
    let (mut none, mut all) = (0, 0);
    let mut random = Pcg64::seed_from_u64(16);
    for _ in 0..MOMENTS {
        let mut merging = merge(&folders, &out);
        let mut merging = merging.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs_f64(random.random_range(0.0..0.5)));
        merging.kill().ok();
        merging.wait().unwrap();
        if out.exists() {
            all += 1;
            assert!(files(&out) == whole);
            fs::remove_dir_all(&out).unwrap();
        } else {
            none += 1;
        }
        inputs_are_left();
    }
    println!("killed {MOMENTS} times by a clock: {none} left nothing, {all} everything");
    assert!(merge(&folders, &out).output().unwrap().status.success());
    assert!(files(&out) == whole);
    // What a killed process left has a name of its own, and none removes it.
    let names = names_in(temporary.path());
    let left = names.iter().filter(|name| name.starts_with(".merged.merging-")).count();
    assert_eq!(names.len() - left, folders.len() + 1, "{names:?}");
}

/// A staging folder of a name that could be foretold was emptied, and what it linked to.
#[cfg(unix)]
#[test]
fn what_lies_where_it_might_be_made_stays() {
    let temporary = TempDir::new().unwrap();
    let folders = Split::of(underwater()).folders(2, temporary.path());
    let [precious, other] = ["precious", ".out.merging"].map(|name| temporary.path().join(name));
    for folder in [&precious, &other] {
        fs::create_dir(folder).unwrap();
        fs::write(folder.join("a"), "keep").unwrap();
    }
    std::os::unix::fs::symlink(&precious, temporary.path().join(".merged.merging")).unwrap();
    for name in ["merged", "out"] {
        assert!(merge(&folders, &temporary.path().join(name)).output().unwrap().status.success());
    }
    for folder in [&precious, &other] {
        assert_eq!(files(folder), [("a".to_owned(), b"keep".to_vec())]);
    }
}

/// Records of anyone may be merged.
#[test]
fn hostile_names_stay_in_the_folder() {
    let temporary = TempDir::new().unwrap();
    let mut split = Split::of(underwater());
    let folders = split.folders(2, temporary.path());
    split.header.adapter.name = "../../../evil'; DROP TABLE x; --\u{1b}[2J/\u{202e}".to_owned();
    for (cell, name) in split.cells.iter_mut().zip(hostile::HOSTILE.iter().cycle()) {
        cell.cell = format!("{}{name}", cell.cell);
        let measured = cell.measured().cloned();
        if let Some(mut measured) = measured {
            measured
                .pictures
                .iter_mut()
                .for_each(|picture| picture.path = "../../../passwd".into());
            cell.outcome = record::Outcome::Measured(Box::new(measured));
        }
    }
    let mut lines = record::read(&folders[1].join("records.jsonl")).unwrap().records;
    for line in &mut lines {
        if let Record::Run(run) = line {
            run.adapter.name = split.header.adapter.name.clone();
        }
    }
    lines.extend(split.cells.into_iter().map(|cell| Record::Cell(Box::new(cell))));
    record::Writer::create(&folders[1].join("records.jsonl")).unwrap().write_all(&lines).unwrap();
    let before = names_in(temporary.path());
    let out = temporary.path().join("merged");
    let merged = merge(&folders, &out).output().unwrap();
    assert_eq!(merged.status.code(), Some(1), "{merged:?}");
    assert_eq!(names_in(temporary.path()), [before, vec!["merged".to_owned()]].concat());
    let told = [merged.stdout, merged.stderr].concat();
    assert!(!told.contains(&0x1b), "{}", String::from_utf8_lossy(&told));
    assert!(out.join("index.html").is_file());
    let runs: Vec<String> =
        names_in(&out).into_iter().filter(|name| out.join(name).is_dir()).collect();
    assert_eq!(runs.len(), 2, "{runs:?}");
    assert!(runs.iter().all(|name| out.join(name).join("records.jsonl").is_file()));
}

/// Names in a folder, sorted; `merged` comes last of those that tests here make.
fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort_by_key(|name| (name == "merged", name.clone()));
    names
}

#[test]
fn bad_input_is_one_line() {
    let temporary = TempDir::new().unwrap();
    let out = temporary.path().join("merged");
    let empty = temporary.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let told = |folders: &[PathBuf]| {
        let merged = merge(folders, &out).output().unwrap();
        let told = String::from_utf8_lossy(&merged.stderr).into_owned();
        assert_eq!(merged.status.code(), Some(2), "{told}");
        assert_eq!(told.lines().count(), 1, "{told}");
        assert!(!out.exists());
        told
    };
    assert!(told(&[reference()]).contains("holds a whole run"));
    assert!(told(&[empty]).contains("records.jsonl"));
    for part in ["0/2", "3/2", "1", "a/b", "1/4096"] {
        let ran = fathom().args(["run", "--shard", part]).output().unwrap();
        assert_eq!(ran.status.code(), Some(2), "{part}");
    }
}

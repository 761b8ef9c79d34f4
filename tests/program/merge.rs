//! Shards of a run, measured and merged, against the run.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::common::{
    Ends, Place, cells, hostile, measured, names, own_experiments, reference, write_records,
};
use fathom::experiments::Experiment;
use fathom::harness::plan::{self, Request};
use fathom::harness::shard;
use fathom::record::{self, Cell, End, Part, Record, Run};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

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
        write_records(folder, &records);
    }

    /// Writes so many shards of the run; their folders.
    fn shards(&self, of: u32, place: &Place) -> Vec<String> {
        let folders: Vec<String> =
            (1..=of).map(|number| format!("shard-{number}-of-{of}")).collect();
        for (number, folder) in (1..).zip(&folders) {
            self.write(Part { number, of }, &place.path(folder));
        }
        folders
    }
}

/// The committed run's records.
fn committed() -> Vec<Record> {
    reference().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The reference run's records of the experiments `uw-…`.
fn underwater() -> Vec<Record> {
    let mut records = committed();
    records.retain(|record| match record {
        Record::Cell(cell) => cell.experiment.starts_with("uw-"),
        Record::Experiment(definition) => definition.id.starts_with("uw-"),
        _ => true,
    });
    records
}

fn merge(place: &Place, folders: &[String], out: &str) -> Command {
    place.fathom(format!("merge {} --out {out}", folders.join(" ")))
}

/// Names and contents of all files in a folder.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let files = names(folder).into_iter().filter(|name| folder.join(name).is_file());
    files.map(|name| (name.clone(), fs::read(folder.join(name)).unwrap())).collect()
}

/// Reports of merged shards are those of the run of the same samples, byte for byte, however many shards there were.
#[test]
fn merged_shards_give_the_reports_of_the_run() {
    let place = Place::new();
    place.write("whole/records.jsonl", reference());
    place.fathom("report whole").ends(0);
    let whole = files(&place.path("whole"));
    let split = Split::of(committed());
    for of in [1, 7, 64] {
        let mut folders = split.shards(of, &place);
        // The order in which folders are named does not matter.
        folders.rotate_left(of as usize / 2);
        let out = format!("merged-{of}");
        merge(&place, &folders, &out).ends(0);
        for ((name, bytes), (other, whole)) in files(&place.path(out)).iter().zip(&whole) {
            assert_eq!(name, other);
            // Records stand in another order.
            assert!(name == "records.jsonl" || bytes == whole, "{name} of {of} shards");
        }
    }
}

/// A run that went on elsewhere has cells of two machines. A claim that speaks of both is not judged.
#[test]
fn no_verdict_rests_on_two_machines() {
    let mut split = Split::of(committed());
    split.experiments.retain(|experiment| experiment.id == "uw-photons");
    split.cells.retain(|cell| cell.experiment == "uw-photons");
    let summary = |hosts: [&str; 2]| {
        let place = Place::new();
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
        write_records(&place.path(""), &records);
        place.fathom("report .").ends(0);
        place.read("summary.md")
    };
    let (one, two) = (summary(["a", "a"]), summary(["a", "b"]));
    let told = "its cells were measured on a and b";
    assert!(one.contains("### Supported") && !one.contains(told), "{one}");
    assert!(two.contains(told) && !two.contains("### Supported"), "{two}");
}

/// Two shards on this machine, one of them in two sittings, and the run that they make.
#[test]
fn shards_that_were_measured_make_a_run() {
    let place = Place::new();
    let experiments = own_experiments(&place, 3);
    let run = |part: &str, options: &str| {
        let words =
            format!("run {experiments} --budget 0.5 --no-ceilings --shard {part} {options}");
        place.fathom(words)
    };
    run("1/2", "--out shard-1").ends(0);
    run("2/2", "--out shard-2").ends(0);
    run("1/2", "--out shard-1 --resume").ends(0);
    run("2/2", "--out shard-1 --resume").refused("holds shard 1/2 of the plan");
    let folders = ["shard-1", "shard-2"].map(str::to_owned);
    merge(&place, &folders, "merged").ends(0);
    let shards = folders.map(|folder| cells(&place.path(folder)));
    assert!(shards.iter().all(|cells| !cells.is_empty()));
    let out = &place.path("merged");
    let joined = cells(out);
    assert_eq!(joined.len(), shards.iter().map(Vec::len).sum::<usize>());
    assert!(joined.iter().all(|cell| shards.iter().any(|cells| cells.contains(cell))));
    // No round is of two shards.
    let [first, second] = shards.map(|cells| -> BTreeSet<u32> {
        cells.iter().flat_map(|cell| measured(cell).frame.rounds.clone()).collect()
    });
    assert!(first.is_disjoint(&second));
    assert!(files(out).iter().all(|(_, bytes)| !bytes.is_empty()));
    assert!(out.join("index.html").is_file() && out.join("renders").is_dir());
}

/// Wherever it is killed, merging leaves its input as it was, and all of its output or none. The first kills fall into the writing
/// of its files, whatever the machine. The others come at random times, and wherever they fall, the law holds.
#[cfg(unix)]
#[test]
fn killed_at_any_moment_it_leaves_all_or_nothing() {
    const MOMENTS: u64 = 15;
    let place = Place::new();
    let folders = Split::of(underwater()).shards(4, &place);
    let inputs = || folders.iter().map(|folder| files(&place.path(folder))).collect::<Vec<_>>();
    let before = inputs();
    let merge = || merge(&place, &folders, "merged");
    let out = &place.path("merged");
    merge().ends(0);
    let whole = files(out);
    fs::remove_dir_all(out).unwrap();
    let largest = whole.iter().map(|(_, bytes)| bytes.len() as u64).max().unwrap();
    for moment in 0..MOMENTS {
        let blocks = largest * moment / MOMENTS / 512;
        let killed = crate::common::killed_beyond(blocks, &merge()).output().unwrap();
        assert_eq!(killed.status.code(), None, "{killed:?}");
        assert!(!out.exists(), "moment {moment}");
        assert!(inputs() == before);
    }
    let (mut none, mut all) = (0, 0);
    let mut random = Pcg64::seed_from_u64(16);
    for _ in 0..MOMENTS {
        let mut merging = merge().stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs_f64(random.random_range(0.0..0.5)));
        merging.kill().ok();
        merging.wait().unwrap();
        if out.exists() {
            all += 1;
            assert!(files(out) == whole);
            fs::remove_dir_all(out).unwrap();
        } else {
            none += 1;
        }
        assert!(inputs() == before);
    }
    println!("killed {MOMENTS} times by a clock: {none} left nothing, {all} everything");
    merge().ends(0);
    assert!(files(out) == whole);
    // What a killed process left has a name of its own, and none removes it.
    let names = names(&place.path(""));
    let left = names.iter().filter(|name| name.starts_with(".merged.merging-")).count();
    assert_eq!(names.len() - left, folders.len() + 1, "{names:?}");
}

/// A staging folder of a name that could be foretold was emptied, and what it linked to.
#[cfg(unix)]
#[test]
fn what_lies_where_it_might_be_made_stays() {
    let place = Place::new();
    let folders = Split::of(underwater()).shards(2, &place);
    for folder in ["precious", ".out.merging"] {
        place.write(format!("{folder}/a"), "keep");
    }
    std::os::unix::fs::symlink(place.path("precious"), place.path(".merged.merging")).unwrap();
    for out in ["merged", "out"] {
        merge(&place, &folders, out).ends(0);
    }
    for folder in ["precious", ".out.merging"] {
        assert_eq!(files(&place.path(folder)), [("a".to_owned(), b"keep".to_vec())]);
    }
}

/// Records of anyone may be merged.
#[test]
fn hostile_names_stay_in_the_folder() {
    let place = Place::new();
    let mut split = Split::of(underwater());
    let folders = split.shards(2, &place);
    for (cell, name) in split.cells.iter_mut().zip(hostile::HOSTILE.iter().cycle()) {
        cell.cell = format!("{}{name}", cell.cell);
        for picture in cell.measured_mut().into_iter().flat_map(|measured| &mut measured.pictures) {
            picture.path = "../../../passwd".into();
        }
    }
    let other = place.path(&folders[1]);
    let mut lines = record::read(&other.join("records.jsonl")).unwrap().records;
    for line in &mut lines {
        if let Record::Run(run) = line {
            run.adapter.name = "../../../evil'; DROP TABLE x; --\u{1b}[2J/\u{202e}".to_owned();
        }
    }
    lines.extend(split.cells.into_iter().map(|cell| Record::Cell(Box::new(cell))));
    write_records(&other, &lines);
    let told = merge(&place, &folders, "merged").ends(1);
    assert_eq!(names(&place.path("")), ["merged", &folders[0], &folders[1]]);
    assert!(!told.out.contains('\x1b') && !told.err.contains('\x1b'), "{}{}", told.out, told.err);
    let out = place.path("merged");
    assert!(out.join("index.html").is_file());
    let runs = names(&out).into_iter().map(|name| out.join(name));
    let runs: Vec<_> = runs.filter(|run| run.is_dir()).collect();
    assert_eq!(runs.len(), 2, "{runs:?}");
    assert!(runs.iter().all(|run| run.join("records.jsonl").is_file()));
}

#[test]
fn bad_input_is_one_line() {
    let place = Place::new();
    std::fs::create_dir(place.path("empty")).unwrap();
    place.write("whole/records.jsonl", reference());
    for (folder, reason) in [("whole", "holds a whole run"), ("empty", "records.jsonl")] {
        merge(&place, &[folder.to_owned()], "merged").refused(reason);
        assert!(!place.path("merged").exists());
    }
    for part in ["0/2", "3/2", "1", "a/b", "1/4096"] {
        place.fathom(format!("run --shard {part}")).refused("--shard");
    }
}

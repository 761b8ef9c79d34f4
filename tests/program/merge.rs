//! Shards of a run, measured and merged, against the run.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::common::{
    Ends, Place, cells, hostile, measured, names, own_experiments, reference, reference_of,
    write_records,
};
use fathom::experiments::Experiment;
use fathom::harness::plan::{self, Request};
use fathom::harness::shard;
use fathom::record::{self, Part, Record};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Writes so many shards of a run as they would have been measured, with the run's header, and its end in the first; their folders.
fn shards(run: &[Record], of: u32, place: &Place) -> Vec<String> {
    let definitions = run.iter().filter_map(Record::try_as_experiment_ref);
    let experiments: Vec<Experiment> = definitions
        .map(|definition| Experiment::parse(&definition.id, &definition.toml).unwrap())
        .collect();
    let request = Request::default();
    let profile = run[0].try_as_run_ref().unwrap().profile;
    let shard = |number| {
        let part = Part { number, of };
        let mut plans = plan::expand(&experiments, &request, profile).unwrap();
        shard::keep(part, &experiments, &mut plans);
        let plans = plans.iter().flatten();
        let mine: BTreeSet<_> = plans.map(|plan| (&*plan.experiment, &*plan.cell)).collect();
        let mut records = run.to_vec();
        records.retain_mut(|record| match record {
            Record::Run(run) => {
                run.shard = Some(shard::of(part, &experiments, &request, profile).unwrap());
                true
            }
            Record::Cell(cell) => mine.contains(&(&*cell.experiment, &*cell.cell)),
            Record::End(_) => number == 1,
            _ => true,
        });
        let folder = format!("shard-{number}-of-{of}");
        write_records(&place.path(&folder), &records);
        folder
    };
    (1..=of).map(shard).collect()
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
    let run = reference_of("");
    for of in [1, 7, 64] {
        let mut folders = shards(&run, of, &place);
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
    let [header, _, cells @ .., end] = &reference_of("uw-photons")[..] else {
        panic!("the run has no such experiment")
    };
    let summary = |hosts: [&str; 2]| {
        let place = Place::new();
        let mut records = Vec::new();
        for (number, host) in hosts.into_iter().enumerate() {
            let mut header = header.clone();
            header.try_as_run_mut().unwrap().conditions.host = Some(host.to_owned());
            records.push(header);
            // Every second cell, so that each claim speaks of both machines.
            records.extend(cells.iter().skip(number).step_by(hosts.len()).cloned());
        }
        records.push(end.clone());
        write_records(&place.path(""), &records);
        place.fathom("report .").ends(0);
        place.read("summary.md")
    };
    let (one, two) = (summary(["a", "a"]), summary(["a", "b"]));
    let told = "its cells were measured on a and b";
    assert!(one.contains("| supported |") && !one.contains(told), "{one}");
    assert!(two.contains(told) && !two.contains("| supported |"), "{two}");
}

/// Two shards on this machine, one of them in two sittings, and the run that they make.
#[test]
fn shards_that_were_measured_make_a_run() {
    let place = Place::new();
    let experiments = own_experiments(&place, 3);
    let run = |part: &str, options: &str| {
        let words = format!(
            "run {experiments} --budget 10m --precision 1 --no-ceilings --shard {part} {options}"
        );
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
    let folders = shards(&reference_of("uw-"), 4, &place);
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
    let folders = shards(&reference_of("uw-"), 2, &place);
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
    let run = reference_of("uw-");
    let folders = shards(&run, 2, &place);
    let mut cells: Vec<_> = run.into_iter().filter_map(Record::try_as_cell).collect();
    for (cell, name) in cells.iter_mut().zip(hostile::HOSTILE.iter().cycle()) {
        cell.cell = format!("{}{name}", cell.cell);
        for picture in cell.measured_mut().into_iter().flat_map(|measured| &mut measured.pictures) {
            picture.path = "../../../passwd".into();
        }
    }
    let other = place.path(&folders[1]);
    let mut lines = record::read(&other.join("records.jsonl")).unwrap().records;
    let header = lines[0].try_as_run_mut().unwrap();
    header.adapter.name = "../../../evil'; DROP TABLE x; --\u{1b}[2J/\u{202e}".to_owned();
    lines.extend(cells.into_iter().map(Record::Cell));
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

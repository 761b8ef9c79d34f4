//! Shards of a run, measured and joined, against the run.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::common::{
    Ends, Place, cells, measured, names, own_experiment, reference, reference_of, write_records,
};
use fathom::record::{Part, Record};

/// Writes the cells of a run in turn into so many shards, with the run's header, and its end in the first; their folders.
fn shards(run: &[Record], of: u32, place: &Place) -> Vec<String> {
    let shard = |number| {
        let mut turn = 0..;
        let mut records = run.to_vec();
        records.retain_mut(|record| match record {
            Record::Run(run) => {
                run.shard = Some(Part { number, of });
                true
            }
            Record::Cell(_) => turn.next().unwrap() % of == number - 1,
            Record::End(_) => number == 1,
            _ => true,
        });
        let folder = format!("shard-{number}-of-{of}");
        write_records(&place.path(&folder), &records);
        folder
    };
    (1..=of).map(shard).collect()
}

/// The records of all shards in one file, and the reports of that.
fn join(place: &Place, shards: &[String], out: &str) {
    let records = shards.iter().map(|shard| place.read(format!("{shard}/records.jsonl")));
    place.write(format!("{out}/records.jsonl"), records.collect::<String>());
    place.fathom(format!("report {out}")).ends(0);
}

/// Names and contents of all files in a folder.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let files = names(folder).into_iter().filter(|name| folder.join(name).is_file());
    files.map(|name| (name.clone(), fs::read(folder.join(name)).unwrap())).collect()
}

/// Reports of joined shards are those of the run of the same samples, byte for byte, however many shards there were.
#[test]
fn joined_shards_give_the_reports_of_the_run() {
    let place = Place::new();
    place.write("whole/records.jsonl", reference());
    place.fathom("report whole").ends(0);
    let whole = files(&place.path("whole"));
    let run = reference_of("");
    for of in [1, 7] {
        let mut folders = shards(&run, of, &place);
        // The order in which folders are named does not matter.
        folders.rotate_left(of as usize / 2);
        let out = format!("joined-{of}");
        join(&place, &folders, &out);
        // Records stand in another order, and page and summary tell of several headers.
        let is_same = |name: &str| name.ends_with(".svg") || name == "cells.csv";
        assert!(!place.read(format!("{out}/index.html")).contains("part of a run"));
        let joined = files(&place.path(out));
        assert_eq!(joined.len(), whole.len());
        for ((name, bytes), (other, whole)) in joined.iter().zip(&whole) {
            assert_eq!(name, other);
            assert!(!is_same(name) || bytes == whole, "{name} of {of} shards");
        }
    }
}

/// A run that went on elsewhere has cells of two machines. A claim that speaks of both is not judged.
#[test]
fn no_verdict_rests_on_two_machines() {
    let [header, experiment, cells @ .., end] = &reference_of("uw-photons")[..] else {
        panic!("the run has no such experiment")
    };
    let summary = |hosts: [&str; 2]| {
        let place = Place::new();
        let mut records = vec![experiment.clone()];
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
    let supported = "\n| supported";
    assert!(one.contains(supported) && !one.contains(told), "{one}");
    assert!(two.contains(told) && !two.contains(supported), "{two}");
}

/// Two shards on this machine, one of them in two sessions, and the run that they make.
#[test]
fn shards_that_were_measured_make_a_run() {
    let place = Place::new();
    for number in [1, 2] {
        place.write(format!("own-{number}.toml"), own_experiment(number));
    }
    let run = |part: &str, options: &str| {
        let run = "run own-1.toml own-2.toml --budget 10m --visits 1 --no-ceilings";
        place.fathom(format!("{run} --shard {part} {options}"))
    };
    run("1/2", "--out shard-1").ends(0);
    run("2/2", "--out shard-2").ends(0);
    run("1/2", "--out shard-1 --resume").ends(0);
    run("2/2", "--out shard-1 --resume")
        .refused("holds cells of another experiment, --set or --shard");
    let page = place.read("shard-1/index.html");
    assert!(page.contains("part of a run") && page.contains("shard 2/2 is not there"));
    let folders = ["shard-1", "shard-2"].map(str::to_owned);
    join(&place, &folders, "joined");
    let shards = folders.map(|folder| cells(&place.path(folder)));
    let joined = cells(&place.path("joined"));
    assert_eq!(joined, shards.concat());
    assert!(shards.iter().all(|cells| !cells.is_empty()));
    // No round is of two shards.
    let [first, second] = shards.map(|cells| -> BTreeSet<u32> {
        cells.iter().flat_map(|cell| measured(cell).frame.rounds.clone()).collect()
    });
    assert!(first.is_disjoint(&second));
}

//! No path, user's name or value of a variable is in anything that fathom writes, and not the host's name in records.
#![cfg(target_os = "linux")]

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{Place, SMALL, own_experiment};

/// Part of the folder's path, of the host's and the user's names, and of other variables.
const MARK: &str = "Zq7privat";
const VARIABLES: [&str; 8] = [
    "HOME",
    "HOSTNAME",
    "LOGNAME",
    "USER",
    "XDG_CACHE_HOME",
    "XDG_RUNTIME_DIR",
    "TMPDIR",
    "ANOTHER",
];
const VOLUME: &str = "--set view.width=16 --set view.height=16 --set voxel.resolution=16";

/// All files beneath a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let inner = entries.map(|path| if path.is_dir() { files(&path) } else { vec![path] });
    inner.flatten().collect()
}

#[test]
fn nothing_that_is_written_tells_paths_names_or_variables() {
    let place = Place::new();
    let home = place.path(MARK);
    let here = home.display();
    place.write(format!("{MARK}/own.toml"), own_experiment(1));
    place.write(format!("{MARK}/points.csv"), "x,y,z,nx,ny,nz\n0,-4,0,0,1,0\n");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/own_worker");
    fs::copy(example.join("worker.py"), home.join("worker.py")).unwrap();
    fs::copy(example.join("cells.toml"), home.join("cells.toml")).unwrap();
    fs::create_dir(home.join("told")).unwrap();
    let worker = &format!("python3 {here}/worker.py --counted");
    let compare = ["--base-cmd", worker, "--head-cmd", worker];
    let run = "run --no-ceilings --budget 10m --precision 1 --shard 1/1";
    // With the words behind them, and status.
    let commands: [(String, &[&str], i32); 21] = [
        (format!("{run} {here}/own.toml --out {here}/out"), &[], 0),
        (format!("merge {here}/out --out {here}/merged"), &[], 0),
        (format!("report {here}/out"), &[], 0),
        (format!("report {here}/out {here}/merged --out {here}/page"), &[], 0),
        (format!("export plots {here}/out -o {here}/plots"), &[], 0),
        (format!("export claims {here}/out -o {here}/claims.md"), &[], 0),
        (format!("export bencher {here}/out -o {here}/bencher.json"), &[], 0),
        (format!("dump caustics/trace {SMALL} -o {here}/dump"), &[], 0),
        (format!("render tank {SMALL} -o {here}/tank.png"), &[], 0),
        (
            format!("query ao --scene ball --points {here}/points.csv {VOLUME} -o {here}/ao.csv"),
            &[],
            0,
        ),
        (format!("history add {here}/out --commit c --branch b --db {here}/h.sqlite"), &[], 0),
        (format!("history show --db {here}/h.sqlite --out {here}/history"), &[], 0),
        (format!("history changes --json --db {here}/h.sqlite"), &[], 0),
        (
            format!(
                "compare --launches 2 --pairs 2 --base-env SECRET={MARK} --out {here}/compared --cells-file {here}/cells.toml"
            ),
            &compare,
            3,
        ),
        (format!("export markdown {here}/compared"), &[], 0),
        (format!("compare {here}/out/records.jsonl {here}/merged/records.jsonl"), &[], 4),
        ("verify voxel/clear --json".to_owned(), &[], 0),
        ("audit --json".to_owned(), &[], 0),
        ("ceilings --json".to_owned(), &[], 0),
        ("list --json".to_owned(), &[], 0),
        ("doctor --json".to_owned(), &[], 1),
    ];
    let variables = VARIABLES.map(|name| (name, home.join("told")));
    for (number, (words, more, status)) in commands.iter().enumerate() {
        let mut command = place.fathom(words);
        command.current_dir(&home).envs(variables.clone()).args(*more);
        let output = command.output().unwrap();
        assert_eq!(
            output.status.code(),
            Some(*status),
            "{words}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        // What is printed as JSON is passed on like a file.
        if words.contains("--json") {
            fs::write(home.join(format!("told/{number}.json")), output.stdout).unwrap();
        }
    }
    let own = ["own.toml", "points.csv", "worker.py", "cells.toml"].map(|name| home.join(name));
    let marked = files(&home).into_iter().filter(|path| !own.contains(path)).filter(|path| {
        fs::read(path).unwrap().windows(MARK.len()).any(|bytes| bytes == MARK.as_bytes())
    });
    assert_eq!(marked.collect::<Vec<_>>(), Vec::<PathBuf>::new());
    let records = fs::read_to_string(home.join("out/records.jsonl")).unwrap();
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let mut words = records.split(|c: char| !c.is_alphanumeric() && c != '-' && c != '.');
    assert!(host.trim().is_empty() || words.all(|word| word != host.trim()));
    assert!(records.contains(&fathom::private::machine().unwrap()));
}

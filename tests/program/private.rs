//! No path, user's name or value of a variable is in anything that fathom writes, and not the host's name in records.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use crate::common::{Ends, Place, SMALL, own_experiment};

/// Part of the folder's path, of the host's and the user's names, and of other variables.
pub const MARK: &str = "Zq7privat";
/// A folder that is not there.
pub const NOWHERE: &str = "/nonexistent/Zq7privat";
const VARIABLES: [&str; 7] =
    ["HOME", "HOSTNAME", "LOGNAME", "USER", "XDG_CACHE_HOME", "XDG_RUNTIME_DIR", "ANOTHER"];
/// Status and words. HERE is the marked folder, beneath which another one is the current folder.
const COMMANDS: &str = "\
    0 run --no-ceilings --budget 10m --visits 1 --shard 1/1 HERE/own.toml --out HERE/out
    0 report HERE/out
    0 export plots HERE/out -o HERE/plots
    0 export claims HERE/out -o HERE/claims.md
    0 export bencher HERE/out -o HERE/bencher.json
    0 dump caustics/trace SMALL -o HERE/dump
    0 render tank SMALL -o HERE/tank.png
    0 history add HERE/out --branch b --db HERE/h.sqlite
    0 history show --db HERE/h.sqlite --out HERE/history
    0 history changes --db HERE/h.sqlite --json
    3 compare --launches 2 --pairs 2 --base-env SECRET==MARK --base-cmd HERE/worker.sh --head-cmd HERE/worker.sh \
        --cells-file HERE/cells.toml --out HERE/compared
    4 compare HERE/out HERE/out/records.jsonl
    0 verify voxel/clear --json
    0 list adapters --json";

/// Variables with a value that holds the mark.
pub fn variables(value: &str) -> [(&str, &str); 7] {
    VARIABLES.map(|name| (name, value))
}

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
    let here = home.display().to_string();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/own_worker");
    let worker = format!("#!/bin/sh\nexec python3 {}/worker.py --counted\n", example.display());
    let own = [
        place.write(format!("{MARK}/own.toml"), own_experiment(1)),
        place.write(format!("{MARK}/cells.toml"), fs::read(example.join("cells.toml")).unwrap()),
        place.write(format!("{MARK}/worker.sh"), worker),
    ];
    fs::set_permissions(&own[2], fs::Permissions::from_mode(0o755)).unwrap();
    let told = place.write(format!("{MARK}/told/0.json"), "");
    for (number, line) in COMMANDS.lines().enumerate() {
        let (status, words) = line.trim().split_once(' ').unwrap();
        let words = words.replace("HERE", &here).replace("SMALL", SMALL).replace("=MARK", MARK);
        let mut command = place.fathom(words);
        command.current_dir(told.parent().unwrap()).envs(variables(&here));
        let output = command.ends(status.parse().unwrap());
        // What is printed as JSON is passed on like a file.
        if line.ends_with("--json") {
            place.write(format!("{MARK}/told/{number}.json"), output.out);
        }
    }
    let marked = files(&home).into_iter().filter(|path| !own.contains(path)).filter(|path| {
        fs::read(path).unwrap().windows(MARK.len()).any(|bytes| bytes == MARK.as_bytes())
    });
    assert_eq!(marked.collect::<Vec<_>>(), Vec::<PathBuf>::new());
    let records = place.read(format!("{MARK}/out/records.jsonl"));
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let mut words = records.split(|c: char| !c.is_alphanumeric() && c != '-' && c != '.');
    assert!(host.trim().is_empty() || words.all(|word| word != host.trim()));
    assert!(records.contains(&fathom::private::machine().unwrap()));
}

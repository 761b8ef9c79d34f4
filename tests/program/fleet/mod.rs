//! A fleet of tasks of a real Slurm, a controller and two nodes, with what may happen to them; and of commands that are scripts.
#![cfg(unix)]

mod cluster;
mod fake;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::common::{cells, experiment_files, fathom};
use cluster::{Cluster, NODES, wait};
use fathom::record::Cell;

/// Experiments of the run, each of two cells.
const EXPERIMENTS: usize = 5;

/// A run whose samples stop at this precision.
fn run_arguments(cluster: &Cluster, precision: &str) -> Vec<String> {
    let mut words = vec!["run".to_owned()];
    words.extend(experiment_files(cluster.folder.path(), EXPERIMENTS));
    words.extend(["--no-ceilings", "--budget", "12", "--precision", precision].map(str::to_owned));
    words
}

fn fleet(cluster: &Cluster, out: &Path, options: &[&str], run: &[String]) -> Command {
    let mut fleet = fathom();
    fleet.env("SLURM_CONF", cluster.path("slurm.conf"));
    fleet.args(["fleet", "slurm"]).args(options).arg("--out").arg(out).arg("--").args(run);
    fleet
}

fn lines_of(folder: &Path) -> Vec<String> {
    let text = fs::read_to_string(folder.join("records.jsonl")).unwrap_or_default();
    let is_cell = |line: &&str| line.starts_with(r#"{"record":"cell""#) && line.ends_with('}');
    text.lines().filter(is_cell).map(str::to_owned).collect()
}

/// Lines of all cells that shards have measured.
fn measured(out: &Path, shards: u32) -> Vec<String> {
    (1..=shards).flat_map(|number| lines_of(&out.join(format!("shards/{number}")))).collect()
}

fn signal(process: &Child, signal: &str) {
    Command::new("kill").args([signal, &process.id().to_string()]).status().unwrap();
}

#[track_caller]
fn ended(mut fleet: Child, status: i32, log: &Path) -> String {
    let code = fleet.wait().unwrap().code();
    let told = fs::read_to_string(log).unwrap();
    assert_eq!(code, Some(status), "{told}");
    told
}

/// Starts a fleet whose words go to a file.
fn begin(mut fleet: Command, log: &Path) -> Child {
    let file = fs::File::create(log).unwrap();
    fleet.stdout(file.try_clone().unwrap()).stderr(file).stdin(Stdio::null()).spawn().unwrap()
}

/// The same, with the last task held back in the queue, and its name there. It is still to come whenever the others end.
fn begin_without_last(
    cluster: &Cluster,
    out: &Path,
    shards: usize,
    run: &[String],
    log: &Path,
) -> (Child, String) {
    let nodes = |state: &str| {
        let update = ["update", "nodename=n1,n2", &format!("state={state}"), "reason=test"];
        cluster.told("scontrol", &update);
    };
    nodes("drain");
    let running = begin(fleet(cluster, out, &["--shards", &shards.to_string()], run), log);
    let tasks = |format| cluster.told("squeue", &["-h", "-r", "-o", format]);
    wait("the job array", || tasks("%i").lines().count() == shards);
    let ending = format!("_{shards}");
    let last = tasks("%i").lines().find(|task| task.ends_with(&ending)).unwrap().to_owned();
    cluster.told("scontrol", &["hold", &last]);
    wait("the hold", || {
        tasks("%r").contains("JobHeldUser") || tasks("%r").contains("JobHeldAdmin")
    });
    nodes("resume");
    (running, last)
}

fn names(cells: &[Cell]) -> Vec<String> {
    let mut names: Vec<String> =
        cells.iter().map(|cell| format!("{} {}", cell.experiment, cell.cell)).collect();
    names.sort();
    names
}

/// Slurm is asked once: its start takes seconds.
#[test]
fn with_a_real_slurm() {
    if !cluster::is_installed() {
        println!("skipped: slurm-wlm and munge are not installed");
        return;
    }
    let mut cluster = Cluster::start();
    let all = measures_all_shards(&cluster);
    keeps_what_is_measured_when_it_is_interrupted(&cluster, &all);
    loses_nothing_when_tasks_and_nodes_die(&mut cluster, &all);
    refuses_bad_input(&cluster);
}

/// Four shards on two nodes; names of all cells.
fn measures_all_shards(cluster: &Cluster) -> Vec<String> {
    // What a shell or Slurm could take for something else.
    let out = cluster.path("%a 'plain' $x");
    let run = run_arguments(cluster, "0.05");
    let log = cluster.path("plain.log");
    let told = ended(begin(fleet(cluster, &out, &["--shards", "4"], &run), &log), 0, &log);
    let merged = out.join("merged");
    let found = names(&cells(&merged));
    let cells_of = |n: usize| [16, 17 + n].map(|cells| format!("own-{n} surface.cells={cells}"));
    let planned: Vec<String> = (1..=EXPERIMENTS).flat_map(cells_of).collect();
    assert_eq!(found, sorted(planned), "{told}");
    let started = NODES.map(|node| {
        let log = fs::read_to_string(cluster.path(&format!("slurmd-N{node}.log"))).unwrap();
        log.matches("Launching batch job").count()
    });
    assert_eq!(started.iter().sum::<usize>(), 4, "{started:?}: {told}");
    assert!(merged.join("index.html").exists() && out.join("shards/4.log").exists());
    // The folder is not begun a second time.
    let again = fleet(cluster, &out, &["--shards", "4"], &run).output().unwrap();
    let told = String::from_utf8_lossy(&again.stderr).into_owned();
    assert_eq!(again.status.code(), Some(2), "{told}");
    assert!(told.contains("holds a fleet already"), "{told}");
    found
}

fn keeps_what_is_measured_when_it_is_interrupted(cluster: &Cluster, all: &[String]) {
    let out = cluster.path("interrupted");
    let log = cluster.path("interrupted.log");
    let run = run_arguments(cluster, "1e-6");
    // Something is left to measure however late the interrupt comes.
    let (running, _) = begin_without_last(cluster, &out, 3, &run, &log);
    wait("a measured cell", || !measured(&out, 3).is_empty());
    signal(&running, "-INT");
    let told = ended(running, 130, &log);
    wait("an empty queue", || cluster.told("squeue", &["-h"]).is_empty());
    let kept = measured(&out, 3);
    assert!(!kept.is_empty() && kept.len() < all.len(), "{} cells\n{told}", kept.len());
    assert_eq!(sorted(lines_of(&out.join("merged"))), sorted(kept.clone()));
    // With another run it is not gone on with, with the same one it is.
    let mut other =
        fleet(cluster, &out, &["--shards", "3", "--resume"], &run_arguments(cluster, "1e-5"));
    assert_eq!(other.output().unwrap().status.code(), Some(2));
    let log = cluster.path("resumed.log");
    let fast = fleet(cluster, &out, &["--shards", "3", "--resume"], &run);
    let told = ended(begin(fast, &log), 0, &log);
    let merged = out.join("merged-2");
    assert_eq!(names(&cells(&merged)), all, "{told}");
    let lines = lines_of(&merged);
    assert!(kept.iter().all(|line| lines.contains(line)));
}

/// A task is killed, one is preempted, and a node's daemon dies: cells that were measured stay as they were, and all are measured.
fn loses_nothing_when_tasks_and_nodes_die(cluster: &mut Cluster, all: &[String]) {
    let out = cluster.path("faults");
    let log = cluster.path("faults.log");
    let run = run_arguments(cluster, "1e-6");
    let (running, last) = begin_without_last(cluster, &out, 4, &run, &log);
    wait("two measured cells", || measured(&out, 4).len() >= 2);
    let before = measured(&out, 4);
    // The task on the second node makes room for an urgent job.
    let job = ["--parsable", "-o", "/dev/null", "-p", "urgent", "-w", "n2", "--wrap", "sleep 2"];
    let urgent = cluster.told("sbatch", &job);
    assert!(!urgent.is_empty());
    wait("the preemption", || {
        !cluster.told("squeue", &["-h", "-p", "urgent", "-o", "%T"]).contains("PENDING")
    });
    // A task is killed, and then the daemon of the first node.
    cluster.told("scontrol", &["release", &last]);
    kill_fathom_in(&out);
    cluster.nodes[0].kill().unwrap();
    cluster.nodes[0].wait().unwrap();
    // A star: the controller hears nothing of it.
    wait("the loss of the node", || {
        let state = cluster.told("sinfo", &["-h", "-n", "n1", "-p", "main", "-o", "%t"]);
        state.trim_end().ends_with('*') || state.starts_with("down")
    });
    cluster.nodes[0] = cluster.node("n1");
    let told = ended(running, 0, &log);
    let merged = out.join("merged");
    assert_eq!(names(&cells(&merged)), all, "{told}");
    let lines = lines_of(&merged);
    assert!(before.iter().all(|line| lines.contains(line)), "{told}");
    let again = told.matches("submitted as job").count();
    assert!(again >= 2, "{told}");
}

/// Kills one process of fathom that writes to a shard of this fleet.
fn kill_fathom_in(out: &Path) {
    let wanted = out.join("shards").display().to_string();
    let mine = |process: &PathBuf| {
        let line = fs::read(process.join("cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line).into_owned();
        line.contains(&wanted) && line.contains("--shard") && !line.starts_with("/bin/sh")
    };
    // Between two tasks there is none.
    wait("a task", || {
        let processes = fs::read_dir("/proc").unwrap().flatten().map(|entry| entry.path());
        let Some(process) = processes.into_iter().find(mine) else { return false };
        let id = process.file_name().unwrap().to_string_lossy().into_owned();
        Command::new("kill").args(["-KILL", &id]).status().unwrap().success()
    });
}

fn sorted(mut lines: Vec<String>) -> Vec<String> {
    lines.sort();
    lines
}

fn refuses_bad_input(cluster: &Cluster) {
    let out = cluster.path("bad");
    let run = run_arguments(cluster, "0.05");
    let told = |options: &[&str], run: &[String]| {
        let refused = fleet(cluster, &out, options, run).output().unwrap();
        let told = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{told}");
        assert_eq!(told.lines().count(), 1, "{told}");
        told
    };
    let refused = told(&["--shards", "2", "--partition", "none"], &run);
    assert!(refused.contains("`sbatch` refused the job array"), "{refused}");
    let unknown = told(&["--nodes", "n[1-9]"], &run);
    assert!(unknown.contains("there is no node `n3`"), "{unknown}");
    let not_run = ["report".to_owned(), "x".to_owned()];
    assert!(told(&["--shards", "2"], &not_run).contains("stands `run`"));
    let own = ["run", "--shard", "1/2"].map(str::to_owned);
    assert!(told(&["--shards", "2"], &own).contains("--shard is not for the run"));
    let typo = ["run", "uw-photon"].map(str::to_owned);
    assert!(told(&["--shards", "2"], &typo).contains("did you mean `uw-photons`"));
    let nothing = told(&["--shards", "2", "--resume"], &run);
    assert!(nothing.contains("holds no fleet to go on with"), "{nothing}");
}

#[test]
fn without_slurm_it_says_so() {
    let out = tempfile::tempdir().unwrap();
    let mut fleet = fathom();
    fleet.env("PATH", out.path()).args(["fleet", "slurm", "--shards", "2", "--out"]);
    let refused = fleet.arg(out.path().join("fleet")).args(["--", "run"]).output().unwrap();
    let told = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{told}");
    assert!(told.contains("cannot start Slurm's `sbatch`") && told.lines().count() == 1, "{told}");
    assert!(!out.path().join("fleet").exists());
}

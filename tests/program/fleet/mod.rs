//! A fleet of tasks of a real Slurm, a controller and two nodes, with what may happen to them; and of commands that are scripts.
#![cfg(unix)]

mod cluster;
mod fake;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::common::{Ends, Place, cells, own_experiments, signal, wait_until};
use cluster::{Cluster, NODES};
use fathom::record::{Cell, Record};

/// Experiments of the run, each of two cells.
const EXPERIMENTS: usize = 5;

/// A run whose samples stop at this precision.
fn run_arguments(cluster: &Cluster, precision: &str) -> String {
    let experiments = own_experiments(&cluster.place, EXPERIMENTS);
    format!("run {experiments} --no-ceilings --budget 10m --precision {precision}")
}

fn fleet(cluster: &Cluster, out: &Path, options: &str, run: &str) -> Command {
    let mut fleet = cluster.place.fathom(format!("fleet slurm {options} --out"));
    fleet
        .arg(out)
        .arg("--")
        .args(run.split(' '))
        .env("SLURM_CONF", cluster.place.path("slurm.conf"));
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
    shards: usize,
    fleet: Command,
    log: &Path,
) -> (Child, String) {
    let nodes = |state: &str| {
        let update = ["update", "nodename=n1,n2", &format!("state={state}"), "reason=test"];
        cluster.told("scontrol", &update);
    };
    nodes("drain");
    let running = begin(fleet, log);
    let tasks = |format| cluster.told("squeue", &["-h", "-r", "-o", format]);
    wait_until("the job array", || tasks("%i").lines().count() == shards);
    let ending = format!("_{shards}");
    let last = tasks("%i").lines().find(|task| task.ends_with(&ending)).unwrap().to_owned();
    cluster.told("scontrol", &["hold", &last]);
    wait_until("the hold", || tasks("%r").contains("JobHeld"));
    nodes("resume");
    (running, last)
}

/// Names of all cells of a run's folder.
fn names(out: &Path) -> Vec<String> {
    sorted(cells(out).iter().map(|cell| format!("{} {}", cell.experiment, cell.cell)).collect())
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
    let out = cluster.place.path("%a 'plain' $x");
    let run = run_arguments(cluster, "1");
    let log = cluster.place.path("plain.log");
    let command = || fleet(cluster, &out, "--shards 4", &run);
    let told = ended(begin(command(), &log), 0, &log);
    let merged = out.join("merged");
    let found = names(&merged);
    let cells_of = |n: usize| [16, 17 + n].map(|cells| format!("own-{n} surface.cells={cells}"));
    let planned: Vec<String> = (1..=EXPERIMENTS).flat_map(cells_of).collect();
    assert_eq!(found, sorted(planned), "{told}");
    let started = NODES.map(|node| {
        let log = cluster.place.read(format!("slurmd-N{node}.log"));
        log.matches("Launching batch job").count()
    });
    assert_eq!(started.iter().sum::<usize>(), 4, "{started:?}: {told}");
    assert!(merged.join("index.html").exists() && out.join("shards/4.log").exists());
    // The folder is not begun a second time.
    command().refused("holds a fleet already");
    found
}

fn keeps_what_is_measured_when_it_is_interrupted(cluster: &Cluster, all: &[String]) {
    let [out, log] = ["interrupted", "interrupted.log"].map(|name| cluster.place.path(name));
    let run = run_arguments(cluster, "1");
    // Something is left to measure however late the interrupt comes.
    let begun = fleet(cluster, &out, "--shards 3", &run);
    let (running, _) = begin_without_last(cluster, 3, begun, &log);
    wait_until("a measured cell", || !measured(&out, 3).is_empty());
    signal("-INT", running.id());
    let told = ended(running, 130, &log);
    wait_until("an empty queue", || cluster.told("squeue", &["-h"]).is_empty());
    let kept = measured(&out, 3);
    assert!(!kept.is_empty() && kept.len() < all.len(), "{} cells\n{told}", kept.len());
    assert_eq!(sorted(lines_of(&out.join("merged"))), sorted(kept.clone()));
    // With another run it is not gone on with, with the same one it is.
    let resumed = |run: &str| fleet(cluster, &out, "--shards 3 --resume", run);
    resumed(&run_arguments(cluster, "0.5")).ends(2);
    let log = cluster.place.path("resumed.log");
    let told = ended(begin(resumed(&run), &log), 0, &log);
    let merged = out.join("merged-2");
    assert_eq!(names(&merged), all, "{told}");
    goes_on_from(&kept, &merged);
}

/// Each cell of these lines is in the merged run, with the same samples and perhaps more: wide cells are sampled on.
fn goes_on_from(lines: &[String], merged: &Path) {
    let merged = cells(merged);
    for line in lines {
        let Ok(Record::Cell(before)) = serde_json::from_str(line) else { panic!("{line}") };
        let name = |cell: &Cell| (cell.experiment.clone(), cell.cell.clone());
        let after = merged.iter().find(|cell| name(cell) == name(&before)).expect("it is there");
        let samples = |cell: &Cell| cell.measured().unwrap().frame.untimed_samples_ns.clone();
        assert!(samples(after).starts_with(&samples(&before)), "{line}");
    }
}

/// A task is killed, one is preempted, and a node's daemon dies: cells that were measured stay as they were, and all are measured.
fn loses_nothing_when_tasks_and_nodes_die(cluster: &mut Cluster, all: &[String]) {
    let [out, log] = ["faults", "faults.log"].map(|name| cluster.place.path(name));
    let begun = fleet(cluster, &out, "--shards 4", &run_arguments(cluster, "1e-6"));
    let (running, last) = begin_without_last(cluster, 4, begun, &log);
    wait_until("two measured cells", || measured(&out, 4).len() >= 2);
    let before = measured(&out, 4);
    // The task on the second node makes room for an urgent job.
    let job = ["--parsable", "-o", "/dev/null", "-p", "urgent", "-w", "n2", "--wrap", "sleep 2"];
    let urgent = cluster.told("sbatch", &job);
    assert!(!urgent.is_empty());
    wait_until("the preemption", || {
        !cluster.told("squeue", &["-h", "-p", "urgent", "-o", "%T"]).contains("PENDING")
    });
    // A task is killed, and then the daemon of the first node.
    cluster.told("scontrol", &["release", &last]);
    kill_fathom_in(&out);
    cluster.nodes[0].kill().unwrap();
    cluster.nodes[0].wait().unwrap();
    // A star: the controller hears nothing of it.
    wait_until("the loss of the node", || {
        let state = cluster.told("sinfo", &["-h", "-n", "n1", "-p", "main", "-o", "%t"]);
        state.trim_end().ends_with('*') || state.starts_with("down")
    });
    cluster.nodes[0] = cluster.node("n1");
    let told = ended(running, 0, &log);
    let merged = out.join("merged");
    assert_eq!(names(&merged), all, "{told}");
    goes_on_from(&before, &merged);
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
    wait_until("a task", || {
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
    let out = cluster.place.path("bad");
    let run = run_arguments(cluster, "0.05");
    for (options, run, reason) in [
        ("--shards 2 --partition none", run.as_str(), "`sbatch` refused the job array"),
        ("--nodes n[1-9]", &run, "there is no node `n3`"),
        ("--shards 2", "report x", "comes `run`"),
        ("--shards 2", "run --shard 1/2", "--shard is not for the run"),
        ("--shards 2", "run uw-photon", "did you mean `uw-photons`"),
        ("--shards 2 --resume", &run, "holds no fleet to continue"),
    ] {
        fleet(cluster, &out, options, run).refused(reason);
    }
}

#[test]
fn without_slurm_it_says_so() {
    let place = Place::new();
    let mut fleet = place.fathom("fleet slurm --shards 2 --out fleet -- run");
    fleet.env("PATH", place.path("")).refused("cannot start Slurm's `sbatch`");
    assert!(!place.path("fleet").exists());
}

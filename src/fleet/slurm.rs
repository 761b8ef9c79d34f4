//! Slurm's commands.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::process::{Command, Output};

use itertools::Itertools;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::text;

#[derive(Debug, Error)]
pub enum SlurmError {
    #[error(
        "cannot start Slurm's `{command}`: {source}; a fleet needs Slurm's commands on this machine"
    )]
    Absent { command: &'static str, source: std::io::Error },
    #[error("`{command}` failed: {reason}")]
    Failed { command: &'static str, reason: String },
    #[error("`sbatch` refused the job array: {reason}")]
    Refused { reason: String },
    #[error("`{command}` answered `{answer}`, which is not understood")]
    Answer { command: &'static str, answer: String },
}

/// Where and how tasks run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    pub partition: Option<String>,
    /// The only nodes to use, as Slurm writes lists of them.
    pub nodes: Option<String>,
    /// Generic resources of each task, such as `gpu:1`.
    pub gres: Option<String>,
    /// Longest time of a task, as Slurm writes it.
    pub time: Option<String>,
    /// Other tasks may run on a task's node.
    pub shared: bool,
    /// Further options of `sbatch`.
    pub more: Vec<String>,
}

/// Number of a job array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct JobId(pub u64);

/// A task that Slurm has in its queue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Task {
    /// The node it runs on; none while it waits.
    pub node: Option<String>,
    /// Why it waits, in Slurm's word.
    pub reason: String,
}

/// Tasks that wait or run, by job array and number.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Queue(BTreeMap<(JobId, u32), Task>);

impl Queue {
    /// The task of a shard in any of these arrays.
    pub fn task(&self, jobs: &[JobId], number: u32) -> Option<&Task> {
        jobs.iter().find_map(|job| self.0.get(&(*job, number)))
    }

    pub fn holds_any(&self, jobs: &[JobId]) -> bool {
        self.0.keys().any(|(job, _)| jobs.contains(job))
    }

    /// From lines of array, number, node and reason.
    fn parse(answer: &str) -> Result<Self, SlurmError> {
        let task = |line: &str| {
            let [array, number, node, reason] = line.split('|').collect_array()?;
            let node = (!node.is_empty()).then(|| node.to_owned());
            // Jobs that are no arrays have no number.
            let Ok(number) = number.parse() else { return Some(None) };
            let task = Task { node, reason: reason.to_owned() };
            Some(Some(((JobId(array.parse().ok()?), number), task)))
        };
        let understood = |line: &str| {
            task(line)
                .ok_or_else(|| SlurmError::Answer { command: SQUEUE, answer: text::line(line) })
        };
        let lines = answer.lines().filter(|line| !line.trim().is_empty());
        let tasks: Vec<_> = lines.map(understood).collect::<Result<_, _>>()?;
        Ok(Self(tasks.into_iter().flatten().collect()))
    }
}

const SBATCH: &str = "sbatch";
const SQUEUE: &str = "squeue";
const SCANCEL: &str = "scancel";
const SINFO: &str = "sinfo";
const SCONTROL: &str = "scontrol";

/// Slurm as this machine reaches it.
pub struct Slurm<'a> {
    options: &'a Options,
    /// Nodes that tasks must not use.
    excluded: Vec<String>,
}

impl<'a> Slurm<'a> {
    /// An error where Slurm's commands are not there, or a node that is asked for.
    pub fn find(options: &'a Options) -> Result<Self, SlurmError> {
        output(SBATCH, Command::new(SBATCH).arg("--version"))?;
        let excluded = match &options.nodes {
            Some(list) => {
                let wanted = hostnames(list)?;
                let known = nodes(options)?;
                if let Some(unknown) = wanted.iter().find(|node| !known.contains(node)) {
                    let reason =
                        format!("there is no node `{unknown}`; there are {}", known.join(", "));
                    return Err(SlurmError::Failed { command: SINFO, reason });
                }
                known.into_iter().filter(|node| !wanted.contains(node)).collect()
            }
            None => Vec::new(),
        };
        Ok(Self { options, excluded })
    }

    /// How many nodes tasks may run on.
    pub fn node_count(options: &Options) -> Result<usize, SlurmError> {
        match &options.nodes {
            Some(list) => Ok(hostnames(list)?.len()),
            None => Ok(nodes(options)?.len()),
        }
    }

    /// Submits one array with a task for each of these numbers.
    pub fn submit(&self, script: &Path, numbers: &[u32], logs: &Path) -> Result<JobId, SlurmError> {
        let mut sbatch = Command::new(SBATCH);
        sbatch.args(["--parsable", "--job-name=fathom", "--nodes=1", "--ntasks=1"]);
        sbatch.args(["--requeue", "--open-mode=append"]);
        sbatch.arg(format!("--array={}", numbers.iter().join(",")));
        sbatch.arg(format!("--output={}", logs.display()));
        let Options { partition, gres, time, shared, more, .. } = self.options;
        for (option, value) in [("partition", partition), ("gres", gres), ("time", time)] {
            sbatch.args(value.iter().map(|value| format!("--{option}={value}")));
        }
        if !shared {
            sbatch.arg("--exclusive");
        }
        if !self.excluded.is_empty() {
            sbatch.arg(format!("--exclude={}", self.excluded.join(",")));
        }
        let answer = match output(SBATCH, sbatch.args(more).arg(script)) {
            Err(SlurmError::Failed { reason, .. }) => return Err(SlurmError::Refused { reason }),
            answer => answer?,
        };
        // `JOB` or `JOB;CLUSTER`.
        let job = answer.trim().split(';').next().and_then(|job| job.parse().ok());
        let not_understood =
            || SlurmError::Answer { command: SBATCH, answer: text::line(answer.trim()) };
        job.map(JobId).ok_or_else(not_understood)
    }

    /// This user's tasks.
    pub fn queue(&self) -> Result<Queue, SlurmError> {
        let mut squeue = Command::new(SQUEUE);
        squeue.args(["--noheader", "--array", "--me", "--format=%F|%K|%N|%r"]);
        Queue::parse(&output(SQUEUE, &mut squeue)?)
    }

    /// Removes the tasks that wait, and tells those that run to end.
    pub fn interrupt(&self, jobs: &[JobId]) -> Result<(), SlurmError> {
        self.cancel(jobs, &["--state=PENDING"])?;
        self.cancel(jobs, &["--batch", "--signal=TERM"])
    }

    /// Ends tasks at once.
    pub fn kill(&self, jobs: &[JobId]) -> Result<(), SlurmError> {
        self.cancel(jobs, &[])
    }

    /// Jobs that are over are no error.
    fn cancel(&self, jobs: &[JobId], options: &[&str]) -> Result<(), SlurmError> {
        if jobs.is_empty() {
            return Ok(());
        }
        let mut scancel = Command::new(SCANCEL);
        scancel.arg("--quiet").args(options).args(jobs.iter().map(ToString::to_string));
        match output(SCANCEL, &mut scancel) {
            Err(SlurmError::Failed { .. }) => Ok(()),
            other => other.map(drop),
        }
    }
}

/// Names of the nodes that jobs can run on.
fn nodes(options: &Options) -> Result<Vec<String>, SlurmError> {
    let mut sinfo = Command::new(SINFO);
    sinfo.args(["--noheader", "--Node", "--format=%N"]);
    sinfo.args(options.partition.iter().map(|name| format!("--partition={name}")));
    let answer = output(SINFO, &mut sinfo)?;
    let nodes: Vec<String> = answer.split_whitespace().unique().map(str::to_owned).collect();
    if nodes.is_empty() {
        let reason = "it names no node".to_owned();
        return Err(SlurmError::Failed { command: SINFO, reason });
    }
    Ok(nodes)
}

/// The names in a list such as `gpu[1-4]`.
fn hostnames(list: &str) -> Result<Vec<String>, SlurmError> {
    let mut scontrol = Command::new(SCONTROL);
    let answer = output(SCONTROL, scontrol.args(["show", "hostnames", list]))?;
    Ok(answer.split_whitespace().unique().map(str::to_owned).collect())
}

/// What a command printed; the last line of its complaint where it failed.
fn output(name: &'static str, command: &mut Command) -> Result<String, SlurmError> {
    let started = command.output();
    let Output { status, stdout, stderr } =
        started.map_err(|source| SlurmError::Absent { command: name, source })?;
    if status.success() {
        return Ok(String::from_utf8_lossy(&stdout).into_owned());
    }
    let told = String::from_utf8_lossy(&stderr);
    let last = told.lines().rev().find(|line| !line.trim().is_empty());
    let reason = last.map_or_else(|| status.to_string(), |line| text::line(line.trim()));
    Err(SlurmError::Failed { command: name, reason })
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.node {
            Some(node) => write!(f, "on {node}"),
            None => write!(f, "waits ({})", self.reason),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_is_read() {
        let answer = "12|1|n1|None\n12|2||Resources\n7|N/A|n2|None\n\n";
        let queue = Queue::parse(answer).unwrap();
        let told = |number| queue.task(&[JobId(12)], number).map(ToString::to_string);
        assert_eq!(told(1).as_deref(), Some("on n1"));
        assert_eq!(told(2).as_deref(), Some("waits (Resources)"));
        assert_eq!(told(3), None);
        assert!(queue.holds_any(&[JobId(3), JobId(12)]) && !queue.holds_any(&[JobId(7)]));
        assert!(Queue::parse("slurm_load_jobs error").is_err());
    }
}

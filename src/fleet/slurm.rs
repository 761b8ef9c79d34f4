//! Slurm's commands.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use itertools::Itertools;
use sha2::{Digest, Sha256};
use thiserror::Error;

use fathom_base::process::{self, Limits, ProcessError};
use fathom_base::text;

/// Longest time of one of Slurm's commands: six times its `MessageTimeout` (`slurm.conf(5)`).
const COMMAND_TIME: Duration = Duration::from_secs(60);
/// Hexadecimal digits of a fleet's folder in the names of its jobs.
const NAME_DIGITS: usize = 12;

#[derive(Debug, Error)]
pub enum SlurmError {
    #[error(
        "cannot start Slurm's `{command}`: {source}; a fleet needs Slurm's commands on this machine"
    )]
    Absent { command: &'static str, source: std::io::Error },
    #[error("`{command}` failed: {reason}")]
    Failed { command: &'static str, reason: String },
    #[error("`{command}`: {source}")]
    Stopped { command: &'static str, source: ProcessError },
    #[error(
        "job {job} has the name `{name}` of this fleet's jobs, but the comment `{comment}` of another: it is left alone"
    )]
    Foreign { job: JobId, name: String, comment: String },
    #[error("`sbatch` refused the job array: {reason}")]
    Refused { reason: String },
    #[error("`{command}` answered `{answer}`, which is not understood")]
    Answer { command: &'static str, answer: String },
}

/// Where and how tasks run.
#[derive(Clone, Debug, Default, clap::Args)]
// The options around it have the same name.
#[group(skip)]
pub struct Options {
    /// The only nodes to use, as Slurm writes a list of them: `gpu[1-4]`
    #[arg(long, value_name = "LIST")]
    pub nodes: Option<String>,
    /// Partition of the nodes
    #[arg(long, value_name = "NAME")]
    pub partition: Option<String>,
    /// Generic resources of each task: `gpu:1`
    #[arg(long, value_name = "LIST")]
    pub gres: Option<String>,
    /// Longest time of a task, as Slurm writes it: `01:30:00`
    #[arg(long, value_name = "TIME")]
    pub time: Option<String>,
    /// Let other jobs run on a task's node, which disturbs its times
    #[arg(long)]
    pub shared: bool,
    /// A further option of `sbatch`; may be given several times
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    pub sbatch: Vec<String>,
}

/// Number of a job array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct JobId(pub u64);

/// A task that waits or runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Task {
    pub job: JobId,
    /// The node it runs on; none while it waits.
    pub node: Option<String>,
}

/// Tasks of a fleet by number.
pub type Queue = BTreeMap<u32, Task>;

/// What tells a fleet's jobs from all others of the user: it follows from the fleet's folder alone, so nothing that a file
/// says can name another job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mark {
    pub name: String,
    comment: String,
}

impl Mark {
    pub fn of(folder: &Path) -> Self {
        let sum = hex::encode(Sha256::digest(folder.as_os_str().as_encoded_bytes()));
        Self {
            name: format!("fathom-{}", &sum[..NAME_DIGITS]),
            comment: format!("fathom fleet {sum}"),
        }
    }
}

/// From lines of array, number, node and comment.
fn queue_of(answer: &str, mark: &Mark) -> Result<Queue, SlurmError> {
    let understood = |line: &str| {
        let (number, task, comment) = fields(line)
            .ok_or_else(|| SlurmError::Answer { command: SQUEUE, answer: text::line(line) })?;
        if comment != mark.comment {
            let (job, name, comment) = (task.job, mark.name.clone(), text::line(comment));
            return Err(SlurmError::Foreign { job, name, comment });
        }
        Ok((number, task))
    };
    answer.lines().filter(|line| !line.trim().is_empty()).map(understood).collect()
}

fn fields(line: &str) -> Option<(u32, Task, &str)> {
    let [array, number, node, comment] = line.splitn(4, '|').collect_array()?;
    let node = (!node.is_empty()).then(|| node.to_owned());
    let task = Task { job: JobId(array.parse().ok()?), node };
    Some((number.parse().ok()?, task, comment.trim()))
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
    mark: Mark,
    /// Arrays of this fleet: submitted here, or seen in the queue with its mark.
    jobs: BTreeSet<JobId>,
    /// Ends the wait for the queue's answer.
    pub interrupted: Option<&'a AtomicBool>,
}

impl<'a> Slurm<'a> {
    /// For the fleet of a folder. An error where Slurm's commands are not there, or a node that is asked for.
    pub fn find(options: &'a Options, folder: &Path) -> Result<Self, SlurmError> {
        output(SBATCH, Command::new(SBATCH).arg("--version"), PLAINLY)?;
        let mut excluded = Vec::new();
        if let Some(list) = &options.nodes {
            let wanted = hostnames(list)?;
            excluded = nodes(options)?;
            if let Some(unknown) = wanted.iter().find(|node| !excluded.contains(node)) {
                let known = excluded.join(", ");
                let reason = format!("there is no node `{unknown}`; there are {known}");
                return Err(SlurmError::Failed { command: SINFO, reason });
            }
            excluded.retain(|node| !wanted.contains(node));
        }
        let (mark, jobs) = (Mark::of(folder), BTreeSet::new());
        Ok(Self { options, excluded, mark, jobs, interrupted: None })
    }

    /// How many nodes tasks may run on.
    pub fn node_count(options: &Options) -> Result<u32, SlurmError> {
        let nodes =
            options.nodes.as_ref().map_or_else(|| nodes(options), |list| hostnames(list))?;
        Ok(nodes.len() as u32)
    }

    /// Submits one array with a task for each of these numbers, which print to `logs`.
    pub fn submit(
        &mut self,
        script: &Path,
        numbers: &[u32],
        logs: &str,
    ) -> Result<JobId, SlurmError> {
        let mut sbatch = Command::new(SBATCH);
        sbatch.args(["--parsable", "--nodes=1", "--ntasks=1"]);
        sbatch.args(["--requeue", "--open-mode=append"]);
        sbatch.arg(format!("--array={}", numbers.iter().join(",")));
        sbatch.arg(format!("--output={logs}"));
        let Options { partition, gres, time, shared, sbatch: more, .. } = self.options;
        for (option, value) in [("partition", partition), ("gres", gres), ("time", time)] {
            sbatch.args(value.iter().map(|value| format!("--{option}={value}")));
        }
        if !shared {
            sbatch.arg("--exclusive");
        }
        if !self.excluded.is_empty() {
            sbatch.arg(format!("--exclude={}", self.excluded.join(",")));
        }
        // Last, so that no option takes the mark away.
        let Mark { name, comment } = &self.mark;
        sbatch.args(more).arg(format!("--job-name={name}")).arg(format!("--comment={comment}"));
        let answer = match output(SBATCH, sbatch.arg(script), PLAINLY) {
            Err(SlurmError::Failed { reason, .. }) => return Err(SlurmError::Refused { reason }),
            answer => answer?,
        };
        // `JOB` or `JOB;CLUSTER`.
        let answer = answer.trim();
        let job = answer.split(';').next().and_then(|job| job.parse().ok()).map(JobId);
        let strange = || SlurmError::Answer { command: SBATCH, answer: text::line(answer) };
        let job = job.ok_or_else(strange)?;
        self.jobs.insert(job);
        Ok(job)
    }

    /// This fleet's tasks.
    pub fn queue(&mut self) -> Result<Queue, SlurmError> {
        let mut squeue = Command::new(SQUEUE);
        squeue.args(["--noheader", "--array", "--me", "--format=%F|%K|%N|%k"]);
        squeue.arg(format!("--name={}", self.mark.name));
        let limits = Limits { interrupted: self.interrupted, ..PLAINLY };
        let queue = queue_of(&output(SQUEUE, &mut squeue, limits)?, &self.mark)?;
        self.jobs.extend(queue.values().map(|task| task.job));
        Ok(queue)
    }

    /// Removes the tasks that wait, and tells those that run to end.
    pub fn interrupt(&self) -> Result<(), SlurmError> {
        self.cancel(&["--state=PENDING"])?;
        self.cancel(&["--batch", "--signal=TERM"])
    }

    /// Ends the tasks that `options` choose, at once unless they say otherwise. Jobs that are over are no error.
    pub fn cancel(&self, options: &[&str]) -> Result<(), SlurmError> {
        if self.jobs.is_empty() {
            return Ok(());
        }
        let mut scancel = Command::new(SCANCEL);
        scancel.arg("--quiet").arg(format!("--name={}", self.mark.name)).args(options);
        scancel.args(self.jobs.iter().map(ToString::to_string));
        match output(SCANCEL, &mut scancel, PLAINLY) {
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
    let answer = output(SINFO, &mut sinfo, PLAINLY)?;
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
    let answer = output(SCONTROL, scontrol.args(["show", "hostnames", list]), PLAINLY)?;
    Ok(answer.split_whitespace().unique().map(str::to_owned).collect())
}

const PLAINLY: Limits<'static> = Limits { time: Some(COMMAND_TIME), interrupted: None };

/// What a command printed; the last line of its complaint where it failed.
fn output(
    name: &'static str,
    command: &mut Command,
    limits: Limits<'_>,
) -> Result<String, SlurmError> {
    process::run(command, limits, &mut |_| ()).map_err(|error| match error {
        ProcessError::Start(source) => SlurmError::Absent { command: name, source },
        ProcessError::Failed { status, complaint } => {
            let last = complaint.lines().next_back();
            let reason = last.map_or_else(|| status.to_string(), |line| line.trim().to_owned());
            SlurmError::Failed { command: name, reason }
        }
        source => SlurmError::Stopped { command: name, source },
    })
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_is_read_and_a_job_of_another_is_refused() {
        let mark = Mark::of(Path::new("/shared/a"));
        let comment = &mark.comment;
        let answer = format!("12|1|n1|{comment}\n14|2||{comment}\n\n");
        let task =
            |job, node: Option<&str>| Task { job: JobId(job), node: node.map(str::to_owned) };
        let expected = [(1, task(12, Some("n1"))), (2, task(14, None))];
        assert_eq!(queue_of(&answer, &mark).unwrap(), expected.into());
        assert!(queue_of("\n", &mark).unwrap().is_empty());
        assert!(queue_of("slurm_load_jobs error", &mark).is_err());
        for comment in ["(null)", "", "a|b", &Mark::of(Path::new("/shared/b")).comment] {
            let refused = queue_of(&format!("7|1|n1|{comment}\n"), &mark).unwrap_err();
            assert!(matches!(refused, SlurmError::Foreign { job: JobId(7), .. }), "{refused}");
        }
        assert_ne!(mark.name, Mark::of(Path::new("/shared/b")).name);
    }

    #[cfg(unix)]
    #[test]
    fn a_command_that_hangs_or_floods_is_named() {
        let told = |script: &str, limits: Limits<'_>| {
            output(SQUEUE, Command::new("sh").args(["-c", script]), limits).unwrap_err().to_string()
        };
        let short = Limits { time: Some(Duration::from_millis(10)), interrupted: None };
        let hung = told("exec sleep 3600", short);
        assert_eq!(hung, "`squeue`: it did not end within 0.01 s and was killed");
        let flooded = told("exec yes", PLAINLY);
        assert_eq!(flooded, "`squeue`: it answered more than 16 MiB and was killed");
    }
}

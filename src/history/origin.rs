//! Where a run comes from: commit, branch and machine, from its records, options, the job's environment, or git.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, bail};

use super::NewRun;
use fathom_base::{private, process};

/// What the user says. The rest is found out.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct OriginArgs {
    /// Commit that was measured, where the records do not name it [default: GITHUB_SHA, CI_COMMIT_SHA, or git's HEAD here]
    #[arg(long, value_name = "SHA")]
    pub commit: Option<String>,
    /// Branch of the commit [default: GITHUB_REF_NAME, CI_COMMIT_REF_NAME, or git's HEAD here if it holds the commit]
    #[arg(long, value_name = "NAME")]
    pub branch: Option<String>,
    /// Machine that measured [default: as the records name it, else this host]
    #[arg(long, value_name = "NAME")]
    pub machine: Option<String>,
}

/// Where a run comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Ends in `-dirty` where the measured program's files differed from it.
    pub commit: String,
    /// Of the commit, seconds of Unix time; none where no repository here has it.
    pub committed_at: Option<i64>,
    pub branch: String,
    /// As it was said.
    pub machine: Option<String>,
    /// The machine on which this runs.
    pub host: Option<String>,
}

impl Origin {
    /// The machine of what was measured: as it was said, else as the records name it, else this one.
    pub fn machine<'a>(&'a self, recorded: Option<&'a str>) -> anyhow::Result<&'a str> {
        let named = self.machine.as_deref().or(recorded).or(self.host.as_deref());
        named.context("this machine has neither an id nor a host name: name it with --machine NAME")
    }
}

/// Variables of GitHub Actions and GitLab CI with the commit, and with the branch.
const COMMIT_VARIABLES: [&str; 2] = ["GITHUB_SHA", "CI_COMMIT_SHA"];
const BRANCH_VARIABLES: [&str; 2] = ["GITHUB_REF_NAME", "CI_COMMIT_REF_NAME"];

/// Digits of the shortest hash that git takes, and of a whole one.
const SHORTEST_HASH: usize = 4;
const WHOLE_HASH: usize = 40;
/// Behind the name of a commit from which files differed, as `git describe` has it.
pub(super) const DIRTY: &str = "-dirty";

/// The first that there is: what was said, the job's variables, git's HEAD of the current folder. But of its commit the run decides.
pub fn origin(said: &OriginArgs, run: &NewRun) -> anyhow::Result<Origin> {
    let commit = match (&run.build.commit, &said.commit) {
        (None, _) => said_commit(said)?,
        (Some(built), Some(name)) if resolve(name).as_ref() != Ok(built) && name != built => {
            bail!(
                "the build of this run is of commit {built}, and not of `{name}`: leave out --commit"
            )
        }
        (Some(built), _) => built.clone(),
    };
    let branch = said.branch.clone().or_else(|| variable(BRANCH_VARIABLES));
    let is_here = || git(&["merge-base", "--is-ancestor", &commit, "HEAD"]);
    let head = |_| git(&["symbolic-ref", "--quiet", "--short", "HEAD"]);
    Ok(Origin {
        committed_at: committed_at(&commit),
        branch: branch.or_else(|| is_here().and_then(head).ok()).context(
            "of which branch is this run? There is no --branch, no GITHUB_REF_NAME or CI_COMMIT_REF_NAME, and git's HEAD is on no branch that holds its commit",
        )?,
        commit: commit + if run.build.dirty { DIRTY } else { "" },
        machine: said.machine.clone(),
        host: private::machine(),
    })
}

fn said_commit(said: &OriginArgs) -> anyhow::Result<String> {
    let named = said.commit.clone().or_else(|| variable(COMMIT_VARIABLES));
    let name = named.as_deref().unwrap_or("HEAD");
    match resolve(name) {
        Ok(commit) => Ok(commit),
        Err(_) if is_hash(name, SHORTEST_HASH) => Ok(name.to_owned()),
        Err(reason) if named.is_none() => bail!(
            "of which commit is this run? There is no --commit, no GITHUB_SHA or CI_COMMIT_SHA, and git has no HEAD here: {reason}"
        ),
        Err(reason) => {
            bail!("`{name}` is no hash of a commit, and git does not know it here: {reason}")
        }
    }
}

/// The hash of a branch, a tag or a short hash, where git knows it here.
fn resolve(name: &str) -> Result<String, String> {
    git(&["rev-parse", "--verify", "--end-of-options", &format!("{name}^{{commit}}")])
}

/// Where those of these commits stand that the repository here has: each behind all commits before it, whatever their dates say, and
/// else by its date. Before the place stands the latest date up to there.
pub(super) fn places(commits: Vec<String>) -> HashMap<String, (i64, usize)> {
    let list = ["rev-list", "--timestamp", "--date-order", "--reverse", "--ignore-missing"];
    let commits = commits.iter().filter(|commit| is_hash(commit, WHOLE_HASH)).map(|name| &**name);
    let listed = git(&list.into_iter().chain(commits).collect::<Vec<_>>()).unwrap_or_default();
    let mut latest = i64::MIN;
    let place = |(place, line): (usize, &str)| {
        let (date, commit) = line.split_once(' ')?;
        latest = latest.max(date.parse().ok()?);
        Some((commit.to_owned(), (latest, place)))
    };
    listed.lines().enumerate().filter_map(place).collect()
}

fn variable(names: [&str; 2]) -> Option<String> {
    names.iter().find_map(|name| std::env::var(name).ok().filter(|value| !value.is_empty()))
}

/// It may be the hash of a commit, or the beginning of one with so many digits or more.
fn is_hash(name: &str, digits: usize) -> bool {
    name.len() >= digits && name.bytes().all(|byte| byte.is_ascii_hexdigit())
}

fn committed_at(commit: &str) -> Option<i64> {
    let is_whole = is_hash(commit, WHOLE_HASH);
    is_whole.then(|| git(&["show", "--no-patch", "--format=%ct", commit]).ok())??.parse().ok()
}

fn git(arguments: &[&str]) -> Result<String, String> {
    process::git(Path::new("."), arguments)
}

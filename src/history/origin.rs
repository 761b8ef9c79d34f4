//! Where a run comes from: commit, branch and machine, from options, the job's environment, or git.

use std::process::Command;

use super::HistoryError;
use crate::quiet;

/// What the user says. The rest is found out.
#[derive(Clone, Debug, Default)]
pub struct Said {
    pub commit: Option<String>,
    pub branch: Option<String>,
    pub machine: Option<String>,
}

/// Where a run comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    pub commit: String,
    /// Of the commit, seconds of Unix time; none where no repository here has it.
    pub committed_at: Option<i64>,
    pub branch: String,
    pub machine: String,
}

/// Variables of GitHub Actions and GitLab CI with the commit, and with the branch.
const COMMIT_VARIABLES: [&str; 2] = ["GITHUB_SHA", "CI_COMMIT_SHA"];
const BRANCH_VARIABLES: [&str; 2] = ["GITHUB_REF_NAME", "CI_COMMIT_REF_NAME"];

/// The first that there is: what was said, the job's variables, git's HEAD of the current folder.
pub fn origin(said: Said) -> Result<Origin, HistoryError> {
    let named = said.commit.or_else(|| variable(COMMIT_VARIABLES));
    let commit = match named {
        // A branch, a tag or a short hash is written out where git knows it.
        Some(name) => resolved(&name).unwrap_or(name),
        None => resolved("HEAD").ok_or(HistoryError::NoCommit)?,
    };
    let branch = said.branch.or_else(|| variable(BRANCH_VARIABLES));
    let branch = branch.or_else(|| git(&["symbolic-ref", "--quiet", "--short", "HEAD"]));
    let machine = said.machine.or_else(quiet::host_name).ok_or(HistoryError::NoMachine)?;
    let committed_at = committed_at(&commit);
    Ok(Origin { commit, committed_at, branch: branch.ok_or(HistoryError::NoBranch)?, machine })
}

fn variable(names: [&str; 2]) -> Option<String> {
    names.iter().find_map(|name| std::env::var(name).ok().filter(|value| !value.is_empty()))
}

fn resolved(name: &str) -> Option<String> {
    let commit = format!("{name}^{{commit}}");
    git(&["rev-parse", "--verify", "--quiet", "--end-of-options", &commit])
}

fn committed_at(commit: &str) -> Option<i64> {
    let is_hash = commit.len() >= 40 && commit.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_hash.then(|| git(&["show", "--no-patch", "--format=%ct", commit]))??.parse().ok()
}

/// What git prints in the current folder; none where it fails or is absent.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (output.status.success() && !text.is_empty()).then_some(text)
}

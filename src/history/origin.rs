//! Where a run comes from: commit, branch and machine, from options, the job's environment, or git.

use std::path::Path;

use anyhow::{Context, bail};

use fathom_base::{private, process};

/// What the user says. The rest is found out.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct OriginArgs {
    /// Commit that was measured [default: GITHUB_SHA, CI_COMMIT_SHA, or git's HEAD here]
    #[arg(long, value_name = "SHA")]
    pub commit: Option<String>,
    /// Branch of the commit [default: GITHUB_REF_NAME, CI_COMMIT_REF_NAME, or git's HEAD here]
    #[arg(long, value_name = "NAME")]
    pub branch: Option<String>,
    /// Machine that measured [default: as the records name it, else this host]
    #[arg(long, value_name = "NAME")]
    pub machine: Option<String>,
}

/// Where a run comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
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

/// The first that there is: what was said, the job's variables, git's HEAD of the current folder.
pub fn origin(said: OriginArgs) -> anyhow::Result<Origin> {
    let named = said.commit.or_else(|| variable(COMMIT_VARIABLES));
    let name = named.as_deref().unwrap_or("HEAD");
    // A branch, a tag or a short hash is written out where git knows it.
    let asked = format!("{name}^{{commit}}");
    let commit = match git(&["rev-parse", "--verify", "--end-of-options", &asked]) {
        Ok(commit) => commit,
        Err(_) if is_hash(name, SHORTEST_HASH) => name.to_owned(),
        Err(reason) if named.is_none() => bail!(
            "of which commit is this run? There is no --commit, no GITHUB_SHA or CI_COMMIT_SHA, and git has no HEAD here: {reason}"
        ),
        Err(reason) => {
            bail!("`{name}` is no hash of a commit, and git does not know it here: {reason}")
        }
    };
    let branch = said.branch.or_else(|| variable(BRANCH_VARIABLES));
    let branch = branch.or_else(|| git(&["symbolic-ref", "--quiet", "--short", "HEAD"]).ok());
    Ok(Origin {
        committed_at: committed_at(&commit),
        commit,
        branch: branch.context(
            "of which branch is this run? There is no --branch, no GITHUB_REF_NAME or CI_COMMIT_REF_NAME, and git's HEAD is on no branch",
        )?,
        machine: said.machine,
        host: private::machine(),
    })
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

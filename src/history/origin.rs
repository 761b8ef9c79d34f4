//! Where a run comes from: commit, branch and machine, from options, the job's environment, or git.

use std::process::Command;

use anyhow::{Context, Error};

use fathom_base::private;
use fathom_base::process;
use fathom_base::text::check_length;

/// What the user says. The rest is found out.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Said {
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

/// The first that there is: what was said, the job's variables, git's HEAD of the current folder.
pub fn origin(said: Said) -> anyhow::Result<Origin> {
    let named = said.commit.or_else(|| variable(COMMIT_VARIABLES));
    let commit = match named {
        // A branch, a tag or a short hash is written out where git knows it.
        Some(name) => resolved(&name).unwrap_or(name),
        None => resolved("HEAD").context(
            "of which commit is this run? There is no --commit, no GITHUB_SHA or CI_COMMIT_SHA, and no git repository here",
        )?,
    };
    let branch = said.branch.or_else(|| variable(BRANCH_VARIABLES));
    let branch = branch.or_else(|| git(&["symbolic-ref", "--quiet", "--short", "HEAD"]));
    let names = [
        ("commit", Some(&commit)),
        ("branch", branch.as_ref()),
        ("machine", said.machine.as_ref()),
    ];
    for (what, name) in names {
        name.map_or(Ok(()), |name| check_length(what, name)).map_err(Error::msg)?;
    }
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
    let text = process::printed(Command::new("git").args(arguments)).ok()?;
    (!text.is_empty()).then_some(text)
}

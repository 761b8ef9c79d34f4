//! What `fathom bisect` searches among, and how the program of each candidate is made.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::rc::Rc;

use anyhow::{Context, Result, anyhow, bail, ensure};
use itertools::Itertools;
use serde::Serialize;

use super::build::{self, ProgramCopy, Worktree};
use super::flow::Program;
use super::launch::{ReplyWait, WorkerStart};
use fathom_base::process::{self, Limits, ProcessError};
use fathom_base::{input, private, text};
use fathom_gpu as gpu;
use fathom_harness::catalog::CargoTarget;

/// The variable in which a command finds the name of its candidate.
const CANDIDATE: &str = "CANDIDATE";
/// Digits of a commit in names.
const SHORT: usize = 12;
/// Built checkouts of a search by commands that are kept until its end, besides the good one.
const CHECKOUTS: usize = 8;

/// What is searched among, the good one first.
#[derive(Clone, Debug)]
pub enum SearchSpace {
    Revisions {
        good: String,
        bad: String,
        by: BuildMethod,
    },
    /// What each line of a file names, by commands that find it in `$CANDIDATE`.
    Lines {
        list: PathBuf,
        by: BuildMethod,
    },
}

#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BuildMethod {
    Cargo,
    /// Commands of the shell, a revision's in its checkout: one builds, and one starts a worker.
    Commands {
        build: String,
        run: String,
    },
}

#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// A commit, or a line.
    pub name: String,
    /// What tables and records call it.
    pub label: String,
    /// First line of a commit's message.
    pub subject: String,
}

impl Candidate {
    fn from_commit(commit: &str, subject: &str) -> Self {
        let label = commit.get(..SHORT).unwrap_or(commit).to_owned();
        Self { name: commit.to_owned(), label, subject: subject.to_owned() }
    }
}

impl SearchSpace {
    /// All candidates in their order. The first is the good one.
    pub fn candidates(&self, folder: &Path) -> Result<Vec<Candidate>> {
        let candidates = match self {
            Self::Revisions { good, bad, .. } => revisions(folder, good, bad)?,
            Self::Lines { list, .. } => lines(list)?,
        };
        ensure!(candidates.len() > 1, "a search needs two candidates or more");
        if let Some(twice) = candidates.iter().map(|candidate| &candidate.name).duplicates().next()
        {
            bail!("{twice} is named twice");
        }
        Ok(candidates)
    }

    /// What the candidates are, in words.
    pub fn noun(&self) -> &'static str {
        match self {
            Self::Revisions { .. } => "revision",
            Self::Lines { .. } => "candidate",
        }
    }

    pub fn building(&self) -> &BuildMethod {
        let (Self::Revisions { by, .. } | Self::Lines { by, .. }) = self;
        by
    }
}

/// The good revision and those after it up to the bad one, along first parents.
fn revisions(folder: &Path, good: &str, bad: &str) -> Result<Vec<Candidate>> {
    let repository = build::repository(folder)?;
    let [good, bad] = [build::commit(&repository, good)?, build::commit(&repository, bad)?];
    let range = format!("{good}..{bad}");
    let lines = process::git(
        &repository,
        &["log", "--reverse", "--first-parent", "--format=%H %s", &range],
    );
    let lines = lines.map_err(|reason| anyhow!("git log: {reason}"))?;
    let precedes = process::git(&repository, &["merge-base", "--is-ancestor", &good, &bad]).is_ok();
    if lines.is_empty() || !precedes {
        let hint = build::shallow_hint(&repository);
        bail!(
            "the good revision must come before the bad one: there is nothing between them{hint}"
        );
    }
    let later = lines.lines().map(|line| {
        let (commit, subject) = line.split_once(' ').unwrap_or((line, ""));
        Candidate::from_commit(commit, subject)
    });
    Ok(std::iter::once(Candidate::from_commit(&good, "")).chain(later).collect())
}

/// What a file lists, one a line.
fn lines(list: &Path) -> Result<Vec<Candidate>> {
    let text = input::text(list, input::MAX_TEXT).with_context(|| list.display().to_string())?;
    let lines = text.lines().map(str::trim);
    let named = lines.filter(|line| !line.is_empty() && !line.starts_with('#')).map(|line| {
        let label = private::redact(line);
        Candidate { name: line.to_owned(), label, subject: String::new() }
    });
    Ok(named.collect())
}

/// A candidate's program, which is there as long as this is.
pub struct BuiltCandidate {
    pub program: Program,
    _aside: Option<ProgramCopy>,
    _checkout: Option<Rc<Worktree>>,
}

pub struct CandidateBuilder<'a> {
    pub searched: &'a SearchSpace,
    pub folder: &'a Path,
    pub target: CargoTarget,
    pub gpu: gpu::Options,
    /// Folder of the checkouts of a search by commands.
    pub checkouts: PathBuf,
    pub waiting: ReplyWait<'a>,
    /// Built checkouts by commit, the latest used last.
    pub built: RefCell<Vec<(String, Rc<Worktree>)>>,
}

impl CandidateBuilder<'_> {
    pub fn make(&self, candidate: &Candidate) -> Result<BuiltCandidate> {
        match self.searched {
            SearchSpace::Revisions { by: BuildMethod::Commands { build, run }, .. } => {
                let checkout = self.checkout(candidate, build)?;
                let path = text::shell(&checkout.path.display().to_string());
                let made = from_command(candidate, &format!("cd {path} || exit 1\n{run}"));
                Ok(BuiltCandidate { _checkout: Some(checkout), ..made })
            }
            SearchSpace::Lines { by: BuildMethod::Commands { build, run }, .. } => {
                (self.waiting.report)(&format!("building {}", candidate.label));
                self.shell(candidate, build, self.folder)?;
                Ok(from_command(candidate, run))
            }
            SearchSpace::Revisions { .. } => self.compiled(candidate),
            SearchSpace::Lines { .. } => bail!("candidates of a file need a command (--cmd)"),
        }
    }

    /// cargo's build, out of reach of later ones.
    fn compiled(&self, candidate: &Candidate) -> Result<BuiltCandidate> {
        (self.waiting.report)(&format!("building {}", candidate.label));
        let [interrupted] = self.waiting.interrupted else { bail!("no flag") };
        let mut tell = |line: &str| (self.waiting.report)(line);
        let built =
            build::revision(self.folder, self.target, &candidate.name, interrupted, &mut tell)?;
        let aside = build::set_aside(&built)?;
        let start = WorkerStart { gpu: self.gpu.clone(), ..WorkerStart::new(&aside.path) };
        let program = Program { label: candidate.label.clone(), start };
        Ok(BuiltCandidate { program, _aside: Some(aside), _checkout: None })
    }

    fn checkout(&self, candidate: &Candidate, command: &str) -> Result<Rc<Worktree>> {
        let mut built = self.built.borrow_mut();
        if let Some(at) = built.iter().position(|(commit, _)| *commit == candidate.name) {
            let used = built.remove(at);
            built.push(used);
        } else {
            (self.waiting.report)(&format!("building {}", candidate.label));
            let path = std::path::absolute(self.checkouts.join(&candidate.label))?;
            let repository = build::repository(self.folder)?;
            let checkout = Worktree::add(&repository, path, &candidate.name)?;
            self.shell(candidate, command, &checkout.path)?;
            built.push((candidate.name.clone(), Rc::new(checkout)));
            if built.len() > CHECKOUTS {
                built.remove(0);
            }
        }
        let (_, last) = built.last().context("nothing was built")?;
        Ok(last.clone())
    }

    /// Runs a build's command; its output is passed on.
    fn shell(&self, candidate: &Candidate, command: &str, folder: &Path) -> Result<()> {
        let [interrupted] = self.waiting.interrupted else { bail!("no flag") };
        let limits = Limits { time: None, interrupted: Some(interrupted) };
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("exec >&2\n{command}")]).current_dir(folder);
        shell.env(CANDIDATE, &candidate.name);
        match process::run(&mut shell, limits, &mut |line| (self.waiting.report)(line)) {
            Ok(_) => Ok(()),
            Err(ProcessError::Interrupted) => bail!("building was interrupted"),
            Err(error) => {
                let said = error.to_string().lines().join(" ");
                bail!("it does not build: {said}")
            }
        }
    }
}

fn from_command(candidate: &Candidate, run: &str) -> BuiltCandidate {
    let name = text::shell(&candidate.name);
    let start = WorkerStart::from_command(&format!("export {CANDIDATE}={name}\n{run}"));
    let program = Program { label: candidate.label.clone(), start };
    BuiltCandidate { program, _aside: None, _checkout: None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_has_a_candidate_on_each_line() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("list.txt");
        let searched = SearchSpace::Lines { list: list.clone(), by: BuildMethod::Cargo };
        std::fs::write(&list, "# Mesa\na b\n\n/b/icd.json\n").unwrap();
        let found = searched.candidates(folder.path()).unwrap();
        let names: Vec<&str> = found.iter().map(|candidate| &*candidate.name).collect();
        assert_eq!(names, ["a b", "/b/icd.json"]);
        for (text, reason) in [("a\n", "two candidates"), ("a\nb\na\n", "named twice")] {
            std::fs::write(&list, text).unwrap();
            let error = searched.candidates(folder.path()).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}

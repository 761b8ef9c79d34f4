//! What `fathom bisect` searches among, and how the program of each candidate is made.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result, anyhow, bail, ensure};
use itertools::Itertools;
use serde::Serialize;

use super::build::{self, ProgramCopy, Revision, Worktree};
use super::flow::Program;
use super::worker_process::WorkerStart;
use fathom_base::process::{self, Limits, ProcessError};
use fathom_base::{input, private, text};
use fathom_gpu as gpu;
use fathom_harness::catalog::CargoTarget;

/// The variable in which a command finds the name of its candidate.
const CANDIDATE: &str = "CANDIDATE";
/// Digits of a commit in names.
const SHORT: usize = 12;

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
        let twice = candidates.iter().map(|candidate| &candidate.name).duplicates().next();
        twice.map_or(Ok(()), |name| Err(anyhow!("{name} is named twice")))?;
        Ok(candidates)
    }

    /// What the candidates are, in words.
    pub fn noun(&self) -> &'static str {
        match self {
            Self::Revisions { .. } => "revision",
            Self::Lines { .. } => "candidate",
        }
    }

    /// The folder of a search's checkouts, if it has any.
    pub fn checkouts(&self, folder: &Path, search: &Path) -> Result<PathBuf> {
        if matches!(self, Self::Lines { .. }) || matches!(self.building(), BuildMethod::Cargo) {
            return Ok(PathBuf::new());
        }
        build::checkouts(folder, search)
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
    // What a good revision of another branch has in common with the bad one is good.
    let common = build::merge_base(&repository, [&good, &bad])?;
    let parted = if common == good {
        String::new()
    } else {
        format!("{good} is of another branch: the search begins where they part, at {common}")
    };
    let good = common;
    let range = format!("{good}..{bad}");
    let lines = process::git(
        &repository,
        &["log", "--reverse", "--first-parent", "--format=%H %s", &range],
    );
    let lines = lines.map_err(|reason| anyhow!("git log: {reason}"))?;
    if lines.is_empty() {
        bail!("the good revision must come before the bad one: there is nothing between them");
    }
    let later = lines.lines().map(|line| {
        let (commit, subject) = line.split_once(' ').unwrap_or((line, ""));
        Candidate::from_commit(commit, subject)
    });
    Ok(std::iter::once(Candidate::from_commit(&good, &parted)).chain(later).collect())
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

pub struct CandidateBuilder<'a> {
    pub searched: &'a SearchSpace,
    pub folder: &'a Path,
    pub target: CargoTarget,
    pub gpu: gpu::Options,
    /// Folder of the checkouts of a search by commands.
    pub checkouts: PathBuf,
    pub interrupted: &'a AtomicBool,
    pub report: &'a dyn Fn(&str),
    /// Built checkouts by commit, until the search ends.
    pub built: RefCell<BTreeMap<String, Worktree>>,
    /// The same of cargo's programs.
    pub programs: RefCell<BTreeMap<String, ProgramCopy>>,
}

impl CandidateBuilder<'_> {
    /// A candidate's program, which is there as long as this is.
    pub fn make(&self, candidate: &Candidate) -> Result<Program> {
        let start = match (self.searched.building(), self.searched) {
            (BuildMethod::Cargo, SearchSpace::Revisions { .. }) => self.compiled(candidate)?,
            (BuildMethod::Cargo, _) => bail!("candidates of a file need a command (--cmd)"),
            (BuildMethod::Commands { build, run }, SearchSpace::Revisions { .. }) => {
                let path = text::shell(&self.checkout(candidate, build)?.display().to_string());
                from_command(candidate, &format!("cd {path} || exit 1\n{run}"))
            }
            (BuildMethod::Commands { build, run }, SearchSpace::Lines { .. }) => {
                self.shell(candidate, build, self.folder)?;
                from_command(candidate, run)
            }
        };
        Ok(Program { label: candidate.label.clone(), start })
    }

    /// cargo's build, which is made once in a search.
    fn compiled(&self, candidate: &Candidate) -> Result<WorkerStart> {
        let name = &candidate.name;
        if !self.programs.borrow().contains_key(name) {
            (self.report)(&format!("building {}", candidate.label));
            let mut tell = |line: &str| (self.report)(line);
            let revision = Revision { label: candidate.label.clone(), commit: name.clone() };
            let (folder, target, interrupted) = (self.folder, self.target, self.interrupted);
            let built = build::revision(folder, target, &revision, interrupted, &mut tell)?;
            self.programs.borrow_mut().insert(name.clone(), built);
        }
        let path = &self.programs.borrow()[name].path;
        Ok(WorkerStart { gpu: self.gpu.clone(), ..WorkerStart::new(path) })
    }

    /// A checkout in which the command has built.
    fn checkout(&self, candidate: &Candidate, command: &str) -> Result<PathBuf> {
        let path = std::path::absolute(self.checkouts.join(&candidate.label))?;
        if !self.built.borrow().contains_key(&candidate.name) {
            let repository = build::repository(self.folder)?;
            let checkout = Worktree::add(&repository, path.clone(), &candidate.name)?;
            self.shell(candidate, command, &checkout.path)?;
            self.built.borrow_mut().insert(candidate.name.clone(), checkout);
        }
        Ok(path)
    }

    /// Runs a build's command; its output is passed on.
    fn shell(&self, candidate: &Candidate, command: &str, folder: &Path) -> Result<()> {
        (self.report)(&format!("building {}", candidate.label));
        let limits = Limits { time: None, interrupted: Some(self.interrupted) };
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("exec >&2\n{command}")]).current_dir(folder);
        shell.env(CANDIDATE, &candidate.name);
        match process::run(&mut shell, limits, &mut |line| (self.report)(line)) {
            Ok(_) => Ok(()),
            Err(ProcessError::Interrupted) => bail!("building was interrupted"),
            Err(error) => {
                let said = error.to_string().lines().join(" ");
                bail!("it does not build: {said}")
            }
        }
    }
}

fn from_command(candidate: &Candidate, run: &str) -> WorkerStart {
    let name = text::shell(&candidate.name);
    WorkerStart::from_command(&format!("export {CANDIDATE}={name}\n{run}"))
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

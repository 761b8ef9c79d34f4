//! What `fathom bisect` searches among, and how the program of each candidate is made.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::rc::Rc;

use anyhow::{Context, Result, anyhow, bail, ensure};
use itertools::Itertools;
use tempfile::TempDir;

use super::build::{self, KEPT_BY_SEARCH, SetAside, Source, Worktree};
use super::driver;
use super::flow::Program;
use super::launch::{Waiting, WorkerStart};
use fathom_base::process::{self, Limits, ProcessError};
use fathom_base::{input, private, text};
use fathom_gpu as gpu;
use fathom_harness::catalog::CargoTarget;
use fathom_record::comparison::Side;

/// Digits of a commit in names.
const SHORT: usize = 12;
/// Built checkouts of a search by commands that are kept until its end, besides the good one.
const CHECKOUTS: usize = 8;

/// What is searched among, the good one first.
#[derive(Clone, Debug)]
pub enum Searched {
    Revisions {
        good: String,
        bad: String,
        by: Building,
    },
    /// One program with the drivers of the manifests that a file lists.
    Drivers {
        list: PathBuf,
        program: PathBuf,
    },
    /// The current revision with versions of a crate.
    Versions {
        package: String,
        versions: Vec<String>,
    },
}

/// How a revision becomes a worker.
#[derive(Clone, Debug)]
pub enum Building {
    Cargo,
    /// Commands of the shell, in a checkout: one builds, and one starts a worker.
    Commands {
        build: String,
        run: String,
    },
}

#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// A commit, the path of a manifest, or a version.
    pub name: String,
    /// What tables and records call it.
    pub label: String,
    /// First line of a commit's message.
    pub subject: String,
}

impl Candidate {
    fn of_commit(commit: &str, subject: &str) -> Self {
        let label = commit.get(..SHORT).unwrap_or(commit).to_owned();
        Self { name: commit.to_owned(), label, subject: subject.to_owned() }
    }
}

impl Searched {
    /// All candidates in their order. The first is the good one.
    pub fn candidates(&self, folder: &Path) -> Result<Vec<Candidate>> {
        let found = match self {
            Self::Revisions { good, bad, .. } => revisions(folder, good, bad)?,
            Self::Drivers { list, .. } => drivers(list)?,
            Self::Versions { package, versions } => {
                let named = |version: &String| Candidate {
                    name: version.clone(),
                    label: format!("{package} {version}"),
                    subject: String::new(),
                };
                versions.iter().map(named).collect()
            }
        };
        ensure!(found.len() > 1, "a search needs two candidates or more");
        if let Some(twice) = found.iter().map(|candidate| &candidate.name).duplicates().next() {
            bail!("{twice} is named twice");
        }
        Ok(found)
    }

    /// What the candidates are, in words.
    pub fn noun(&self) -> &'static str {
        match self {
            Self::Revisions { .. } => "revision",
            Self::Drivers { .. } => "driver",
            Self::Versions { .. } => "version",
        }
    }
}

/// The good revision and those after it up to the bad one, along first parents.
fn revisions(folder: &Path, good: &str, bad: &str) -> Result<Vec<Candidate>> {
    let repository = build::repository(folder)?;
    let [good, bad] = [build::commit(&repository, good)?, build::commit(&repository, bad)?];
    let git = |arguments: &[&str]| {
        process::printed(Command::new("git").arg("-C").arg(&repository).args(arguments))
    };
    let range = format!("{good}..{bad}");
    let lines = git(&["log", "--reverse", "--first-parent", "--format=%H %s", &range]);
    let lines = lines.map_err(|reason| anyhow!("git log: {reason}"))?;
    let precedes = git(&["merge-base", "--is-ancestor", &good, &bad]).is_ok();
    if lines.is_empty() || !precedes {
        bail!("the good revision must come before the bad one: there is nothing between them");
    }
    let later = lines.lines().map(|line| {
        let (commit, subject) = line.split_once(' ').unwrap_or((line, ""));
        Candidate::of_commit(commit, subject)
    });
    Ok(std::iter::once(Candidate::of_commit(&good, "")).chain(later).collect())
}

/// The manifests that a file lists, one a line. Relative paths begin at the file.
fn drivers(list: &Path) -> Result<Vec<Candidate>> {
    let shown = || list.display().to_string();
    let text = input::text(list, input::MAX_TEXT).with_context(shown)?;
    let folder = std::path::absolute(list)?;
    let lines = text.lines().map(str::trim);
    let paths = lines.filter(|line| !line.is_empty() && !line.starts_with('#')).map(|line| {
        let path = folder.parent().unwrap_or(Path::new("")).join(line);
        let name = path.display().to_string();
        Candidate { label: private::path(&path), name, subject: String::new() }
    });
    Ok(paths.collect())
}

/// A candidate's program, which is there as long as this is.
pub struct Made {
    pub program: Program,
    _aside: Option<SetAside>,
    _shaders: Option<TempDir>,
    _checkout: Option<Rc<Worktree>>,
}

/// Makes programs of candidates.
pub struct Maker<'a> {
    pub searched: &'a Searched,
    pub folder: &'a Path,
    pub target: CargoTarget,
    pub gpu: gpu::Options,
    /// Folder of the checkouts of a search by commands.
    pub checkouts: PathBuf,
    pub waiting: Waiting<'a>,
    /// Built checkouts by commit, the latest used last.
    built: RefCell<Vec<(String, Rc<Worktree>)>>,
}

impl<'a> Maker<'a> {
    pub fn new(
        searched: &'a Searched,
        folder: &'a Path,
        target: CargoTarget,
        gpu: gpu::Options,
        checkouts: PathBuf,
        waiting: Waiting<'a>,
    ) -> Self {
        Self { searched, folder, target, gpu, checkouts, waiting, built: RefCell::default() }
    }

    pub fn make(&self, candidate: &Candidate, side: Side) -> Result<Made> {
        match self.searched {
            Searched::Revisions { by: Building::Cargo, .. } => {
                self.compiled(candidate, &candidate.name, None)
            }
            Searched::Revisions { by: Building::Commands { build, run }, .. } => {
                self.commanded(candidate, build, run)
            }
            Searched::Versions { package, .. } => {
                self.compiled(candidate, "HEAD", Some((package, &candidate.name)))
            }
            Searched::Drivers { program, .. } => {
                let manifest = Path::new(&candidate.name);
                let environment = driver::environment(side, &[], Some(manifest))?;
                let shaders = driver::shader_cache(&environment)?;
                let shader_cache = shaders.as_ref().map(|folder| folder.path().to_owned());
                let made = self.of_program(candidate, build::set_aside(program)?);
                let start = WorkerStart { environment, shader_cache, ..made.program.start };
                driver::try_driver(side, &start, &self.waiting)?;
                let program = Program { start, ..made.program };
                Ok(Made { program, _shaders: shaders, ..made })
            }
        }
    }

    /// cargo's build, out of reach of later ones.
    fn compiled(
        &self,
        candidate: &Candidate,
        revision: &str,
        pin: Option<(&str, &str)>,
    ) -> Result<Made> {
        (self.waiting.tell)(&format!("building {}", candidate.label));
        let (folder, target, kept) = (self.folder, self.target, KEPT_BY_SEARCH);
        let [interrupted] = self.waiting.interrupted else { bail!("no flag") };
        let source = Source { folder, target, revision, pin, kept };
        let program = source.build(interrupted, &mut |line| (self.waiting.tell)(line))?;
        Ok(self.of_program(candidate, build::set_aside(&program)?))
    }

    fn of_program(&self, candidate: &Candidate, aside: SetAside) -> Made {
        let start = WorkerStart { gpu: self.gpu.clone(), ..WorkerStart::new(&aside.path) };
        let program = Program { label: candidate.label.clone(), start };
        Made { program, _aside: Some(aside), _shaders: None, _checkout: None }
    }

    /// A worker that a command starts in a built checkout.
    fn commanded(&self, candidate: &Candidate, build: &str, run: &str) -> Result<Made> {
        let checkout = self.checkout(candidate, build)?;
        let path = text::shell(&checkout.path.display().to_string());
        let start = WorkerStart::of_command(&format!("cd {path} || exit 1\n{run}"));
        let program = Program { label: candidate.label.clone(), start };
        Ok(Made { program, _aside: None, _shaders: None, _checkout: Some(checkout) })
    }

    fn checkout(&self, candidate: &Candidate, command: &str) -> Result<Rc<Worktree>> {
        let mut built = self.built.borrow_mut();
        if let Some(at) = built.iter().position(|(commit, _)| *commit == candidate.name) {
            let used = built.remove(at);
            built.push(used);
        } else {
            (self.waiting.tell)(&format!("building {}", candidate.label));
            let path = std::path::absolute(self.checkouts.join(&candidate.label))?;
            let repository = build::repository(self.folder)?;
            let checkout = Worktree::add(&repository, path, &candidate.name)?;
            self.shell(command, &checkout.path)?;
            built.push((candidate.name.clone(), Rc::new(checkout)));
            if built.len() > CHECKOUTS {
                built.remove(0);
            }
        }
        let (_, last) = built.last().context("nothing was built")?;
        Ok(last.clone())
    }

    /// Runs a build's command; its output is passed on.
    fn shell(&self, command: &str, folder: &Path) -> Result<()> {
        let [interrupted] = self.waiting.interrupted else { bail!("no flag") };
        let limits = Limits { time: None, interrupted: Some(interrupted) };
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("exec >&2\n{command}")]).current_dir(folder);
        match process::run(&mut shell, limits, &mut |line| (self.waiting.tell)(line)) {
            Ok(_) => Ok(()),
            Err(ProcessError::Interrupted) => bail!("building was interrupted"),
            Err(error) => {
                let said = error.to_string().lines().join(" ");
                bail!("it does not build by `{command}`: {said}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_drivers_has_a_manifest_on_each_line() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("drivers.txt");
        let searched = Searched::Drivers { list: list.clone(), program: PathBuf::new() };
        std::fs::write(&list, "# Mesa\na/icd.json\n\n/b/icd.json\n").unwrap();
        let found = searched.candidates(folder.path()).unwrap();
        let names: Vec<&str> = found.iter().map(|candidate| &*candidate.name).collect();
        assert_eq!(names, [folder.path().join("a/icd.json").to_str().unwrap(), "/b/icd.json"]);
        for (text, reason) in [("a\n", "two candidates"), ("a\nb\na\n", "named twice")] {
            std::fs::write(&list, text).unwrap();
            let error = searched.candidates(folder.path()).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}

//! A checkout in which sources are changed and built, one change at a time.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, Result};
use fathom::compare::build::{self, Worktree};
use fathom::harness::catalog::CargoTarget;
use fathom::tell;

use crate::INTERRUPT;
use crate::injections::Changes;

/// How a program is built. Programs that are compared must be built in the same way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compilation {
    /// As `cargo build --release` does, the whole crate anew.
    Whole,
    /// Only what a change touches.
    Incremental,
}

pub struct Workshop {
    worktree: Worktree,
    target: PathBuf,
}

impl Workshop {
    /// A checkout of a commit of the repository.
    pub fn open(repository: &Path, commit: &str) -> Result<Self> {
        let cache = repository.join(build::CACHE);
        Ok(Self {
            worktree: Worktree::add(repository, &cache, commit)?,
            target: cache.join("self-test-target"),
        })
    }

    /// The text of a file as it was committed.
    pub fn read(&self, file: &str) -> Result<String, String> {
        let path = self.worktree.path.join(file);
        std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))
    }

    /// Builds with these files in place of the committed ones, and keeps the program.
    pub fn build(&self, changes: &Changes, compilation: Compilation, program: &Path) -> Result<()> {
        let committed = changes.keys().map(|file| Ok((file.clone(), self.read(file)?)));
        let committed: Result<Changes, String> = committed.collect();
        let committed = committed.map_err(anyhow::Error::msg).context("reading a source")?;
        self.put(changes)?;
        // So that cargo builds again what it would call fresh.
        self.touch("src/main.rs")?;
        self.touch("src/lib.rs")?;
        let incremental = match compilation {
            Compilation::Whole => "0",
            Compilation::Incremental => "1",
        };
        let built = build::compile(
            (&self.worktree.path, &self.target),
            CargoTarget::FATHOM,
            "with a change",
            &[("CARGO_INCREMENTAL", incremental)],
            &INTERRUPT,
            &mut |line| {
                if !line.trim_start().starts_with("Compiling") {
                    tell::note(line);
                }
            },
        );
        self.put(&committed)?;
        build::keep(&built?, program)
    }

    fn put(&self, changes: &Changes) -> Result<()> {
        for (file, text) in changes {
            let path = self.worktree.path.join(file);
            let written = std::fs::write(&path, text);
            written.with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    fn touch(&self, file: &str) -> Result<()> {
        let path = self.worktree.path.join(file);
        std::fs::File::options()
            .append(true)
            .open(&path)
            .and_then(|file| file.set_modified(SystemTime::now()))
            .with_context(|| format!("cannot touch {}", path.display()))
    }
}

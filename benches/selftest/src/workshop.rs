//! A checkout in which sources are changed and built, one change at a time.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use fathom::compare::build::{self, Worktree};
use fathom::harness::catalog::CargoTarget;
use fathom::tell;

use crate::INTERRUPT;
use crate::injections::{Changes, Injection, every, unfit, unrelated};
use crate::trials::Variant;

pub struct Workshop {
    worktree: Worktree,
    target: PathBuf,
    /// Folder of what was built.
    programs: PathBuf,
    /// The injected build that is at hand.
    at_hand: Option<Variant>,
}

impl Workshop {
    /// A checkout of HEAD of the repository around a folder.
    pub fn open(folder: &Path) -> Result<Self> {
        let repository = build::repository(folder)?;
        let commit = build::commit(&repository, "HEAD")?;
        let cache = repository.join(build::CACHE);
        let short = commit.get(..12).unwrap_or(&commit);
        Ok(Self {
            worktree: Worktree::in_cache(&repository, &cache, &commit)?,
            target: cache.join("self-test-target"),
            programs: cache.join(format!("self-test-{short}")),
            at_hand: None,
        })
    }

    /// The base and the variant, compiled in the same way: as `cargo build --release` does, the whole crate anew, or, for an
    /// injection, incrementally. Of injected builds only the last is kept.
    pub fn programs(
        &mut self,
        variant: &Variant,
        injections: &[Injection],
    ) -> Result<[PathBuf; 2]> {
        let (base, incremental) = match variant {
            Variant::Again | Variant::Unrelated => ("base", false),
            Variant::Injected(..) | Variant::Every(_) => ("base-of-injections", true),
        };
        let base = self.build(base, incremental, &Changes::new())?;
        if let Some(old) = self.at_hand.take_if(|old| old != variant) {
            // What is left behind only takes room.
            let _ = std::fs::remove_file(self.programs.join(old.to_string()));
        }
        let changes = self.changes(variant, injections).map_err(unfit)?;
        let head = self.build(&variant.to_string(), incremental, &changes)?;
        self.at_hand = incremental.then(|| variant.clone());
        Ok([base, head])
    }

    fn changes(&self, variant: &Variant, injections: &[Injection]) -> Result<Changes, String> {
        let read = |file: &str| self.read(file);
        match variant {
            Variant::Again => Ok(Changes::new()),
            Variant::Unrelated => unrelated(&read),
            Variant::Injected(id, size) => injections
                .iter()
                .find(|injection| injection.id == *id)
                .ok_or_else(|| format!("no injection is called {id}"))
                .and_then(|injection| injection.changes(*size, &read)),
            Variant::Every(size) => every(injections, *size, &read),
        }
    }

    /// The text of a file as it was committed.
    fn read(&self, file: &str) -> Result<String, String> {
        let path = self.worktree.path.join(file);
        std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))
    }

    /// Builds with these files in place of the committed ones, if that was not done before.
    fn build(&self, name: &str, incremental: bool, changes: &Changes) -> Result<PathBuf> {
        let program = self.programs.join(name);
        if program.is_file() {
            return Ok(program);
        }
        tell::note(format!("building {}", program.display()));
        // The last two so that cargo builds again what it would call fresh.
        let files = changes.keys().map(String::as_str).chain(["src/main.rs", "src/lib.rs"]);
        let committed = files.map(|file| Ok((file.to_owned(), self.read(file)?)));
        let committed = committed.collect::<Result<Changes, String>>();
        let committed =
            committed.map_err(|reason| anyhow!("`reading a source` failed: {reason}"))?;
        self.put(&committed)?;
        self.put(changes)?;
        let built = build::compile(
            (&self.worktree.path, &self.target),
            CargoTarget::FATHOM,
            "with a change",
            &[("CARGO_INCREMENTAL", if incremental { "1" } else { "0" })],
            &INTERRUPT,
            &mut |line| {
                if !line.trim_start().starts_with("Compiling") {
                    tell::note(line);
                }
            },
        );
        self.put(&committed)?;
        build::keep(&built?, &program)?;
        Ok(program)
    }

    fn put(&self, changes: &Changes) -> Result<()> {
        for (file, text) in changes {
            let path = self.worktree.path.join(file);
            let written = std::fs::write(&path, text);
            written.with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }
}

//! Two checkouts of HEAD, built once each. Their programs read shaders from the checkouts, so most variants need no build.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use fathom::compare::build::{self, Worktree};
use fathom::compare::store::StoredComparison;
use fathom::harness::catalog::CargoTarget;
use fathom::record::FolderLock;
use fathom::record::comparison::Side;
use fathom::tell;

use crate::INTERRUPT;
use crate::patches::{Changes, changes};
use crate::trials::{Trial, Variant};

/// `rust_embed` reads folders from disk where these two crates are compiled with debug assertions.
const FROM_DISK: [&str; 4] = [
    "--config",
    "profile.release.package.fathom-embedded.debug-assertions=true",
    "--config",
    "profile.release.package.rust-embed.debug-assertions=true",
];
/// Both checkouts share a target folder. A touch makes cargo build this crate again, which holds the checkout's path.
const HOLDS_PATH: &str = "src/embedded/mod.rs";

pub struct Workshop {
    /// In the order of [`Side::BOTH`].
    worktrees: [Worktree; 2],
    target: PathBuf,
    /// Folder of what was built.
    programs: PathBuf,
    /// Nobody else changes the checkouts.
    _lock: FolderLock,
}

impl Workshop {
    /// Of HEAD of the repository around a folder.
    pub fn open(folder: &Path) -> Result<Self> {
        let repository = build::repository(folder)?;
        let commit = build::commit(&repository, "HEAD")?;
        let cache = repository.join(build::CACHE);
        let own = |what: &str| cache.join(format!("self-test-{what}"));
        let target = own("target");
        let lock = FolderLock::take(&target, "fathom-selftest")?;
        let add = |side: Side| Worktree::add(&repository, own(&side.to_string()), &commit);
        Ok(Self {
            worktrees: [add(Side::Base)?, add(Side::Head)?],
            target,
            programs: own(commit.get(..12).unwrap_or(&commit)),
            _lock: lock,
        })
    }

    /// Calls `compare` with the programs of the base and of a trial, whose changes lie in the head's checkout meanwhile.
    pub fn with<T>(
        &self,
        trial: &Trial,
        tried: Option<&StoredComparison>,
        compare: impl FnOnce([PathBuf; 2]) -> Result<T>,
    ) -> Result<T> {
        let base = self.build(Side::Base, "base")?;
        let [_, head] = &self.worktrees;
        let changes = changes(&head.path, &trial.variant, tried)?;
        let committed = changes
            .keys()
            .map(|file| Ok((file.clone(), std::fs::read_to_string(head.path.join(file))?)));
        let committed = committed.collect::<Result<Changes>>()?;
        let only_shaders = changes.keys().all(|file| Path::new(file).starts_with("shaders"));
        let name = match &trial.variant {
            _ if only_shaders => "head",
            Variant::Patched(patch) => &patch.kind.replace(' ', "-"),
            _ => unreachable!("only patches change the host"),
        };
        let put = self.put(&changes).and_then(|()| self.build(Side::Head, name));
        let compared = put.and_then(|head| compare([base, head]));
        self.put(&committed)?;
        compared
    }

    fn put(&self, changes: &Changes) -> Result<()> {
        for (file, text) in changes {
            let path = self.worktrees[Side::Head as usize].path.join(file);
            let written = std::fs::write(&path, text);
            written.with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(())
    }

    /// Builds a side's checkout as it is, if that was not done before.
    fn build(&self, side: Side, name: &str) -> Result<PathBuf> {
        let program = self.programs.join(name);
        if program.is_file() {
            return Ok(program);
        }
        tell::note(format!("building {}", program.display()));
        let source = &self.worktrees[side as usize].path;
        let touched = source.join(HOLDS_PATH);
        let text = std::fs::read(&touched).and_then(|text| std::fs::write(&touched, text));
        text.with_context(|| format!("cannot write {}", touched.display()))?;
        let built = build::compile(
            (source, &self.target),
            CargoTarget::FATHOM,
            name,
            &FROM_DISK,
            &INTERRUPT,
            &mut |line| {
                if !line.trim_start().starts_with("Compiling") {
                    tell::note(line);
                }
            },
        )?;
        build::keep(&built, &program)?;
        Ok(program)
    }
}

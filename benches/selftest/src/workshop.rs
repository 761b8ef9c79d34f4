//! Two checkouts of HEAD, built once each. Their programs read shaders from the checkouts, so most variants need no build.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use fathom::compare::build::{self, Worktree};
use fathom::compare::store::Comparison;
use fathom::harness::catalog::CargoTarget;
use fathom::record::comparison::Side;
use fathom::{folder, print, process};

use crate::INTERRUPT;
use crate::slowed::{self, TRIED};
use crate::trials::{Trial, Variant, stages};

/// `rust_embed` reads folders from disk where these two crates are compiled with debug assertions.
const FROM_DISK: [&str; 4] = [
    "--config",
    "profile.release.package.fathom-base.debug-assertions=true",
    "--config",
    "profile.release.package.rust-embed.debug-assertions=true",
];
/// Both checkouts share a target folder. A touch makes cargo build this crate again, which holds the checkout's path.
const HOLDS_PATH: &str = "src/base/embedded.rs";

pub struct Workshop {
    /// In the order of [`Side::BOTH`].
    worktrees: [Worktree; 2],
    target: PathBuf,
    /// Folder of what was built.
    programs: PathBuf,
}

impl Workshop {
    /// Of HEAD of the repository around a folder.
    pub fn open(folder: &Path) -> Result<Self> {
        let repository = build::repository(folder)?;
        let commit = build::commit(&repository, "HEAD")?;
        let cache = folder::user_cache().context("there is no home folder to build in")?;
        let own = |what: &str| cache.join(format!("self-test-{what}"));
        let add = |side: Side| Worktree::add(&repository, own(&side.to_string()), &commit);
        Ok(Self {
            worktrees: [add(Side::Base)?, add(Side::Head)?],
            target: own("target"),
            programs: own(commit.get(..12).unwrap_or(&commit)),
        })
    }

    /// Calls `compare` with the programs of the base and of a trial, whose changes lie in the head's checkout meanwhile.
    pub fn with<T>(
        &self,
        trial: &Trial,
        tried: Option<&Comparison>,
        compare: impl FnOnce([PathBuf; 2]) -> Result<T>,
    ) -> Result<T> {
        let base = self.build(Side::Base, "base")?;
        let [_, Worktree { path: checkout, .. }] = &self.worktrees;
        let changes = changes(checkout, &trial.variant, tried)?;
        let mut name = "head".to_owned();
        for (file, text) in &changes {
            if let Variant::Patched(patch) = &trial.variant
                && !file.starts_with("shaders")
            {
                name = patch.kind.replace(' ', "-");
            }
            std::fs::write(checkout.join(file), text)
                .with_context(|| format!("cannot write {file}"))?;
        }
        let compared = self.build(Side::Head, &name).and_then(|head| compare([base, head]));
        let mut git = Command::new("git");
        process::run_for_stdout(git.arg("-C").arg(checkout).args(["checkout", "--quiet", "."]))
            .map_err(anyhow::Error::msg)?;
        compared
    }

    /// Builds a side's checkout as it is, if that was not done before.
    fn build(&self, side: Side, name: &str) -> Result<PathBuf> {
        let program = self.programs.join(name);
        if program.is_file() {
            return Ok(program);
        }
        print::note(format!("building {}", program.display()));
        let source = &self.worktrees[side as usize].path;
        let touched = source.join(HOLDS_PATH);
        let text = std::fs::read(&touched).and_then(|text| std::fs::write(&touched, text));
        text.with_context(|| format!("cannot write {}", touched.display()))?;
        let built = build::compile(
            source,
            &self.target,
            CargoTarget::FATHOM,
            name,
            &FROM_DISK,
            &INTERRUPT,
            &mut |line| print::note(line),
        )?;
        build::store_program(&built.path, &program)?;
        Ok(program)
    }
}

/// Changed files with their new text.
pub type ChangedFiles = BTreeMap<String, String>;

/// The files of a checkout that a variant changes. `tried` is what [`Variant::Tried`] gave.
pub fn changes(
    checkout: &Path,
    variant: &Variant,
    tried: Option<&Comparison>,
) -> Result<ChangedFiles> {
    let read = |file: &str| std::fs::read_to_string(checkout.join(file)).context(file.to_owned());
    let mut changes = ChangedFiles::new();
    let mut slow = |stage: &str, iterations: u32| -> Result<()> {
        let (file, condition) = slowed::shader(stage);
        let text = changes.remove(&file).map_or_else(|| read(&file), Ok)?;
        let looped = slowed::with_loop(&text, iterations, condition.as_deref());
        changes.insert(file, looped.with_context(|| format!("{stage} has no entry point"))?);
        Ok(())
    };
    match variant {
        Variant::Again => {}
        Variant::Tried => stages().iter().try_for_each(|stage| slow(stage, TRIED))?,
        Variant::Slowed(stage, share) => {
            let measured = tried.and_then(|tried| slowed::iterations(tried, stage, *share));
            slow(stage, measured.with_context(|| format!("{stage} was not tried"))?)?;
        }
        Variant::Patched(patch) => {
            changes.insert(patch.file.clone(), patch.applied(&read(&patch.file)?)?);
        }
    }
    Ok(changes)
}

//! Builds of revisions of the repository, each checked out into a temporary worktree and compiled into a target folder of its
//! own; a base is kept by its commit and what compiled it.

use std::cmp::Reverse;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

use anyhow::{Error, Result, anyhow, bail};
use itertools::Itertools;
use serde_json::Value;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use fathom_base::folder::Dir;
use fathom_base::input;
use fathom_base::process::{self, Limits, ProcessError, git};
use fathom_harness::catalog::CargoTarget;
use fathom_record::{Build, FolderLock};

/// Built revisions that are kept: a search of hundreds of candidates visits fewer.
const MAX_CACHED: usize = 32;
/// Beginning of the names of checkouts in the cache.
const WORKTREE: &str = "worktree-";
/// Folder of the cache, in the repository's target folder.
pub const CACHE: &str = "target/compare";
/// Variables that change what cargo and the compilers make of a source.
const VARIABLES: [&str; 7] = [
    "RUSTFLAGS",
    "CARGO_ENCODED_RUSTFLAGS",
    "RUSTC",
    "RUSTC_WRAPPER",
    "RUSTC_WORKSPACE_WRAPPER",
    "CC",
    "CFLAGS",
];
/// Beginnings of more of them.
const PREFIXES: [&str; 3] = ["CARGO_PROFILE_", "CARGO_BUILD_", "CARGO_TARGET_"];
/// Hexadecimal digits of [`build_fingerprint`].
const FINGERPRINT_DIGITS: usize = 8;

/// The release build of `target` at `revision` of the repository around `folder`, from the cache if it is there.
///
/// cargo starts in the same folder of the checkout, so the crate need not be at the repository's root. `progress` is given each line that
/// cargo writes. Once `interrupted` is set the build ends, and nothing of it is left.
pub fn revision(
    folder: &Path,
    target: CargoTarget,
    revision: &str,
    interrupted: &AtomicBool,
    progress: &mut dyn FnMut(&str),
) -> Result<PathBuf> {
    let repository = repository(folder)?;
    let commit = commit(&repository, revision)?;
    let cache = repository.join(CACHE);
    let (configurations, variables) = (cargo_configurations(&cache), std::env::vars_os());
    let fingerprint =
        build_fingerprint(&compiler(&repository)?, target, variables, &configurations);
    let kept = cache.join("builds").join(format!("{commit}-{fingerprint}"));
    let program = kept.join(format!("{}{}", target.binary, std::env::consts::EXE_SUFFIX));
    if program.is_file() {
        return Ok(program);
    }
    let _lock = FolderLock::take(&cache)?;
    remove_stale(&repository, &cache, WORKTREE);
    let worktree = Worktree::add(&repository, cache.join(format!("{WORKTREE}{commit}")), &commit)?;
    let prefix = git(folder, &["rev-parse", "--show-prefix"]).map_err(Error::msg)?;
    let source = worktree.path.join(prefix);
    let source = source.ancestors().find(|path| path.is_dir()).unwrap_or(&worktree.path);
    let folders = (source, &*cache.join("target"));
    let built = compile(folders, target, revision, &[], interrupted, progress)?;
    store_program(&built, &program)?;
    forget_old(&cache.join("builds"), &kept);
    Ok(program)
}

fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// What the compiler used in a folder says of itself.
fn compiler(folder: &Path) -> Result<String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    process::run_for_stdout(Command::new(rustc).arg("-vV").current_dir(folder))
        .map_err(|reason| anyhow!("`rustc -vV` failed: {reason}"))
}

/// What cargo's configuration files hold that count in a folder, beside those of the checkout in it (The Cargo Book, *Configuration*,
/// "Hierarchical structure").
fn cargo_configurations(folder: &Path) -> Vec<Vec<u8>> {
    let of_user = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let of_user = of_user.or_else(|| Some(std::env::home_dir()?.join(".cargo")));
    let folders = folder.ancestors().map(|folder| folder.join(".cargo")).chain(of_user);
    let files = folders.flat_map(|folder| ["config", "config.toml"].map(|name| folder.join(name)));
    files.filter_map(|file| std::fs::read(file).ok()).collect()
}

/// A short name of all that decides what is built of a commit.
fn build_fingerprint(
    compiler: &str,
    target: CargoTarget,
    variables: impl IntoIterator<Item = (OsString, OsString)>,
    configurations: &[Vec<u8>],
) -> String {
    let counts = |name: &str| {
        VARIABLES.contains(&name) || PREFIXES.iter().any(|prefix| name.starts_with(prefix))
    };
    let variables = variables.into_iter().filter(|(name, _)| name.to_str().is_some_and(counts));
    let variables: Vec<_> = variables.sorted().collect();
    // Written as values of Rust, none of them passes for another.
    let all = format!("{compiler:?} {target:?} {variables:?} {configurations:?}");
    hex::encode(Sha256::digest(all))[..FINGERPRINT_DIGITS].to_owned()
}

/// What `git` says of the checkout around a folder, as [`fathom_harness::catalog::Catalog::with_revision`] takes it: its commit, and
/// whether files differ.
pub fn checkout(folder: &Path) -> Option<Build> {
    let arguments = ["describe", "--always", "--dirty=-dirty", "--abbrev=40", "--exclude=*"];
    Some(Build::described(&git(folder, &arguments).ok()?))
}

pub fn repository(folder: &Path) -> Result<PathBuf> {
    let root = git(folder, &["rev-parse", "--show-toplevel"]).map(PathBuf::from);
    let shown = folder.display();
    root.map_err(|reason| {
        anyhow!("no revision of {shown} can be had: {reason}; `compare` also takes --base-bin PATH")
    })
}

pub fn commit(repository: &Path, revision: &str) -> Result<String> {
    let asked = format!("{revision}^{{commit}}");
    let commit = git(repository, &["rev-parse", "--verify", "--end-of-options", &asked]);
    let hint = || shallow_hint(repository);
    commit.map_err(|reason| anyhow!("unknown revision `{revision}`: {reason}{}", hint()))
}

/// What to do where a revision or its history is not there because the clone is shallow; else nothing.
pub fn shallow_hint(repository: &Path) -> &'static str {
    let is_shallow = git(repository, &["rev-parse", "--is-shallow-repository"]);
    if is_shallow.as_deref() == Ok("true") {
        "; the clone is shallow: check out the whole history (git fetch --unshallow; GitHub: fetch-depth: 0; GitLab: GIT_DEPTH: 0)"
    } else {
        ""
    }
}

/// Removes the checkouts that a killed process has left in a folder, which is locked: those whose names begin so.
pub fn remove_stale(repository: &Path, folder: &Path, beginning: &str) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(beginning) {
            drop(Worktree { repository: repository.to_owned(), path: entry.path() });
        }
    }
}

/// A checkout that is removed when it is dropped.
pub struct Worktree {
    repository: PathBuf,
    pub path: PathBuf,
}

impl Worktree {
    /// A checkout in this folder, which is made anew, with its submodules.
    pub fn add(repository: &Path, path: PathBuf, commit: &str) -> Result<Self> {
        let worktree = Self { repository: repository.to_owned(), path };
        worktree.remove();
        let path = worktree.path.to_string_lossy();
        let failed = |what| move |reason: String| anyhow!("git {what} of {commit}: {reason}");
        git(repository, &["worktree", "add", "--detach", "--force", &path, commit])
            .map_err(failed("worktree add"))?;
        if worktree.path.join(".gitmodules").exists() {
            git(&worktree.path, &["submodule", "update", "--init", "--recursive"])
                .map_err(failed("submodule update"))?;
        }
        Ok(worktree)
    }

    /// Also forgets checkouts whose folders are gone.
    fn remove(&self) {
        if self.path.exists() {
            let path = self.path.to_string_lossy();
            let _ = git(&self.repository, &["worktree", "remove", "--force", &path]);
            let _ = std::fs::remove_dir_all(&self.path);
        }
        let _ = git(&self.repository, &["worktree", "prune"]);
    }
}

impl Drop for Worktree {
    fn drop(&mut self) {
        self.remove();
    }
}

/// The program that cargo makes of a checkout, into a target folder, with these arguments more.
///
/// Nothing that cargo started is left in the end, or once `interrupted` is set.
pub fn compile(
    (source, built): (&Path, &Path),
    target: CargoTarget,
    revision: &str,
    arguments: &[&str],
    interrupted: &AtomicBool,
    progress: &mut dyn FnMut(&str),
) -> Result<PathBuf> {
    let limits = Limits { time: None, interrupted: Some(interrupted) };
    let mut cargo = cargo();
    cargo.args(["build", "--release", "--locked", "--color=never"]);
    cargo.arg("--message-format=json-render-diagnostics");
    cargo.args(["-p", target.package, "--bin", target.binary, "--target-dir"]).arg(built);
    cargo.args(arguments).current_dir(source);
    match process::run(&mut cargo, limits, progress) {
        Ok(messages) => executable(&messages, target.binary)
            .ok_or_else(|| anyhow!("cargo names no program that it has built of `{revision}`")),
        Err(ProcessError::Interrupted) => bail!("building `{revision}` was interrupted"),
        Err(ProcessError::Failed { complaint, .. }) => {
            let said = complaint.lines().join("\n");
            bail!("revision `{revision}` does not build; the compiler says:\n{said}")
        }
        Err(other) => bail!("`cargo build` failed: {other}"),
    }
}

/// The program that cargo says it has made (The Cargo Book, *External tools*, "Artifact messages"): where it lies depends on
/// variables and configuration.
fn executable(messages: &str, binary: &str) -> Option<PathBuf> {
    let messages = messages.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let mut of_binary = messages.filter(|message| message["target"]["name"] == binary);
    of_binary.find_map(|message| message["executable"].as_str().map(PathBuf::from))
}

/// Copies a program into the cache. It appears there whole or not at all.
pub fn store_program(built: &Path, program: &Path) -> Result<()> {
    let folder = Dir::make(program.parent().unwrap_or(Path::new("."))).map_err(Error::msg)?;
    let copied = input::open(built).and_then(|mut source| {
        folder.write_with(program.file_name().unwrap_or_default(), |file| {
            std::io::copy(&mut source, file)?;
            file.set_permissions(source.metadata()?.permissions())
        })
    });
    copied.map_err(|error| anyhow!("cannot copy {}: {error}", built.display()))
}

/// A program's copy for one comparison, which building anew meanwhile does not change. It goes when this is dropped.
pub struct ProgramCopy {
    /// Held for its removal.
    _folder: TempDir,
    /// The copy.
    pub path: PathBuf,
}

/// Copies a program out of reach of the build tool.
pub fn set_aside(program: &Path) -> Result<ProgramCopy> {
    let folder = tempfile::Builder::new().prefix("fathom-compare-").tempdir();
    let folder = folder.map_err(|error| {
        anyhow!("cannot make a folder in {}: {error}", std::env::temp_dir().display())
    })?;
    let name = program.file_name().unwrap_or(OsStr::new("program"));
    let path = folder.path().join(name);
    store_program(program, &path)?;
    Ok(ProgramCopy { _folder: folder, path })
}

/// Removes the oldest builds but `newest`, so that [`MAX_CACHED`] are left. What cannot be removed stays.
fn forget_old(builds: &Path, newest: &Path) {
    let Ok(entries) = std::fs::read_dir(builds) else {
        return;
    };
    let age = |path: &Path| {
        let modified = path.metadata().and_then(|meta| meta.modified());
        modified.unwrap_or(SystemTime::UNIX_EPOCH)
    };
    let others = entries.flatten().map(|entry| entry.path());
    let others = others.filter(|path| path.to_str().is_some() && path != newest);
    for path in others.sorted_by_key(|path| Reverse(age(path))).skip(MAX_CACHED - 1) {
        let _ = std::fs::remove_dir_all(path);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const MANIFEST: &str = "[package]\nname = \"mine\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n\
        [[bin]]\nname = \"my-bench\"\npath = \"src/main.rs\"\n\n[workspace]\n";
    const LOCK: &str = "version = 4\n\n[[package]]\nname = \"mine\"\nversion = \"0.1.0\"\n";
    const TARGET: CargoTarget = CargoTarget { package: "mine", binary: "my-bench" };

    /// A repository with a crate of two commits: the first builds, the second, HEAD, does not. The crate lies in a folder of it.
    struct TestRepository {
        folder: tempfile::TempDir,
        /// Of the crate.
        path: PathBuf,
    }

    impl TestRepository {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("crates/mine");
            std::fs::create_dir_all(&path).unwrap();
            let repository = Self { folder, path };
            git(repository.folder.path(), &["init", "--quiet"]).unwrap();
            repository.git(["config", "user.name", "Someone"]);
            repository.git(["config", "user.email", "someone@example.org"]);
            repository.write("Cargo.toml", MANIFEST);
            repository.write("Cargo.lock", LOCK);
            repository.write("../../.gitignore", "/target\n");
            repository.write("src/main.rs", "fn main() { println!(\"first\"); }\n");
            repository.commit();
            repository.write("src/main.rs", "fn main() { second() }\n");
            repository.commit();
            repository
        }

        fn cache(&self) -> PathBuf {
            self.folder.path().join(CACHE)
        }

        fn write(&self, name: &str, text: &str) {
            let path = self.path.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }

        fn git<const N: usize>(&self, arguments: [&str; N]) -> String {
            git(&self.path, &arguments).unwrap()
        }

        fn commit(&self) {
            self.git(["add", "--all"]);
            self.git(["commit", "--quiet", "--message=Change"]);
        }

        /// No worktree and no build is left.
        fn is_clean(&self) -> bool {
            let folders = std::fs::read_dir(self.cache()).unwrap().flatten();
            folders.map(|entry| entry.file_name()).eq(["target"])
                && self.git(["worktree", "list"]).split(" [").count() == 2
        }

        fn build(&self, name: &str) -> (Result<PathBuf>, usize) {
            let mut lines = 0;
            let built = revision(&self.path, TARGET, name, &AtomicBool::new(false), &mut |_| {
                lines += 1;
            });
            (built, lines)
        }
    }

    #[test]
    fn a_revision_is_built_once_and_leaves_no_worktree() {
        let repository = TestRepository::new();
        let (built, lines) = repository.build("HEAD~1");
        let built = built.unwrap();
        assert!(lines > 0, "cargo's progress is passed on");
        let commit = repository.git(["rev-parse", "HEAD~1"]);
        assert!(built.to_string_lossy().contains(&commit), "{}", built.display());
        let output = Command::new(&built).output().unwrap();
        assert_eq!(output.stdout, b"first\n");
        assert_eq!(repository.git(["worktree", "list"]).split(" [").count(), 2);
        assert_eq!(repository.git(["status", "--porcelain"]), "");
        let (again, lines) = repository.build(&commit);
        assert_eq!(again.unwrap(), built);
        assert_eq!(lines, 0, "it comes from the cache");
        let _lock = FolderLock::take(&repository.cache()).unwrap();
        let refused = repository.build("HEAD").0.unwrap_err().to_string();
        assert!(refused.contains("is in use by process "), "{refused}");
    }

    #[test]
    fn whatever_changes_what_is_built_makes_another_build() {
        let plain = |variables: &[(&str, &str)], configurations: &[&str]| {
            let variables = variables.iter().map(|(name, value)| (name.into(), value.into()));
            let configurations: Vec<_> =
                configurations.iter().map(|text| text.as_bytes().to_vec()).collect();
            build_fingerprint("rustc 1", TARGET, variables, &configurations)
        };
        let other = CargoTarget { package: "other", ..TARGET };
        let fingerprints = [
            plain(&[], &[]),
            build_fingerprint("rustc 2", TARGET, [], &[]),
            build_fingerprint("rustc 1", other, [], &[]),
            plain(&[("RUSTFLAGS", "")], &[]),
            plain(&[("RUSTFLAGS", "-Ctarget-cpu=native")], &[]),
            plain(&[("CARGO_ENCODED_RUSTFLAGS", "-Ctarget-cpu=native")], &[]),
            plain(&[("CARGO_PROFILE_RELEASE_OPT_LEVEL", "0")], &[]),
            plain(&[("CARGO_BUILD_TARGET", "x86_64-unknown-linux-gnu")], &[]),
            plain(&[("CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_LINKER", "lld")], &[]),
            plain(&[], &["[profile.release]\nlto = true"]),
            plain(&[], &["", "[profile.release]\nlto = true"]),
        ];
        let different: BTreeSet<&String> = fingerprints.iter().collect();
        assert_eq!(different.len(), fingerprints.len(), "{fingerprints:?}");
        assert_eq!(plain(&[("PATH", "/bin"), ("CARGO_TERM_COLOR", "never")], &[]), fingerprints[0]);
        let folder = tempfile::tempdir().unwrap();
        let before = cargo_configurations(folder.path()).len();
        let deep = folder.path().join("a/b");
        std::fs::create_dir_all(folder.path().join(".cargo")).unwrap();
        std::fs::write(folder.path().join(".cargo/config.toml"), "[build]").unwrap();
        assert_eq!(cargo_configurations(&deep).len(), before + 1);
    }

    #[test]
    fn a_program_set_aside_stays_as_it_was_and_goes_in_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("fathom");
        std::fs::write(&program, "old").unwrap();
        let aside = set_aside(&program).unwrap();
        std::fs::write(&program, "new").unwrap();
        assert_eq!(std::fs::read_to_string(&aside.path).unwrap(), "old");
        let path = aside.path.clone();
        drop(aside);
        assert!(!path.parent().unwrap().exists());
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
            std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
            assert_eq!(mode(&set_aside(&program).unwrap().path), mode(&program));
        }
        let missing = set_aside(&folder.path().join("none")).err().unwrap();
        assert!(missing.to_string().contains("none"), "{missing}");
    }

    #[test]
    fn a_revision_that_does_not_build_shows_the_compilers_last_lines() {
        let repository = TestRepository::new();
        let message = repository.build("HEAD").0.unwrap_err().to_string();
        assert!(message.contains("revision `HEAD` does not build"), "{message}");
        assert!(message.contains("cannot find function `second`"), "{message}");
        assert!(repository.is_clean());
    }

    #[test]
    fn only_the_newest_builds_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        for n in 0..MAX_CACHED + 3 {
            std::fs::create_dir(folder.path().join(n.to_string())).unwrap();
        }
        let newest = folder.path().join("0");
        forget_old(folder.path(), &newest);
        assert!(newest.exists());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), MAX_CACHED);
    }
}

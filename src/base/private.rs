//! What records tell of the machine and of the user's folders: enough to tell machines and files apart, and no more, because
//! records are published.

use std::path::Path;

use sha2::{Digest, Sha256};

/// Bytes of the digest that stands for a machine: among a thousand machines two have the same once in 9,000 times.
const MACHINE_BYTES: usize = 4;
/// What a path in a text ends at.
const AFTER_PATH: &[char] =
    &['"', '\'', '`', '(', ')', '[', ']', '{', '}', '<', '>', ',', ';', ':', '=', '|'];

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

/// A command line of this process.
pub fn command() -> Vec<String> {
    let shown = |word: std::ffi::OsString| {
        if Path::new(&word).is_absolute() {
            path(Path::new(&word))
        } else {
            redact(&word.to_string_lossy())
        }
    };
    std::env::args_os().map(shown).collect()
}

/// A text with the absolute paths in it as [`path`] gives them.
pub fn redact(text: &str) -> String {
    let is_beside_path = |c: char| c.is_whitespace() || AFTER_PATH.contains(&c);
    // Names of these folders may hold what ends a path elsewhere, such as spaces.
    let folders = [(std::env::current_dir().ok(), ""), (std::env::home_dir(), "/~/")];
    let folders =
        folders.map(|(path, by)| (format!("{}/", path.unwrap_or_default().display()), by));
    let whole = folders.iter().filter(|(folder, _)| folder.len() > 2);
    let text = whole.fold(text.to_owned(), |text, (folder, by)| text.replace(folder, by));
    let shown = |word: &str| {
        let path = word.trim_end_matches(is_beside_path);
        match path.trim_end_matches('/').rsplit_once('/') {
            // `https://` and comments are no paths, nor is a lone name after a stroke: `1 /s`.
            Some((folder, last)) if folder.starts_with('/') && !folder.starts_with("//") => {
                format!("{last}{}", &word[path.len()..])
            }
            _ => word.to_owned(),
        }
    };
    text.split_inclusive(is_beside_path).map(shown).collect()
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

    #[test]
    fn texts_keep_all_but_the_folders_of_their_paths() {
        let current = std::env::current_dir().unwrap();
        let current = current.display();
        let home = std::env::home_dir().unwrap();
        let home = home.display();
        for (text, shown) in [
            ("cannot read /data/jo/x.obj: gone", "cannot read x.obj: gone"),
            ("`/data/jo/x.obj`, `/data/jo/y/`", "`x.obj`, `y`"),
            ("scene=/data/jo/a.toml,/data/jo/b.toml", "scene=a.toml,b.toml"),
            ("--out=/data/jo/run", "--out=run"),
            ("/data/jo", "jo"),
            // No paths.
            (
                "12 /s and 3 m/s², and/or https://example.org/a/b // all",
                "12 /s and 3 m/s², and/or https://example.org/a/b // all",
            ),
            ("a / b", "a / b"),
            ("/", "/"),
            ("", ""),
        ] {
            assert_eq!(redact(text), shown);
        }
        assert_eq!(redact(&format!("see {current}/runs/one/x.png")), "see runs/one/x.png");
        assert_eq!(redact(&format!("see {home}/some/x.png")), "see x.png");
        assert_eq!(redact(&format!("see {current}x/y")), "see y");
    }
}

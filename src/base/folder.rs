//! Files in a folder that a user names, which can hold other people's files. The folder itself may be a symbolic link; beneath it no
//! link is followed, and only regular files are read and replaced. A file is written beside its place and moved there when it is whole.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Component, Path, PathBuf};

use crate::input::{self, kind_name};

/// First bytes of a text, in which one of fathom's names it; and those in which files of a format are alike.
const BEGINNING: u64 = 1 << 10;
const FORMAT: usize = 4;

/// A folder that is there. Names of files are paths beneath it.
#[derive(Clone, Debug)]
pub struct Dir {
    path: PathBuf,
}

/// The folder of a path's last part, and that part.
pub fn open_parent(path: &Path) -> io::Result<(Dir, &Path)> {
    let name = path.file_name().ok_or_else(|| outside(path))?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    Ok((Dir::open(folder.unwrap_or(Path::new(".")))?, Path::new(name)))
}

/// Writes a file that fathom names; see [`Dir::write_own`].
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (folder, name) = open_parent(path)?;
    folder.write_own(name, bytes)
}

/// Writes a file that the user names; see [`Dir::write`].
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (folder, name) = open_parent(path)?;
    folder.write(name, bytes)
}

/// The bytes of a file that lies beneath its folder, decompressed as [`input::unpacked`] does.
pub fn unpacked(path: &Path, limit: u64) -> io::Result<Box<dyn Read>> {
    let (folder, name) = open_parent(path)?;
    input::unpack(folder.read(name)?, limit)
}

/// Something has this name, if only a link that leads nowhere.
pub fn is_there(path: &Path) -> bool {
    path.symlink_metadata().is_ok()
}

/// The folder for what fathom can make again, by each system's convention.
pub fn user_cache() -> Option<PathBuf> {
    let absolute = |name: &str| {
        std::env::var_os(name).map(PathBuf::from).filter(|folder| folder.is_absolute())
    };
    let home = std::env::home_dir().filter(|home| !home.as_os_str().is_empty());
    if cfg!(windows) {
        let local = absolute("LOCALAPPDATA").or_else(|| Some(home?.join("AppData/Local")));
        return Some(local?.join("fathom/cache"));
    }
    if cfg!(target_os = "macos") {
        return Some(home?.join("Library/Caches/fathom"));
    }
    let cache = absolute("XDG_CACHE_HOME").or_else(|| Some(home?.join(".cache")));
    Some(cache?.join("fathom"))
}

impl Dir {
    pub fn open(path: &Path) -> io::Result<Self> {
        // Only a folder has entries: anything else is an error.
        std::fs::read_dir(path)?;
        Ok(Self { path: path.to_owned() })
    }

    /// Opens a folder, which is made with its parents where it is not there.
    pub fn make(path: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(path)?;
        Self::open(path)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes a folder beneath, where it is not there.
    pub fn make_beneath(&self, name: &str) -> io::Result<()> {
        let path = self.path.join(name);
        match path.symlink_metadata() {
            Ok(found) if !found.is_dir() => {
                Err(refusal(Path::new(name), kind_name(found.file_type())))
            }
            _ => std::fs::create_dir_all(path),
        }
    }

    /// The path of a name at which there is a regular file or nothing.
    fn place(&self, name: &Path) -> io::Result<PathBuf> {
        let mut path = self.path.clone();
        let mut parts = name.components().peekable();
        while let Some(part) = parts.next() {
            let Component::Normal(part) = part else { return Err(outside(name)) };
            path.push(part);
            match path.symlink_metadata() {
                Ok(found) if parts.peek().is_some() && found.is_dir() => {}
                Ok(found) if parts.peek().is_none() && found.is_file() => {}
                Ok(found) => return Err(refusal(Path::new(part), kind_name(found.file_type()))),
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        if path == self.path { Err(outside(name)) } else { Ok(path) }
    }

    pub fn read(&self, name: impl AsRef<Path>) -> io::Result<File> {
        File::open(self.place(name.as_ref())?)
    }

    /// Opens a file to read it and to add to its end. It is made where it is not there.
    pub fn append(&self, name: impl AsRef<Path>) -> io::Result<File> {
        let path = self.place(name.as_ref())?;
        OpenOptions::new().read(true).append(true).create(true).open(path)
    }

    /// Its bytes, no more than `limit`.
    pub fn bytes(&self, name: impl AsRef<Path>, limit: u64) -> io::Result<Vec<u8>> {
        input::limited(self.read(name)?, limit)?.bytes()
    }

    /// Writes a file, replacing one of that name, all or nothing.
    pub fn write(&self, name: impl AsRef<Path>, bytes: &[u8]) -> io::Result<()> {
        self.write_with(name, |file| file.write_all(bytes))
    }

    /// Writes a file that fathom names, and replaces none but its own.
    pub fn write_own(&self, name: impl AsRef<Path>, bytes: &[u8]) -> io::Result<()> {
        self.check_own(&name, bytes)?;
        self.write(name, bytes)
    }

    /// Refuses to put this where another program's file is. Pictures, arrays and tables cannot name fathom: there the format counts.
    pub fn check_own(&self, name: impl AsRef<Path>, new: &[u8]) -> io::Result<()> {
        let (name, mut old) = (name.as_ref(), Vec::new());
        match self.read(name) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            file => file?.take(BEGINNING).read_to_end(&mut old)?,
        };
        let is_named = |bytes: &[u8]| bytes.windows(6).any(|word| word == b"fathom");
        let is_own = match is_named(&new[..new.len().min(BEGINNING as usize)]) {
            true => is_named(&old),
            false => old.get(..FORMAT) == new.get(..FORMAT),
        };
        let name = name.display();
        let message =
            format!("`{name}` is there, and not by fathom: move it, or choose another folder");
        let error = || io::Error::other(message);
        (is_own || old.is_empty()).then_some(()).ok_or_else(error)
    }

    /// The same as [`Dir::write`], with what `write` writes.
    pub fn write_with<E: From<io::Error>>(
        &self,
        name: impl AsRef<Path>,
        write: impl FnOnce(&mut File) -> Result<(), E>,
    ) -> Result<(), E> {
        let path = self.place(name.as_ref())?;
        let mut fresh = tempfile::Builder::new();
        // Those of any new file, in place of the private ones of temporary files.
        #[cfg(unix)]
        fresh.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = fresh.tempfile_in(path.parent().unwrap_or(&self.path))?;
        write(file.as_file_mut())?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    }
}

fn outside(name: &Path) -> io::Error {
    let message = format!("`{}` is no path within its folder", name.display());
    io::Error::new(ErrorKind::InvalidInput, message)
}

fn refusal(name: &Path, kind: &str) -> io::Error {
    let message =
        format!("`{}` is {kind}; only regular files are read and replaced", name.display());
    io::Error::new(ErrorKind::InvalidInput, message)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_is_replaced_whole_or_stays() {
        let place = tempfile::tempdir().unwrap();
        let folder = Dir::make(&place.path().join("a/b")).unwrap();
        folder.write("x", b"one").unwrap();
        let failed = folder.write_with("x", |file| {
            file.write_all(b"tw")?;
            Err(io::Error::other("disk full"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "disk full");
        assert_eq!(folder.bytes("x", 3).unwrap(), b"one");
        assert_eq!(folder.bytes("x", 2).unwrap_err().kind(), ErrorKind::FileTooLarge);
        folder.append("x").unwrap().write_all(b"+").unwrap();
        assert_eq!(folder.bytes("x", 9).unwrap(), b"one+");
        folder.make_beneath("c").unwrap();
        folder.write("c/y", b"").unwrap();
        assert!(folder.read("c/y").is_ok() && folder.read("c").is_err());
        assert_eq!(folder.read("z").unwrap_err().kind(), ErrorKind::NotFound);
        assert_eq!(fs::read_dir(folder.path().join("c")).unwrap().count(), 1);
    }

    #[test]
    fn only_files_that_fathom_wrote_are_replaced() {
        let place = tempfile::tempdir().unwrap();
        let folder = Dir::open(place.path()).unwrap();
        let page = b"<!DOCTYPE html><title>fathom on a GPU</title>";
        for (old, new, is_own) in [
            (&b"<!DOCTYPE html><title>fathom: history</title>"[..], &page[..], true),
            (b"", page, true),
            (b"<!DOCTYPE html><title>My pool</title>", page, false),
            (b"\x89PNG old", b"\x89PNG new", true),
            (b"notes", b"\x89PNG new", false),
            (b"a", b"experiment,cell", false),
        ] {
            folder.write("x", old).unwrap();
            let written = folder.write_own("x", new);
            assert_eq!(written.is_ok(), is_own, "{written:?}");
            assert_eq!(folder.bytes("x", 99).unwrap(), if is_own { new } else { old });
        }
        folder.write_own("y", page).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn links_pipes_folders_and_paths_out_of_the_folder_are_refused_and_stay() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let place = tempfile::tempdir().unwrap();
        let precious = place.path().join("precious");
        fs::create_dir(&precious).unwrap();
        fs::write(precious.join("a"), "keep").unwrap();
        let folder = Dir::make(&place.path().join("own")).unwrap();
        folder.write("own", b"own").unwrap();
        let links = [
            (precious.join("a"), "link"),
            (precious.clone(), "linked"),
            ("nowhere".into(), "dangling"),
            ("own".into(), "inner"),
        ];
        for (to, name) in links {
            symlink(to, folder.path().join(name)).unwrap();
        }
        folder.make_beneath("folder").unwrap();
        let made = std::process::Command::new("mkfifo").arg(folder.path().join("pipe")).status();
        assert!(made.unwrap().success());
        let absolute = precious.join("a").display().to_string();
        for (name, what) in [
            ("link", "a symbolic link"),
            ("dangling", "a symbolic link"),
            ("inner", "a symbolic link"),
            ("linked/a", "a symbolic link"),
            ("linked/new", "a symbolic link"),
            ("folder", "a folder"),
            ("pipe", "a pipe"),
            ("own/x", "a file"),
            ("../precious/a", "no path within"),
            (&absolute, "no path within"),
            ("", "no path within"),
        ] {
            let tried = [
                folder.read(name).map(drop),
                folder.append(name).map(drop),
                folder.write(name, b"lost"),
            ];
            for result in tried {
                let message = result.unwrap_err().to_string();
                assert!(message.contains(what), "{name}: {message}");
            }
        }
        assert!(folder.make_beneath("linked").is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 7);
        assert_eq!(fs::read_dir(&precious).unwrap().count(), 1);
        // The folder that the user names may be a link.
        let linked = Dir::open(&folder.path().join("linked")).unwrap();
        assert_eq!(linked.bytes("a", 9).unwrap(), b"keep");
        // What is written can be read by whom any new file can.
        let usual = place.path().join("usual");
        fs::write(&usual, "").unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&folder.path().join("own")), mode(&usual));
    }
}

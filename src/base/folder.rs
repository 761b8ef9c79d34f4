//! What lies in a folder that the user names. The folder itself may be a symbolic link: that is the user's choice. What lies
//! beneath it may come from anyone: there no link is followed, and only regular files are read and written.
//!
//! A file is written under no name or a random one and moved to its place when it is whole. If something else than a regular
//! file stands there (a link, pipe, device or folder), that is refused and stays as it is.

use std::fs::{File, FileType, Metadata, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Component, Path, PathBuf};

use crate::input::{self, Limited};

/// A folder that is there. Names of files are paths beneath it.
#[derive(Clone, Debug)]
pub struct Folder {
    path: PathBuf,
}

/// The folder of a path's last part, and that part.
pub fn of(path: &Path) -> io::Result<(Folder, &Path)> {
    let name = path.file_name().ok_or_else(|| outside(path))?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    Ok((Folder::open(folder.unwrap_or(Path::new(".")))?, Path::new(name)))
}

/// Writes a file that the user names; see [`Folder::write`].
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (folder, name) = of(path)?;
    folder.write(name, bytes)
}

/// The bytes of a file that lies beneath its folder, decompressed as [`input::unpacked`] does.
pub fn unpacked(path: &Path, limit: u64) -> io::Result<Box<dyn Read>> {
    let (folder, name) = of(path)?;
    input::unpack(folder.read(name)?, limit)
}

/// Something has this name, if only a link that leads nowhere.
pub fn is_there(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok()
}

impl Folder {
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

    /// A folder beneath, which is made where it is not there.
    pub fn make_beneath(&self, name: impl AsRef<Path>) -> io::Result<Self> {
        let path = self.descend(name.as_ref(), |path| match std::fs::create_dir(path) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(error),
            _ => Ok(()),
        })?;
        Ok(Self { path })
    }

    /// The path of a folder beneath. None of its parts is a link.
    fn descend(
        &self,
        name: &Path,
        before: impl Fn(&Path) -> io::Result<()>,
    ) -> io::Result<PathBuf> {
        let mut path = self.path.clone();
        for part in name.components() {
            let Component::Normal(part) = part else {
                return Err(outside(name));
            };
            path.push(part);
            before(&path)?;
            let kind = path.symlink_metadata()?.file_type();
            if !kind.is_dir() {
                return Err(refusal(Path::new(part), &format!("is {} and no folder", told(kind))));
            }
        }
        Ok(path)
    }

    /// The path of a name whose folder is no link.
    fn place(&self, name: &Path) -> io::Result<PathBuf> {
        let Some(Component::Normal(last)) = name.components().next_back() else {
            return Err(outside(name));
        };
        Ok(self.descend(name.parent().unwrap_or(Path::new("")), |_| Ok(()))?.join(last))
    }

    /// Of what has this name, a link not followed.
    pub fn metadata(&self, name: impl AsRef<Path>) -> io::Result<Metadata> {
        self.place(name.as_ref())?.symlink_metadata()
    }

    /// A regular file has this name.
    pub fn has_file(&self, name: impl AsRef<Path>) -> bool {
        self.metadata(name).is_ok_and(|found| found.is_file())
    }

    /// An open file is the one that has this name. Elsewhere than on Unix any regular file passes.
    pub fn has(&self, name: impl AsRef<Path>, file: &File) -> bool {
        let Ok(found) = self.metadata(name) else { return false };
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let id = |of: &Metadata| (of.dev(), of.ino());
            file.metadata().is_ok_and(|own| id(&own) == id(&found))
        }
        #[cfg(not(unix))]
        {
            let _ = file;
            found.is_file()
        }
    }

    /// Opens a regular file, without waiting for the other end of a pipe.
    fn open_file(&self, name: &Path, options: &mut OpenOptions) -> io::Result<File> {
        let path = self.place(name)?;
        // Asked before it is opened, because opening a device can act on it, and again of what was opened.
        refuse_other(&path, name)?;
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::custom_flags(
            options,
            libc::O_NOFOLLOW | libc::O_NONBLOCK,
        );
        let file = options.open(path)?;
        if file.metadata()?.is_file() {
            return Ok(file);
        }
        Err(refusal(name, "is no regular file"))
    }

    /// Opens a file to read it.
    pub fn read(&self, name: impl AsRef<Path>) -> io::Result<File> {
        self.open_file(name.as_ref(), OpenOptions::new().read(true))
    }

    /// Opens a file to read it and to add to its end. It is made where it is not there.
    pub fn append(&self, name: impl AsRef<Path>) -> io::Result<File> {
        self.open_file(name.as_ref(), OpenOptions::new().read(true).append(true).create(true))
    }

    /// Makes a file of a name that nothing has.
    pub fn create_new(&self, name: impl AsRef<Path>) -> io::Result<File> {
        File::create_new(self.place(name.as_ref())?)
    }

    /// Its bytes, to be read one after the other, no more than `limit`.
    pub fn plain(&self, name: impl AsRef<Path>, limit: u64) -> io::Result<Limited<File>> {
        Limited::of_file(self.read(name)?, limit)
    }

    /// Its bytes, no more than `limit`.
    pub fn bytes(&self, name: impl AsRef<Path>, limit: u64) -> io::Result<Vec<u8>> {
        self.plain(name, limit)?.bytes()
    }

    /// Writes a file, replacing one of that name, all or nothing.
    pub fn write(&self, name: impl AsRef<Path>, bytes: &[u8]) -> io::Result<()> {
        self.write_with(name, |file| file.write_all(bytes))
    }

    /// The same, with what `write` writes.
    pub fn write_with<E: From<io::Error>>(
        &self,
        name: impl AsRef<Path>,
        write: impl FnOnce(&mut File) -> Result<(), E>,
    ) -> Result<(), E> {
        let path = self.place(name.as_ref())?;
        refuse_other(&path, name.as_ref())?;
        let mut fresh = tempfile::Builder::new();
        // Those of any new file, in place of the private ones of temporary files.
        #[cfg(unix)]
        fresh.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = fresh.tempfile_in(path.parent().unwrap_or(&self.path))?;
        write(file.as_file_mut())?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    }

    /// Writes a file of no name to the disk and lets go of it.
    pub fn try_writing(&self, bytes: &[u8]) -> io::Result<()> {
        let mut file = tempfile::tempfile_in(&self.path)?;
        file.write_all(bytes)?;
        file.sync_all()
    }

    /// Removes a file, or a link itself.
    pub fn remove(&self, name: impl AsRef<Path>) -> io::Result<()> {
        std::fs::remove_file(self.place(name.as_ref())?)
    }
}

/// An error where something else than a regular file is there.
fn refuse_other(path: &Path, name: &Path) -> io::Result<()> {
    match path.symlink_metadata() {
        Ok(found) if !found.is_file() => {
            Err(refusal(name, &format!("is {}", told(found.file_type()))))
        }
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

fn told(kind: FileType) -> &'static str {
    if kind.is_symlink() {
        "a symbolic link"
    } else if kind.is_dir() {
        "a folder"
    } else if kind.is_file() {
        "a file"
    } else {
        "a pipe or a device"
    }
}

fn outside(name: &Path) -> io::Error {
    let message = format!("`{}` is no path within its folder", name.display());
    io::Error::new(ErrorKind::InvalidInput, message)
}

fn refusal(name: &Path, what: &str) -> io::Error {
    let message = format!("`{}` {what}; only regular files are read and replaced", name.display());
    io::Error::new(ErrorKind::InvalidInput, message)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::sync::mpsc;
    use std::time::Duration;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().flatten();
        let mut names: Vec<String> =
            entries.map(|entry| entry.file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_whole_or_stays() {
        let place = tempfile::tempdir().unwrap();
        let folder = Folder::make(&place.path().join("a/b")).unwrap();
        folder.write("x", b"one").unwrap();
        let failed = folder.write_with("x", |file| {
            file.write_all(b"tw")?;
            Err(io::Error::other("disk full"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "disk full");
        assert_eq!(folder.bytes("x", 3).unwrap(), b"one");
        folder.write("x", b"three").unwrap();
        assert_eq!(folder.bytes("x", 5).unwrap(), b"three");
        assert_eq!(folder.bytes("x", 4).unwrap_err().kind(), ErrorKind::FileTooLarge);
        assert_eq!(names(folder.path()), ["x"]);
        assert_eq!(folder.create_new("x").unwrap_err().kind(), ErrorKind::AlreadyExists);
        folder.append("x").unwrap().write_all(b"+").unwrap();
        assert_eq!(folder.bytes("x", 9).unwrap(), b"three+");
        folder.make_beneath("c/d").unwrap().write("y", b"").unwrap();
        assert!(folder.has_file("c/d/y") && !folder.has_file("c/d") && !folder.has_file("z"));
        folder.remove("c/d/y").unwrap();
        assert!(!folder.has_file("c/d/y"));
    }

    #[test]
    fn no_name_leads_out_of_the_folder() {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("secret"), "keep").unwrap();
        let folder = Folder::make(&place.path().join("own")).unwrap();
        let absolute = place.path().join("secret");
        for name in [Path::new("../secret"), &absolute, Path::new(""), Path::new("..")] {
            assert!(folder.read(name).is_err(), "{name:?}");
            assert!(folder.write(name, b"lost").is_err(), "{name:?}");
            assert!(folder.append(name).is_err(), "{name:?}");
            assert!(folder.remove(name).is_err(), "{name:?}");
        }
        assert_eq!(fs::read_to_string(absolute).unwrap(), "keep");
    }

    #[cfg(unix)]
    #[test]
    fn links_pipes_and_folders_are_refused_and_stay() {
        let place = tempfile::tempdir().unwrap();
        let precious = place.path().join("precious");
        fs::create_dir(&precious).unwrap();
        fs::write(precious.join("a"), "keep").unwrap();
        let folder = Folder::make(&place.path().join("own")).unwrap();
        let link = |to: &Path, name: &str| {
            std::os::unix::fs::symlink(to, folder.path().join(name)).unwrap();
        };
        link(&precious.join("a"), "link");
        link(&precious, "linked");
        link(Path::new("nowhere"), "dangling");
        // A link to a file of the folder itself is none the less a link.
        folder.write("own", b"own").unwrap();
        link(Path::new("own"), "inner");
        fs::create_dir(folder.path().join("folder")).unwrap();
        let made = std::process::Command::new("mkfifo").arg(folder.path().join("pipe")).status();
        assert!(made.unwrap().success());
        let before = names(folder.path());
        for (name, what) in [
            ("link", "a symbolic link"),
            ("dangling", "a symbolic link"),
            ("inner", "a symbolic link"),
            ("linked/a", "a symbolic link"),
            ("linked/new", "a symbolic link"),
            ("folder", "a folder"),
            ("pipe", "a pipe"),
            ("own/x", "a file"),
        ] {
            let (path, (done, tried)) = (folder.path().to_owned(), mpsc::channel());
            std::thread::spawn(move || {
                let folder = Folder::open(&path).unwrap();
                let tried = [
                    folder.read(name).map(drop),
                    folder.append(name).map(drop),
                    folder.write(name, b"lost"),
                ];
                done.send(tried)
            });
            // Far longer than it takes: only a hang ends so.
            let tried = tried.recv_timeout(Duration::from_secs(300)).expect(name);
            for result in tried {
                let told = result.unwrap_err().to_string();
                assert!(told.contains(what), "{name}: {told}");
            }
            assert!(!folder.has_file(name), "{name}");
        }
        assert!(folder.make_beneath("linked/new").is_err());
        assert_eq!(names(folder.path()), before);
        assert_eq!(names(&precious), ["a"]);
        assert_eq!(fs::read_to_string(precious.join("a")).unwrap(), "keep");
        // The folder that the user names may be a link.
        let linked = Folder::open(&folder.path().join("linked")).unwrap();
        assert_eq!(linked.bytes("a", 9).unwrap(), b"keep");
        folder.remove("link").unwrap();
        assert!(precious.join("a").exists());
    }

    #[cfg(unix)]
    #[test]
    fn what_is_written_can_be_read_by_whom_any_new_file_can() {
        use std::os::unix::fs::PermissionsExt;
        let place = tempfile::tempdir().unwrap();
        let usual = place.path().join("usual");
        fs::write(&usual, "").unwrap();
        let folder = Folder::open(place.path()).unwrap();
        folder.write("own", b"").unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&place.path().join("own")), mode(&usual));
    }
}

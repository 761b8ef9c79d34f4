//! Files in a folder that a user names. A file is written beside its place and moved there when it is whole.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Component, Path, PathBuf};

use crate::input;

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

/// Writes a file that the user names; see [`Dir::write`].
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (folder, name) = open_parent(path)?;
    folder.write(name, bytes)
}

/// Something has this name, if only a link that leads nowhere.
pub fn is_there(path: &Path) -> bool {
    path.symlink_metadata().is_ok()
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

    /// Records name pictures, and anyone may have written them.
    fn place(&self, name: &Path) -> io::Result<PathBuf> {
        let mut parts = name.components();
        let is_within = parts.clone().all(|part| matches!(part, Component::Normal(_)));
        let is_within = is_within && parts.next().is_some();
        if is_within { Ok(self.path.join(name)) } else { Err(outside(name)) }
    }

    /// A regular file has this name.
    pub fn has_file(&self, name: impl AsRef<Path>) -> bool {
        self.place(name.as_ref()).is_ok_and(|path| path.is_file())
    }

    pub fn read(&self, name: impl AsRef<Path>) -> io::Result<File> {
        input::open(&self.place(name.as_ref())?)
    }

    /// Opens a file to read it and to add to its end. It is made where it is not there.
    pub fn append(&self, name: impl AsRef<Path>) -> io::Result<File> {
        OpenOptions::new().read(true).append(true).create(true).open(self.place(name.as_ref())?)
    }

    /// Its bytes, no more than `limit`.
    pub fn bytes(&self, name: impl AsRef<Path>, limit: u64) -> io::Result<Vec<u8>> {
        input::limited(self.read(name)?, limit)?.bytes()
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
        assert!(folder.has_file("x") && !folder.has_file("z"));
        for name in ["../a", "/etc/hosts", ""] {
            assert!(!folder.has_file(name) && folder.write(name, b"").is_err(), "{name}");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn what_is_written_can_be_read_by_whom_any_new_file_can() {
        use std::os::unix::fs::PermissionsExt;
        let place = tempfile::tempdir().unwrap();
        Dir::open(place.path()).unwrap().write("own", b"own").unwrap();
        fs::write(place.path().join("usual"), "").unwrap();
        let mode = |name| place.path().join(name).metadata().unwrap().permissions().mode();
        assert_eq!(mode("own"), mode("usual"));
    }
}

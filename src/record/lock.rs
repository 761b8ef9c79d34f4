//! One process at a time writes to a folder.

use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use fathom_base::folder::{self, Dir};

use super::calendar;

/// Name of the locked file. The system releases the lock when its process ends, however that ends, so a file that a killed
/// process left behind does not block others.
pub const LOCK: &str = ".lock";
/// Bytes read of what a holder says of itself.
const MAX_HOLDER_BYTES: u64 = 1_000;

#[derive(Debug, thiserror::Error)]
pub enum LockError {
    #[error("{} is in use by {holder}: wait until that ends, or choose another folder", folder.display())]
    InUse { folder: PathBuf, holder: String },
    #[error("cannot write to {}: {source}; choose another folder", folder.display())]
    Unwritable { folder: PathBuf, source: io::Error },
}

/// The right to write to a folder, until this is dropped. Every command that writes a folder holds it.
#[derive(Debug)]
pub struct FolderLock {
    file: File,
    folder: PathBuf,
    /// The folder was made for this lock. It goes with it, if nothing was written.
    made_folder: bool,
}

impl FolderLock {
    /// Takes the lock of a folder, which is made if it is not there. Another process is told who holds it.
    pub fn take(path: &Path) -> Result<Self, LockError> {
        let unwritable = |source| LockError::Unwritable { folder: path.to_owned(), source };
        let made_folder = !folder::is_there(path);
        let mut file =
            Dir::make(path).and_then(|folder| folder.append(LOCK)).map_err(unwritable)?;
        match file.try_lock() {
            // Its last holder removed the file after it was opened here.
            Ok(()) if !folder::is_there(&path.join(LOCK)) => {}
            Ok(()) => {
                let written = file.set_len(0).and_then(|()| file.write_all(holder().as_bytes()));
                written.map_err(unwritable)?;
                return Ok(Self { file, folder: path.to_owned(), made_folder });
            }
            Err(TryLockError::WouldBlock) => {}
            Err(TryLockError::Error(source)) => return Err(unwritable(source)),
        }
        Err(LockError::InUse { folder: path.to_owned(), holder: read_holder(&file) })
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // What stays behind does not block others.
        let _ = fs::remove_file(self.folder.join(LOCK));
        if self.made_folder {
            // Fails if anything was written.
            let _ = fs::remove_dir(&self.folder);
        }
        let _ = self.file.unlock();
    }
}

/// What this process says of itself to another that wants the same folder. Of its command line only the command: the rest may
/// hold secrets.
fn holder() -> String {
    let mut words = std::env::args().skip(1);
    let command = words.find(|word| !word.starts_with('-')).unwrap_or_default();
    format!("process {} (`fathom {command}`, since {})", std::process::id(), calendar::now())
}

/// One line. On some systems only its holder can read a locked file.
fn read_holder(file: &File) -> String {
    let mut text = Vec::new();
    let _ = file.take(MAX_HOLDER_BYTES).read_to_end(&mut text);
    let text = String::from_utf8_lossy(&text).replace(char::is_control, "");
    if text.is_empty() { "another process".to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_holder_is_refused_and_told_of_the_first_until_that_ends() {
        let folder = tempfile::tempdir().unwrap();
        // Of a process that was killed.
        fs::write(folder.path().join(LOCK), format!("process 0 {}", "x".repeat(5_000))).unwrap();
        let first = FolderLock::take(folder.path()).unwrap();
        let message = FolderLock::take(folder.path()).unwrap_err().to_string();
        let me = format!("in use by process {} (`fathom ", std::process::id());
        assert!(message.contains(&me) && message.contains("): wait until"), "{message}");
        drop(first);
        FolderLock::take(folder.path()).unwrap();
    }

    #[test]
    fn a_folder_made_for_the_lock_goes_with_it_unless_it_was_used() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("new");
        drop(FolderLock::take(&folder).unwrap());
        assert!(!folder.exists());
        let lock = FolderLock::take(&folder).unwrap();
        fs::write(folder.join("kept"), "").unwrap();
        drop(lock);
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "only the lock goes");
        let message = FolderLock::take(&folder.join("kept")).unwrap_err().to_string();
        assert!(message.starts_with("cannot write to "), "{message}");
    }
}

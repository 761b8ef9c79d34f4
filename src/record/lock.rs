//! One process at a time writes to a folder.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use fathom_base::folder::{self, Folder};

/// Name of the locked file. The system releases the lock when its process ends, however that ends, so a file that a killed
/// process left behind blocks nobody.
pub const LOCK: &str = ".lock";
/// Bytes read of what a holder says of itself.
const MAX_HOLDER_BYTES: u64 = 1_000;
/// Tries to take a lock, and the time between two: 10 s, in which a holder on a busy machine tells its name.
const MAX_TRIES: usize = 500;
const BETWEEN_TRIES: Duration = Duration::from_millis(20);

#[derive(Debug, thiserror::Error)]
pub enum LockError {
    #[error(
        "{} is in use by {holder}: wait until that ends, or choose another folder with --out",
        folder.display()
    )]
    InUse { folder: PathBuf, holder: String },
    #[error("cannot write to {}: {source}; choose another folder with --out", folder.display())]
    Unwritable { folder: PathBuf, source: io::Error },
}

/// The right to write to a folder, until this is dropped.
#[derive(Debug)]
pub struct FolderLock {
    file: File,
    folder: Folder,
    /// The folder was made for this lock. It goes with it, if nothing was written.
    made_folder: bool,
}

impl FolderLock {
    /// Takes the lock of a folder, which is made if it is not there. `holder` tells another process who holds it.
    ///
    /// A holder may be about to let go of it, or have told nothing yet but what its killed predecessor told. So it is
    /// tried again until two tries find the same holder, which has not ended.
    pub fn take(path: &Path, holder: &str) -> Result<Self, LockError> {
        let unwritable = |source| LockError::Unwritable { folder: path.to_owned(), source };
        let (mut other, mut failure) = (String::new(), None);
        for _ in 0..MAX_TRIES {
            match Self::attempt(path, holder) {
                Ok(Ok(lock)) => return Ok(lock),
                Ok(Err(now)) => {
                    failure = None;
                    let before = std::mem::replace(&mut other, now);
                    if !other.is_empty() && other == before && !has_ended(&other) {
                        break;
                    }
                    std::thread::sleep(BETWEEN_TRIES);
                }
                // As when the last holder removes the file or the folder at this moment.
                Err(error)
                    if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::AlreadyExists) =>
                {
                    failure = Some(error);
                }
                Err(error) => return Err(unwritable(error)),
            }
        }
        if let Some(error) = failure {
            return Err(unwritable(error));
        }
        let holder = if other.is_empty() { "another process".to_owned() } else { other };
        Err(LockError::InUse { folder: path.to_owned(), holder })
    }

    /// The lock, or what its holder says of itself.
    fn attempt(path: &Path, holder: &str) -> io::Result<Result<Self, String>> {
        let made_folder = !folder::is_there(path);
        // Opened anew by each try: another may have made the folder again that the last holder removed.
        let folder = Folder::make(path)?;
        let mut file = folder.append(LOCK)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Ok(Err(read_holder(&folder))),
            Err(TryLockError::Error(source)) => return Err(source),
        }
        // Its last holder may have removed the file after it was opened here: then the lock is that of no name.
        if !folder.has(LOCK, &file) {
            return Err(ErrorKind::NotFound.into());
        }
        file.set_len(0)?;
        file.write_all(holder.as_bytes())?;
        Ok(Ok(Self { file, folder, made_folder }))
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // What stays behind blocks nobody. Elsewhere than on Unix it cannot be told whether a file still has its name.
        if cfg!(unix) {
            let _ = self.folder.remove(LOCK);
        }
        if self.made_folder {
            // Fails if anything was written.
            let _ = fs::remove_dir(self.folder.path());
        }
        let _ = self.file.unlock();
    }
}

/// One line; empty where nothing can be read. On some systems nobody but its holder reads a locked file.
fn read_holder(folder: &Folder) -> String {
    let mut text = Vec::new();
    let read =
        folder.read(LOCK).and_then(|file| file.take(MAX_HOLDER_BYTES).read_to_end(&mut text));
    match read {
        Ok(_) => String::from_utf8_lossy(&text).chars().filter(|c| !c.is_control()).collect(),
        Err(_) => String::new(),
    }
}

/// A holder that begins with `process` and a number is no process of this machine any more.
#[cfg(unix)]
fn has_ended(holder: &str) -> bool {
    use nix::{errno::Errno, sys::signal::kill, unistd::Pid};
    let number = holder.strip_prefix("process ").and_then(|rest| rest.split(' ').next());
    let id = number.and_then(|number| number.parse().ok()).filter(|id| *id > 0);
    id.is_some_and(|id| kill(Pid::from_raw(id), None) == Err(Errno::ESRCH))
}

#[cfg(not(unix))]
fn has_ended(_: &str) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_holder_is_refused_and_told_of_the_first() {
        let folder = tempfile::tempdir().unwrap();
        let first = FolderLock::take(folder.path(), "process 1 (`fathom run`)").unwrap();
        let error = FolderLock::take(folder.path(), "process 2").unwrap_err();
        let told = error.to_string();
        assert!(told.contains("in use by process 1 (`fathom run`)"), "{told}");
        assert_eq!(told.lines().count(), 1);
        drop(first);
        FolderLock::take(folder.path(), "process 2").unwrap();
    }

    #[test]
    fn what_a_killed_process_left_behind_does_not_block() {
        let folder = tempfile::tempdir().unwrap();
        let long = format!("process 1 {}", "x".repeat(5_000));
        fs::write(folder.path().join(LOCK), long).unwrap();
        let held = FolderLock::take(folder.path(), "process 2").unwrap();
        let error = FolderLock::take(folder.path(), "process 3").unwrap_err();
        assert!(error.to_string().contains("process 2:"), "{error}");
        drop(held);
    }

    #[test]
    fn a_folder_made_for_the_lock_goes_with_it_unless_it_was_used() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("new");
        drop(FolderLock::take(&folder, "me").unwrap());
        assert!(!folder.exists());
        let held = FolderLock::take(&folder, "me").unwrap();
        fs::write(folder.join("kept"), "").unwrap();
        drop(held);
        let names: Vec<_> = fs::read_dir(&folder).unwrap().flatten().collect();
        assert_eq!(names.len(), 1, "only the lock goes");
    }

    #[test]
    fn of_many_that_try_at_once_one_holds_it_and_no_other_fault_comes_of_it() {
        use std::sync::atomic::{AtomicUsize, Ordering};

        let parent = tempfile::tempdir().unwrap();
        // It goes and comes with its holders.
        let folder = parent.path().join("new");
        let (inside, entered) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        match FolderLock::take(&folder, "one of many") {
                            Ok(held) => {
                                assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                                entered.fetch_add(1, Ordering::SeqCst);
                                inside.fetch_sub(1, Ordering::SeqCst);
                                drop(held);
                            }
                            Err(LockError::InUse { .. }) => {}
                            Err(error) => panic!("{error}"),
                        }
                    }
                });
            }
        });
        assert!(entered.into_inner() > 0);
    }

    #[cfg(unix)]
    #[test]
    fn a_killed_predecessor_is_known_by_its_number() {
        let mut ended = std::process::Command::new("true").spawn().unwrap();
        ended.wait().unwrap();
        assert!(has_ended(&format!("process {} (`fathom run`, since 2026)", ended.id())));
        assert!(!has_ended(&format!("process {} (`fathom run`)", std::process::id())));
        for nobody in ["", "process", "process x", "process -1 (`a`)", "somebody else"] {
            assert!(!has_ended(nobody), "{nobody}");
        }
    }
}

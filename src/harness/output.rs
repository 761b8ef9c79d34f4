//! The folder that a run writes to.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use thiserror::Error;

use super::calendar;
use crate::record;
use crate::report::PICTURES;

/// Where runs go that are not told where.
pub const DEFAULT_FOLDER: &str = "reports/out";
/// Name of the records' file in a run's folder.
pub const RECORDS: &str = "records.jsonl";
/// Bytes written to see whether the folder takes any: more than a cell's record.
const PROBE_BYTES: usize = 1 << 20;

#[derive(Debug, Error)]
pub enum OutputError {
    #[error("cannot write to {}: {source}; choose another folder with --out", path.display())]
    Unwritable {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error(
        "{} holds records already: continue them with --resume, or choose another folder with --out",
        path.display()
    )]
    Occupied { path: PathBuf },
    #[error("no run to resume under {}: name its folder with --out", path.display())]
    NothingToResume { path: PathBuf },
}

/// A folder that takes files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Output {
    pub folder: PathBuf,
}

impl Output {
    /// Makes the folder and tries that it can be written to, before anything is measured. Without
    /// `asked` a new folder under [`DEFAULT_FOLDER`] is named after the adapter, the profile and the time.
    pub fn create(asked: Option<&Path>, adapter: &str, profile: &str) -> Result<Self, OutputError> {
        let folder = asked.map_or_else(|| fresh(adapter, profile), Path::to_owned);
        if folder.join(RECORDS).exists() {
            return Err(OutputError::Occupied { path: folder });
        }
        Self::open(folder)
    }

    /// The folder of the run to resume: `asked`, or the latest under [`DEFAULT_FOLDER`].
    pub fn resume(asked: Option<&Path>) -> Result<Self, OutputError> {
        let default = Path::new(DEFAULT_FOLDER);
        let folder = asked.map(Path::to_owned).or_else(|| latest(default));
        Self::open(folder.ok_or_else(|| OutputError::NothingToResume {
            path: default.to_owned(),
        })?)
    }

    fn open(folder: PathBuf) -> Result<Self, OutputError> {
        probe(&folder).map_err(|source| OutputError::Unwritable {
            path: folder.clone(),
            source,
        })?;
        Ok(Self { folder })
    }

    pub fn records(&self) -> PathBuf {
        self.folder.join(RECORDS)
    }

    pub fn pictures(&self) -> PathBuf {
        self.folder.join(PICTURES)
    }
}

/// Writes a file the size of several records and removes it again.
fn probe(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder.join(PICTURES))?;
    let path = folder.join(".probe");
    let written = std::fs::File::create(&path).and_then(|mut file| {
        std::io::Write::write_all(&mut file, &vec![0; PROBE_BYTES])?;
        file.sync_all()
    });
    let removed = std::fs::remove_file(&path);
    written.and(removed)
}

fn fresh(adapter: &str, profile: &str) -> PathBuf {
    let word = |c: char| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            ' '
        }
    };
    let plain: String = adapter.chars().map(word).collect();
    let words: Vec<&str> = plain.split_whitespace().take(3).collect();
    let time = calendar::compact(SystemTime::now());
    Path::new(DEFAULT_FOLDER).join(format!("{}-{profile}-{time}", words.join("-")))
}

/// The folder whose records were changed last.
fn latest(parent: &Path) -> Option<PathBuf> {
    let folders = std::fs::read_dir(parent)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path()));
    let changed = |folder: &PathBuf| {
        std::fs::metadata(folder.join(RECORDS))
            .and_then(|records| records.modified())
            .ok()
    };
    folders
        .filter_map(|folder| Some((changed(&folder)?, folder)))
        .max()
        .map(|(_, folder)| folder)
}

/// The records of a folder; none where it has no such file.
pub fn read(output: &Output) -> Result<record::Reading, record::RecordError> {
    match output.records().exists() {
        true => record::read(&output.records()),
        false => Ok(record::Reading::default()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_with_records_is_only_resumed() {
        let folder = tempfile::tempdir().unwrap();
        let output = Output::create(Some(folder.path()), "gpu", "quick").unwrap();
        assert!(read(&output).unwrap().records.is_empty());
        std::fs::write(output.records(), "").unwrap();
        let error = Output::create(Some(folder.path()), "gpu", "quick").unwrap_err();
        assert!(error.to_string().contains("--resume"), "{error}");
        assert_eq!(Output::resume(Some(folder.path())).unwrap(), output);
    }

    #[test]
    fn a_file_in_the_way_is_one_clear_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("taken");
        std::fs::write(&file, "").unwrap();
        let error = Output::create(Some(&file), "gpu", "quick")
            .unwrap_err()
            .to_string();
        assert!(error.starts_with("cannot write to "), "{error}");
        assert_eq!(error.lines().count(), 1);
    }

    #[test]
    fn the_latest_run_is_the_one_to_resume() {
        let parent = tempfile::tempdir().unwrap();
        assert_eq!(latest(parent.path()), None);
        for name in ["b", "a", "empty"] {
            std::fs::create_dir(parent.path().join(name)).unwrap();
        }
        std::fs::write(parent.path().join("b").join(RECORDS), "").unwrap();
        std::thread::sleep(std::time::Duration::from_millis(20));
        std::fs::write(parent.path().join("a").join(RECORDS), "").unwrap();
        assert_eq!(latest(parent.path()), Some(parent.path().join("a")));
    }

    #[test]
    fn fresh_folders_bear_adapter_and_profile() {
        let name = fresh("llvmpipe (LLVM 15.0.6, 256 bits)", "quick");
        let name = name.file_name().unwrap().to_string_lossy().into_owned();
        assert!(name.starts_with("llvmpipe-llvm-15-quick-2"), "{name}");
    }
}

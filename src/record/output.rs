//! The folder that a run or a comparison writes to.

use std::path::{Path, PathBuf};

use itertools::Itertools;
use thiserror::Error;

use super::calendar;
use crate as record;
use crate::{
    Compared, FolderLock, LockError, PictureKind, Profile, Record, RecordError, RecordFile, Writer,
};
use fathom_base::folder::{self, Dir};
use fathom_base::text;

/// Default folders of runs: in a checkout of fathom, and elsewhere.
const IN_CHECKOUT: &str = "reports/out";
const ELSEWHERE: &str = "fathom-runs";
/// Name of the records' file in the folder of a run or a comparison.
pub const RECORDS: &str = "records.jsonl";
/// Name of the folder of pictures, in a run's folder.
pub const PICTURES: &str = "renders";

#[derive(Debug, Error)]
pub enum OutputError {
    #[error(transparent)]
    Lock(#[from] LockError),
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error("cannot write to {}: {source}; choose another folder with --out", path.display())]
    Unwritable { path: PathBuf, source: std::io::Error },
    #[error(
        "{} holds records already: continue them with --resume, or choose another folder with --out",
        path.display()
    )]
    Occupied { path: PathBuf },
    #[error("no {kind} to resume in {}: name its folder with --out", path.display())]
    NothingToResume { kind: FolderKind, path: PathBuf },
    #[error("{} holds no {kind} but other records: choose another folder with --out", path.display())]
    OtherKind { kind: FolderKind, path: PathBuf },
    #[error("{} has no readable header, so its other records cannot be interpreted", path.display())]
    NoHeader { path: PathBuf },
    #[error(
        "{} is compressed and only read: unpack it with gunzip, or choose another folder with --out",
        path.display()
    )]
    Packed { path: PathBuf },
}

/// What was measured into a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum FolderKind {
    Run,
    Comparison,
}

impl FolderKind {
    fn from_record(record: &Record) -> Self {
        match record {
            Record::Comparison(_) => Self::Comparison,
            Record::Run(_)
            | Record::Experiment(_)
            | Record::Cell(_)
            | Record::Begun(_)
            | Record::End(_) => Self::Run,
        }
    }

    /// Refuses records that this cannot be continued with.
    fn check(self, path: &Path, read: &RecordFile) -> Result<(), OutputError> {
        record::empty_or_sound(path, read)?;
        let path = path.to_owned();
        if read.records.iter().any(|record| Self::from_record(record) != self) {
            return Err(OutputError::OtherKind { kind: self, path });
        }
        let header = |record: &Record| matches!(record, Record::Comparison(Compared::Header(_)));
        if self == Self::Comparison && !read.records.is_empty() && !read.records.iter().any(header)
        {
            return Err(OutputError::NoHeader { path });
        }
        Ok(())
    }
}

/// The folder of a run or a comparison, and its files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputFolder {
    pub folder: PathBuf,
}

impl OutputFolder {
    pub fn records(&self) -> PathBuf {
        self.folder.join(RECORDS)
    }

    /// It holds something that was measured.
    fn is_occupied(&self) -> bool {
        let path = record::stored(&self.records());
        path.symlink_metadata().is_ok_and(|file| file.len() > 0)
    }
}

/// A folder that no other process writes to while this is held. Nothing is written yet, and where nothing will be, a new folder goes.
#[derive(Debug)]
pub struct LockedFolder {
    output: OutputFolder,
    lock: FolderLock,
}

impl LockedFolder {
    /// Takes a folder that holds nothing that was measured.
    pub fn lock_free(folder: &Path) -> Result<Self, OutputError> {
        let locked = Self::take(folder)?;
        if locked.output.is_occupied() {
            return Err(OutputError::Occupied { path: folder.to_owned() });
        }
        Ok(locked)
    }

    /// Takes the folder that is asked for, else one in `default_folder` that is named after this and the time.
    pub fn lock_named(folder: Option<&Path>, name: &str) -> Result<Self, OutputError> {
        let fresh = || format!("{name}-{}", calendar::compact_now());
        let default = || default_folder(Path::new("")).join(fresh());
        Self::lock_free(&folder.map_or_else(default, Path::to_owned))
    }

    /// Takes a folder whose measurement is to be continued.
    pub fn lock_measured(folder: &Path, kind: FolderKind) -> Result<Self, OutputError> {
        let output = OutputFolder { folder: folder.to_owned() };
        if !folder::is_there(&output.records()) && !output.is_occupied() {
            return Err(OutputError::NothingToResume { kind, path: output.folder });
        }
        Self::take(folder)
    }

    fn take(folder: &Path) -> Result<Self, OutputError> {
        let output = OutputFolder { folder: folder.to_owned() };
        let path = record::stored(&output.records());
        if path != output.records() {
            return Err(OutputError::Packed { path });
        }
        Ok(Self { lock: FolderLock::take(folder)?, output })
    }

    /// Opens the records.
    pub fn open(self, kind: FolderKind) -> Result<Recording, OutputError> {
        let path = self.output.records();
        let (writer, read) = Writer::open(&path, |read| kind.check(&path, read))?;
        let damage = read.damaged.notice(&path);
        Ok(Recording { output: self.output, writer, before: read.records, damage, lock: self.lock })
    }

    pub fn folder(&self) -> &Path {
        &self.output.folder
    }
}

/// The folder of a run or a comparison, with its records open to be continued.
#[derive(Debug)]
pub struct Recording {
    pub output: OutputFolder,
    pub writer: Writer,
    /// Records that were there.
    pub before: Vec<Record>,
    /// Damage that was found in them.
    pub damage: Option<String>,
    pub lock: FolderLock,
}

/// Where runs that start in this folder go by default.
fn default_folder(current: &Path) -> PathBuf {
    let is_checkout = ["reports", "shaders"].iter().all(|name| current.join(name).is_dir());
    current.join(if is_checkout { IN_CHECKOUT } else { ELSEWHERE })
}

impl Recording {
    /// Makes the folder before anything is measured. Without
    /// `asked` a new folder under `default_folder` is named after the adapter, the profile and the time.
    pub fn create(
        asked: Option<&Path>,
        adapter: &str,
        profile: Profile,
    ) -> Result<Self, OutputError> {
        Self::open_run(LockedFolder::lock_named(asked, &name(adapter, profile))?)
    }

    /// The folder of the run to resume: `asked`, or the latest under `default_folder`.
    pub fn resume(asked: Option<&Path>) -> Result<Self, OutputError> {
        let path = default_folder(Path::new(""));
        let folder = asked.map(Path::to_owned).or_else(|| latest(&path));
        let nothing = || OutputError::NothingToResume { kind: FolderKind::Run, path };
        let folder = folder.ok_or_else(nothing)?;
        Self::open_run(LockedFolder::lock_measured(&folder, FolderKind::Run)?)
    }

    fn open_run(taken: LockedFolder) -> Result<Self, OutputError> {
        let path = taken.output.folder.clone();
        let made = Dir::make(&path).and_then(|folder| folder.make_beneath(PICTURES));
        made.map_err(|source| OutputError::Unwritable { path, source })?;
        taken.open(FolderKind::Run)
    }
}

/// Path within a run's folder of the picture of an experiment's cell, different for different cells. An id holds no `_` and no
/// file's stem ends in `~error`, so that no two are the same.
pub fn picture_path(experiment: &str, cell: &str, shows: PictureKind) -> String {
    let [experiment, cell] = [experiment, cell].map(text::file_stem);
    let ending = match shows {
        PictureKind::Image => "",
        PictureKind::Error => "~error",
    };
    format!("{PICTURES}/{experiment}_{cell}{ending}.png")
}

/// Beginning of the name of a run's folder.
fn name(adapter: &str, profile: Profile) -> String {
    let word = |c: char| {
        if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { ' ' }
    };
    let plain: String = adapter.chars().map(word).collect();
    let words: Vec<&str> = plain.split_whitespace().take(3).collect();
    format!("{}-{profile}", words.join("-"))
}

/// The folder of the run whose records were changed last.
fn latest(parent: &Path) -> Option<PathBuf> {
    let folders = std::fs::read_dir(parent).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let changed = |folder: &PathBuf| {
        std::fs::symlink_metadata(folder.join(RECORDS)).and_then(|records| records.modified()).ok()
    };
    let dated = folders.filter_map(|folder| Some((changed(&folder)?, folder)));
    let mut folders = dated.sorted().rev().map(|(_, folder)| folder);
    folders.find(|folder| !is_comparison(&folder.join(RECORDS)))
}

/// Records that can be read are those of a comparison.
fn is_comparison(path: &Path) -> bool {
    let first = |read: RecordFile| read.records.first().map(FolderKind::from_record);
    record::read(path).ok().and_then(first) == Some(FolderKind::Comparison)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LOCK;

    fn create(folder: &Path) -> Result<Recording, OutputError> {
        Recording::create(Some(folder), "gpu", Profile::Quick)
    }

    const END: &str = "{\"record\":\"end\",\"measuring_wall_s\":1.0,\"measured_gpu_s\":1.0,\"set_up_s\":1.0,\
        \"peak_memory_bytes\":null,\"interrupted\":false}\n";

    fn files(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap().flatten();
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).sorted().collect()
    }

    #[test]
    fn runs_outside_a_checkout_go_into_a_folder_of_their_own() {
        let folder = tempfile::tempdir().unwrap();
        let place =
            || default_folder(folder.path()).strip_prefix(folder.path()).unwrap().to_owned();
        for (made, expected) in
            [("scenes", ELSEWHERE), ("reports", ELSEWHERE), ("shaders", IN_CHECKOUT)]
        {
            std::fs::create_dir(folder.path().join(made)).unwrap();
            assert_eq!(place(), Path::new(expected), "{made}");
        }
    }

    #[test]
    fn a_folder_with_compressed_records_is_not_written_to() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("records.jsonl.gz"), "packed").unwrap();
        for refused in [create(folder.path()), Recording::resume(Some(folder.path()))] {
            let error = refused.unwrap_err().to_string();
            assert!(error.contains("records.jsonl.gz is compressed and only read"), "{error}");
        }
        assert_eq!(files(folder.path()), ["records.jsonl.gz"]);
    }

    #[test]
    fn a_folder_without_a_run_is_not_resumed_and_not_made() {
        let folder = tempfile::tempdir().unwrap();
        let typo = folder.path().join("typo");
        for path in [folder.path(), &typo] {
            let error = Recording::resume(Some(path)).unwrap_err();
            assert!(matches!(error, OutputError::NothingToResume { .. }), "{error}");
        }
        assert!(files(folder.path()).is_empty());
        // A run that was killed before its first record.
        drop(create(&typo).unwrap());
        Recording::resume(Some(&typo)).unwrap();
        create(&typo).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn a_run_neither_begins_nor_goes_on_over_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let precious = folder.path().join("precious");
        std::fs::create_dir(&precious).unwrap();
        std::fs::write(precious.join("a"), END).unwrap();
        for name in [RECORDS, "records.jsonl.gz", PICTURES, LOCK] {
            let out = folder.path().join(format!("out-{name}"));
            std::fs::create_dir(&out).unwrap();
            let target = if name == PICTURES { precious.clone() } else { precious.join("a") };
            std::os::unix::fs::symlink(target, out.join(name)).unwrap();
            create(&out).unwrap_err();
            Recording::resume(Some(&out)).unwrap_err();
            assert!(out.join(name).is_symlink(), "{name}");
        }
        assert_eq!(files(&precious), ["a"]);
        assert_eq!(std::fs::read_to_string(precious.join("a")).unwrap(), END);
    }

    #[test]
    fn the_latest_run_is_the_one_to_resume() {
        let parent = tempfile::tempdir().unwrap();
        assert_eq!(latest(parent.path()), None);
        let folder = |name: &str| parent.path().join(name);
        for name in ["b", "a", "empty"] {
            std::fs::create_dir(folder(name)).unwrap();
        }
        for (name, hours_ago) in [("b", 2), ("a", 1)] {
            let records = std::fs::File::create(folder(name).join(RECORDS)).unwrap();
            let ago = std::time::Duration::from_secs(3600 * hours_ago);
            records.set_modified(std::time::SystemTime::now() - ago).unwrap();
        }
        std::fs::create_dir(folder("compared")).unwrap();
        let compared = LockedFolder::lock_free(&folder("compared")).unwrap();
        let mut held = compared.open(FolderKind::Comparison).unwrap();
        held.writer.write(&Record::Comparison(Compared::Header(Default::default()))).unwrap();
        drop(held);
        assert_eq!(latest(parent.path()), Some(folder("a")));
        let error = Recording::resume(Some(&folder("compared"))).unwrap_err().to_string();
        assert!(error.contains("holds no run but other records"), "{error}");
    }

    #[test]
    fn fresh_folders_bear_adapter_and_profile() {
        let name = name("llvmpipe (LLVM 15.0.6, 256 bits)", Profile::Quick);
        assert_eq!(name, "llvmpipe-llvm-15-quick");
    }
}

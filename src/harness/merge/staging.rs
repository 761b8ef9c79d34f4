//! A folder that is made beside its place and moved there when it is whole, so that a process that is killed leaves none or all of
//! it.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use super::super::output::{OutputFolder, holder, picture_path};
use super::{MergeError, Merged, OfAdapter};
use crate::input;
use crate::record::{Cell, FolderLock, LOCK, Picture, Record, Writer};

/// Lines that are written at once.
const LINES_AT_ONCE: usize = 256;
/// A picture is no larger.
const MOST_PICTURE_BYTES: u64 = 64 << 20;

/// The folder that is being made.
pub struct Staging {
    place: PathBuf,
    folder: PathBuf,
    lock: FolderLock,
}

impl Staging {
    /// Begins a folder for `place`, where nothing may be. What a killed process left of the same folder is removed.
    pub fn begin(place: &Path) -> Result<Self, MergeError> {
        let io = |source| MergeError::Io { path: place.to_owned(), source };
        let taken = fs::symlink_metadata(place).is_ok();
        if taken && !fs::read_dir(place).is_ok_and(|mut entries| entries.next().is_none()) {
            return Err(MergeError::Taken { path: place.to_owned() });
        }
        // A name without an end, such as `..`, names a folder that is there.
        let Some(name) = place.file_name() else {
            return Err(MergeError::Taken { path: place.to_owned() });
        };
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(".merging");
        let folder = place.with_file_name(hidden);
        let lock = FolderLock::take(&folder, &holder())?;
        for entry in fs::read_dir(&folder).map_err(io)? {
            let entry = entry.map_err(io)?;
            let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
            let remove = |path: PathBuf| {
                if is_folder { fs::remove_dir_all(path) } else { fs::remove_file(path) }
            };
            if entry.file_name() != LOCK {
                remove(entry.path()).map_err(io)?;
            }
        }
        Ok(Self { place: place.to_owned(), folder, lock })
    }

    /// Where files are put meanwhile.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes the records and pictures of one adapter's shards into the folder, or into one within it. The records come back.
    pub fn write(
        &self,
        within: Option<&str>,
        shards: OfAdapter,
    ) -> Result<(Vec<Record>, Merged), MergeError> {
        let folder = within.map_or(self.folder.clone(), |within| self.folder.join(within));
        let output = OutputFolder { folder };
        let io = |source| MergeError::Io { path: output.folder.clone(), source };
        fs::create_dir_all(output.pictures()).map_err(io)?;
        let mut notes = Vec::new();
        for source in &shards.sources {
            notes.extend(copy_pictures(&source.folder, &source.records, &output)?);
        }
        let (lines, mut merged) = shards.merge()?;
        merged.notes.extend(notes);
        let mut writer = Writer::create(&output.records())?;
        for lines in lines.chunks(LINES_AT_ONCE) {
            writer.hand_over(lines)?;
        }
        writer.sync()?;
        Ok((lines, merged))
    }

    /// Moves the folder to its place.
    pub fn publish(self) -> Result<(), MergeError> {
        let Self { place, folder, lock } = self;
        drop(lock);
        fs::rename(&folder, &place).map_err(|source| MergeError::Io { path: place, source })
    }
}

/// Copies the pictures that records name. One by a name that fathom does not give is left where it is: it could lie anywhere.
fn copy_pictures(
    from: &Path,
    records: &[Record],
    to: &OutputFolder,
) -> Result<Vec<String>, MergeError> {
    let mut notes = Vec::new();
    let cells = records.iter().filter_map(|record| match record {
        Record::Cell(cell) => Some((cell, cell.measured()?)),
        _ => None,
    });
    for (cell, measured) in cells {
        for picture in &measured.pictures {
            if let Err(reason) = copy_picture(from, cell, picture, to)? {
                notes.push(format!("{}: picture of {}: {reason}", from.display(), cell.cell));
            }
        }
    }
    Ok(notes)
}

/// The inner error says why it was left out.
fn copy_picture(
    from: &Path,
    cell: &Cell,
    picture: &Picture,
    to: &OutputFolder,
) -> Result<Result<(), String>, MergeError> {
    let path = picture_path(&cell.experiment, &cell.cell, picture.shows);
    if path != picture.path {
        return Ok(Err(format!("`{}` is not the name of its file", picture.path)));
    }
    let bytes = match input::bytes(&from.join(&path), MOST_PICTURE_BYTES) {
        Ok(bytes) => bytes,
        Err(error) => return Ok(Err(error.to_string())),
    };
    let target = to.folder.join(&path);
    fs::write(&target, bytes).map(Ok).map_err(|source| MergeError::Io { path: target, source })
}

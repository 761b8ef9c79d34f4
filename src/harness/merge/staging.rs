//! A folder that is made beside its place and moved there when it is whole, so that a process that is killed leaves none or all of
//! it. It has a random name of its own, and nothing is removed but what this process made.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use tempfile::TempDir;

use super::{Merged, OfAdapter};
use fathom_base::folder::{self, Folder};
use fathom_record::output::{OutputFolder, PICTURES, picture_path};
use fathom_record::{Cell, Picture, Record, Writer};

/// Lines that are written at once.
const LINES_AT_ONCE: usize = 256;
/// A picture is no larger.
const MOST_PICTURE_BYTES: u64 = 64 << 20;

/// The folder that is being made.
pub struct Staging {
    place: PathBuf,
    folder: TempDir,
}

impl Staging {
    /// Begins a folder for `place`, where nothing may be but an empty folder.
    pub fn begin(path: &Path) -> Result<Self> {
        let io = |error| unwritten(path, &error);
        let taken =
            format!("{} is there already: choose another folder with --out", path.display());
        let mut place = path.to_owned();
        if folder::is_there(&place) {
            // The user may name an empty folder by a link.
            place = fs::canonicalize(&place).map_err(|_| anyhow!("{taken}"))?;
            let is_empty = fs::read_dir(&place).is_ok_and(|mut entries| entries.next().is_none());
            ensure!(is_empty, taken);
        }
        // A name without an end, such as `..`, names a folder that is there.
        let name = place.file_name().context(taken)?;
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(".merging-");
        let parent = place.parent().filter(|parent| !parent.as_os_str().is_empty());
        let parent = parent.unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(io)?;
        let mut fresh = tempfile::Builder::new();
        #[cfg(unix)]
        {
            // Those of any new folder, in place of the private ones of temporary folders.
            use std::os::unix::fs::PermissionsExt;
            fresh.permissions(fs::Permissions::from_mode(0o777));
        }
        let folder = fresh.prefix(&hidden).tempdir_in(parent).map_err(io)?;
        Ok(Self { place, folder })
    }

    /// Where files are put meanwhile.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Writes the records and pictures of one adapter's shards into the folder, or into one within it. The records come back.
    pub fn write(&self, within: Option<&str>, shards: OfAdapter) -> Result<(Vec<Record>, Merged)> {
        let folder = within.map_or(self.folder().into(), |within| self.folder().join(within));
        let output = OutputFolder { folder };
        let sources = shards.sources.iter();
        let shown = sources.map(|source| (source.folder.as_path(), source.records.as_slice()));
        let notes = put_pictures(&output, shown)?;
        let (lines, mut merged) = shards.merge()?;
        merged.notes.extend(notes);
        put_records(&output, &lines)?;
        Ok((lines, merged))
    }

    /// Moves the folder to its place.
    pub fn publish(self) -> Result<()> {
        let Self { place, folder } = self;
        fs::rename(folder.path(), &place).map_err(|error| unwritten(&place, &error))?;
        // It is no longer where it was made, and not to be removed.
        let _ = folder.keep();
        Ok(())
    }
}

/// Writes records into a folder.
pub fn put_records(output: &OutputFolder, records: &[Record]) -> Result<()> {
    let mut writer = Writer::create(&output.records())?;
    for lines in records.chunks(LINES_AT_ONCE) {
        writer.hand_over(lines)?;
    }
    Ok(writer.sync()?)
}

/// Copies the pictures that the records of each folder name. Gives a line for each that was left out.
pub fn put_pictures<'a>(
    output: &OutputFolder,
    sources: impl IntoIterator<Item = (&'a Path, &'a [Record])>,
) -> Result<Vec<String>> {
    let to = Folder::make(&output.folder).and_then(|to| {
        to.make_beneath(PICTURES)?;
        Ok(to)
    });
    let to = to.map_err(|error| unwritten(&output.folder, &error))?;
    let mut notes = Vec::new();
    for (folder, records) in sources {
        let from = Folder::open(folder).map_err(|error| unwritten(folder, &error))?;
        notes.extend(copy_pictures(&from, records, &to)?);
    }
    Ok(notes)
}

/// Copies the pictures that records name. One by a name that fathom does not give is left where it is: it could lie anywhere.
fn copy_pictures(from: &Folder, records: &[Record], to: &Folder) -> Result<Vec<String>> {
    let mut notes = Vec::new();
    for cell in records.iter().filter_map(Record::try_as_cell_ref) {
        for picture in cell.measured().into_iter().flat_map(|measured| &measured.pictures) {
            if let Err(reason) = copy_picture(from, cell, picture, to)? {
                let folder = from.path().display();
                notes.push(format!("{folder}: picture of {}: {reason}", cell.cell));
            }
        }
    }
    Ok(notes)
}

/// The inner error says why it was left out.
fn copy_picture(
    from: &Folder,
    cell: &Cell,
    picture: &Picture,
    to: &Folder,
) -> Result<Result<(), String>> {
    let path = picture_path(&cell.experiment, &cell.cell, picture.shows);
    if path != picture.path {
        return Ok(Err(format!("`{}` is not the name of its file", picture.path)));
    }
    let bytes = match from.bytes(&path, MOST_PICTURE_BYTES) {
        Ok(bytes) => bytes,
        Err(error) => return Ok(Err(error.to_string())),
    };
    let written = to.write(&path, &bytes);
    written.map(Ok).map_err(|error| unwritten(&to.path().join(&path), &error))
}

fn unwritten(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow!("cannot write to {}: {error}", path.display())
}

//! `fathom merge`: the records of a run's shards, one shard after the other, in a new folder.
//!
//! A reader takes several headers and the latest record of a cell, so a merged run reads like one that was resumed on another machine, and
//! no header says any more that it is of a shard.
//! Shards of one run have the same adapter, version, profile and shader checks. Others are an error.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use itertools::Itertools as _;

use fathom_base::folder::Folder;
use fathom_record::output::{FolderKind, OutputFolder, PICTURES, Taken, picture_path};
use fathom_record::{
    Adapter, Cell, FolderLock, Note, NoteKind, Part, Picture, Reading, Record, Run,
};

/// A picture is no larger.
const MAX_PICTURE_BYTES: u64 = 64 << 20;

/// A shard's folder as it was read.
struct ShardFolder {
    path: PathBuf,
    reading: Reading,
    part: Part,
    /// Its last header.
    header: Run,
}

pub struct Merged {
    /// Shards that were not named.
    pub absent: Vec<Part>,
    /// What was left out, a line each.
    pub notes: Vec<String>,
    /// Of the folder, which further files are written to.
    pub lock: FolderLock,
}

/// Writes the records and pictures of the shards in `folders` into `out`, in order of their numbers.
pub fn merge(folders: &[PathBuf], out: &Path) -> Result<Merged> {
    let shards = folders.iter().map(|folder| ShardFolder::read(folder));
    let mut shards = shards.collect::<Result<Vec<_>>>()?;
    shards.sort_by_key(|shard| shard.part.number);
    for (first, other) in shards.iter().tuple_windows() {
        other.check_same_run(first)?;
    }
    let absent = absent(&shards);
    let mut held = Taken::free(out)?.open(FolderKind::Run)?;
    let unwritable = || format!("cannot write to {}", out.display());
    let to = Folder::make(out).with_context(unwritable)?;
    to.make_beneath(PICTURES).with_context(unwritable)?;
    let (mut notes, mut merged_records) = (Vec::new(), Vec::new());
    for mut shard in shards {
        let records = OutputFolder { folder: shard.path.clone() }.records();
        notes.extend(shard.reading.damaged.notice(&records));
        notes.extend(copy_pictures(&shard, &to)?);
        let headers = shard.reading.records.iter_mut().filter_map(Record::try_as_run_mut);
        headers.for_each(|run| run.shard = None);
        merged_records.append(&mut shard.reading.records);
    }
    if !absent.is_empty() {
        note_absent(&mut merged_records, &absent);
    }
    // In one piece: a merge that fails on the way does not pass for one of fewer shards.
    held.writer.write_all(&merged_records)?;
    Ok(Merged { absent, notes, lock: held.lock })
}

/// Every page of the merged run says so.
fn note_absent(records: &mut [Record], absent: &[Part]) {
    let text = format!("merged without shard {}", absent.iter().join(", "));
    if let Some(run) = records.iter_mut().rev().find_map(Record::try_as_run_mut) {
        run.notes.push(Note::new(NoteKind::Incomplete, text));
    }
}

fn absent(shards: &[ShardFolder]) -> Vec<Part> {
    let parts = shards.first().map_or(0, |shard| shard.part.of);
    let is_there = |number: &u32| shards.iter().any(|shard| shard.part.number == *number);
    (1..=parts).filter(|n| !is_there(n)).map(|number| Part { number, of: parts }).collect()
}

impl ShardFolder {
    fn read(folder: &Path) -> Result<Self> {
        let shown = folder.display();
        let path = OutputFolder { folder: folder.to_owned() }.records();
        let reading = fathom_record::read(&path)?;
        fathom_record::empty_or_sound(&path, &reading)?;
        let last = reading.records.iter().rev().find_map(Record::try_as_run_ref);
        let Some(header) = last.map(|run| Run::clone(run)) else {
            bail!("{shown} holds no header of a run: nothing can be merged with it");
        };
        let Some(part) = header.shard else {
            bail!("{shown} holds a whole run and no shard");
        };
        ensure!(part.is_one(), "{shown} says that it is shard {part}, and there is no such shard");
        Ok(Self { path: folder.to_owned(), reading, part, header })
    }

    fn check_same_run(&self, first: &Self) -> Result<()> {
        let (a, b) = (&first.header, &self.header);
        let differs = [
            ("the adapter", !is_same_adapter(&a.adapter, &b.adapter)),
            ("fathom's version", a.fathom_version != b.fathom_version),
            ("the profile", a.profile != b.profile),
            ("the checks in shaders", a.shader_checks != b.shader_checks),
            ("the number of shards", first.part.of != self.part.of),
        ];
        let (first_path, path) = (first.path.display(), self.path.display());
        if let Some((what, _)) = differs.into_iter().find(|(_, differs)| *differs) {
            bail!("{first_path} and {path} are shards of different runs: they differ in {what}");
        }
        let part = self.part;
        ensure!(first.part != part, "{first_path} and {path} both hold shard {part}: name one");
        Ok(())
    }
}

/// Hosts may differ where the GPU does the work.
fn is_same_adapter(a: &Adapter, b: &Adapter) -> bool {
    let of_gpu = |adapter: &Adapter| Adapter { host_threads: 0, ..adapter.clone() };
    a == b || !a.software && of_gpu(a) == of_gpu(b)
}

/// Copies the pictures that a shard's records name. Gives a line for each that was left out.
fn copy_pictures(shard: &ShardFolder, to: &Folder) -> Result<Vec<String>> {
    let from = Folder::open(&shard.path)?;
    let mut notes = Vec::new();
    for cell in shard.reading.records.iter().filter_map(Record::try_as_cell_ref) {
        for picture in cell.measured().into_iter().flat_map(|measured| &measured.pictures) {
            if let Err(reason) = copy_picture(&from, cell, picture, to) {
                let folder = shard.path.display();
                notes.push(format!("{folder}: picture of {}: {reason}", cell.cell));
            }
        }
    }
    Ok(notes)
}

/// A picture by a name that fathom does not give is left where it is: it could lie anywhere.
fn copy_picture(from: &Folder, cell: &Cell, picture: &Picture, to: &Folder) -> Result<()> {
    let path = picture_path(&cell.experiment, &cell.cell, picture.shows);
    ensure!(path == picture.path, "`{}` is not the name of its file", picture.path);
    to.write(&path, &from.bytes(&path, MAX_PICTURE_BYTES)?)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_record::output::RECORDS;
    use fathom_record::{Measured, Outcome, PictureKind, Profile, SCHEMA};

    fn cell(name: &str, pictures: &[&str]) -> Cell {
        let picture = |path: &&str| Picture {
            path: (*path).to_owned(),
            shows: PictureKind::Image,
            scale: None,
        };
        let pictures = pictures.iter().map(picture).collect();
        let outcome = Outcome::Measured(Box::new(Measured { pictures, ..Measured::default() }));
        Cell {
            experiment: "own".into(),
            cell: name.into(),
            axes: serde_json::Map::new(),
            pipeline: "underwater".into(),
            scene: "tank".into(),
            stand_ins: Vec::new(),
            params: serde_json::json!({}).into(),
            outcome,
        }
    }

    /// Writes a shard of three with one cell; its folder.
    fn shard(place: &Path, number: u32, change: fn(&mut Run), cell: Cell) -> PathBuf {
        let part = Some(Part { number, of: 3 });
        let mut run =
            Run { schema: SCHEMA, profile: Profile::Quick, shard: part, ..Run::default() };
        change(&mut run);
        let folder = place.join(format!("shard-{number}"));
        std::fs::create_dir_all(&folder).unwrap();
        let records = [Record::Run(Box::new(run)), Record::Cell(Box::new(cell))];
        let lines = records.map(|record| serde_json::to_string(&record).unwrap() + "\n");
        std::fs::write(folder.join(RECORDS), lines.concat()).unwrap();
        folder
    }

    #[test]
    fn shards_are_joined_in_order_of_their_numbers() {
        let place = tempfile::tempdir().unwrap();
        let bad = "../secret";
        let good = picture_path("own", "b", PictureKind::Image);
        let folders = [3, 1].map(|number| {
            let name = if number == 1 { "a" } else { "b" };
            shard(place.path(), number, |_| {}, cell(name, &[&good, bad]))
        });
        std::fs::write(place.path().join("secret"), "secret").unwrap();
        std::fs::create_dir(folders[0].join("renders")).unwrap();
        std::fs::write(folders[0].join(&good), "picture").unwrap();
        // A line that was torn while it was written.
        let records = folders[1].join(RECORDS);
        let text = std::fs::read_to_string(&records).unwrap();
        std::fs::write(&records, text + "{\"rec").unwrap();

        let out = place.path().join("merged");
        let Merged { absent, notes, .. } = merge(&folders, &out).unwrap();
        assert_eq!(absent, [Part { number: 2, of: 3 }]);
        assert_eq!(notes.len(), 4, "{notes:?}");
        let read = fathom_record::read(&out.join(RECORDS)).unwrap();
        let cells = read.records.iter().filter_map(Record::try_as_cell_ref);
        assert_eq!(cells.map(|cell| &*cell.cell).collect::<Vec<_>>(), ["a", "b"]);
        let last = read.records.iter().rev().find_map(Record::try_as_run_ref).unwrap();
        assert!(last.notes[0].text.contains("without shard 2/3"), "{:?}", last.notes);
        assert_eq!(std::fs::read(out.join(&good)).unwrap(), b"picture");
        assert_eq!(std::fs::read_dir(out.join("renders")).unwrap().count(), 1);
        // A folder with records is not written to.
        assert!(merge(&folders, &out).err().unwrap().to_string().contains("holds records already"));
    }

    #[test]
    fn what_does_not_belong_together_is_refused() {
        type Change = fn(&mut Run);
        let changes: [(&str, Change); 7] = [
            ("differ in the profile", |run| run.profile = Profile::Paper),
            ("differ in fathom's version", |run| run.fathom_version = "9".to_owned()),
            ("differ in the adapter", |run| run.adapter.name = "another".to_owned()),
            ("differ in the number of shards", |run| run.shard = Some(Part { number: 2, of: 9 })),
            ("both hold shard 1/3", |run| run.shard = Some(Part { number: 1, of: 3 })),
            ("holds a whole run", |run| run.shard = None),
            ("there is no such shard", |run| run.shard = Some(Part { number: 4, of: 3 })),
        ];
        for (reason, change) in changes {
            let place = tempfile::tempdir().unwrap();
            let first = shard(place.path(), 1, |_| {}, cell("a", &[]));
            let other = shard(place.path(), 2, change, cell("b", &[]));
            let error =
                merge(&[first, other], &place.path().join("out")).err().unwrap().to_string();
            assert!(error.contains(reason) && error.lines().count() == 1, "{error}");
            assert!(!place.path().join("out").exists());
        }
    }
}

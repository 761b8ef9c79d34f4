use super::*;
use crate::catalog::Catalog;
use crate::plan::{self, Request};
use crate::shard;
use fathom_experiments::Experiment;
use fathom_record::output::{RECORDS, picture_path};
use fathom_record::{
    Cell, Definition, End, Measured, Outcome, Picture, PictureKind, Profile, SCHEMA, Writer,
};

const OF: u32 = 3;
const EXPERIMENTS: [&str; 4] = ["uw-photons", "uw-buffers", "vao-samples", "vao-view"];

/// A run of built-in experiments in three shards, whose cells have no figures.
struct Shards {
    folder: tempfile::TempDir,
    parts: Vec<Vec<Record>>,
}

fn measured(pictures: Vec<Picture>) -> Outcome {
    Outcome::Measured(Box::new(Measured { pictures, ..Measured::default() }))
}

fn picture(path: &str) -> Picture {
    Picture { path: path.to_owned(), shows: PictureKind::Image, scale: None }
}

fn path_of(cell: &Cell) -> String {
    picture_path(&cell.experiment, &cell.cell, PictureKind::Image)
}

impl Shards {
    fn new() -> Self {
        let experiments = EXPERIMENTS.map(str::to_owned).into();
        let request = Request { experiments, ..Request::default() };
        let catalog = Catalog::builtin();
        let experiments = request.load(&catalog).unwrap();
        let part = |number| {
            let part = Part { number, of: OF };
            let shard = shard::of(part, &experiments, &request, Profile::Quick).unwrap();
            let mut expanded = plan::expand(&experiments, &request, Profile::Quick).unwrap();
            shard::keep(part, &experiments, &mut expanded);
            let command = format!("fathom run --shard {part} --out x --seed 3");
            let header = Run {
                schema: SCHEMA,
                profile: Profile::Quick,
                started_at: format!("2026-01-0{number}T00:00:00Z"),
                command: command.split(' ').map(str::to_owned).collect(),
                shard: Some(shard),
                ..Run::default()
            };
            let definition = |experiment: &Experiment| {
                let (id, toml) = (experiment.id.clone(), experiment.text.clone());
                Record::Experiment(Definition { id, toml })
            };
            let cell = |plan| fathom_experiments::fixtures::cell(plan, measured(Vec::new()));
            let mut records = vec![Record::Run(Box::new(header))];
            records.extend(experiments.iter().map(definition));
            records.extend(expanded.iter().flatten().map(cell));
            let end = End { measuring_wall_s: 1.0, peak_memory_bytes: Some(3), ..End::default() };
            records.push(Record::End(end));
            records
        };
        let parts = (1..=OF).map(part).collect();
        Self { folder: tempfile::tempdir().unwrap(), parts }
    }

    /// Writes the shards; their folders.
    fn folders(&self) -> Vec<PathBuf> {
        let folder = |(index, records): (usize, &Vec<Record>)| {
            let folder = self.folder.path().join(format!("shard-{}", index + 1));
            std::fs::create_dir_all(&folder).unwrap();
            Writer::create(&folder.join(RECORDS)).unwrap().write_all(records).unwrap();
            folder
        };
        self.parts.iter().enumerate().map(folder).collect()
    }

    fn header(&mut self, part: usize) -> &mut Run {
        self.parts[part][0].try_as_run_mut().unwrap()
    }

    fn cell(&mut self, part: usize) -> &mut Cell {
        self.parts[part].iter_mut().find_map(Record::try_as_cell_mut).unwrap()
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("merged")
    }

    /// Merges shards of one adapter; what became of them, and the records.
    fn merged(&self, folders: &[PathBuf]) -> (Merged, Vec<Record>) {
        let mut groups = sources(folders).unwrap();
        assert_eq!(groups.len(), 1);
        let staging = Staging::begin(&self.out()).unwrap();
        let (lines, merged) = staging.write(None, groups.remove(0)).unwrap();
        staging.publish().unwrap();
        let read = read(&self.out().join(RECORDS)).unwrap();
        assert_eq!(read.damaged.count(), 0);
        assert!(read.records == lines);
        (merged, read.records)
    }

    fn error(&self, folders: &[PathBuf]) -> String {
        let error = sources(folders).err().unwrap().to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        error
    }
}

fn cells(records: &[Record]) -> Vec<&Cell> {
    records.iter().filter_map(Record::try_as_cell_ref).map(Box::as_ref).collect()
}

#[test]
fn shards_with_one_header_are_one_sitting() {
    let shards = Shards::new();
    let mut folders = shards.folders();
    folders.reverse();
    let (merged, records) = shards.merged(&folders);
    assert!(merged.missing.is_empty() && merged.absent.is_empty(), "{:?}", merged.missing);
    assert_eq!(merged.notes, [""; 0]);
    let [Record::Run(run), Record::Experiment(_), ..] = &records[..] else {
        panic!("{:?}", &records[..2]);
    };
    assert_eq!(run.shard, None);
    assert_eq!(run.started_at, "2026-01-01T00:00:00Z");
    assert_eq!(run.command.join(" "), "fathom run --seed 3");
    let all: usize = shards.parts.iter().map(|part| cells(part).len()).sum();
    assert_eq!(cells(&records).len(), all);
    assert_eq!(merged.counts.measured, all);
    let Some(Record::End(end)) = records.last() else { panic!("{:?}", records.last()) };
    assert_eq!((end.measuring_wall_s, end.peak_memory_bytes), (3.0, Some(3)));
    assert_eq!(records.iter().filter_map(Record::try_as_run_ref).count(), 1);
    // The order of the plan, as in a run of all cells.
    let place = |cell: &&Cell| EXPERIMENTS.iter().position(|known| *known == cell.experiment);
    assert!(cells(&records).iter().map(place).is_sorted());
}

#[test]
fn what_headers_say_stays_with_their_cells() {
    let mut shards = Shards::new();
    shards.header(1).submit_cost_ns = [(fathom_record::PassKind::Copy, 7.0)].into();
    let mine = cells(&shards.parts[1]).len();
    let (_, records) = shards.merged(&shards.folders());
    let second = records.iter().rposition(|record| record.try_as_run_ref().is_some()).unwrap();
    assert_eq!(records[second].try_as_run_ref().unwrap().submit_cost_ns.len(), 1);
    assert_eq!(cells(&records[second..]).len(), mine);
}

#[test]
fn missing_cells_are_listed() {
    let mut shards = Shards::new();
    let folders = shards.folders();
    let lost = cells(&shards.parts[1]).len();
    let (merged, records) = shards.merged(&[folders[0].clone(), folders[2].clone()]);
    let notes = &records[0].try_as_run_ref().unwrap().notes;
    let [note] = &notes[..] else { panic!("{notes:?}") };
    assert_eq!(note.text, format!("merged with {lost} cells missing; not there: shard 2/3"));
    assert_eq!(merged.absent, [Part { number: 2, of: OF }]);
    assert_eq!(merged.missing.len(), lost);
    // A cell of a shard that is there.
    std::fs::remove_dir_all(shards.out()).unwrap();
    let removed = shards.cell(0).clone();
    shards.parts[0].retain(|record| record.try_as_cell_ref().is_none_or(|cell| **cell != removed));
    let (merged, _) = shards.merged(&shards.folders());
    assert_eq!(merged.missing, [(removed.experiment, removed.cell)]);
}

#[test]
fn a_measured_cell_counts_before_one_that_failed_later() {
    let mut shards = Shards::new();
    let good = shards.cell(0).clone();
    let failed = Outcome::Failed { reason: "lost".to_owned() };
    let bad = Cell { outcome: failed, ..good.clone() };
    shards.parts[0].push(Record::Cell(Box::new(bad)));
    let (merged, records) = shards.merged(&shards.folders());
    assert_eq!(merged.counts.failed, 0);
    let of_name = |cell: &Cell| cell.experiment == good.experiment && cell.cell == good.cell;
    let found: Vec<_> = cells(&records).into_iter().filter(|cell| of_name(cell)).collect();
    assert!(matches!(found[..], [cell] if cell.measured().is_some()), "{found:?}");
    assert_eq!(merged.notes.len(), 1, "{:?}", merged.notes);
}

/// Nothing is counted up to a number that someone wrote into a header.
#[test]
fn shards_that_do_not_belong_together_are_refused() {
    type Change = fn(&mut Run);
    fn numbered<const NUMBER: u32, const OF: u32>(run: &mut Run) {
        let shard = run.shard.as_mut().unwrap();
        (shard.part.number, shard.part.of) = (NUMBER, OF);
    }
    let changes: [(&str, Change); 10] = [
        ("differ in the profile", |run| run.profile = Profile::Paper),
        ("differ in fathom's version", |run| run.fathom_version = "9".to_owned()),
        ("differ in the number of shards", |run| run.shard.as_mut().unwrap().part.of = 9),
        ("differ in experiments, cells or parameters", |run| {
            run.shard.as_mut().unwrap().plan.push('x');
        }),
        ("both hold shard 1/3", numbered::<1, 3>),
        ("holds a whole run", |run| run.shard = None),
        ("there is no such shard", numbered::<0, 3>),
        ("there is no such shard", numbered::<4, 3>),
        ("there is no such shard", numbered::<1, { u32::MAX }>),
        ("there is no such shard", numbered::<0, 0>),
    ];
    for (what, change) in changes {
        let mut shards = Shards::new();
        change(shards.header(2));
        let error = shards.error(&shards.folders());
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn damage_is_named() {
    let shards = Shards::new();
    let folders = shards.folders();
    let path = folders[1].join(RECORDS);
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.trim_end().rsplit_once('\n').unwrap().0.to_owned() + "\n{\"rec")
        .unwrap();
    let (merged, _) = shards.merged(&folders);
    let [note] = &merged.notes[..] else { panic!("{:?}", merged.notes) };
    assert!(note.contains("shard-2") && note.contains("torn off"), "{note}");
    std::fs::write(&path, "nonsense\n").unwrap();
    let error = shards.error(&folders);
    assert!(error.contains("shard-2") && error.contains("no sound record"), "{error}");
    std::fs::write(&path, "").unwrap();
    assert!(shards.error(&folders).contains("holds no header"));
}

#[test]
fn adapters_are_kept_apart() {
    let mut shards = Shards::new();
    shards.header(1).adapter.name = "another".to_owned();
    let mut groups = sources(&shards.folders()).unwrap();
    let names: Vec<&str> = groups.iter().map(|group| group.adapter.name.as_str()).collect();
    assert_eq!(names, ["", "another"]);
    assert_eq!(groups.remove(1).merge().unwrap().1.absent.len(), 2);
    // The host does not matter where a GPU does the work.
    let mut shards = Shards::new();
    shards.header(1).adapter.host_threads = 5;
    assert_eq!(sources(&shards.folders()).unwrap().len(), 1);
    for part in 0..3 {
        shards.header(part).adapter.software = true;
    }
    assert_eq!(sources(&shards.folders()).unwrap().len(), 2);
}

#[test]
fn only_pictures_by_their_own_names_are_copied() {
    let mut shards = Shards::new();
    let [good, other] = [0, 1].map(|part| shards.cell(part).clone());
    let path = path_of(&good);
    shards.cell(0).outcome = measured(vec![picture(&path)]);
    let bad = ["../../secret", "/etc/hostname", path.as_str()].map(picture);
    shards.cell(1).outcome = measured(bad.into());
    let folders = shards.folders();
    std::fs::create_dir(folders[0].join("renders")).unwrap();
    std::fs::write(folders[0].join(&path), "picture").unwrap();
    std::fs::write(shards.folder.path().join("secret"), "secret").unwrap();
    let (merged, _) = shards.merged(&folders);
    assert_eq!(std::fs::read(shards.out().join(&path)).unwrap(), b"picture");
    assert_eq!(std::fs::read_dir(shards.out().join("renders")).unwrap().count(), 1);
    assert_eq!(merged.notes.len(), 3, "{:?}", merged.notes);
    assert!(merged.notes.iter().all(|note| note.contains(&other.cell)), "{:?}", merged.notes);
}

#[test]
fn a_folder_that_holds_something_is_not_touched() {
    let shards = Shards::new();
    let folders = shards.folders();
    for place in [folders[0].clone(), folders[0].join(".."), folders[0].join(RECORDS)] {
        let error = Staging::begin(&place).err().unwrap().to_string();
        assert!(error.contains("is there already"), "{error}");
    }
    // An empty folder is taken.
    std::fs::create_dir(shards.out()).unwrap();
    shards.merged(&folders);
}

#[cfg(unix)]
#[test]
fn no_link_is_followed_and_an_empty_folder_may_be_named_by_one() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let mut shards = Shards::new();
    let [linked, beneath] = [0, 1].map(|part| {
        let cell = shards.cell(part);
        let path = path_of(cell);
        cell.outcome = measured(vec![picture(&path)]);
        path
    });
    let folders = shards.folders();
    let precious = shards.folder.path().join("precious");
    std::fs::create_dir(&precious).unwrap();
    std::fs::write(precious.join("a"), "keep").unwrap();
    let name = Path::new(&beneath).file_name().unwrap();
    std::fs::write(precious.join(name), "keep").unwrap();
    // A picture that is a link, and one that lies in a folder that is a link.
    std::fs::create_dir(folders[0].join("renders")).unwrap();
    symlink(precious.join("a"), folders[0].join(&linked)).unwrap();
    symlink(&precious, folders[1].join("renders")).unwrap();
    symlink(precious.join("a"), folders[2].join("samples.jsonl")).unwrap();
    symlink(&precious, shards.folder.path().join(".merged.merging")).unwrap();
    let place = shards.folder.path().join("place");
    std::fs::create_dir(&place).unwrap();
    symlink(&place, shards.out()).unwrap();
    let (merged, _) = shards.merged(&folders);
    assert_eq!(merged.notes.len(), 2, "{:?}", merged.notes);
    assert!(merged.notes.iter().all(|note| note.contains("is a symbolic link")));
    assert_eq!(std::fs::read_dir(place.join("renders")).unwrap().count(), 0);
    assert_eq!(std::fs::read_dir(&precious).unwrap().count(), 2);
    assert_eq!(std::fs::read_to_string(precious.join("a")).unwrap(), "keep");
    // A folder that goes to its place is open to those whom any new folder is.
    let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
    assert_eq!(mode(&place), mode(&precious));
}

//! The file of samples of a run: what was taken of cells that have no record yet, so that a killed run goes on from there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use fathom_base::folder;
use fathom_clock::Samples;
use fathom_record::{Addition, Clocks, LineWriter, RecordError, SAMPLES_SCHEMA, SampleLine};

/// A round that takes longer is written visit by visit.
const LONGEST_UNWRITTEN: Duration = Duration::from_millis(200);
/// What is written is forced to the disk no more often than this: it outlives the process at once, and a loss of power costs no
/// more than this. Forcing takes milliseconds, handing over tens of microseconds.
const SYNC_INTERVAL: Duration = Duration::from_secs(5);

/// A cell as its lines name it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CellName {
    /// See [`SampleLine::id`].
    pub id: String,
    pub experiment: String,
    pub cell: String,
}

/// What was taken of a cell, as far as it counts.
#[derive(Default)]
struct Taken {
    additions: Vec<Addition>,
    /// So many of the additions, the first, are of an earlier run.
    earlier: usize,
    /// Those of the last line.
    clocks: Clocks,
}

impl Taken {
    fn pairs(&self) -> usize {
        let additions = self.additions.iter();
        additions.filter(|added| added.pair.is_some()).count()
    }

    fn add(&mut self, added: Addition) {
        if added.afresh {
            self.additions.clear();
            self.earlier = 0;
        }
        self.additions.push(added);
    }
}

/// By the id of the cell.
type Cells = BTreeMap<String, Taken>;

/// Writes samples as they are taken, and hands them out to whoever goes on with a cell: this run or the next one. A cell is closed
/// when nobody is to go on with it.
pub struct Journal {
    path: PathBuf,
    writer: LineWriter<SampleLine>,
    /// Of the cells that are not closed.
    open: Cells,
    /// By which samples are taken.
    clocks: Clocks,
    unwritten: Vec<SampleLine>,
    written: Instant,
    synced: Instant,
}

impl Journal {
    /// Opens the file, or starts it where there is none, and gives what there is to say of its damage.
    pub fn open(path: &Path) -> Result<(Self, Option<String>), RecordError> {
        let (writer, read) = LineWriter::open(path, |_| Ok::<(), RecordError>(()))?;
        let damage = read.damaged.notice(path);
        let open = by_cell(read.records);
        let now = Instant::now();
        let journal = Self {
            path: path.to_owned(),
            writer,
            open,
            clocks: Clocks::new(),
            unwritten: Vec::new(),
            written: now,
            synced: now,
        };
        Ok((journal, damage))
    }

    /// Whether samples of the cell are here to go on with.
    pub fn is_open(&self, id: &str) -> bool {
        self.open.get(id).is_some_and(|taken| taken.pairs() > 0)
    }

    /// Pairs of frames that an earlier run took of these cells, and how many of the cells have any.
    pub fn earlier_pairs(&self, ids: &[String]) -> (usize, usize) {
        let found = ids.iter().filter_map(|id| self.open.get(id));
        let pairs = found.map(Taken::pairs).filter(|pairs| *pairs > 0);
        pairs.fold((0, 0), |(pairs, cells), more| (pairs + more, cells + 1))
    }

    /// The largest number of a round among the samples of earlier runs.
    pub fn last_round(&self) -> Option<u32> {
        let additions = self.open.values().flat_map(|taken| &taken.additions);
        additions.filter_map(|added| Some(added.pair.as_ref()?.round)).max()
    }

    /// The clocks to take samples by: those that an earlier run took most pairs of these cells by, else those that were found
    /// now. Samples by different clocks do not go together, and what one audit found sound, the next may not on a busy machine.
    pub fn choose_clocks(&mut self, ids: &[String], found: Clocks) -> &Clocks {
        let mut pairs = BTreeMap::<&Clocks, usize>::new();
        for taken in ids.iter().filter_map(|id| self.open.get(id)) {
            *pairs.entry(&taken.clocks).or_default() += taken.pairs();
        }
        let most = pairs.into_iter().max_by_key(|(_, pairs)| *pairs);
        let most = most.filter(|(_, pairs)| *pairs > 0);
        self.clocks = most.map_or(found, |(clocks, _)| clocks.clone());
        &self.clocks
    }

    /// What was taken of a cell before.
    pub fn taken(&self, cell: &CellName) -> Samples {
        let Some(taken) = self.open.get(&cell.id) else { return Samples::default() };
        let earlier_pairs = Samples::of(&taken.additions[..taken.earlier]).pairs();
        Samples { earlier_pairs, ..Samples::of(&taken.additions) }
    }

    fn line(&self, cell: &CellName, added: Addition) -> SampleLine {
        SampleLine {
            schema: SAMPLES_SCHEMA,
            id: cell.id.clone(),
            experiment: cell.experiment.clone(),
            cell: cell.cell.clone(),
            clocks: self.clocks.clone(),
            added,
        }
    }

    pub fn keep(&mut self, cell: &CellName, added: Addition) -> Result<(), RecordError> {
        self.open.entry(cell.id.clone()).or_default().add(added.clone());
        self.unwritten.push(self.line(cell, added));
        if self.written.elapsed() < LONGEST_UNWRITTEN {
            return Ok(());
        }
        self.write()
    }

    /// Hands all lines over to the system, in one piece.
    pub fn write(&mut self) -> Result<(), RecordError> {
        if !self.unwritten.is_empty() {
            self.writer.hand_over(&std::mem::take(&mut self.unwritten))?;
        }
        self.written = Instant::now();
        if self.synced.elapsed() >= SYNC_INTERVAL {
            self.writer.sync()?;
            self.synced = Instant::now();
        }
        Ok(())
    }

    /// Nobody is to go on with a cell: it needs no more samples, or it failed and will be measured anew, from nothing.
    pub fn close(&mut self, cell: &CellName) -> Result<(), RecordError> {
        if self.open.remove(&cell.id).is_some() {
            self.unwritten.push(self.line(cell, ended()));
            self.write()?;
        }
        Ok(())
    }

    /// Removes the file if every cell in it is closed.
    pub fn end(mut self) -> Result<(), RecordError> {
        self.write()?;
        if self.open.is_empty() {
            // What stays is read again and found to be closed.
            let _ = folder::of(&self.path).and_then(|(folder, name)| folder.remove(name));
            return Ok(());
        }
        self.writer.sync()
    }
}

/// What the lines say of each cell, from the last one on that begins it afresh.
fn by_cell(lines: Vec<SampleLine>) -> Cells {
    let mut cells = Cells::new();
    for line in lines {
        let taken = cells.entry(line.id).or_default();
        taken.add(line.added);
        taken.earlier = taken.additions.len();
        taken.clocks = line.clocks;
    }
    // A cell whose last line only ended what was before has nothing left.
    cells.retain(|_, taken| taken.additions.iter().any(|added| *added != ended()));
    cells
}

/// Ends what came before.
fn ended() -> Addition {
    Addition { afresh: true, ..Addition::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_record::{Clock, FaultKind, FramePair, PassKind};

    fn cell(id: &str) -> CellName {
        CellName { id: id.to_owned(), experiment: "e".to_owned(), cell: id.to_owned() }
    }

    fn pair(ns: f64) -> Addition {
        let stages = Vec::new();
        Addition {
            pair: Some(FramePair {
                round: ns as u32,
                sampled_at_s: 1.5e9,
                machine: None,
                stages,
                envelope_ns: ns,
                gaps_ns: 0.0,
                untimed_ns: ns,
            }),
            ..Addition::default()
        }
    }

    fn keep<const N: usize>(journal: &mut Journal, added: [(&str, Addition); N]) {
        for (id, added) in added {
            journal.keep(&cell(id), added).unwrap();
        }
        journal.write().unwrap();
    }

    fn journal(folder: &tempfile::TempDir) -> Journal {
        let (journal, damage) = Journal::open(&folder.path().join("samples.jsonl")).unwrap();
        assert_eq!(damage, None);
        journal
    }

    #[test]
    fn what_was_kept_is_handed_out_after_the_process_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = journal(&folder);
        let warm_up = Addition {
            warm_up_frames: 2,
            rejected: Some(FaultKind::Zero.into()),
            ..Addition::default()
        };
        keep(&mut first, [("a", warm_up.clone()), ("b", pair(3.0)), ("a", pair(1.0))]);
        first.keep(&cell("a"), pair(2.0)).unwrap();
        // It is killed: what was not handed over is gone.
        drop(first);
        let mut second = journal(&folder);
        let ids = ["a", "b", "c"].map(str::to_owned);
        assert_eq!(second.last_round(), Some(3));
        assert_eq!(second.earlier_pairs(&ids), (2, 2));
        let taken = Samples::of(&[warm_up, pair(1.0)]);
        assert_eq!(second.taken(&cell("a")), taken);
        // What this run adds is not of an earlier one.
        keep(&mut second, [("a", pair(5.0))]);
        let all = second.taken(&cell("a"));
        assert_eq!((all.pairs(), all.earlier_pairs), (2, 1));
        assert_eq!(second.taken(&cell("c")), Samples::default());
    }

    #[test]
    fn a_resumed_run_takes_samples_by_the_clocks_of_the_earlier_one() {
        let folder = tempfile::tempdir().unwrap();
        let ids = ["a", "b"].map(str::to_owned);
        let by = |clock| Clocks::from([(PassKind::Compute, clock)]);
        let (stamped, fenced) = (by(Clock::Timestamp), by(Clock::FencedHost));
        let mut first = journal(&folder);
        assert_eq!(*first.choose_clocks(&ids, stamped.clone()), stamped);
        keep(&mut first, [("a", pair(1.0)), ("b", pair(1.0))]);
        drop(first);
        let mut second = journal(&folder);
        assert_eq!(*second.choose_clocks(&ids, fenced.clone()), stamped);
        let others = ["c".to_owned()];
        assert_eq!(*second.choose_clocks(&others, fenced.clone()), fenced);
        ids.iter().for_each(|id| second.close(&cell(id)).unwrap());
        assert_eq!(*second.choose_clocks(&ids, fenced.clone()), fenced);
    }

    #[test]
    fn numbers_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = journal(&folder);
        let numbers: Vec<f64> = (1..2_000).map(|n| 1e7 / f64::from(n).sqrt()).collect();
        for ns in &numbers {
            first.keep(&cell("a"), pair(*ns)).unwrap();
        }
        first.write().unwrap();
        let read = journal(&folder).taken(&cell("a"));
        assert_eq!(read.each(|pair| pair.envelope_ns), numbers);
    }

    #[test]
    fn the_file_goes_when_nobody_is_to_go_on_with_any_cell() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("samples.jsonl");
        let mut first = journal(&folder);
        for id in ["a", "b", "c"] {
            first.keep(&cell(id), pair(1.0)).unwrap();
        }
        first.close(&cell("a")).unwrap();
        first.end().unwrap();
        let mut second = journal(&folder);
        assert_eq!(["a", "b", "c", "d"].map(|id| second.is_open(id)), [false, true, true, false]);
        second.close(&cell("b")).unwrap();
        second.keep(&cell("c"), pair(2.0)).unwrap();
        second.close(&cell("c")).unwrap();
        second.end().unwrap();
        assert!(!path.exists());
    }
}

//! A comparison's folder: what its records hold, sorted for the verdicts.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, bail};

use fathom_base::folder;
use fathom_record as record;
use fathom_record::comparison::{
    CellId, ChangedStage, CheckFigure, Compared, ComparisonEnd, ComparisonHeader,
    ConfigurationFigures, ExactFigures, Fault, InstructionCounts, Launch, MAX_LAUNCHES, Pair, Side,
    UnchangedCells,
};
use fathom_record::output::{RECORDS, Recording};
use fathom_record::{Record, RecordError, RecordFile};

/// Appends records in one piece. Nothing else than this writes, so that measuring is not disturbed.
pub fn write(held: &mut Recording, lines: Vec<Compared>) -> Result<(), RecordError> {
    let records: Vec<Record> = lines.into_iter().map(Record::from).collect();
    held.writer.write_all(&records)
}

/// Everything that was measured, as verdicts take it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    pub header: ComparisonHeader,
    pub configurations: Vec<ConfigurationFigures>,
    pub unchanged: Vec<UnchangedCells>,
    pub changed: Vec<ChangedStage>,
    pub exact: Vec<ExactFigures>,
    pub checks: Vec<CheckFigure>,
    pub instructions: Vec<InstructionCounts>,
    /// Of complete launches.
    pub pairs: Vec<Pair>,
    pub launches: Vec<Launch>,
    /// The highest number of a launch that anything was stored of, complete or not.
    pub last_launch: Option<u32>,
    pub faults: Vec<Fault>,
    /// So many of the faults, the first, stood when measuring was last interrupted: the interruption may have caused
    /// them, so what they took is tried again.
    pub faults_before_interruption: usize,
    /// The last end, if measuring came to one, with the wall time of all.
    pub end: Option<ComparisonEnd>,
    /// Records that could not be read, as the tables name them.
    pub damaged: Vec<String>,
}

impl Comparison {
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join(RECORDS);
        if !folder::is_there(&record::stored(&path)) {
            bail!("no comparison in {}", folder.display());
        }
        Self::from_reading(record::read(&path)?, &path)
    }

    pub fn from_reading(reading: RecordFile, path: &Path) -> anyhow::Result<Self> {
        let damaged = Some(reading.damaged.to_string()).filter(|_| !reading.damaged.is_empty());
        let foreign = !reading.records.is_empty() && !holds_comparison(&reading.records);
        if foreign {
            bail!("no comparison in {}", path.display());
        }
        let mut all = Self::from_records(reading.records).with_context(|| {
            let path = path.display();
            format!("{path} has no readable header, so its other records cannot be interpreted")
        })?;
        all.damaged.splice(0..0, damaged);
        Ok(all)
    }

    /// Sorts records by their kind; none without a header. Of several headers the first holds.
    pub fn from_records(records: impl IntoIterator<Item = Record>) -> Option<Self> {
        let mut header = None;
        let mut all = Self::default();
        for record in records {
            let Record::Comparison(compared) = record else { continue };
            match compared {
                Compared::Header(first) => header = header.or(Some(*first)),
                Compared::Configuration(line) => all.configurations.push(line),
                Compared::Unchanged(line) => all.unchanged.push(line),
                Compared::Changed(line) => all.changed.push(line),
                Compared::Exact(line) => all.exact.push(line),
                Compared::Check(line) => all.checks.push(line),
                Compared::Instructions(line) => all.instructions.push(line),
                Compared::Pair(line) => all.pairs.push(line),
                Compared::Launch(line) => all.launches.push(line),
                Compared::Fault(line) => all.faults.push(line),
                Compared::End(line) => all.set_end(line),
            }
        }
        all.header = header?;
        all.leave_out_launches();
        all.count_whole_launches();
        Some(all)
    }

    /// Both sides' exact figures of a cell and of its configuration are there.
    pub fn has_exact(&self, cell: &CellId) -> bool {
        Side::BOTH.into_iter().all(|side| {
            let (mut exact, mut whole) = (self.exact.iter(), self.configurations.iter());
            exact.any(|line| line.side == side && line.cell == *cell)
                && whole.any(|line| line.side == side && line.configuration == cell.configuration())
        })
    }

    /// The cell asks the GPU for the same on both sides.
    pub fn is_unchanged(&self, cell: &CellId) -> bool {
        self.unchanged.iter().any(|line| line.cells.contains(cell))
    }

    pub fn is_complete(&self) -> bool {
        self.end.as_ref().is_some_and(|end| !end.interrupted)
    }

    fn set_end(&mut self, mut end: ComparisonEnd) {
        if end.interrupted {
            self.faults_before_interruption = self.faults.len();
        }
        end.wall_s += self.end.as_ref().map_or(0.0, |before| before.wall_s);
        self.end = Some(end);
    }

    /// Leaves out launches beyond those that a comparison may have, and says so.
    fn leave_out_launches(&mut self) {
        let max = 2 * MAX_LAUNCHES as usize;
        let left_out = self.launches.len().saturating_sub(max);
        self.launches.truncate(max);
        if left_out > 0 {
            self.damaged.push(format!("{left_out} launches beyond the first {max} were left out"));
        }
    }

    /// Drops the pairs of launches that did not finish. Their numbers are not used again.
    fn count_whole_launches(&mut self) {
        let whole: Vec<u32> = self.launches.iter().map(|launch| launch.launch).collect();
        let paired = self.pairs.iter().map(|pair| pair.launch);
        let failed = self.faults.iter().filter_map(|fault| fault.launch);
        self.last_launch = paired.chain(failed).chain(whole.iter().copied()).max();
        self.pairs.retain(|pair| whole.contains(&pair.launch));
    }
}

/// Lines of the base, each with the head's line of the same key; what one side lacks is left out. Of several lines
/// with one key, which a resumed comparison may have, the last holds.
pub fn pair_sides<'a, T, K: Ord>(
    lines: impl Iterator<Item = &'a T> + Clone,
    key: impl Fn(&'a T) -> (Side, K),
) -> Vec<(&'a T, &'a T)> {
    let last: BTreeMap<(Side, K), &T> = lines.clone().map(|line| (key(line), line)).collect();
    let with_head = |line: &'a T| {
        let own = key(line);
        let holds = own.0 == Side::Base && std::ptr::eq(last[&own], line);
        let head = last.get(&(Side::Head, own.1))?;
        holds.then_some((line, *head))
    };
    lines.filter_map(with_head).collect()
}

/// Records of a comparison, and not of a run.
pub fn holds_comparison(records: &[Record]) -> bool {
    records.iter().any(|record| matches!(record, Record::Comparison(_)))
}

//! Adding runs to a history and getting them out.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use flate2::read::GzDecoder;
use itertools::Itertools;
use jiff::Timestamp;

use super::database::{Database, Value, integer, no_history, other_type, stored_name, text};
use super::run::{MAX_RECORDS, NewFigure, NewRun};
use super::{FORMAT, Origin, short};
use fathom_base::input::{self, Limited};
use fathom_base::text::line;
use fathom_record::Estimate;

/// Rows of one statement. SQLite binds at most 32,766 values.
const ROWS_AT_ONCE: usize = 500;
/// Fewest digits of a run's digest that name it.
const LEAST_DIGITS: usize = 4;
/// The table that says that a database is a history.
const MARK: &str = "fathom_history";

/// Columns of `fathom_series` after the id.
pub(super) const SERIES_COLUMNS: &str =
    "machine, adapter, driver, profile, cell, configuration, figure, unit, clock";
pub(super) const FIGURE_COLUMNS: &str = "series, run, median, low, high, n";
/// Columns of `fathom_run` before the records.
pub(super) const RUN_COLUMNS: &str = "id, digest, commit_name, committed_at, branch, machine, adapter, driver, started_at, cells, figures";

/// An open history.
pub struct History {
    pub(super) database: Database,
}

/// What became of a run that was to be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Added {
    New,
    /// The same records of the same commit were stored before.
    Already,
}

impl History {
    /// Opens a history to read it.
    ///
    /// # Errors
    /// Where there is none, it cannot be reached, is another program's, or has a newer format.
    pub fn open(path: &Path) -> anyhow::Result<History> {
        let mut history = History { database: Database::open(path, false)? };
        if history.is_made()? { Ok(history) } else { Err(no_history(path)) }
    }

    /// The same to add to it. What is not there yet is made with the first run.
    pub fn open_or_make(path: &Path) -> anyhow::Result<History> {
        let mut history = History { database: Database::open(path, true)? };
        history.is_made()?;
        Ok(history)
    }

    /// Whether the tables are there, in this build's format.
    fn is_made(&mut self) -> anyhow::Result<bool> {
        let place = line(&self.database.path.display().to_string());
        let foreign =
            || anyhow!("{place} is the database of another program, so nothing was changed in it");
        let statement = "SELECT COUNT(*) FROM sqlite_master WHERE type = 'table' AND name = $1";
        if self.database.integer(statement, vec![MARK.to_owned().into()])? == 0 {
            let others = self.database.integer("SELECT COUNT(*) FROM sqlite_master", Vec::new())?;
            return if others == 0 { Ok(false) } else { Err(foreign()) };
        }
        let rows = self.database.rows("SELECT format FROM fathom_history", Vec::new())?;
        match rows.first().and_then(|row| row.first()) {
            Some(Value::Integer(FORMAT)) => Ok(true),
            Some(Value::Integer(found)) => bail!(
                "{place} has history format {found}, but this build reads format {FORMAT}: use the build that wrote it"
            ),
            _ => Err(foreign()),
        }
    }

    /// Stores a run, all or nothing. The same run again changes nothing.
    ///
    /// # Errors
    /// Where the same records are stored as another commit's or branch's.
    pub fn add(&mut self, run: &NewRun, origin: &Origin) -> anyhow::Result<Added> {
        self.database.begin()?;
        // Another process may have made them meanwhile.
        if !self.is_made()? {
            self.make()?;
        } else if self.has(run, origin)? {
            self.database.commit()?;
            return Ok(Added::Already);
        }
        let id = self.next_id("fathom_run")?;
        let machines = run.hosts.iter().map(|host| origin.machine(host.as_deref()));
        let machines: Vec<&str> = machines.collect::<Result<_, _>>()?;
        let committed_at = self.commit_time(run, origin)?;
        let row = vec![
            id.into(),
            run.digest.clone().into(),
            stored_name(&origin.commit).into(),
            committed_at.into(),
            stored_name(&origin.branch).into(),
            stored_name(&machines.iter().unique().join(", ")).into(),
            stored_name(&run.adapter).into(),
            stored_name(&run.driver).into(),
            stored_name(&run.started_at).into(),
            (run.cells as i64).into(),
            (run.figures.len() as i64).into(),
            run.packed.clone().into(),
        ];
        self.insert("fathom_run", &format!("{RUN_COLUMNS}, records"), vec![row])?;
        self.add_figures(id, run, origin)?;
        self.database.commit()?;
        Ok(Added::New)
    }

    fn make(&mut self) -> anyhow::Result<()> {
        let statements = [
            "CREATE TABLE fathom_history (format BIGINT NOT NULL)",
            "CREATE TABLE fathom_run (id BIGINT NOT NULL PRIMARY KEY, digest TEXT NOT NULL UNIQUE, \
                 commit_name TEXT NOT NULL, committed_at BIGINT NOT NULL, branch TEXT NOT NULL, machine TEXT NOT NULL, \
                 adapter TEXT NOT NULL, driver TEXT NOT NULL, started_at TEXT NOT NULL, cells BIGINT NOT NULL, \
                 figures BIGINT NOT NULL, records BLOB NOT NULL)",
            // Writers take turns, so no series is stored twice.
            "CREATE TABLE fathom_series (id BIGINT NOT NULL PRIMARY KEY, machine TEXT NOT NULL, adapter TEXT NOT NULL, \
             driver TEXT NOT NULL, profile TEXT NOT NULL, cell TEXT NOT NULL, configuration TEXT NOT NULL, \
             figure TEXT NOT NULL, unit TEXT NOT NULL, clock TEXT NOT NULL)",
            "CREATE TABLE fathom_figure (series BIGINT NOT NULL, run BIGINT NOT NULL, median REAL NOT NULL, \
             low REAL, high REAL, n BIGINT NOT NULL, PRIMARY KEY (series, run)) WITHOUT ROWID",
        ];
        for statement in statements {
            self.database.execute(statement, Vec::new())?;
        }
        let statement = "INSERT INTO fathom_history (format) VALUES ($1)";
        self.database.execute(statement, vec![FORMAT.into()])
    }

    /// The run is stored as one of this commit, on this branch.
    fn has(&mut self, run: &NewRun, origin: &Origin) -> anyhow::Result<bool> {
        let statement = "SELECT commit_name, branch FROM fathom_run WHERE digest = $1";
        let found = self.database.rows(statement, vec![run.digest.clone().into()])?;
        let Some(row) = found.first() else { return Ok(false) };
        let [commit, branch] = [text(&row[0])?, text(&row[1])?];
        if commit == stored_name(&origin.commit) && branch == stored_name(&origin.branch) {
            return Ok(true);
        }
        let digest = short(&run.digest);
        let [commit, branch, other, on] =
            [commit, branch, &origin.commit, &origin.branch].map(line);
        bail!(
            "run {digest} is stored already, as one of commit {commit} on {branch}: the same records cannot be of {other} on {on} too"
        )
    }

    /// As git says; else as the commit's first run was placed; else when this run started.
    fn commit_time(&mut self, run: &NewRun, origin: &Origin) -> anyhow::Result<i64> {
        if let Some(time) = origin.committed_at {
            return Ok(time);
        }
        let statement = "SELECT committed_at FROM fathom_run WHERE commit_name = $1 ORDER BY id";
        let earlier = self.database.rows(statement, vec![stored_name(&origin.commit).into()])?;
        if let Some(row) = earlier.first() {
            return integer(&row[0]);
        }
        let started: Option<Timestamp> = run.started_at.parse().ok();
        started.map(Timestamp::as_second).with_context(|| {
            let commit = line(&origin.commit);
            format!(
                "no repository here has commit {commit}, and the run does not say when it started, so its place in the series is unknown"
            )
        })
    }

    fn next_id(&mut self, table: &str) -> anyhow::Result<i64> {
        let statement = format!("SELECT COALESCE(MAX(id), 0) FROM {table}");
        Ok(self.database.integer(&statement, Vec::new())? + 1)
    }

    fn add_figures(&mut self, run: i64, new: &NewRun, origin: &Origin) -> anyhow::Result<()> {
        let mut known = HashMap::new();
        for host in &new.hosts {
            self.add_known(stored_name(origin.machine(host.as_deref())?), &mut known)?;
        }
        let mut next = self.next_id("fathom_series")?;
        for chunk in new.figures.chunks(ROWS_AT_ONCE) {
            let (mut series, mut figures) = (Vec::new(), Vec::new());
            for NewFigure { key, host, value } in chunk {
                let names = std::iter::once(origin.machine(host.as_deref())?).chain(key.names());
                let names: Vec<Value> = names.map(|name| stored_name(name).into()).collect();
                let id = *known.entry(joined(&names)?).or_insert_with(|| {
                    series.push(std::iter::once(next.into()).chain(names).collect());
                    next += 1;
                    next - 1
                });
                figures.push(figure_row(id, run, value));
            }
            self.insert("fathom_series", &format!("id, {SERIES_COLUMNS}"), series)?;
            self.insert("fathom_figure", FIGURE_COLUMNS, figures)?;
        }
        Ok(())
    }

    /// Adds a machine's series by their names.
    fn add_known(
        &mut self,
        machine: String,
        known: &mut HashMap<String, i64>,
    ) -> anyhow::Result<()> {
        let statement =
            format!("SELECT {SERIES_COLUMNS}, id FROM fathom_series WHERE machine = $1");
        self.database.each(&statement, vec![machine.into()], &mut |row| {
            let [names @ .., id] = row.as_slice() else { return Err(other_type()) };
            known.insert(joined(names)?, integer(id)?);
            Ok(())
        })
    }

    /// Up to [`ROWS_AT_ONCE`] rows.
    fn insert(&mut self, table: &str, columns: &str, rows: Vec<Vec<Value>>) -> anyhow::Result<()> {
        let mut places = 1..;
        let mut place =
            |_: &Value| places.next().map_or_else(String::new, |place| format!("${place}"));
        let row = |row: &Vec<Value>| format!("({})", row.iter().map(&mut place).join(", "));
        if rows.is_empty() {
            return Ok(());
        }
        let values = rows.iter().map(row).join(", ");
        let statement = format!("INSERT INTO {table} ({columns}) VALUES {values}");
        self.database.execute(&statement, rows.into_iter().flatten().collect())
    }

    /// The records of the run whose digest begins so, byte for byte, and the whole digest.
    pub fn records(&mut self, name: &str) -> anyhow::Result<(String, Vec<u8>)> {
        let unknown =
            || anyhow!("no run `{}` in this history; see `fathom history list`", line(name));
        if name.len() < LEAST_DIGITS || !name.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return Err(unknown());
        }
        let statement = "SELECT digest FROM fathom_run WHERE digest LIKE $1";
        let pattern = format!("{}%", name.to_ascii_lowercase());
        let found = self.database.rows(statement, vec![pattern.into()])?;
        let digest = match found.as_slice() {
            [] => return Err(unknown()),
            [row] => text(&row[0])?.to_owned(),
            _ => {
                bail!("`{}` is the beginning of several runs: give more of its digits", line(name))
            }
        };
        let statement = "SELECT records FROM fathom_run WHERE digest = $1";
        let rows = self.database.rows(statement, vec![digest.clone().into()])?;
        let records = match rows.first().map(|row| &row[0]) {
            Some(Value::Blob(packed)) => unpacked(packed, &digest, MAX_RECORDS),
            Some(_) => return Err(other_type()),
            None => None,
        };
        let altered = || {
            let run = short(&digest);
            format!(
                "run {run} came out of the database with other bytes than went in: the database is damaged"
            )
        };
        let records = records.with_context(altered)?;
        Ok((digest, records))
    }
}

/// One name for a row of stored names, none of which holds a line's end.
fn joined(names: &[Value]) -> anyhow::Result<String> {
    names.iter().map(text).process_results(|mut names| names.join("\n"))
}

fn figure_row(series: i64, run: i64, value: &Estimate) -> Vec<Value> {
    vec![
        series.into(),
        run.into(),
        value.median.into(),
        value.interval.map(|interval| interval.low).into(),
        value.interval.map(|interval| interval.high).into(),
        (value.n as i64).into(),
    ]
}

/// Records of this digest; none where others come out. Nothing is kept before that is known, so an archive that has no end
/// takes no memory.
fn unpacked(packed: &[u8], digest: &str, most: u64) -> Option<Vec<u8>> {
    let source = || Limited::new(GzDecoder::new(packed), most);
    if input::sha256(source()).ok()? != digest {
        return None;
    }
    let mut records = Vec::new();
    source().read_to_end(&mut records).ok()?;
    Some(records)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;

    #[test]
    fn only_records_of_the_digest_and_of_a_size_come_out() {
        let records = vec![b'x'; 1 << 20];
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(&records).unwrap();
        let packed = encoder.finish().unwrap();
        let digest = input::sha256(&records[..]).unwrap();
        assert!(unpacked(&packed, &digest, 1 << 20).is_some_and(|found| found == records));
        assert_eq!(unpacked(&packed, &digest, (1 << 20) - 1), None);
        assert_eq!(unpacked(&packed, "0", 1 << 20), None);
        assert_eq!(unpacked(&packed[..packed.len() / 2], &digest, 1 << 20), None);
    }
}

//! A history's file of SQLite, and adding runs to it. Values are bound, never written into a statement.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, anyhow, bail, ensure};
use itertools::Itertools;
use jiff::Timestamp;
use rusqlite::{Connection, OpenFlags, OptionalExtension, TransactionBehavior, params};

use super::run::{NewFigure, NewRun, shorten};
use super::{DEFAULT_FILE, FORMAT, Origin, VARIABLE};
use fathom_base::text::{excerpt, line};

/// How long a writer waits for another one.
const BUSY_TIMEOUT: Duration = Duration::from_secs(60);
/// Of a series, after its id; the machine and then a figure's key.
pub(super) const SERIES_COLUMNS: &str =
    "machine, adapter, driver, profile, cell, configuration, figure, unit, clock";
pub(super) const RUN_COLUMNS: &str = "id, digest, commit_name, committed_at, branch, machine, adapter, driver, started_at, cells, figures";
const TABLES: &str = "
    CREATE TABLE fathom_run (id INTEGER PRIMARY KEY, digest TEXT NOT NULL UNIQUE, commit_name TEXT NOT NULL,
        committed_at INTEGER NOT NULL, branch TEXT NOT NULL, machine TEXT NOT NULL, adapter TEXT NOT NULL, driver TEXT NOT NULL,
        started_at TEXT NOT NULL, cells INTEGER NOT NULL, figures INTEGER NOT NULL);
    CREATE TABLE fathom_series (id INTEGER PRIMARY KEY, machine TEXT NOT NULL, adapter TEXT NOT NULL, driver TEXT NOT NULL,
        profile TEXT NOT NULL, cell TEXT NOT NULL, configuration TEXT NOT NULL, figure TEXT NOT NULL, unit TEXT NOT NULL,
        clock TEXT NOT NULL, UNIQUE (machine, adapter, driver, profile, cell, configuration, figure, unit, clock));
    CREATE TABLE fathom_figure (series INTEGER NOT NULL, run INTEGER NOT NULL, median REAL NOT NULL, low REAL, high REAL,
        n INTEGER NOT NULL, PRIMARY KEY (series, run)) WITHOUT ROWID;
    CREATE TABLE fathom_history (format INTEGER NOT NULL);";
/// Places of their values in a statement.
const ONE_SERIES: &str = "(?, ?, ?, ?, ?, ?, ?, ?, ?)";

/// An open history.
pub struct History {
    path: PathBuf,
    pub(super) connection: Connection,
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
    /// Where there is none, it is another program's, or has another format.
    pub fn open(path: &Path) -> anyhow::Result<History> {
        let history = Self::connect(path, OpenFlags::empty())?;
        ensure!(history.is_made()?, no_history(path));
        Ok(history)
    }

    /// The same to add to it. What is not there yet is made with the first run.
    pub fn open_or_make(path: &Path) -> anyhow::Result<History> {
        let is_address = path.to_string_lossy().contains("://");
        ensure!(!is_address, "a history is a file of SQLite: give its path and no address");
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(|| named(path))?;
        }
        let history = Self::connect(path, OpenFlags::SQLITE_OPEN_CREATE)?;
        history.is_made()?;
        Ok(history)
    }

    fn connect(path: &Path, create: OpenFlags) -> anyhow::Result<History> {
        match std::fs::metadata(path) {
            Ok(found) => ensure!(found.is_file(), "{} is no regular file", path.display()),
            Err(_) => ensure!(!create.is_empty(), no_history(path)),
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX | create;
        // The library's own message names the file.
        let why = |error: rusqlite::Error| error.sqlite_error().map(ToString::to_string);
        let opened = Connection::open_with_flags(path, flags);
        let connection = opened
            .map_err(|error| anyhow!("{}: {}", named(path), why(error).unwrap_or_default()))?;
        connection.busy_timeout(BUSY_TIMEOUT)?;
        Ok(History { path: path.to_owned(), connection })
    }

    /// Whether the tables are there, in this build's format.
    fn is_made(&self) -> anyhow::Result<bool> {
        // The library's message of a damaged table may quote lines of it.
        let quoted = |error| anyhow!("{}: {}", named(&self.path), excerpt(&format!("{error:#}")));
        is_made(&self.connection).map_err(quoted)
    }

    /// Stores a run, all or nothing. The same run again changes nothing.
    ///
    /// # Errors
    /// Where the same records are stored as another commit's or branch's.
    pub fn add(&mut self, run: &NewRun, origin: &Origin) -> anyhow::Result<Added> {
        let immediate = TransactionBehavior::Immediate;
        let transaction = self.connection.transaction_with_behavior(immediate)?;
        // Another process may have made them meanwhile.
        if !is_made(&transaction)? {
            transaction.execute_batch(TABLES)?;
            transaction.execute("INSERT INTO fathom_history (format) VALUES (?)", [FORMAT])?;
        } else if has(&transaction, run, origin)? {
            return Ok(Added::Already);
        }
        let machines = run.hosts.iter().map(|host| origin.machine(host.as_deref()));
        let machines: Vec<&str> = machines.collect::<Result<_, _>>()?;
        transaction.execute(
            &format!(
                "INSERT INTO fathom_run ({RUN_COLUMNS}) VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
            ),
            params![
                run.digest,
                origin.commit,
                commit_time(&transaction, run, origin)?,
                origin.branch,
                machines.iter().unique().join(", "),
                run.adapter,
                run.driver,
                run.started_at,
                run.cells as i64,
                run.figures.len() as i64,
            ],
        )?;
        let id = transaction.last_insert_rowid();
        add_figures(&transaction, id, run, origin)?;
        transaction.commit()?;
        Ok(Added::New)
    }
}

fn no_history(path: &Path) -> String {
    format!("there is no history in {}: `fathom history add DIR` makes one", named(path))
}

/// A history's file for messages. What names no file may hold a password: it is not repeated.
fn named(path: &Path) -> String {
    if path.exists() || path == Path::new(DEFAULT_FILE) {
        return line(&path.display().to_string());
    }
    format!("the file that --db or {VARIABLE} names")
}

fn is_made(connection: &Connection) -> anyhow::Result<bool> {
    let made = "SELECT name, tbl_name, sql FROM sqlite_master WHERE sql IS NOT NULL";
    let row = |row: &rusqlite::Row<'_>| Ok([row.get(0)?, row.get(1)?, row.get(2)?]);
    let made: Vec<[String; 3]> = connection.prepare(made)?.query_map([], row)?.try_collect()?;
    if !made.iter().any(|[name, ..]| name == "fathom_history") {
        let is_empty = made.is_empty();
        ensure!(is_empty, "it is the database of another program, so nothing was changed in it");
        return Ok(false);
    }
    // A view, a virtual table, a computed column, or an index or a trigger on a table may do anything.
    let is_own = |table: &str| table.to_lowercase().starts_with("fathom_");
    let is_foreign = |[_, table, sql]: &&[String; 3]| is_own(table) && !TABLES.contains(&**sql);
    if let Some([name, ..]) = made.iter().find(is_foreign) {
        bail!("`{name}` in it was not made by this build of fathom: begin another history");
    }
    let format: i64 =
        connection.query_row("SELECT format FROM fathom_history", [], |row| row.get(0))?;
    ensure!(
        format == FORMAT,
        "it has history format {format}, but this build reads format {FORMAT}: use the build that wrote it"
    );
    // Pages of a damaged table may refer to one another without end.
    for [table, ..] in made.iter().filter(|[_, table, _]| is_own(table)) {
        let check = format!("PRAGMA quick_check({table})");
        let found: String = connection.query_row(&check, [], |row| row.get(0))?;
        ensure!(found == "ok", "its table {table} is damaged");
    }
    Ok(true)
}

/// The run is stored as one of this commit, on this branch.
fn has(connection: &Connection, run: &NewRun, origin: &Origin) -> anyhow::Result<bool> {
    let statement = "SELECT commit_name, branch FROM fathom_run WHERE digest = ?";
    let place = |row: &rusqlite::Row<'_>| Ok([row.get(0)?, row.get(1)?]);
    let found = connection.query_row(statement, [&run.digest], place).optional()?;
    let Some([commit, branch]): Option<[String; 2]> = found else { return Ok(false) };
    if commit == origin.commit && branch == origin.branch {
        return Ok(true);
    }
    let digest = shorten(&run.digest);
    let [commit, branch, other, on] =
        [&commit, &branch, &origin.commit, &origin.branch].map(|name| line(name));
    bail!(
        "run {digest} is stored already, as one of commit {commit} on {branch}: the same records cannot be of {other} on {on} too"
    )
}

/// As git says; else as the commit's first run was placed; else when this run started.
fn commit_time(connection: &Connection, run: &NewRun, origin: &Origin) -> anyhow::Result<i64> {
    if let Some(time) = origin.committed_at {
        return Ok(time);
    }
    let statement = "SELECT committed_at FROM fathom_run WHERE commit_name = ? ORDER BY id LIMIT 1";
    let earlier = connection.query_row(statement, [&origin.commit], |row| row.get(0)).optional()?;
    let started = || run.started_at.parse().ok().map(Timestamp::as_second);
    earlier.or_else(started).with_context(|| {
        let commit = line(&origin.commit);
        format!(
            "no repository here has commit {commit}, and the run does not say when it started, so its place in the series is unknown"
        )
    })
}

fn add_figures(
    connection: &Connection,
    run: i64,
    new: &NewRun,
    origin: &Origin,
) -> anyhow::Result<()> {
    let mut add = connection.prepare(&format!(
        "INSERT OR IGNORE INTO fathom_series ({SERIES_COLUMNS}) VALUES {ONE_SERIES}"
    ))?;
    let find = format!("SELECT id FROM fathom_series WHERE ({SERIES_COLUMNS}) = {ONE_SERIES}");
    let mut find = connection.prepare(&find)?;
    let mut put = connection.prepare("INSERT INTO fathom_figure VALUES (?, ?, ?, ?, ?, ?)")?;
    for NewFigure { key, host, value } in &new.figures {
        let [adapter, driver, profile, cell, configuration, figure, unit, clock] = key.names();
        let machine = origin.machine(host.as_deref())?;
        let names = [machine, adapter, driver, profile, cell, configuration, figure, unit, clock];
        add.execute(names)?;
        let series: i64 = find.query_row(names, |row| row.get(0))?;
        let ends = value.interval.map(|interval| (interval.low, interval.high)).unzip();
        put.execute(params![series, run, value.median, ends.0, ends.1, value.n as i64])?;
    }
    Ok(())
}

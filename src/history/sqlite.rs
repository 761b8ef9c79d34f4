//! A history in a file of SQLite.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, params_from_iter};

use anyhow::{anyhow, bail};

use super::database::{
    Database, Dialect, MOST_BYTES, MOST_ROWS, Value, counted, fault_of, no_history, too_much,
};
use fathom_base::input;

/// How long a writer waits for another one.
const PATIENCE: Duration = Duration::from_secs(60);
/// First bytes of a file of SQLite. <https://www.sqlite.org/fileformat.html>, section 1.3.
const MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// Statements of several sizes are prepared once each.
const PREPARED: usize = 32;

/// Steps of SQLite's machine between two calls of the handler that counts them.
const STEPS_AT_ONCE: i32 = 100_000;
/// Most of these spans in one statement: ten steps for each of [`MOST_ROWS`], and as many again for the search. A file may
/// hold views in place of its tables, and theirs may be endless.
const MOST_SPANS: u32 = (20 * MOST_ROWS / STEPS_AT_ONCE as usize) as u32;
/// Longest name or run of records, bytes.
const MOST_LENGTH: i32 = MOST_BYTES as i32;

pub struct Sqlite {
    path: PathBuf,
    connection: Connection,
    /// Spans of the statement that runs.
    steps: Arc<AtomicU32>,
}

impl Sqlite {
    pub fn open(path: &Path, writable: bool) -> anyhow::Result<Sqlite> {
        check(path, writable)?;
        let mut flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        flags.set(OpenFlags::SQLITE_OPEN_CREATE, writable);
        let steps = Arc::new(AtomicU32::new(0));
        let counted = Arc::clone(&steps);
        let opened = Connection::open_with_flags(path, flags).and_then(|mut connection| {
            connection.busy_timeout(PATIENCE)?;
            connection.set_prepared_statement_cache_capacity(PREPARED);
            // As SQLite advises for files of others: <https://www.sqlite.org/security.html>, section 1.2.
            connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, MOST_LENGTH)?;
            connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
            let is_endless = move || counted.fetch_add(1, Ordering::Relaxed) >= MOST_SPANS;
            connection.progress_handler(STEPS_AT_ONCE, Some(is_endless))?;
            Ok(connection)
        });
        let connection = opened.map_err(fault(path))?;
        Ok(Sqlite { path: path.to_owned(), connection, steps })
    }
}

/// Names the file, and makes the folder of a new one.
fn check(path: &Path, writable: bool) -> anyhow::Result<()> {
    let io = |source| anyhow!("cannot read {}: {source}", path.display());
    match std::fs::metadata(path) {
        Ok(found) if found.is_file() && found.len() == 0 => Ok(()),
        Ok(_) => {
            let mut begin = [0; MAGIC.len()];
            let read = input::open(path).and_then(|mut file| file.read_exact(&mut begin));
            let is_sqlite = read.is_ok() && &begin == MAGIC;
            if !is_sqlite {
                bail!("{} is no database of SQLite", path.display());
            }
            Ok(())
        }
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(io(error)),
        Err(_) if !writable => Err(no_history(&path.display().to_string())),
        Err(_) => match path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            Some(folder) => std::fs::create_dir_all(folder).map_err(io),
            None => Ok(()),
        },
    }
}

fn fault(path: &Path) -> impl Fn(rusqlite::Error) -> anyhow::Error + use<> {
    let place = path.display().to_string();
    move |error| match error.sqlite_error_code() {
        Some(ErrorCode::OperationInterrupted) => {
            let steps = u64::from(MOST_SPANS) * STEPS_AT_ONCE as u64;
            too_much(&format!("no end within {steps} steps"))
        }
        _ => fault_of(&place, &error.to_string()),
    }
}

impl Database for Sqlite {
    fn dialect(&self) -> Dialect {
        Dialect {
            bytes: "BLOB",
            real: "REAL",
            by_key: " WITHOUT ROWID",
            count_of_table: "SELECT COUNT(*) FROM sqlite_master WHERE type = 'table' AND name = $1",
            count_of_all: Some("SELECT COUNT(*) FROM sqlite_master"),
        }
    }

    fn begin(&mut self) -> anyhow::Result<()> {
        self.execute("BEGIN IMMEDIATE", Vec::new())
    }

    fn each(
        &mut self,
        statement: &str,
        values: Vec<Value>,
        take: &mut dyn FnMut(Vec<Value>) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        self.steps.store(0, Ordering::Relaxed);
        let fault = fault(&self.path);
        let mut prepared = self.connection.prepare_cached(statement).map_err(&fault)?;
        let columns = prepared.column_count();
        let mut rows = prepared.query(params_from_iter(&values)).map_err(&fault)?;
        let mut count = 0;
        while let Some(row) = rows.next().map_err(&fault)? {
            counted(&mut count)?;
            let values = (0..columns).map(|column| value(row.get_ref(column)?));
            take(values.collect::<rusqlite::Result<_>>().map_err(&fault)?)?;
        }
        Ok(())
    }
}

fn value(stored: ValueRef<'_>) -> rusqlite::Result<Value> {
    match stored {
        ValueRef::Text(text) => Ok(Value::Text(String::from_utf8_lossy(text).into_owned())),
        other => Ok(other.try_into()?),
    }
}

//! A history in a file of SQLite.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rusqlite::types::{ToSqlOutput, Value as Stored, ValueRef};
use rusqlite::{Connection, OpenFlags, ToSql, params_from_iter};

use super::HistoryError;
use super::database::{ColumnTypes, Database, FigureRow, Value};
use crate::input;

/// How long a writer waits for another one.
const PATIENCE: Duration = Duration::from_secs(60);
/// First bytes of a file of SQLite. <https://www.sqlite.org/fileformat.html>, section 1.3.
const MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// Statements of several sizes are prepared once each.
const PREPARED: usize = 32;

pub struct Sqlite {
    path: PathBuf,
    connection: Connection,
}

impl Sqlite {
    pub fn open(path: &Path, writable: bool) -> Result<Sqlite, HistoryError> {
        check(path, writable)?;
        let mut flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        flags.set(OpenFlags::SQLITE_OPEN_CREATE, writable);
        let opened = Connection::open_with_flags(path, flags).and_then(|connection| {
            connection.busy_timeout(PATIENCE)?;
            connection.set_prepared_statement_cache_capacity(PREPARED);
            Ok(connection)
        });
        match opened {
            Ok(connection) => Ok(Sqlite { path: path.to_owned(), connection }),
            Err(error) => Err(fault(path)(error)),
        }
    }

    fn fault(&self) -> impl Fn(rusqlite::Error) -> HistoryError + use<> {
        fault(&self.path)
    }
}

/// Names the file, and makes the folder of a new one.
fn check(path: &Path, writable: bool) -> Result<(), HistoryError> {
    let io = |source| HistoryError::Read { path: path.to_owned(), source };
    match std::fs::metadata(path) {
        Ok(found) if !found.is_file() => Err(HistoryError::NotSqlite { path: path.to_owned() }),
        Ok(found) if found.len() == 0 => Ok(()),
        Ok(_) => {
            let mut begin = [0; MAGIC.len()];
            let read = input::open(path).and_then(|mut file| file.read_exact(&mut begin));
            if read.is_ok() && &begin == MAGIC {
                return Ok(());
            }
            Err(HistoryError::NotSqlite { path: path.to_owned() })
        }
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(io(error)),
        Err(_) if !writable => Err(HistoryError::NoHistory { place: path.display().to_string() }),
        Err(_) => match path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            Some(folder) => std::fs::create_dir_all(folder).map_err(io),
            None => Ok(()),
        },
    }
}

fn fault(path: &Path) -> impl Fn(rusqlite::Error) -> HistoryError + use<> {
    let place = path.display().to_string();
    move |error| HistoryError::Database { place: place.clone(), message: error.to_string() }
}

impl ToSql for Value {
    fn to_sql(&self) -> rusqlite::Result<ToSqlOutput<'_>> {
        Ok(match self {
            Value::Null => ToSqlOutput::Owned(Stored::Null),
            Value::Integer(integer) => ToSqlOutput::Owned(Stored::Integer(*integer)),
            Value::Real(real) => ToSqlOutput::Owned(Stored::Real(*real)),
            Value::Text(text) => ToSqlOutput::Borrowed(ValueRef::Text(text.as_bytes())),
            Value::Bytes(bytes) => ToSqlOutput::Borrowed(ValueRef::Blob(bytes)),
        })
    }
}

impl Database for Sqlite {
    fn types(&self) -> ColumnTypes {
        ColumnTypes { bytes: "BLOB", real: "REAL", by_key: " WITHOUT ROWID" }
    }

    fn count_of_table(&self) -> &'static str {
        "SELECT COUNT(*) FROM sqlite_master WHERE type = 'table' AND name = $1"
    }

    fn is_foreign(&mut self) -> Result<bool, HistoryError> {
        let rows = self.rows("SELECT COUNT(*) FROM sqlite_master", &[])?;
        Ok(rows[0][0].integer() > 0)
    }

    fn begin(&mut self) -> Result<(), HistoryError> {
        self.connection.execute_batch("BEGIN IMMEDIATE").map_err(self.fault())
    }

    fn commit(&mut self) -> Result<(), HistoryError> {
        self.connection.execute_batch("COMMIT").map_err(self.fault())
    }

    fn execute(&mut self, statement: &str, values: &[Value]) -> Result<(), HistoryError> {
        let prepared = self.connection.prepare_cached(statement);
        let executed = prepared.and_then(|mut it| it.execute(params_from_iter(values)));
        executed.map(drop).map_err(self.fault())
    }

    fn rows(&mut self, statement: &str, values: &[Value]) -> Result<Vec<Vec<Value>>, HistoryError> {
        let read = || -> rusqlite::Result<Vec<Vec<Value>>> {
            let mut prepared = self.connection.prepare_cached(statement)?;
            let columns = prepared.column_count();
            let mut rows = prepared.query(params_from_iter(values))?;
            let mut found = Vec::new();
            while let Some(row) = rows.next()? {
                let values = (0..columns).map(|column| row.get_ref(column).map(value));
                found.push(values.collect::<rusqlite::Result<_>>()?);
            }
            Ok(found)
        };
        read().map_err(self.fault())
    }

    fn each_figure(
        &mut self,
        statement: &str,
        values: &[Value],
        take: &mut dyn FnMut(FigureRow),
    ) -> Result<(), HistoryError> {
        let mut read = || -> rusqlite::Result<()> {
            let mut prepared = self.connection.prepare_cached(statement)?;
            let mut rows = prepared.query(params_from_iter(values))?;
            while let Some(row) = rows.next()? {
                take(FigureRow {
                    series: row.get(0)?,
                    run: row.get(1)?,
                    median: row.get(2)?,
                    low: row.get(3)?,
                    high: row.get(4)?,
                    n: row.get(5)?,
                });
            }
            Ok(())
        };
        let read = read();
        read.map_err(self.fault())
    }
}

fn value(stored: ValueRef<'_>) -> Value {
    match stored {
        ValueRef::Null => Value::Null,
        ValueRef::Integer(integer) => Value::Integer(integer),
        ValueRef::Real(real) => Value::Real(real),
        ValueRef::Text(text) => Value::Text(String::from_utf8_lossy(text).into_owned()),
        ValueRef::Blob(bytes) => Value::Bytes(bytes.to_owned()),
    }
}

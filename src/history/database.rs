//! A history's file of SQLite. Values are bound, never written into a statement.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, anyhow, bail, ensure};
use fathom_base::input;
use fathom_base::text::line;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags, params_from_iter};

pub use rusqlite::types::Value;

/// How long a writer waits for another one.
const PATIENCE: Duration = Duration::from_secs(60);
/// First bytes of a file of SQLite. <https://www.sqlite.org/fileformat.html>, section 1.3.
const MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// Statements of several sizes are prepared once each.
const PREPARED: usize = 32;

/// The file of a history, by what a user gave as its place.
///
/// # Errors
/// What looks like a connection to a server may hold a password. It is neither shown nor taken for a file's name.
pub fn location(text: &str) -> anyhow::Result<PathBuf> {
    ensure!(
        !looks_like_url(text),
        "a history is a file of SQLite, and its place looks like a URL: it is not shown, as it may hold a password"
    );
    Ok(text.into())
}

/// It begins with a scheme (RFC 3986, 3.1; a letter alone is a drive), or is what libpq takes for a connection.
fn looks_like_url(text: &str) -> bool {
    let text = text.trim_start().to_ascii_lowercase();
    let scheme = text.split_once(':').is_some_and(|(scheme, _)| {
        scheme.len() > 1
            && scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    });
    scheme || text.contains("://") || text.contains("password=")
}

pub fn no_history(path: &Path) -> anyhow::Error {
    anyhow!("there is no history in {}: `fathom history add DIR` makes one", path.display())
}

pub fn other_type() -> anyhow::Error {
    anyhow!("a column has another type than this build stores: the database is damaged")
}

/// A text as it is stored: control characters and `\` are escaped, and different names stay different.
pub fn stored_name(text: &str) -> String {
    let escaped = text.chars().map(|c| match c {
        '\\' => "\\\\".to_owned(),
        c if c.is_control() => c.escape_unicode().to_string(),
        c => c.to_string(),
    });
    escaped.collect()
}

pub fn integer(value: &Value) -> anyhow::Result<i64> {
    if let Value::Integer(integer) = value { Ok(*integer) } else { Err(other_type()) }
}

pub fn text(value: &Value) -> anyhow::Result<&str> {
    if let Value::Text(text) = value { Ok(text) } else { Err(other_type()) }
}

pub struct Database {
    pub path: PathBuf,
    connection: Connection,
}

impl Database {
    /// Only where it is `writable` a file is made that is not there.
    pub fn open(path: &Path, writable: bool) -> anyhow::Result<Self> {
        check(path, writable)?;
        let mut flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        flags.set(OpenFlags::SQLITE_OPEN_CREATE, writable);
        let opened = Connection::open_with_flags(path, flags).and_then(|connection| {
            connection.busy_timeout(PATIENCE)?;
            connection.set_prepared_statement_cache_capacity(PREPARED);
            Ok(connection)
        });
        let connection = opened.map_err(fault(path))?;
        Ok(Self { path: path.to_owned(), connection })
    }

    /// Begins a transaction that no other writer shares. Without [`Self::commit`] nothing of it stays.
    pub fn begin(&mut self) -> anyhow::Result<()> {
        self.execute("BEGIN IMMEDIATE", Vec::new())
    }

    pub fn commit(&mut self) -> anyhow::Result<()> {
        self.execute("COMMIT", Vec::new())
    }

    /// Calls `take` with each row of a statement.
    pub fn each(
        &mut self,
        statement: &str,
        values: Vec<Value>,
        take: &mut dyn FnMut(Vec<Value>) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let fault = fault(&self.path);
        let mut prepared = self.connection.prepare_cached(statement).map_err(&fault)?;
        let columns = prepared.column_count();
        let mut rows = prepared.query(params_from_iter(&values)).map_err(&fault)?;
        while let Some(row) = rows.next().map_err(&fault)? {
            let values = (0..columns).map(|column| value(row.get_ref(column)?));
            take(values.collect::<rusqlite::Result<_>>().map_err(&fault)?)?;
        }
        Ok(())
    }

    pub fn execute(&mut self, statement: &str, values: Vec<Value>) -> anyhow::Result<()> {
        self.each(statement, values, &mut |_| Ok(()))
    }

    /// All rows of a statement.
    pub fn rows(&mut self, statement: &str, values: Vec<Value>) -> anyhow::Result<Vec<Vec<Value>>> {
        let mut rows = Vec::new();
        self.each(statement, values, &mut |row| {
            rows.push(row);
            Ok(())
        })?;
        Ok(rows)
    }

    /// The integer that a statement gives.
    pub fn integer(&mut self, statement: &str, values: Vec<Value>) -> anyhow::Result<i64> {
        let rows = self.rows(statement, values)?;
        integer(rows.first().and_then(|row| row.first()).context("a statement gave no row")?)
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
        Err(_) if !writable => Err(no_history(path)),
        Err(_) => match path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            Some(folder) => std::fs::create_dir_all(folder).map_err(io),
            None => Ok(()),
        },
    }
}

fn fault(path: &Path) -> impl Fn(rusqlite::Error) -> anyhow::Error + use<> {
    let place = path.display().to_string();
    move |error| anyhow!("{}: {}", line(&place), line(&error.to_string()))
}

fn value(stored: ValueRef<'_>) -> rusqlite::Result<Value> {
    match stored {
        ValueRef::Text(text) => Ok(Value::Text(String::from_utf8_lossy(text).into_owned())),
        other => Ok(other.try_into()?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_stored_without_control_characters_and_stay_different() {
        assert_eq!(stored_name("Größe 'x\"; DROP"), "Größe 'x\"; DROP");
        assert_eq!(stored_name("a\0b"), "a\\u{0}b");
        assert_ne!(stored_name("a\0b"), stored_name("a\\u{0}b"));
    }

    #[test]
    fn what_may_hold_a_password_is_no_file_and_is_not_shown() {
        for path in ["a/b.sqlite", "C:/b.sqlite", "./a:b", "/tmp/x:y", "password"] {
            assert_eq!(location(path).unwrap(), Path::new(path));
        }
        for url in [
            "postgres://u:secret@h/d",
            " mysql:u:secret@h",
            "host=h PASSWORD=secret",
            "a b://secret",
        ] {
            let message = location(url).unwrap_err().to_string();
            assert!(
                !message.contains("secret") && message.lines().count() == 1,
                "{url}: {message}"
            );
        }
    }
}

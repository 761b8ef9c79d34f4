//! The two databases behind one set of statements. Values are bound, never written into a statement.

#[cfg(feature = "postgres")]
use super::postgres::Postgres;
use super::sqlite::Sqlite;
use fathom_base::text::line;
use std::fmt;
use std::path::PathBuf;

use anyhow::anyhow;

pub use rusqlite::types::Value;

/// Most rows of one statement: figures of 16,000 runs with 1,000 each.
pub const MOST_ROWS: usize = 16_000_000;
/// Most bytes of names and records of one statement.
pub const MOST_BYTES: usize = 512 << 20;

/// Where a history lies.
#[derive(Clone, PartialEq, Eq)]
pub enum Location {
    /// A file of SQLite.
    File(PathBuf),
    /// A PostgreSQL database. Its URL may hold a password, so it is never printed.
    Server {
        url: String,
        /// The connection is not encrypted, also to another host.
        unencrypted: bool,
    },
}

impl Location {
    /// A URL begins with `postgres://` or `postgresql://`; a path is anything else that looks like no URL.
    ///
    /// # Errors
    /// Other URLs: one of another program may hold a password, which must not become the name of a file.
    pub fn new(text: &str, unencrypted: bool) -> anyhow::Result<Location> {
        if ["postgres://", "postgresql://"].iter().any(|scheme| text.starts_with(scheme)) {
            return Ok(Location::Server { url: text.to_owned(), unencrypted });
        }
        if looks_like_url(text) { Err(no_place()) } else { Ok(Location::File(text.into())) }
    }
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

impl fmt::Debug for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => path.fmt(f),
            Self::Server { .. } => f.write_str("a server"),
        }
    }
}

pub fn no_place() -> anyhow::Error {
    anyhow!(
        "the place of the history is not understood, and not shown as it may hold a password: say a path, \
         or postgres://USER:PASSWORD@HOST/DATABASE, where a `@`, `/` or `?` of a name or password is %40, %2F or %3F"
    )
}

pub fn no_history(place: &str) -> anyhow::Error {
    anyhow!("there is no history in {}: `fathom history add DIR` makes one", line(place))
}

pub fn fault_of(place: &str, message: &str) -> anyhow::Error {
    anyhow!("{}: {}", line(place), line(message))
}

pub fn too_much(what: &str) -> anyhow::Error {
    anyhow!(
        "a statement gave {what}, and no history holds so much: the database is damaged, or not fathom's; --since takes a part"
    )
}

pub fn other_type() -> anyhow::Error {
    anyhow!("a column has another type than this build stores: the database is damaged")
}

/// A text as it is stored: control characters and `\` are escaped. PostgreSQL refuses NUL, and different names stay different.
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

/// Adds what a row's names and records take, and refuses what goes beyond [`MOST_BYTES`].
pub fn keep(bytes: &mut usize, row: &[Value]) -> anyhow::Result<()> {
    let size = |value: &Value| match value {
        Value::Text(text) => text.len(),
        Value::Blob(bytes) => bytes.len(),
        Value::Null | Value::Integer(_) | Value::Real(_) => 0,
    };
    *bytes += row.iter().map(size).sum::<usize>();
    if *bytes > MOST_BYTES {
        return Err(too_much(&format!("more than {} MiB", MOST_BYTES >> 20)));
    }
    Ok(())
}

/// Where the languages of the databases differ.
pub struct Dialect {
    /// Types of columns.
    pub bytes: &'static str,
    pub real: &'static str,
    /// Behind a table whose rows lie in the order of its primary key.
    pub by_key: &'static str,
    /// Counts the tables of a name.
    pub count_of_table: &'static str,
    /// Counts everything, where a history has a database to itself.
    pub count_of_all: Option<&'static str>,
}

/// What this build needs of a database. Statements have parameters `$1`, `$2`, …, each first used in this order.
pub trait Database {
    fn dialect(&self) -> Dialect;

    /// Begins a transaction that no other writer shares. Without [`Self::commit`] nothing of it stays.
    fn begin(&mut self) -> anyhow::Result<()>;

    fn commit(&mut self) -> anyhow::Result<()> {
        self.execute("COMMIT", Vec::new())
    }

    /// Calls `take` with each row of a statement. One that goes on beyond all that a history holds is an error.
    fn each(
        &mut self,
        statement: &str,
        values: Vec<Value>,
        take: &mut dyn FnMut(Vec<Value>) -> anyhow::Result<()>,
    ) -> anyhow::Result<()>;

    fn execute(&mut self, statement: &str, values: Vec<Value>) -> anyhow::Result<()> {
        self.each(statement, values, &mut |_| Ok(()))
    }

    /// All rows of a statement.
    fn rows(&mut self, statement: &str, values: Vec<Value>) -> anyhow::Result<Vec<Vec<Value>>> {
        let (mut rows, mut bytes) = (Vec::new(), 0);
        self.each(statement, values, &mut |row| {
            keep(&mut bytes, &row)?;
            rows.push(row);
            Ok(())
        })?;
        Ok(rows)
    }

    /// The integer that a statement gives.
    fn integer(&mut self, statement: &str, values: Vec<Value>) -> anyhow::Result<i64> {
        integer(&self.rows(statement, values)?[0][0])
    }
}

/// Counts a row, and refuses those beyond [`MOST_ROWS`].
pub fn counted(rows: &mut usize) -> anyhow::Result<()> {
    *rows += 1;
    if *rows > MOST_ROWS {
        return Err(too_much(&format!("more than {MOST_ROWS} rows")));
    }
    Ok(())
}

/// Opens a database. Only where it is `writable` a file is made that is not there.
pub fn open(location: &Location, writable: bool) -> anyhow::Result<Box<dyn Database>> {
    Ok(match location {
        Location::File(path) => Box::new(Sqlite::open(path, writable)?),
        #[cfg(feature = "postgres")]
        Location::Server { url, unencrypted } => Box::new(Postgres::connect(url, *unencrypted)?),
        #[cfg(not(feature = "postgres"))]
        Location::Server { .. } => anyhow::bail!(
            "this build of fathom cannot reach PostgreSQL: build it with `cargo build --release --locked --features postgres`"
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_of_another_type_is_an_error() {
        assert!(integer(&Value::Text("1".to_owned())).is_err());
        assert!(text(&Value::Integer(1)).is_err());
        assert_eq!(integer(&Value::Integer(1)).unwrap(), 1);
    }

    #[test]
    fn names_are_stored_without_control_characters_and_stay_different() {
        assert_eq!(stored_name("Größe 'x\"; DROP"), "Größe 'x\"; DROP");
        assert_eq!(stored_name("a\0b"), "a\\u{0}b");
        assert_ne!(stored_name("a\0b"), stored_name("a\\u{0}b"));
    }

    #[test]
    fn what_may_hold_a_password_is_no_file_and_is_not_shown() {
        let new = |text: &str| Location::new(text, false);
        for url in ["postgres://u@h/d", "postgresql://h"] {
            assert!(matches!(new(url), Ok(Location::Server { .. })));
            assert!(!format!("{:?}", new(url)).contains("h/d"));
        }
        for path in ["a/b.sqlite", "C:/b.sqlite", "./a:b", "/tmp/x:y", "password"] {
            assert_eq!(new(path).unwrap(), Location::File(path.into()));
        }
        for url in [
            "Postgres://user:secret@h/d",
            " postgres://user:secret@h/d",
            "jdbc:postgresql:secret",
            "JDBC:x//secret",
            "mysql://user:secret@h/d",
            "a b://secret",
            "postgres:user:secret@h",
            "host=h password=secret",
            "//h?PASSWORD=secret",
        ] {
            let told = new(url).unwrap_err().to_string();
            assert!(!told.contains("secret") && told.lines().count() == 1, "{url}: {told}");
        }
    }
}

//! The two databases behind one set of statements. Values are bound, never written into a statement.

use super::HistoryError;
use super::postgres::Postgres;
use super::sqlite::Sqlite;
use std::path::PathBuf;

/// Where a history lies.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Location {
    /// A file of SQLite.
    File(PathBuf),
    /// URL of a PostgreSQL database. It may hold a password, so it is never printed.
    Url(String),
}

impl Location {
    /// A URL begins with `postgres://` or `postgresql://`; anything else is a path.
    pub fn new(text: &str) -> Location {
        let is_url = ["postgres://", "postgresql://"].iter().any(|scheme| text.starts_with(scheme));
        if is_url { Location::Url(text.to_owned()) } else { Location::File(text.into()) }
    }
}

/// Something that a database stores.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    Null,
    Integer(i64),
    Real(f64),
    Text(String),
    Bytes(Vec<u8>),
}

impl Value {
    /// A text in which control characters and `\` are escaped: PostgreSQL refuses NUL, and different names stay different.
    pub fn name(text: &str) -> Value {
        let escaped = text.chars().map(|c| match c {
            '\\' => "\\\\".to_owned(),
            c if c.is_control() => c.escape_unicode().to_string(),
            c => c.to_string(),
        });
        Value::Text(escaped.collect())
    }

    pub fn integer(&self) -> i64 {
        if let Value::Integer(integer) = self { *integer } else { 0 }
    }

    pub fn text(&self) -> String {
        if let Value::Text(text) = self { text.clone() } else { String::new() }
    }

    pub fn bytes(&self) -> &[u8] {
        if let Value::Bytes(bytes) = self { bytes } else { &[] }
    }
}

/// A stored figure of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FigureRow {
    pub series: i64,
    pub run: i64,
    pub median: f64,
    pub low: Option<f64>,
    pub high: Option<f64>,
    pub n: i64,
}

/// Types of columns that the databases name differently.
pub struct ColumnTypes {
    pub bytes: &'static str,
    pub real: &'static str,
    /// Behind a table whose rows lie in the order of its primary key.
    pub by_key: &'static str,
}

/// What this build needs of a database. Statements have parameters `$1`, `$2`, …, each first used in this order.
pub trait Database {
    fn types(&self) -> ColumnTypes;

    /// The statement that counts the tables of a name.
    fn count_of_table(&self) -> &'static str;

    /// A table of this name exists.
    fn has_table(&mut self, name: &str) -> Result<bool, HistoryError> {
        let rows = self.rows(self.count_of_table(), &[Value::Text(name.to_owned())])?;
        Ok(rows[0][0].integer() > 0)
    }

    /// It holds tables, and they are another program's alone.
    fn is_foreign(&mut self) -> Result<bool, HistoryError>;

    /// Begins a transaction that no other writer shares. Without [`Self::commit`] nothing of it stays.
    fn begin(&mut self) -> Result<(), HistoryError>;

    fn commit(&mut self) -> Result<(), HistoryError>;

    fn execute(&mut self, statement: &str, values: &[Value]) -> Result<(), HistoryError>;

    fn rows(&mut self, statement: &str, values: &[Value]) -> Result<Vec<Vec<Value>>, HistoryError>;

    /// Calls `take` with each row of a statement that selects series, run, median, low, high and n.
    fn each_figure(
        &mut self,
        statement: &str,
        values: &[Value],
        take: &mut dyn FnMut(FigureRow),
    ) -> Result<(), HistoryError>;
}

/// Opens a database. Only where it is `writable` a file is made that is not there.
pub fn open(location: &Location, writable: bool) -> Result<Box<dyn Database>, HistoryError> {
    Ok(match location {
        Location::File(path) => Box::new(Sqlite::open(path, writable)?),
        Location::Url(url) => Box::new(Postgres::connect(url)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_stored_without_control_characters_and_stay_different() {
        let stored = |text: &str| Value::name(text).text();
        assert_eq!(stored("Größe 'x\"; DROP"), "Größe 'x\"; DROP");
        assert_eq!(stored("a\0b"), "a\\u{0}b");
        assert_ne!(stored("a\0b"), stored("a\\u{0}b"));
    }

    #[test]
    fn only_urls_of_postgresql_are_urls() {
        assert!(matches!(Location::new("postgres://u@h/d"), Location::Url(_)));
        assert!(matches!(Location::new("postgresql://h"), Location::Url(_)));
        assert_eq!(Location::new("a/b.sqlite"), Location::File("a/b.sqlite".into()));
    }
}

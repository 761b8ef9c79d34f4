//! A history in a database of PostgreSQL.

use std::str::FromStr;
use std::sync::mpsc;
use std::time::Duration;

use itertools::Itertools;
use postgres::fallible_iterator::FallibleIterator;
use postgres::types::{ToSql, Type};
use postgres::{Client, Config, NoTls, Row};

use super::HistoryError;
use super::database::{ColumnTypes, Database, FigureRow, Value};

/// How long a server may take to be reached, and to greet.
const CONNECT: Duration = Duration::from_secs(5);
const GREETING: Duration = Duration::from_secs(10);
/// After this time without an answer to what was sent a server counts as gone.
const SILENCE: Duration = Duration::from_secs(30);
/// Key of the lock that keeps writers apart: `fathom` in ASCII.
const LOCK: i64 = 0x0066_6174_686f_6d00;

pub struct Postgres {
    place: String,
    client: Client,
}

impl Postgres {
    pub fn connect(url: &str) -> Result<Postgres, HistoryError> {
        let mut config = Config::from_str(url).map_err(|error| HistoryError::Database {
            place: "the URL of the history".to_owned(),
            message: with_cause(&error),
        })?;
        if config.get_connect_timeout().is_none() {
            config.connect_timeout(CONNECT);
        }
        config.tcp_user_timeout(SILENCE).application_name("fathom");
        let place = place(&config);
        let unreachable =
            |message: String| HistoryError::Unreachable { place: place.clone(), message };
        // A server that takes the connection and says nothing is waited for in a thread that is left behind.
        let (greeted, greeting) = mpsc::channel();
        std::thread::spawn(move || {
            // Nobody listens any more where it took too long.
            let _ = greeted.send(config.connect(NoTls));
        });
        match greeting.recv_timeout(GREETING) {
            Ok(Ok(client)) => Ok(Postgres { place, client }),
            Ok(Err(error)) => Err(unreachable(with_cause(&error))),
            Err(_) => Err(unreachable(format!("no answer within {} s", GREETING.as_secs()))),
        }
    }

    fn fault(&self, error: &postgres::Error) -> HistoryError {
        HistoryError::Database { place: self.place.clone(), message: with_cause(error) }
    }
}

/// Database and hosts, without user and password.
fn place(config: &Config) -> String {
    let hosts = config.get_hosts().iter().map(|host| match host {
        postgres::config::Host::Tcp(name) => name.clone(),
        #[cfg(unix)]
        postgres::config::Host::Unix(path) => path.display().to_string(),
    });
    let hosts = hosts.zip(config.get_ports().iter().chain(std::iter::repeat(&5432)));
    let hosts = hosts.map(|(host, port)| format!("{host}:{port}")).join(", ");
    let database = config.get_dbname().or(config.get_user()).unwrap_or("postgres");
    format!("the PostgreSQL database `{database}` at {hosts}")
}

/// The crate's messages leave out their causes.
fn with_cause(error: &postgres::Error) -> String {
    let mut message = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(next) = cause {
        let text = next.to_string();
        if !message.contains(&text) {
            message = format!("{message}: {text}");
        }
        cause = next.source();
    }
    message
}

fn bound(value: &Value) -> &(dyn ToSql + Sync) {
    match value {
        Value::Null => &None::<f64>,
        Value::Integer(integer) => integer,
        Value::Real(real) => real,
        Value::Text(text) => text,
        Value::Bytes(bytes) => bytes,
    }
}

fn value(row: &Row, column: usize) -> Result<Value, postgres::Error> {
    let kind = row.columns()[column].type_();
    Ok(match *kind {
        Type::INT8 => row.try_get::<_, Option<i64>>(column)?.map_or(Value::Null, Value::Integer),
        Type::FLOAT8 => row.try_get::<_, Option<f64>>(column)?.map_or(Value::Null, Value::Real),
        Type::BYTEA => row.try_get::<_, Option<Vec<u8>>>(column)?.map_or(Value::Null, Value::Bytes),
        _ => row.try_get::<_, Option<String>>(column)?.map_or(Value::Null, Value::Text),
    })
}

fn figure(row: &Row) -> Result<FigureRow, postgres::Error> {
    Ok(FigureRow {
        series: row.try_get(0)?,
        run: row.try_get(1)?,
        median: row.try_get(2)?,
        low: row.try_get(3)?,
        high: row.try_get(4)?,
        n: row.try_get(5)?,
    })
}

impl Database for Postgres {
    fn types(&self) -> ColumnTypes {
        ColumnTypes { bytes: "BYTEA", real: "DOUBLE PRECISION", by_key: "" }
    }

    fn count_of_table(&self) -> &'static str {
        "SELECT COUNT(*) FROM pg_catalog.pg_tables WHERE schemaname = current_schema() AND tablename = $1"
    }

    /// A server's database is often shared, and the history's tables have names of their own.
    fn is_foreign(&mut self) -> Result<bool, HistoryError> {
        Ok(false)
    }

    fn begin(&mut self) -> Result<(), HistoryError> {
        let begun = self.client.batch_execute("BEGIN");
        begun.map_err(|error| self.fault(&error))?;
        self.rows("SELECT CAST(pg_advisory_xact_lock($1) AS TEXT)", &[Value::Integer(LOCK)])
            .map(drop)
    }

    fn commit(&mut self) -> Result<(), HistoryError> {
        self.client.batch_execute("COMMIT").map_err(|error| self.fault(&error))
    }

    fn execute(&mut self, statement: &str, values: &[Value]) -> Result<(), HistoryError> {
        let values = values.iter().map(bound).collect_vec();
        self.client.execute(statement, &values).map(drop).map_err(|error| self.fault(&error))
    }

    fn rows(&mut self, statement: &str, values: &[Value]) -> Result<Vec<Vec<Value>>, HistoryError> {
        let values = values.iter().map(bound).collect_vec();
        let rows = self.client.query(statement, &values).map_err(|error| self.fault(&error))?;
        let of_row = |row: &Row| (0..row.len()).map(|column| value(row, column)).collect();
        rows.iter().map(of_row).collect::<Result<_, _>>().map_err(|error| self.fault(&error))
    }

    fn each_figure(
        &mut self,
        statement: &str,
        values: &[Value],
        take: &mut dyn FnMut(FigureRow),
    ) -> Result<(), HistoryError> {
        let values = values.iter().map(bound).collect_vec();
        let read = self.client.query_raw(statement, values).and_then(|mut rows| {
            while let Some(row) = rows.next()? {
                take(figure(&row)?);
            }
            Ok(())
        });
        read.map_err(|error| self.fault(&error))
    }
}

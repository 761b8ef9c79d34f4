//! A history in a database of PostgreSQL.

use std::net::IpAddr;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError, SyncSender};
use std::time::Duration;

use itertools::Itertools;
use postgres::config::{Host, SslMode};
use postgres::fallible_iterator::FallibleIterator;
use postgres::types::{ToSql, Type};
use postgres::{Client, Config, NoTls, Row};

use super::HistoryError;
use super::database::{ColumnTypes, Database, Value, counted};
use super::tls;

/// How long a server may take to be reached, and to greet.
const CONNECT: Duration = Duration::from_secs(5);
const GREETING: Duration = Duration::from_secs(10);
/// After this time without an answer to what was sent a server counts as gone.
const SILENCE: Duration = Duration::from_secs(30);
/// Key of the lock that keeps writers apart: `fathom` in ASCII.
const LOCK: i64 = 0x0066_6174_686f_6d00;

/// After this time the server ends a statement. Writers may wait so long for each other.
const STATEMENT: Duration = Duration::from_secs(60);
/// After this time without a row the server counts as gone, though the connection stands.
const ANSWER: Duration = Duration::from_secs(75);
/// Rows that are handed over together, and how many times before the reader has caught up.
const BATCH: usize = 1024;
const BATCHES: usize = 4;

type Job = Box<dyn FnOnce(&mut Client) + Send>;

/// The connection lies in a thread of its own, which is left behind where the server says nothing any more.
pub struct Postgres {
    place: String,
    jobs: mpsc::Sender<Job>,
}

impl Postgres {
    pub fn connect(url: &str, unencrypted: bool) -> Result<Postgres, HistoryError> {
        // What cannot be read is not shown: it may be a part of the password.
        let mut config = match Config::from_str(url) {
            Ok(config) if url.matches('@').count() <= 1 => config,
            _ => return Err(HistoryError::Place),
        };
        let place = place(&config);
        let encrypted = !unencrypted && is_encrypted(&config, &place)?;
        if encrypted {
            config.ssl_mode(SslMode::Require);
        }
        if config.get_connect_timeout().is_none() {
            config.connect_timeout(CONNECT);
        }
        config.tcp_user_timeout(SILENCE).application_name("fathom");
        let unreachable =
            |message: String| HistoryError::Unreachable { place: place.clone(), message };
        let (greeted, greeting) = mpsc::channel();
        let (jobs, due) = mpsc::channel::<Job>();
        std::thread::spawn(move || {
            match connect(&config, encrypted) {
                // Nobody listens any more where it took too long.
                Err(message) => drop(greeted.send(Err(message))),
                Ok(mut client) if greeted.send(Ok(())).is_ok() => {
                    due.into_iter().for_each(|job| job(&mut client));
                }
                Ok(_) => {}
            }
        });
        match greeting.recv_timeout(GREETING) {
            Ok(Ok(())) => Ok(Postgres { place, jobs }),
            Ok(Err(message)) => Err(unreachable(message)),
            Err(_) => Err(unreachable(format!("no answer within {} s", GREETING.as_secs()))),
        }
    }

    /// Has the connection's thread do something, and calls `take` with each of its answers.
    fn ask<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Client, &SyncSender<T>) -> Result<(), postgres::Error> + Send + 'static,
        take: &mut dyn FnMut(T) -> Result<(), HistoryError>,
    ) -> Result<(), HistoryError> {
        let (ended, end) = mpsc::channel();
        let (found, answers) = mpsc::sync_channel(BATCHES);
        let job: Job = Box::new(move |client| {
            let result = work(client, &found);
            // Before the answers' end, so that it is there then.
            let _ = ended.send(result);
        });
        let gone = || HistoryError::Unreachable {
            place: self.place.clone(),
            message: format!("no answer within {} s", ANSWER.as_secs()),
        };
        self.jobs.send(job).map_err(|_| gone())?;
        loop {
            match answers.recv_timeout(ANSWER) {
                Ok(answer) => take(answer)?,
                Err(RecvTimeoutError::Timeout) => return Err(gone()),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        let fault = |error: postgres::Error| HistoryError::Database {
            place: self.place.clone(),
            message: with_cause(&error),
        };
        end.try_recv().map_err(|_| gone())?.map_err(fault)
    }

    fn batch(&self, statement: &'static str) -> Result<(), HistoryError> {
        self.ask::<()>(|client, _| client.batch_execute(statement), &mut |()| Ok(()))
    }
}

/// The client; or why there is none.
fn connect(config: &Config, encrypted: bool) -> Result<Client, String> {
    let connected = if encrypted { config.connect(tls::checked()?) } else { config.connect(NoTls) };
    let limited = connected.and_then(|mut client| {
        let limit = STATEMENT.as_millis();
        client.batch_execute(&format!("SET statement_timeout = {limit}"))?;
        Ok(client)
    });
    limited.map_err(|error| with_cause(&error))
}

/// To another host it is, and to this one where the URL asks for it.
fn is_encrypted(config: &Config, place: &str) -> Result<bool, HistoryError> {
    match (config.get_ssl_mode(), is_here(config)) {
        (SslMode::Disable, false) => Err(HistoryError::Unencrypted { place: place.to_owned() }),
        (SslMode::Require, _) => Ok(true),
        (_, here) => Ok(!here),
    }
}

/// The server is on this host.
fn is_here(config: &Config) -> bool {
    let names = config.get_hosts().iter().all(|host| match host {
        Host::Tcp(name) => {
            name == "localhost" || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
        }
        #[cfg(unix)]
        Host::Unix(_) => true,
    });
    // Where there is an address, the name is for the greeting alone.
    let addresses = config.get_hostaddrs();
    if addresses.is_empty() { names } else { addresses.iter().all(IpAddr::is_loopback) }
}

/// Database and hosts, without user and password.
fn place(config: &Config) -> String {
    let hosts = config.get_hosts().iter().map(|host| match host {
        Host::Tcp(name) => name.clone(),
        #[cfg(unix)]
        Host::Unix(path) => path.display().to_string(),
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
        Value::Bytes(bytes) => &**bytes,
    }
}

fn value(row: &Row, column: usize) -> Result<Value, postgres::Error> {
    let kind = row.columns()[column].type_();
    Ok(match *kind {
        Type::INT8 => row.try_get::<_, Option<i64>>(column)?.map_or(Value::Null, Value::Integer),
        Type::FLOAT8 => row.try_get::<_, Option<f64>>(column)?.map_or(Value::Null, Value::Real),
        Type::BYTEA => {
            let bytes = row.try_get::<_, Option<Vec<u8>>>(column)?;
            bytes.map_or(Value::Null, |bytes| Value::Bytes(Arc::new(bytes)))
        }
        _ => row.try_get::<_, Option<String>>(column)?.map_or(Value::Null, Value::Text),
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
        self.batch("BEGIN")?;
        self.rows("SELECT CAST(pg_advisory_xact_lock($1) AS TEXT)", &[Value::Integer(LOCK)])
            .map(drop)
    }

    fn commit(&mut self) -> Result<(), HistoryError> {
        self.batch("COMMIT")
    }

    fn execute(&mut self, statement: &str, values: Vec<Value>) -> Result<(), HistoryError> {
        let statement = statement.to_owned();
        let work = move |client: &mut Client, _: &SyncSender<()>| {
            client.execute(&statement, &values.iter().map(bound).collect_vec()).map(drop)
        };
        self.ask(work, &mut |()| Ok(()))
    }

    fn each(
        &mut self,
        statement: &str,
        values: Vec<Value>,
        take: &mut dyn FnMut(Vec<Value>) -> Result<(), HistoryError>,
    ) -> Result<(), HistoryError> {
        let statement = statement.to_owned();
        let work = move |client: &mut Client, found: &SyncSender<Vec<Vec<Value>>>| {
            let mut rows = client.query_raw(&statement, values.iter().map(bound))?;
            let mut batch = Vec::new();
            while let Some(row) = rows.next()? {
                let values = (0..row.len()).map(|column| value(&row, column));
                batch.push(values.collect::<Result<_, _>>()?);
                // Where nobody listens any more the rest is left.
                if batch.len() == BATCH && found.send(std::mem::take(&mut batch)).is_err() {
                    return Ok(());
                }
            }
            let _ = found.send(batch);
            Ok(())
        };
        let mut count = 0;
        self.ask(work, &mut |rows: Vec<Vec<Value>>| {
            rows.into_iter().try_for_each(|row| counted(&mut count).and_then(|()| take(row)))
        })
    }
}

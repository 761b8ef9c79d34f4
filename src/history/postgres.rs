//! A history in a database of PostgreSQL.

use std::net::IpAddr;
use std::str::FromStr;
use std::sync::mpsc::{self, SyncSender};
use std::time::Duration;

use anyhow::{anyhow, bail};
use itertools::Itertools;
use postgres::config::{Host, SslMode};
use postgres::fallible_iterator::FallibleIterator;
use postgres::types::{ToSql, Type};
use postgres::{Client, Config, NoTls, Row};
use tokio_postgres_rustls::MakeRustlsConnect;

use super::database::{Database, Dialect, Value, counted, fault_of, no_place};
use fathom_base::text::line;

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

/// Rows of a statement. A batch that is not full is the last.
type Batch = Vec<Vec<Value>>;

/// A statement, and where its rows go.
struct Job {
    statement: String,
    values: Vec<Value>,
    answers: SyncSender<Result<Batch, postgres::Error>>,
}

impl Job {
    fn run(self, client: &mut Client) {
        let last = self.rows(client);
        // Where nobody listens any more nothing is owed.
        drop(self.answers.send(last));
    }

    /// Sends the full batches, and gives the last.
    fn rows(&self, client: &mut Client) -> Result<Batch, postgres::Error> {
        let mut rows = client.query_raw(&self.statement, self.values.iter().map(bound))?;
        let mut batch = Batch::new();
        while let Some(row) = rows.next()? {
            let values = (0..row.len()).map(|column| value(&row, column));
            batch.push(values.collect::<Result<_, _>>()?);
            if batch.len() == BATCH && self.answers.send(Ok(std::mem::take(&mut batch))).is_err() {
                break;
            }
        }
        Ok(batch)
    }
}

/// The connection lies in a thread of its own, which is left behind where the server says nothing any more.
pub struct Postgres {
    place: String,
    jobs: mpsc::Sender<Job>,
}

impl Postgres {
    pub fn connect(url: &str, unencrypted: bool) -> anyhow::Result<Postgres> {
        // What cannot be read is not shown: it may be a part of the password.
        let mut config = match Config::from_str(url) {
            Ok(config) if url.matches('@').count() <= 1 => config,
            _ => return Err(no_place()),
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
        let (greeted, greeting) = mpsc::channel();
        let (jobs, due) = mpsc::channel::<Job>();
        std::thread::spawn(move || {
            match connect(&config, encrypted) {
                // Nobody listens any more where it took too long.
                Err(message) => drop(greeted.send(Err(message))),
                Ok(mut client) if greeted.send(Ok(())).is_ok() => {
                    due.into_iter().for_each(|job| job.run(&mut client));
                }
                Ok(_) => {}
            }
        });
        match greeting.recv_timeout(GREETING) {
            Ok(Ok(())) => Ok(Postgres { place, jobs }),
            Ok(Err(message)) => Err(unreachable(&place, &message)),
            Err(_) => Err(unreachable(&place, &silent(GREETING))),
        }
    }
}

fn unreachable(place: &str, message: &str) -> anyhow::Error {
    anyhow!("cannot reach {}: {}", line(place), line(message))
}

fn silent(time: Duration) -> String {
    format!("no answer within {} s", time.as_secs())
}

/// The client; or why there is none.
fn connect(config: &Config, encrypted: bool) -> Result<Client, String> {
    let connected = if encrypted { config.connect(checked()?) } else { config.connect(NoTls) };
    let limited = connected.and_then(|mut client| {
        let limit = STATEMENT.as_millis();
        client.batch_execute(&format!("SET statement_timeout = {limit}"))?;
        Ok(client)
    });
    limited.map_err(|error| with_cause(&error))
}

/// Checks the server's certificate and its name against the certificates that the system trusts, or that `SSL_CERT_FILE` or
/// `SSL_CERT_DIR` names.
///
/// # Errors
/// Says that there are none.
fn checked() -> Result<MakeRustlsConnect, String> {
    let trusting = MakeRustlsConnect::with_native_certs().map_err(|errors| {
        let why = errors.first().map_or_else(String::new, |error| format!(" ({error})"));
        format!(
            "no certificate is trusted on this system{why}: name a file of them by SSL_CERT_FILE"
        )
    });
    Ok(trusting?.0)
}

/// To another host it is, and to this one where the URL asks for it.
fn is_encrypted(config: &Config, place: &str) -> anyhow::Result<bool> {
    match (config.get_ssl_mode(), is_here(config)) {
        (SslMode::Disable, false) => bail!(
            "{} is on another host, and the URL says that the connection is not encrypted: leave out sslmode=disable, or say --unencrypted",
            line(place)
        ),
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
        Value::Blob(bytes) => bytes,
    }
}

fn value(row: &Row, column: usize) -> Result<Value, postgres::Error> {
    Ok(match *row.columns()[column].type_() {
        Type::INT8 => row.try_get::<_, Option<i64>>(column)?.into(),
        Type::FLOAT8 => row.try_get::<_, Option<f64>>(column)?.into(),
        Type::BYTEA => row.try_get::<_, Option<Vec<u8>>>(column)?.into(),
        _ => row.try_get::<_, Option<String>>(column)?.into(),
    })
}

impl Database for Postgres {
    fn dialect(&self) -> Dialect {
        Dialect {
            bytes: "BYTEA",
            real: "DOUBLE PRECISION",
            by_key: "",
            count_of_table: "SELECT COUNT(*) FROM pg_catalog.pg_tables \
                             WHERE schemaname = current_schema() AND tablename = $1",
            // A server's database is often shared, and the history's tables have names of their own.
            count_of_all: None,
        }
    }

    fn begin(&mut self) -> anyhow::Result<()> {
        self.execute("BEGIN", Vec::new())?;
        let lock = "SELECT CAST(pg_advisory_xact_lock($1) AS TEXT)";
        self.execute(lock, vec![Value::Integer(LOCK)])
    }

    fn each(
        &mut self,
        statement: &str,
        values: Vec<Value>,
        take: &mut dyn FnMut(Vec<Value>) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let (answers, found) = mpsc::sync_channel(BATCHES);
        let gone = || unreachable(&self.place, &silent(ANSWER));
        let job = Job { statement: statement.to_owned(), values, answers };
        self.jobs.send(job).map_err(|_| gone())?;
        let (mut count, mut is_last) = (0, false);
        while !is_last {
            let batch = found.recv_timeout(ANSWER).map_err(|_| gone())?;
            let batch = batch.map_err(|error| fault_of(&self.place, &with_cause(&error)))?;
            is_last = batch.len() < BATCH;
            batch.into_iter().try_for_each(|row| counted(&mut count).and_then(|()| take(row)))?;
        }
        Ok(())
    }
}

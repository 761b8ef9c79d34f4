//! Runs over commits: a database of records and of the figures in them, and where these changed.
//!
//! A run is stored whole and comes out byte for byte. Its identity is the SHA-256 of its records. A figure over the runs of one branch,
//! machine, adapter, driver, profile and configuration is a series, in the order of the commits' dates, and of one commit in
//! the order in which the runs started.

pub mod changes;
mod database;
pub mod findings;
pub mod on_page;
pub mod origin;
pub mod otava;
#[cfg(feature = "postgres")]
mod postgres;
pub mod run;
mod scores;
mod shift;
mod sqlite;
mod store;
mod stored;
pub mod tables;

pub use database::Location;
pub use findings::{Change, Findings, Size};
pub use origin::{Origin, Said, origin};
pub use run::{NewFigure, NewRun};
pub use store::{Added, History};
pub use stored::{Point, Selection, Series, SeriesKey, StoredRun, StoredRuns};

use std::path::PathBuf;

use thiserror::Error;

use fathom_base::text;
use fathom_record::{Damage, RecordError};

/// Where a history lies that nobody said the place of.
pub const DEFAULT_FILE: &str = "reports/history.sqlite";
/// Variable with its place.
pub const VARIABLE: &str = "FATHOM_HISTORY";
/// Version of the tables; raised when a column changes its meaning or goes away.
pub const FORMAT: i64 = 1;

#[derive(Debug, Error)]
pub enum HistoryError {
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error("{} holds no run: there is no {name} in it", folder.display())]
    NoRun { folder: PathBuf, name: String },
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("cannot write a series as CSV: {0}")]
    Csv(#[from] csv::Error),
    #[error("{} is damaged, so it was not stored: {first}{}", path.display(), more(*.count))]
    Damaged { path: PathBuf, first: Damage, count: usize },
    #[error("{} holds a comparison, and a history stores runs only", path.display())]
    Comparison { path: PathBuf },
    #[error("{} does not begin with a run's header, so it was not stored", path.display())]
    NoHeader { path: PathBuf },
    #[error(
        "of which commit is this run? There is no --commit, no GITHUB_SHA or CI_COMMIT_SHA, and no git repository here"
    )]
    NoCommit,
    #[error(
        "of which branch is this run? There is no --branch, no GITHUB_REF_NAME or CI_COMMIT_REF_NAME, and git's HEAD is on no branch"
    )]
    NoBranch,
    #[error("this machine has neither an id nor a host name: name it with --machine NAME")]
    NoMachine,
    #[error("no repository here has commit {}, and the run does not say when it started, so its place in the series is unknown", text::line(.commit))]
    NoTime { commit: String },
    #[error("{}: {}", text::line(.place), text::line(.message))]
    Database { place: String, message: String },
    #[error("cannot reach {}: {}", text::line(.place), text::line(.message))]
    Unreachable { place: String, message: String },
    #[error(
        "the place of the history is not understood, and not shown as it may hold a password: say a path, \
         or postgres://USER:PASSWORD@HOST/DATABASE, where a `@`, `/` or `?` of a name or password is %40, %2F or %3F"
    )]
    Place,
    #[error("{} is on another host, and the URL says that the connection is not encrypted: leave out sslmode=disable, or say --unencrypted", text::line(.place))]
    Unencrypted { place: String },
    #[error(
        "this build of fathom cannot reach PostgreSQL: build it with `cargo build --release --locked --features postgres`"
    )]
    NoPostgres,
    #[error(
        "a statement gave {what}, and no history holds so much: the database is damaged, or not fathom's; --since takes a part"
    )]
    TooMuch { what: String },
    #[error("{} is no database of SQLite", path.display())]
    NotSqlite { path: PathBuf },
    #[error("there is no history in {}: `fathom history add DIR` makes one", text::line(.place))]
    NoHistory { place: String },
    #[error("{} is the database of another program, so nothing was changed in it", text::line(.place))]
    Foreign { place: String },
    #[error("{} has history format {found}, but this build reads format {FORMAT}: use the build that wrote it", text::line(.place))]
    Format { place: String, found: i64 },
    #[error(
        "run {} is stored already, as one of commit {} on {}: the same records cannot be of {} on {} too",
        short(.digest), text::line(.stored_commit), text::line(.stored_branch), text::line(.commit), text::line(.branch)
    )]
    OtherOrigin {
        digest: String,
        stored_commit: String,
        stored_branch: String,
        commit: String,
        branch: String,
    },
    #[error("no run `{}` in this history; see `fathom history list`", text::line(.name))]
    UnknownRun { name: String },
    #[error("`{}` is the beginning of several runs: give more of its digits", text::line(.name))]
    SeveralRuns { name: String },
    #[error("a column has another type than this build stores: the database is damaged")]
    Type,
    #[error("run {} came out of the database with other bytes than went in: the database is damaged", short(.digest))]
    Altered { digest: String },
    #[error("`{}` is neither a date such as 2026-01-31 nor a commit of this history", text::line(.text))]
    Since { text: String },
    #[error("nothing in this history fits{}", text::line(.what))]
    NothingFits { what: String },
}

/// Enough digits to find a run by. A database that something else wrote to may hold anything.
fn short(digest: &str) -> String {
    text::line(digest).chars().take(12).collect()
}

fn more(count: usize) -> String {
    if count > 1 { format!(" (and {} more)", count - 1) } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_digest_of_a_database_can_be_told() {
        for digest in ["", "abcd", "äöüäöüäöüäöüäöü", "0123456789abcdef"] {
            let told = HistoryError::Altered { digest: digest.to_owned() }.to_string();
            assert!(told.contains("the database is damaged"), "{told}");
        }
    }
}

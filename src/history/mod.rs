//! Runs over commits: a database of the figures in their records, and where these changed.
//!
//! A run's identity is the SHA-256 of its records. A figure over the runs of one branch,
//! machine, adapter, driver, profile and configuration is a series, in the order of the commits, and of one commit in
//! the order in which the runs started.

mod controls;
pub mod document;
pub mod findings;
pub mod origin;
pub mod run;
mod store;
mod stored;
pub mod tables;

pub use controls::MachineShift;
pub use findings::{HistoryChanges, SeriesChange, Size};
pub use origin::{Origin, OriginArgs, origin};
pub use run::{NewFigure, NewRun};
pub use store::{Added, History};
pub use stored::{FigureSeries, RunValue, Selection, SeriesKey, StoredRun, StoredRuns};

/// Default file of a history.
pub const DEFAULT_FILE: &str = "reports/history.sqlite";
/// Variable with its place.
pub const VARIABLE: &str = "FATHOM_HISTORY";
/// Version of the tables; raised when a column changes its meaning or goes away.
pub const FORMAT: i64 = 2;

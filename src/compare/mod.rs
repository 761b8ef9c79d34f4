//! `fathom compare`: whether a change made any stage of any pipeline slower, costlier or less accurate.
//!
//! Two builds are compared through three gates, from exact to noisy: declared work, counters,
//! bytes and errors ([`exact`]); instruction counts ([`instructions`]); time ([`time`]). [`worker`] is the measured side: a
//! process that holds the prepared configurations of one build and answers [`protocol`]'s requests. [`flow`] measures;
//! what is measured goes to a folder of records ([`store`]); the [`verdict`] is a function of those alone, and
//! `report` writes it.

pub mod bisect;
pub mod build;
pub mod candidates;
pub mod cells;
pub mod environment;
pub mod exact_gate;
pub mod fingerprint;
pub mod flow;
pub mod instructions;
pub mod launch_workers;
pub mod launches;
pub mod settings;
mod valgrind;
pub mod worker;
pub mod worker_process;

pub use fathom_record::protocol;

pub use fathom_judge::{exact, rank, store, time, verdict};

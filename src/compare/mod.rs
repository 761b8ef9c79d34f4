//! `fathom compare`: whether a change made any stage of any pipeline slower, costlier or less accurate.
//!
//! Two builds are compared through three gates, from exact to noisy: declared work, counters,
//! bytes and errors ([`exact`]); instruction counts ([`instructions`]); time ([`time`]). [`worker`] is the measured side: a
//! process that holds the prepared configurations of one build and answers [`protocol`]'s requests. [`flow`] measures;
//! what is measured goes to a folder of records ([`store`]); the [`verdict`] is a function of those alone, and
//! [`tables`] report it.

pub mod adapters;
pub mod bench;
pub mod build;
pub mod cells;
pub mod driver;
pub mod exact;
pub mod files;
pub mod flow;
pub mod instructions;
pub mod launch;
pub mod protocol;

pub mod rank;
pub mod rounds;
pub mod store;
pub mod survey;
pub mod tables;
pub mod time;
pub mod unpaired;
mod valgrind;
pub mod verdict;
pub mod worker;

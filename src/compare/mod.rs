//! `fathom compare`: whether a change made any stage of any pipeline slower, costlier or less accurate.
//!
//! Two builds are held against each other through three gates, from exact to noisy: declared work, counters,
//! bytes and errors; instruction counts; time. [`worker`] is the measured side: a process that holds the prepared
//! configurations of one build and answers [`protocol`]'s requests. What is measured goes to a folder of lines
//! ([`store`]); verdicts are a function of those lines alone.

pub mod bench;
pub mod build;
pub mod cells;
pub mod exact;
pub mod instructions;
pub mod launch;
pub mod protocol;
pub mod rank;
pub mod rounds;
pub mod store;
pub mod survey;
pub mod time;
mod valgrind;
pub mod worker;

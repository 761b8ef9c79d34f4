//! `fathom compare`: whether a change made any stage of any pipeline slower, costlier or less accurate.
//!
//! Two builds are held against each other through three gates, from exact to noisy: declared work, counters,
//! bytes and errors; instruction counts; time. What is measured goes to a folder of lines ([`store`]); verdicts
//! are a function of those lines alone.

pub mod cells;
pub mod store;

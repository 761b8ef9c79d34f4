//! Verdicts of a comparison of two builds: functions of the records that were measured ([`store`]), and of nothing else.
//!
//! Three gates, from exact to noisy: declared work, counters, bytes and errors ([`exact`]); instruction counts ([`counts`]); time
//! ([`time`]). The [`verdict`] joins them, and [`tables`] report it.

pub mod adapters;
pub mod bisect;
pub mod changes;
pub mod counts;
pub mod exact;
pub mod files;
pub mod noise;
pub mod rank;
pub mod schedule;
pub mod store;
pub mod tables;
pub mod time;
pub mod verdict;

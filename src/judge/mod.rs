//! Verdicts from records: on a run ([`run`], [`clocks`]) and its [`claims`], on the exact figures of two runs ([`files`]), on a series
//! of runs ([`change_points`]), and on a comparison of two builds. Functions of records alone; the words for people are in `report`. The
//! test of one claim stands beside the claims in `fathom-experiments`.
//!
//! A comparison has three gates, from exact to noisy: declared work, counters, bytes and errors ([`exact`]); instruction counts
//! ([`counts`]); time ([`time`]). The [`verdict`] joins them.

pub mod adapters;
pub mod bisect;
pub mod change_points;
pub mod claims;
pub mod clocks;
pub mod counts;
pub mod exact;
pub mod files;
pub mod knees;
pub mod matched_cells;
pub mod noise;
pub mod rank;
pub mod run;
pub mod scores;
pub mod shift;
pub mod store;
pub mod time;
pub mod verdict;

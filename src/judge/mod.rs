//! What records amount to: the verdict on a run ([`run`], [`clocks`]), the rulings on its [`claims`], what
//! [`changes`] between two runs, change points of a series ([`change_points`]), and the verdicts of a comparison of two builds. Functions
//! of records alone, without words for people: those are `report`'s. The test of one claim stands beside the claims in
//! `fathom-experiments`.
//!
//! A comparison has three gates, from exact to noisy: declared work, counters, bytes and errors ([`exact`]); instruction counts
//! ([`counts`]); time ([`time`]). The [`verdict`] joins them.

pub mod adapters;
pub mod bisect;
pub mod change_points;
pub mod changes;
pub mod claims;
pub mod clocks;
pub mod counts;
pub mod exact;
pub mod files;
pub mod knees;
pub mod noise;
pub mod rank;
pub mod run;
pub mod schedule;
pub mod scores;
pub mod shift;
pub mod store;
pub mod time;
pub mod verdict;

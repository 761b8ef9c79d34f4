//! `fathom compare`: what it tells of stored comparisons, whole comparisons of builds that are scripts, and workers.
#![cfg(unix)]

mod bisect;
mod builds;
#[path = "../common/mod.rs"]
mod common;
mod folders;
mod formats;
mod gate;
mod own_worker;
mod revisions;
mod script;
mod stored;

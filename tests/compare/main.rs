//! `fathom compare`: what it tells of stored comparisons, whole comparisons of builds that are scripts, and workers.
#![cfg(unix)]

mod bisect;
mod builds;
#[path = "../common/mod.rs"]
mod common;
mod folders;
mod formats;
mod gate;
#[cfg(target_os = "linux")]
mod hostile_workers;
mod own_worker;
mod processes;
mod script;
mod stored;

//! The program as a user meets it: its commands, the folders that they write, a history.

mod claims;
mod cli;
#[path = "../common/mod.rs"]
mod common;
mod documents;
mod dumps;
#[allow(dead_code, reason = "an STL file is written elsewhere")]
#[path = "../common/files.rs"]
mod files;
mod folders;
mod history;
mod hostile_names;
mod masks;
mod missing_figures;
mod overlay;
mod printing;
mod private;
mod shards;
mod sweeps;

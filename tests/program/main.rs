//! The program as a user meets it: its commands, the folders that they write, a fleet, a history, the page in a browser.

mod busy_machine;
mod ceilings;
mod claims;
mod cli;
#[path = "../common/mod.rs"]
mod common;
mod documents;
mod dumps;
mod faults;
mod fleet;
mod folders;
mod hardware;
mod history;
mod hostile_names;
mod masks;
mod merge;
mod missing_figures;
mod overlay;
mod page;
mod printing;
mod queries;
mod replayed;
mod shaders;

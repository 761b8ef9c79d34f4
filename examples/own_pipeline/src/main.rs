//! A program with all of fathom's commands over a pipeline of its own: ripples on the water, drawn and blurred.
//!
//! `cargo run --release -p own_pipeline -- run` measures the experiment, `… -- compare --base REV` compares the gate cell.

mod blur;
mod check;
mod draw;
mod pipeline;

use std::process::ExitCode;

use fathom::Catalog;
use fathom::embedded::Folder;
use rust_embed::Embed;

#[derive(Embed)]
#[folder = "shaders"]
struct Shaders;

#[derive(Embed)]
#[folder = "scenes"]
struct Scenes;

#[derive(Embed)]
#[folder = "experiments"]
struct Experiments;

/// A folder of shaders to use in place of the crate's own, to try a change without a build.
const SHADERS_VARIABLE: &str = "OWN_PIPELINE_SHADERS";

fn main() -> ExitCode {
    let shaders = std::env::var_os(SHADERS_VARIABLE)
        .map_or_else(|| Folder::from_embed::<Shaders>("own shaders"), Folder::from_path);
    let catalog = Catalog::builtin()
        .program(env!("CARGO_PKG_NAME"), env!("CARGO_BIN_NAME"))
        .pipeline::<pipeline::Ripples>()
        .shaders(shaders)
        .scenes(Folder::from_embed::<Scenes>("own scenes"))
        .only_experiments(Folder::from_embed::<Experiments>("own experiments"))
        .checks(check::cases)
        .gates("gates.toml", include_str!("../gates.toml"));
    fathom::cli::main(&catalog)
}

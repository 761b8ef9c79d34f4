//! `fathom sweep`: one command for one's own scene and sizes.

use std::path::{PathBuf, absolute};
use std::time::Instant;

use clap::Args;
use serde_json::Value;

use super::MeasureArgs;
use super::commands::{self, ExitResult};
use crate::experiments::{parse_axis, parse_set};
use crate::harness::catalog::Catalog;
use crate::harness::plan::Request;
use crate::harness::run::RunOptions;
use crate::harness::sweep::{KNEE_SHARE, SweepRequest};

#[derive(Args)]
pub struct SweepArgs {
    /// Name of a pipeline; see `fathom list pipelines`
    pub pipeline: String,
    /// Name of a scene, or path of a scene file or a mesh (.obj, .ply, .stl, .gltf, .glb), which is placed on a plate, lit, and fills the view
    #[arg(long)]
    pub scene: String,
    /// A parameter and its values; may be given twice. See `fathom list parameters --pipeline PIPELINE`
    #[arg(long, value_name = "PARAM=V1,V2,…", value_parser = parse_axis)]
    pub axis: Vec<(String, Vec<String>)>,
    /// Set a parameter of every cell
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
    /// Azimuth and elevation in degrees, from where the scene fills the view
    #[arg(
        long,
        value_name = "AZIMUTH,ELEVATION",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    pub camera: Option<Vec<f64>>,
    /// Share of the frame from which a stage counts as costly
    #[arg(long, default_value_t = KNEE_SHARE)]
    pub share: f64,
    /// Measure the adapter's limits first, so that stages have a share of them
    #[arg(long)]
    pub ceilings: bool,
    #[command(flatten)]
    pub measured: MeasureArgs,
}

/// A file's whole path, so that `sweep.toml` means the same wherever it is run.
fn located(scene: &str) -> String {
    let is_file = |path: &PathBuf| path.extension().is_some() && path.is_file();
    let whole = absolute(scene).ok().filter(is_file);
    whole.map_or_else(|| scene.to_owned(), |path| path.display().to_string())
}

pub fn sweep(catalog: &Catalog, args: SweepArgs) -> ExitResult {
    let start = Instant::now();
    let options = commands::shared_options(catalog, &args.measured)?;
    let request = SweepRequest {
        pipeline: args.pipeline,
        scene: located(&args.scene),
        axes: args.axis,
        sets: args.set,
        camera: args.camera,
        knee_share: args.share,
        command: options.command.join(" "),
    };
    let experiment = request.experiment(catalog)?;
    commands::watch_interrupts()?;
    let request = Request { given: Some(experiment), ..Request::default() };
    let options = RunOptions { request, no_ceilings: !args.ceilings, ..options };
    commands::measure(args.measured.png, &options, start)
}

//! `fathom sweep`: one command for one's own scene and sizes.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::Value;

use super::AdapterArgs;
use super::commands::{self, ExitResult};
use crate::experiments::{parse_axis, parse_set};
use crate::gpu::Gpu;
use crate::harness::catalog::Catalog;
use crate::harness::plan::Request;
use crate::harness::run::RunOptions;
use crate::harness::sweep::{KNEE_SHARE, SweepRequest};
use crate::record::{Profile, calendar};
use crate::{private, quiet};

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
    /// Sizes: `quick` has a view of 160 × 120 pixels, `paper` that of the pipeline [default: by the adapter]
    #[arg(long, value_enum)]
    pub profile: Option<Profile>,
    /// Share of the frame from which a stage counts as costly
    #[arg(long, default_value_t = KNEE_SHARE)]
    pub share: f64,
    /// Time of the whole command: `90s`, `5m` [default: half a minute and 6 s a cell, at most 4 minutes; on a GPU 20 s a cell, at most 30]
    #[arg(long, value_name = "TIME", value_parser = calendar::duration)]
    pub budget: Option<Duration>,
    /// Stop a cell when half its 95 % interval is this share of the frame time [default: 0.02 on a software driver, else 0.01]
    #[arg(long, value_name = "SHARE")]
    pub precision: Option<f64>,
    /// Folder to write to [default: a new one in fathom-runs, in a checkout in reports/out]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Measure the adapter's limits first, so that stages have a share of them
    #[arg(long)]
    pub ceilings: bool,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

pub fn sweep(catalog: &Catalog, args: SweepArgs) -> ExitResult {
    let start = Instant::now();
    let gpu = commands::gpu_options(catalog, &args.adapter);
    if Gpu::choose(&gpu)?.software {
        quiet::begin_again();
    }
    let command = private::command();
    let request = SweepRequest {
        pipeline: args.pipeline,
        scene: private::relative(&args.scene),
        axes: args.axis,
        sets: args.set,
        camera: args.camera,
        knee_share: args.share,
        command: command.join(" "),
    };
    let experiment = request.experiment(catalog)?;
    commands::watch_interrupts()?;
    let options = RunOptions {
        catalog: catalog.clone(),
        gpu,
        profile: args.profile,
        request: Request { given: Some(experiment), ..Request::default() },
        budget_s: args.budget.map(|budget| budget.as_secs_f64()),
        precision: args.precision,
        out: args.out,
        no_ceilings: !args.ceilings,
        command,
        ..RunOptions::default()
    };
    commands::measure(&options, start)
}

//! The command line: its arguments, its errors and its exit status.

pub mod commands;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Args, Parser, Subcommand, ValueEnum};
use fathom::experiments::{Profile, parse_axis, parse_set};
use serde_json::Value;

/// Bad input, or nothing could be run.
const COULD_NOT_RUN: u8 = 2;

#[derive(Parser)]
#[command(
    version,
    about,
    after_help = "Exit status: 0 all well; 1 a cell or a check failed; 2 bad input, or it could not run; \
        130 interrupted, with everything measured so far written."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
pub enum Command {
    /// Measure experiments; write records, tables, plots and pictures
    Run(RunArgs),
    /// List what there is
    List(ListArgs),
    /// Hold the adapter's timestamps against the host clock
    Audit(AdapterArgs),
    /// Check stages against their references
    Verify(VerifyArgs),
    /// Get the meshes and volumes that are not part of the project, with the ordinary package clients
    Fetch(FetchArgs),
    /// Render one frame of a scene as a PNG file
    Render(RenderArgs),
    /// Write a stage's outputs as .npy files with descriptions
    Dump(DumpArgs),
    /// Answer at given points
    Query(QueryArgs),
    /// Write the reports of a run again, from its records alone
    Report(ReportArgs),
}

#[derive(Args)]
pub struct AdapterArgs {
    /// Part of the adapter's name, or its number in `fathom list adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    pub adapter: Option<String>,
    /// Compile shaders without bounds and loop checks
    #[arg(long)]
    pub unchecked: bool,
}

#[derive(Args)]
pub struct RunArgs {
    /// Names of experiments or paths of experiment files [default: all built-in ones]
    pub experiments: Vec<String>,
    /// Sizes: `quick` for software drivers, `paper` as published [default: by the adapter]
    #[arg(long, value_parser = clap::builder::PossibleValuesParser::new(Profile::NAMES))]
    pub profile: Option<String>,
    /// Set a parameter of every cell; see `fathom list parameters`
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
    /// Replace the values of an axis
    #[arg(long, value_name = "NAME=VALUE,…", value_parser = parse_axis)]
    pub axis: Vec<(String, Vec<String>)>,
    /// Time for all cells together, seconds
    #[arg(long, value_name = "SECONDS")]
    pub budget: Option<f64>,
    /// Stop a cell when half its 95 % interval is this share of the frame time [default: 0.02 quick, 0.01 paper]
    #[arg(long, value_name = "SHARE")]
    pub precision: Option<f64>,
    /// Folder to write to [default: a new one in reports/out]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Measure only what the folder's records lack [default folder: the latest in reports/out]
    #[arg(long)]
    pub resume: bool,
    /// Seed of the order of cells and frames [default: drawn, and recorded]
    #[arg(long)]
    pub seed: Option<u64>,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Listing {
    Experiments,
    Scenes,
    Stages,
    Parameters,
    Adapters,
    Pipelines,
}

#[derive(Args)]
pub struct ListArgs {
    /// What to list [default: everything but parameters]
    pub what: Option<Listing>,
    #[command(flatten)]
    pub subject: SubjectArgs,
}

/// A pipeline on a scene.
#[derive(Args)]
pub struct SubjectArgs {
    #[arg(long, default_value = "underwater")]
    pub pipeline: String,
    /// Name of a scene, or path of a scene file
    #[arg(long, default_value = "tank")]
    pub scene: String,
    /// Set a parameter; see `fathom list parameters`
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
}

#[derive(Args)]
pub struct VerifyArgs {
    /// Only the checks of stages whose name holds this
    pub filter: Option<String>,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Args)]
pub struct FetchArgs {
    /// Names of assets [default: all]
    pub assets: Vec<String>,
}

#[derive(Args)]
pub struct RenderArgs {
    /// Name of a scene, or path of a scene file
    pub scene: String,
    #[arg(long, default_value = "underwater")]
    pub pipeline: String,
    /// Set a parameter; see `fathom list parameters`
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
    /// File to write [default: SCENE.png]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Args)]
pub struct DumpArgs {
    /// Name of a stage; see `fathom list stages`
    pub stage: String,
    #[command(flatten)]
    pub subject: SubjectArgs,
    /// Folder to write to
    #[arg(short, long, value_name = "DIR", default_value = ".")]
    pub output: PathBuf,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Question {
    /// Volume ambient occlusion, 0 open to 1 closed
    Ao,
}

#[derive(Args)]
pub struct QueryArgs {
    /// What is asked
    pub question: Question,
    /// Name of a scene, or path of a scene file
    #[arg(long)]
    pub scene: String,
    /// CSV file with the columns x, y, z (metres) and nx, ny, nz
    #[arg(long, value_name = "FILE")]
    pub points: PathBuf,
    /// Set a parameter of the pipeline volume_ao; see `fathom list parameters --pipeline volume_ao`
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
    /// CSV file to write [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Args)]
pub struct ReportArgs {
    /// Folder of a run
    pub folder: PathBuf,
}

/// The command, or the status to exit with: help was asked for, or the line is wrong.
pub fn parse() -> Result<Command, ExitCode> {
    Cli::try_parse()
        .map(|cli| cli.command)
        .map_err(|error| match error.kind() {
            ErrorKind::DisplayHelp
            | ErrorKind::DisplayVersion
            | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => error.exit(),
            _ => {
                eprintln!("{}", one_line(&error.render().to_string()));
                ExitCode::from(COULD_NOT_RUN)
            }
        })
}

/// clap's message without its usage: up to the first empty line, and its tips.
fn one_line(message: &str) -> String {
    let lines = message.lines().map(str::trim);
    let head = lines
        .clone()
        .take_while(|line| !line.is_empty())
        .collect::<Vec<_>>()
        .join(" ");
    let tips = lines.filter(|line| line.starts_with("tip:"));
    std::iter::once(head.as_str())
        .chain(tips)
        .collect::<Vec<_>>()
        .join("; ")
}

/// Prints an error on one line, with the causes that it does not tell of itself.
pub fn exit_status(result: anyhow::Result<ExitCode>) -> ExitCode {
    result.unwrap_or_else(|error| {
        let mut message = String::new();
        for cause in error.chain().map(ToString::to_string) {
            if message.is_empty() {
                message = cause;
            } else if !message.contains(&cause) {
                message = format!("{message}: {cause}");
            }
        }
        fail(&message)
    })
}

/// Prints an error on one line.
pub fn fail(message: &str) -> ExitCode {
    let lines: Vec<&str> = message.lines().map(str::trim).collect();
    eprintln!("error: {}", lines.join(" "));
    ExitCode::from(COULD_NOT_RUN)
}

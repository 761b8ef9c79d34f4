//! The command line: its arguments, its errors and its exit status.

mod bisect;
mod commands;
mod compare;
mod compare_args;
mod doctor;
mod export;
mod history;
mod list;
mod sweep;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use crate::experiments::{parse_axis, parse_set};
use crate::gpu;
use crate::harness::catalog::Catalog;
use crate::print;
use crate::process::take_size_limit_as_error;
use crate::record::calendar;
use crate::record::schema::LineKind;
use crate::record::{Feature, Mask, Part, Profile};
use clap::error::ErrorKind;
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use serde_json::Value;
use strum::IntoEnumIterator;

/// Defaults of commands that run one pipeline on one scene.
pub const PIPELINE: &str = "underwater";
pub const SCENE: &str = "tank";

/// Bad input, or nothing could be run.
const COULD_NOT_RUN: u8 = 2;

/// The program of a crate: parses the command line and does what it says with what `catalog` holds. The whole `main` of a crate
/// of one's own.
pub fn main(catalog: &Catalog) -> ExitCode {
    quiet_driver_layers();
    take_size_limit_as_error();
    match Cli::try_parse() {
        Ok(cli) => {
            if cli.quiet {
                print::set_quiet();
            }
            exit_status(obey(catalog, cli.command))
        }
        Err(error) => not_parsed(error),
    }
}

/// Reads a command line, the program's name first, and does nothing.
pub fn parse<W: AsRef<str>>(words: &[W]) -> Result<(), clap::Error> {
    Cli::try_parse_from(words.iter().map(AsRef::as_ref)).map(drop)
}

fn obey(catalog: &Catalog, command: Command) -> commands::ExitResult {
    match command {
        Command::Run(args) => commands::run(catalog, args),
        Command::Sweep(args) => sweep::sweep(catalog, args),
        Command::Doctor(args) => doctor::doctor(catalog, &args),
        Command::List(args) => list::list(catalog, &args),
        Command::Audit(args) => commands::audit(catalog, &args),
        Command::Ceilings(args) => commands::ceilings(catalog, &args),
        Command::Verify { filter, args } => commands::verify(catalog, filter.as_deref(), &args),
        Command::Fetch { assets } => commands::fetch(&assets),
        Command::Render(args) => commands::render(catalog, args),
        Command::Dump(args) => commands::dump(catalog, args),
        Command::Report { folders, out, png } => commands::report(folders, out, png),
        Command::Export(args) => export::export(args),
        Command::Schema { kind } => export::schema(kind),
        Command::Compare(args) => compare::compare(catalog, *args),
        Command::Bisect(args) => bisect::bisect(catalog, &args),
        Command::History { command } => history::history(command),
        Command::Completions { shell } => {
            let binary = catalog.program.binary;
            clap_complete::generate(shell, &mut Cli::command(), binary, &mut print::AnswerWriter);
            Ok(ExitCode::SUCCESS)
        }
        Command::Worker(args) => commands::worker(catalog, args),
    }
}

/// Keeps Mesa's device-select layer out of the run: it looks for a Wayland display, complains on standard error where
/// there is none, and may reorder the adapters.
fn quiet_driver_layers() {
    // SAFETY: no other thread runs yet.
    unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
}

#[derive(Parser)]
#[command(
    version,
    about,
    after_help = "Examples:\n  \
          fathom doctor                           does a run work on this machine?\n  \
          fathom run                              measure everything, then open the page that it names\n  \
          fathom run uw-default --set view.width=400\n  \
          fathom sweep volume_ao --scene my.glb --axis voxel.resolution=64,128,256\n  \
          fathom compare --base HEAD~1            did a stage become slower?\n  \
          fathom list parameters --pipeline hsao\n\n\
        Exit status: 0 all well; 1 a cell or a check failed, or `compare` found a regression; 2 bad input, or it could not run; \
        3 `compare` was inconclusive; 130 interrupted, with everything measured so far written. A closed pipe on standard output \
        changes no status."
)]
struct Cli {
    /// Print only errors on standard error
    #[arg(short, long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
pub enum Command {
    /// Measure experiments; write records, tables, plots and pictures
    Run(RunArgs),
    /// Time a pipeline on a scene or a mesh of your own, over the values of one or two parameters
    #[command(after_help = "Examples:\n  \
            fathom sweep volume_ao --scene my.glb --axis voxel.resolution=64,128,256\n  \
            fathom sweep underwater --scene tank --axis caustics.grid=100,200,400 --axis view.width=400,800 --budget 2m\n\n\
            Prints the time of each stage at each value with the error of its result, the exponent of its growth, and the knees: from which \
            size on a stage takes more than a share of the frame, and where its exponent changes. Writes what `fathom run` does, and the \
            experiment as sweep.toml: edit it, and `fathom run` measures it.")]
    Sweep(sweep::SweepArgs),
    /// Check whether a run works on this machine: adapters, clocks, assets, tools
    #[command(
        after_help = "Exit status: 0 the machine is ready for a run; 1 a warning says what would make its \
            times less precise; 2 no run is possible."
    )]
    Doctor(AnswerArgs),
    /// List experiments, claims, figures, scenes, pipelines, stages, parameters, adapters, exporters or generators
    List(ListArgs),
    /// Check the clocks that `run` uses on this adapter against the host clock
    Audit(AnswerArgs),
    /// Measure the adapter's own limits: bandwidth, fill, texels, atomics, arithmetic, small primitives, empty passes
    Ceilings(AnswerArgs),
    /// Compare every stage with its reference
    Verify {
        /// Only checks of stages whose names contain this
        filter: Option<String>,
        #[command(flatten)]
        args: AnswerArgs,
    },
    /// Download meshes and volumes that are not part of the project, with the ordinary package clients
    Fetch {
        /// Names of assets [default: all]
        assets: Vec<String>,
    },
    /// Render one frame of a scene, or a published figure, as PNG files
    Render(RenderArgs),
    /// Write a stage's outputs as .npy files with descriptions (docs/dumps.md)
    Dump(DumpArgs),
    /// Write the reports of a run or a comparison again, from its records alone; or one page of several
    Report {
        /// Folders of runs and comparisons
        #[arg(required = true, value_name = "DIR")]
        folders: Vec<PathBuf>,
        /// Write one page of all folders, into this folder
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Of one folder, write each plot as a PNG beside its SVG
        #[arg(long)]
        png: bool,
    },
    /// Write a folder's records in another format: CSV, JUnit, Bencher and others
    Export(ExportArgs),
    /// Print the JSON Schema (draft 2020-12) of the lines that fathom writes
    Schema {
        /// Which lines
        #[arg(value_enum, default_value_t)]
        kind: LineKind,
    },
    /// Compare two builds: did a stage become slower, costlier or less accurate?
    #[command(
        after_help = "Exit status: 0 no regression; 1 regression; 2 could not measure; 3 inconclusive; \
            4 times not judged, exact figures no worse; 130 interrupted, with everything measured so far stored."
    )]
    Compare(Box<compare_args::CompareArgs>),
    /// Find the revision, or the line of a list of candidates, that made a stage slower, costlier or less accurate, through noise
    #[command(
        after_help = "The ends are compared first. Then revisions between them are built and compared with the good one, in the cell that \
            regressed most. Exit status: 0 the first one is found, with a probability of 95 % or more; 1 nothing to find; 2 could not \
            measure; 3 several could not be told apart, or the ends are too noisy; 130 interrupted, and --resume goes on."
    )]
    Bisect(Box<compare_args::BisectArgs>),
    /// Store runs of many commits in a database, and find between which commits a stage changed
    History {
        #[command(subcommand)]
        command: history::HistoryCommand,
    },
    /// Print completions for a shell: `fathom completions bash > ~/.local/share/bash-completion/completions/fathom`
    Completions { shell: clap_complete::Shell },
    /// Serve a comparing process on standard input and output, one JSON object a line
    #[command(hide = true)]
    Worker(WorkerArgs),
}

#[derive(Args)]
pub struct WorkerArgs {
    /// Set a parameter in each cell whose pipeline has it; see `fathom list parameters`
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

/// How a command that runs on an adapter answers.
#[derive(Args)]
pub struct AnswerArgs {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Args)]
pub struct AdapterArgs {
    /// Part of the adapter's name, or its number in `fathom list adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    pub adapter: Option<String>,
    /// Do without a feature of the adapter; may be given several times
    #[arg(long, value_name = "FEATURE", value_parser = parse_feature)]
    pub without: Vec<Feature>,
    /// Compile shaders without bounds and loop checks
    #[arg(long)]
    pub unchecked: bool,
    /// On a software adapter, allow pipelines that take more than half of the memory, and frames that take minutes
    #[arg(long)]
    pub allow_large: bool,
}

impl AdapterArgs {
    pub fn options(&self) -> gpu::Options {
        gpu::Options {
            adapter: self.adapter.clone(),
            mask: Mask { without: self.without.clone() },
            unchecked: self.unchecked,
            allow_large: self.allow_large,
            ..gpu::Options::default()
        }
    }
}

#[derive(Args)]
pub struct RunArgs {
    /// Names of experiments or paths of experiment files [default: all built-in ones]
    pub experiments: Vec<String>,
    /// Set a parameter of every cell; see `fathom list parameters`
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
    /// Replace the values of an axis
    #[arg(long, value_name = "NAME=VALUE,…", value_parser = parse_axis)]
    pub axis: Vec<(String, Vec<String>)>,
    /// Measure only the cell of this name, as records and reports write it; may be given several times
    #[arg(long, value_name = "NAME")]
    pub cell: Vec<String>,
    /// Measure only part I of N of the cells; the records of all parts, in one file, are those of the run
    #[arg(long, value_name = "I/N")]
    pub shard: Option<Part>,
    /// Measure what the folder's records lack, and go on with cells and claims that need more samples [default folder: the latest one there]
    #[arg(long)]
    pub resume: bool,
    /// Seed of the order of cells and frames [default: drawn, and recorded]
    #[arg(long)]
    pub seed: Option<u64>,
    /// Skip measuring the adapter's limits, which takes some seconds; stages then have no share of a limit
    #[arg(long)]
    pub no_ceilings: bool,
    #[command(flatten)]
    pub measured: MeasureArgs,
}

/// How a run or a sweep measures.
#[derive(Args)]
pub struct MeasureArgs {
    /// Sizes: `quick` for software drivers, `paper` as published [default: by the adapter]
    #[arg(long, value_enum)]
    pub profile: Option<Profile>,
    /// Time of the whole command, of a shard's for its own: `90s`, `5m`, `1h30m`, or a number of seconds. Cells that it leaves are
    /// listed, with the command that measures them [default: at most 4 minutes quick, 30 paper]
    #[arg(long, value_name = "TIME", value_parser = calendar::duration)]
    pub budget: Option<Duration>,
    /// Visits to each cell at most, 10 s apart; an interval takes 4 [default: as many as the budget has time for, 12 at most]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub visits: Option<u32>,
    /// Folder to write to [default: a new one in fathom-runs, in a checkout in reports/out]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Write each plot as a PNG beside its SVG when the run ends
    #[arg(long)]
    pub png: bool,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

/// What there is to list; its name is its heading.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Listing {
    Experiments,
    Figures,
    Scenes,
    Stages,
    Parameters,
    Adapters,
    Pipelines,
    Exporters,
    Claims,
    Generators,
}

#[derive(Args)]
pub struct ListArgs {
    /// What to list [default: everything but parameters, claims and generators]
    pub what: Option<Listing>,
    /// Only rows that contain this
    pub filter: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// List the stages that a pipeline runs, or its parameters [default for parameters: underwater]
    #[arg(long)]
    pub pipeline: Option<String>,
    /// List the parameters with the values that a scene gives them [default: tank]
    #[arg(long)]
    pub scene: Option<String>,
    /// List the parameters with one of them set
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
}

#[derive(Args)]
pub struct RenderArgs {
    /// Name of a scene, or path of a scene file
    #[arg(required_unless_present = "figure")]
    pub scene: Option<String>,
    /// Render a published figure in place of a scene, those of a paper (`uw`, `vao`, `spt`), or `all`: see `fathom list figures`
    #[arg(long, value_name = "NAME", conflicts_with_all = ["scene", "pipeline"])]
    pub figure: Option<String>,
    #[arg(long, default_value = PIPELINE)]
    pub pipeline: String,
    /// Set a parameter, of a figure in all its panels; see `fathom list parameters`
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
    /// Samples of a pixel, which smooth edges: 1, 4, 9 or 16 [default: 1; of a figure 4, or what its file says]
    #[arg(long, value_parser = parse_samples)]
    pub samples: Option<u32>,
    /// File to write [default: SCENE.png]; of a figure the folder [default: figures]
    #[arg(short, long, value_name = "PATH")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Args)]
pub struct DumpArgs {
    /// Name of a stage; see `fathom list stages`
    pub stage: String,
    #[arg(long, default_value = PIPELINE)]
    pub pipeline: String,
    /// Name of a scene, or path of a scene file
    #[arg(long, default_value = SCENE)]
    pub scene: String,
    /// Set a parameter; see `fathom list parameters`
    #[arg(long, value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, Value)>,
    /// Folder to write to
    #[arg(short, long, value_name = "DIR", default_value = ".")]
    pub output: PathBuf,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Args)]
pub struct ExportArgs {
    /// Name of a format; see `fathom list exporters`
    pub format: String,
    /// Folder of a run or of a comparison
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// File to write, or the folder for it [default: standard output]
    #[arg(short, long, value_name = "PATH")]
    pub output: Option<PathBuf>,
}

fn parse_feature(text: &str) -> Result<Feature, String> {
    let all = || Feature::iter().map(|feature| feature.to_string());
    text.parse().map_err(|_| format!("there are {}", all().collect::<Vec<_>>().join(", ")))
}

fn parse_samples(text: &str) -> Result<u32, String> {
    let known = [1, 4, 9, 16];
    let samples = text.parse().ok().filter(|samples| known.contains(samples));
    samples.ok_or_else(|| "samples of a pixel are 1, 4, 9 or 16".to_owned())
}

/// Help was asked for, or the line is wrong.
fn not_parsed(error: clap::Error) -> ExitCode {
    if let ErrorKind::DisplayHelp
    | ErrorKind::DisplayVersion
    | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand = error.kind()
    {
        print::failed_if(error.print());
    } else {
        print::note(one_line(&error.render().to_string()));
    }
    match error.exit_code() {
        0 => exit_status(Ok(ExitCode::SUCCESS)),
        _ => ExitCode::from(COULD_NOT_RUN),
    }
}

/// clap's message up to its usage, and its tips; a guess at an option only where it begins as what was written, unlike `--allow-large` for
/// `--parallel`.
fn one_line(message: &str) -> String {
    let lines = message.lines().map(str::trim);
    let head = lines.clone().take_while(|line| !line.is_empty()).collect::<Vec<_>>().join(" ");
    let initial = |line: &str| line.split("'--").nth(1).and_then(|option| option.chars().next());
    let fits = |tip: &&str| initial(tip).is_none_or(|letter| initial(&head) == Some(letter));
    let is_of_use = |line: &&str| line.starts_with("tip:") && !line.contains(" as a value, use ");
    let tips = lines.filter(is_of_use).filter(fits);
    std::iter::once(head.as_str()).chain(tips).collect::<Vec<_>>().join("; ")
}

/// The status of a command. Prints its error on one line, with the causes that it does not tell of itself. A command that
/// did well but could not write its answer could not do what it was asked for.
pub fn exit_status(result: anyhow::Result<ExitCode>) -> ExitCode {
    let status = result.unwrap_or_else(|error| {
        let mut message = String::new();
        for cause in error.chain().map(ToString::to_string) {
            if message.is_empty() {
                message = cause;
            } else if !message.contains(&cause) {
                message = format!("{message}: {cause}");
            }
        }
        fail(&message)
    });
    match print::write_failure() {
        Some(error) if status == ExitCode::SUCCESS => {
            fail(&format!("cannot write to standard output: {error}"))
        }
        _ => status,
    }
}

/// Prints an error on one line.
pub fn fail(message: &str) -> ExitCode {
    print::error(message);
    ExitCode::from(COULD_NOT_RUN)
}

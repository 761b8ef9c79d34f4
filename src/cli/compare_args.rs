//! Arguments of `fathom compare` and `fathom bisect`.

use std::path::PathBuf;

use clap::Args;

use super::{AdapterArgs, AnswerArgs};
use crate::exporters::OF_COMPARISONS;
use crate::record::comparison::{self, Gate, MAX_LAUNCHES, MAX_PAIRS};

/// The format that is printed where none is asked for.
const TEXT: &str = "text";

#[derive(Args)]
pub struct CompareArgs {
    /// Two runs in place of two builds, each a folder or its file of records: what changed from one to the other. Exact figures are judged; times are not, as two runs share no pairs
    #[arg(value_names = ["BASE", "HEAD"], num_args = 2, conflicts_with_all = ["base", "base_exact", "base_bin", "replay", "resume", "out", "format"])]
    pub records: Vec<PathBuf>,
    /// Revision to build as the base: the commit in which it and the head part, their merge base
    #[arg(long, value_name = "REV", conflicts_with_all = ["base_bin", "replay"])]
    pub base: Option<String>,
    /// Revision to build as the base, itself
    #[arg(long, value_name = "REV", conflicts_with_all = ["base", "base_bin", "replay"])]
    pub base_exact: Option<String>,
    /// A built fathom as the base
    #[arg(long, value_name = "PATH", conflicts_with = "replay")]
    pub base_bin: Option<PathBuf>,
    /// A built fathom as the head [default: this one]
    #[arg(long, value_name = "PATH", conflicts_with = "replay")]
    pub head_bin: Option<PathBuf>,
    /// Command of the shell that starts the base's workers: any program that speaks the worker protocol (docs/worker-protocol.md)
    #[arg(long, value_name = "COMMAND", requires = "head_cmd", conflicts_with_all = ["base", "base_exact", "base_bin", "head_bin", "replay", "records"])]
    pub base_cmd: Option<String>,
    /// Command that starts the head's workers
    #[arg(long, value_name = "COMMAND", requires = "base_cmd")]
    pub head_cmd: Option<String>,
    /// Environment variable for the base's processes alone; may be given several times. The base is this program, unless one is named
    #[arg(long, value_name = "NAME=VALUE", conflicts_with_all = ["replay", "records"])]
    pub base_env: Vec<String>,
    /// Environment variable for the head's processes alone; may be given several times
    #[arg(long, value_name = "NAME=VALUE", conflicts_with_all = ["replay", "records"])]
    pub head_env: Vec<String>,
    /// Write the values of these variables into records and reports too; without it only their names are written
    #[arg(long, conflicts_with_all = ["replay", "records"])]
    pub env_values: bool,
    /// Gates to run
    #[arg(long, value_name = "GATE,…", value_delimiter = ',', value_parser = parse_gate, default_value = "exact,instructions,time")]
    pub gates: Vec<Gate>,
    /// Pairs of worker processes in the time gate; as many again for cells that are still undecided
    #[arg(long, default_value_t = comparison::LAUNCHES, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_LAUNCHES)))]
    pub launches: u32,
    /// Pairs of samples of each cell in each launch
    #[arg(long, default_value_t = comparison::PAIRS, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_PAIRS)))]
    pub pairs: u32,
    /// Share by which a time must change to count
    #[arg(long, value_name = "SHARE", default_value_t = comparison::THRESHOLD, value_parser = parse_share)]
    pub threshold: f64,
    /// Share by which an instruction count must change to count
    #[arg(long, value_name = "SHARE", default_value_t = comparison::INSTRUCTION_THRESHOLD, value_parser = parse_share)]
    pub instruction_threshold: f64,
    /// Only cells whose names contain this
    #[arg(long, value_name = "FILTER")]
    pub cells: Option<String>,
    /// Experiment file whose cells list the `stages` to compare [default: benches/gates.toml, built in]
    #[arg(long, value_name = "FILE")]
    pub cells_file: Option<PathBuf>,
    /// The same file of the base: its cells that the head's lacks are named [default: as the base's revision has it]
    #[arg(long, value_name = "FILE", requires = "cells_file")]
    pub base_cells_file: Option<PathBuf>,
    /// Seed of the order of cells and samples [default: drawn, and stored]
    #[arg(long)]
    pub seed: Option<u64>,
    /// Folder to write to [default: a new one in fathom-runs, in a checkout in reports/out]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Measure only what the folder lacks
    #[arg(long, requires = "out")]
    pub resume: bool,
    /// Measure also what asks the GPU for the same work on the same inputs in both builds
    #[arg(long)]
    pub all: bool,
    /// Print the comparison stored in a folder, and write its reports again
    #[arg(long, value_name = "DIR", conflicts_with_all = ["out", "resume"])]
    pub replay: Option<PathBuf>,
    /// What to print; files of every other format are written in any case
    #[arg(long, default_value = TEXT, value_parser = clap::builder::PossibleValuesParser::new(OF_COMPARISONS.map(|format| format.name)))]
    pub format: String,
    #[command(flatten)]
    pub adapter: AdapterArgs,
}

#[derive(Args)]
pub struct BisectArgs {
    /// Known-good revision
    #[arg(long, value_name = "REV", required_unless_present = "candidates")]
    pub good: Option<String>,
    /// Later revision that is worse
    #[arg(long, value_name = "REV", default_value = "HEAD")]
    pub bad: String,
    /// Search among the lines of a file in place of revisions, the known-good one first. The commands find a line in $CANDIDATE
    #[arg(long, value_name = "FILE", conflicts_with_all = ["good", "bad"], requires = "cmd")]
    pub candidates: Option<PathBuf>,
    /// Command of the shell that builds a candidate, a revision in its checkout
    #[arg(long, value_name = "COMMAND", requires = "cmd")]
    pub build_cmd: Option<String>,
    /// Command that starts a candidate's worker, in place of cargo's program: any program that speaks the worker protocol
    /// (docs/worker-protocol.md)
    #[arg(long, value_name = "COMMAND")]
    pub cmd: Option<String>,
    /// Gates that tell a change; the first of exact, instructions and time that does is searched by [default: instructions,time]
    #[arg(long, value_name = "GATE,…", value_delimiter = ',', value_parser = parse_gate)]
    pub gates: Vec<Gate>,
    /// Only cells whose names contain this
    #[arg(long, value_name = "FILTER")]
    pub cells: Option<String>,
    /// Experiment file whose cells list the `stages` to compare [default: benches/gates.toml, built in]
    #[arg(long, value_name = "FILE")]
    pub cells_file: Option<PathBuf>,
    /// Pairs of worker processes between the ends
    #[arg(long, default_value_t = comparison::LAUNCHES, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_LAUNCHES)))]
    pub launches: u32,
    /// Pairs of worker processes each time that a candidate is measured
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_LAUNCHES)))]
    pub batch: u32,
    /// Pairs of worker processes for the whole search, those of the ends apart
    #[arg(long = "most-launches", value_name = "N", default_value_t = 120)]
    pub max_launches: u32,
    /// Share by which a time must change to count
    #[arg(long, value_name = "SHARE", default_value_t = comparison::THRESHOLD, value_parser = parse_share)]
    pub threshold: f64,
    /// Seed of the order of cells and samples
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder to write to [default: a new one in fathom-runs, in a checkout in reports/out]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Go on with the search in the folder
    #[arg(long, requires = "out")]
    pub resume: bool,
    #[command(flatten)]
    pub answer: AnswerArgs,
}

fn parse_gate(name: &str) -> Result<Gate, String> {
    let names = || Gate::ALL.map(|gate| gate.to_string()).join(", ");
    let gate = Gate::ALL.into_iter().find(|gate| gate.to_string() == name);
    gate.ok_or_else(|| format!("gates are {}", names()))
}

fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if 0.0 < share && share < 1.0 => Ok(share),
        _ => Err("a share lies between 0 and 1, such as 0.02".to_owned()),
    }
}

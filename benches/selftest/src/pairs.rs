//! `fathom-pairs`: how narrow ratios of times are on a machine that others use, and how often their intervals hold the truth.
//!
//! Beside a process that works and rests in turns, the cells of `benches/selftest/pairs.toml` are measured in two orders: each
//! cell apart, and together with the cells that a claim compares it with (`harness::sample::visit`). Rounds of the two orders
//! alternate. Both render the same frames, so they take the same time. Of a block of rounds each order gives each pair of
//! neighbours two ratios, one of timed and one of untimed frames. The true ratio of equal cells is 1.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Parser;
use fathom::Catalog;
use fathom::experiments::{CellPlan, Experiment};
use fathom::folder::Folder;
use fathom::gpu::{self, FrameTimer, Gpu};
use fathom::harness::MAX_PASSES;
use fathom::harness::plan::{self, Request};
use fathom::harness::sample::visit::{Frame, Visits};
use fathom::pipelines::AnyPipeline;
use fathom::process::ProcessTree;
use fathom::record::{Outcome, Profile};
use fathom::report::format::{Table, three};
use fathom::statistics::{self, Estimate, median};
use fathom::{quiet, tell, text};
use itertools::Itertools;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;
use strum::{Display, EnumIter, IntoEnumIterator};

const EXPERIMENT: &str = "benches/selftest/pairs.toml";
/// Of each order in a block. The interval of a median of 17 samples has a level of 95.1 %, nearer to 95 % than that of other numbers.
const ROUNDS: usize = 17;
/// How long the process beside works or rests at a time, in seconds.
const TURN_S: std::ops::Range<f64> = 0.1..2.0;
/// What it reads while it works: more than caches hold.
const WORK_BYTES: usize = 64 << 20;
/// Readings of a frame before its clock is given up.
const ATTEMPTS: usize = 20;
const RESULTS: [&str; 2] = ["pairs.json", "pairs.md"];

/// Measure how narrow ratios of times are beside a process that works and rests, in the order of `fathom run` and in random order
#[derive(Parser)]
#[command(version)]
struct Cli {
    /// Folder of the results
    #[arg(long, value_name = "DIR", default_value = "reports/out/pairs")]
    out: PathBuf,
    /// Minutes of sampling; preparing comes on top
    #[arg(long, default_value_t = 10.0)]
    minutes: f64,
    /// Seed of the orders and of the turns of the process beside
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Part of the adapter's name, or its number in `fathom list adapters`
    #[arg(long, value_name = "NAME|INDEX")]
    adapter: Option<String>,
    /// Only work and rest, until this process is killed
    #[arg(long, hide = true)]
    beside: bool,
}

fn main() -> anyhow::Result<()> {
    let cli = Cli::parse();
    if cli.beside {
        work_and_rest(cli.seed);
    }
    quiet::begin_again();
    let mut bench = Bench::open(&cli)?;
    let own = quiet::allowed_cores();
    let other = quiet::cores_before().into_iter().find(|core| !own.contains(core));
    let beside = Beside::start(cli.seed, other)?;
    let found = bench.measure(&cli)?;
    drop(beside);
    let findings = Findings {
        adapter: bench.gpu.adapter.name.clone(),
        cores: own,
        core_beside: other,
        cells: bench.cells.len(),
        blocks: found.blocks,
        round_s: found.round_s,
        rows: Cells::iter().map(|cells| Row::of(cells, &found.ratios)).collect(),
    };
    let folder = Folder::make(&cli.out)?;
    for (name, text) in
        RESULTS.iter().zip([serde_json::to_string(&findings)? + "\n", findings.markdown()])
    {
        let path = cli.out.join(name);
        folder
            .write(name, text.as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))?;
        tell::done(path.display());
    }
    Ok(())
}

fn work_and_rest(seed: u64) -> ! {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut words = vec![1u64; WORK_BYTES / size_of::<u64>()];
    loop {
        let end = Instant::now() + Duration::from_secs_f64(random.random_range(TURN_S));
        while Instant::now() < end {
            for word in &mut words {
                *word = word.wrapping_mul(3);
            }
            std::hint::black_box(&mut words);
        }
        std::thread::sleep(Duration::from_secs_f64(random.random_range(TURN_S)));
    }
}

/// The process that works and rests; it ends when this is dropped.
struct Beside(#[expect(dead_code, reason = "kept until it is to end")] ProcessTree);

impl Beside {
    fn start(seed: u64, core: Option<usize>) -> anyhow::Result<Self> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["--beside", "--seed", &seed.to_string()]).stdin(Stdio::null());
        let process = ProcessTree::spawn(&mut command)?;
        if let Some(core) = core {
            quiet::pin(process.id(), core);
        }
        Ok(Self(process))
    }
}

struct Bench {
    gpu: Gpu,
    timer: FrameTimer,
    cells: Vec<(CellPlan, Box<AnyPipeline>)>,
    chains: Vec<Vec<usize>>,
}

/// Times of a cell in one order: of timed and of untimed frames, one for each round.
type Times = [Vec<f64>; 2];

/// The two orders.
#[derive(Clone, Copy)]
enum Order {
    Apart,
    Together,
}

struct Ratio {
    /// Never all.
    cells: Cells,
    /// By [`Order`].
    estimates: [Estimate; 2],
}

#[derive(Default)]
struct Found {
    blocks: usize,
    round_s: f64,
    ratios: Vec<Ratio>,
}

impl Bench {
    fn open(cli: &Cli) -> anyhow::Result<Self> {
        let gpu =
            Gpu::open(&gpu::Options { adapter: cli.adapter.clone(), ..gpu::Options::default() })?;
        let mut timer = FrameTimer::new(&gpu, gpu::audit_all(&gpu)?.plan, MAX_PASSES)?;
        let experiment = Experiment::read(Path::new(EXPERIMENT))?;
        let planned = plan::plan(
            vec![experiment],
            &Request::default(),
            Profile::Quick,
            &gpu.capacity,
            &Catalog::builtin(),
        )?;
        let [planned] = &planned[..] else { bail!("{EXPERIMENT} has no cell") };
        let unmeasured = Outcome::Skipped { reason: String::new() };
        let records =
            planned.cells.iter().map(|cell| cell.record(unmeasured.clone())).collect_vec();
        let chains = planned.experiment.chains(&records.iter().collect_vec());
        let mut cells = Vec::new();
        for cell in &planned.cells {
            let pipeline = cell.subject.build(&gpu)?;
            timer.untimed(&gpu, &pipeline.stages())?;
            cells.push((cell.plan.clone(), pipeline));
        }
        Ok(Self { gpu, timer, cells, chains })
    }

    /// Blocks of rounds, as many as fit into the time, at least one.
    fn measure(&mut self, cli: &Cli) -> anyhow::Result<Found> {
        let mut random = Pcg64::seed_from_u64(cli.seed);
        let start = Instant::now();
        let limit = Duration::from_secs_f64(60.0 * cli.minutes);
        let mut found = Found::default();
        loop {
            self.block(&mut random, &mut found)?;
            found.blocks += 1;
            let block = start.elapsed() / found.blocks as u32;
            found.round_s = block.as_secs_f64() / (2 * ROUNDS) as f64;
            tell::note(format!("block {} of {:.0} s", found.blocks, block.as_secs_f64()));
            if start.elapsed() + block > limit {
                return Ok(found);
            }
        }
    }

    fn block(&mut self, random: &mut Pcg64, found: &mut Found) -> anyhow::Result<()> {
        let all = (0..self.cells.len()).collect_vec();
        let apart = all.iter().map(|cell| vec![*cell]);
        let mut visits = [Visits::new(apart), Visits::new(self.chains.clone())];
        let mut times: [Vec<Times>; 2] = [(); 2].map(|()| vec![Times::default(); all.len()]);
        for round in 0..2 * ROUNDS {
            let order = if round % 2 == 0 { Order::Apart } else { Order::Together } as usize;
            let known = &times[order];
            let pair_s =
                |cell: usize| known[cell].iter().filter_map(|ns| ns.last()).sum::<f64>() * 1e-9;
            for frame in visits[order].round(&all, pair_s, random).concat() {
                let ns = self.frame(frame)?;
                times[order][frame.cell][usize::from(frame.timed)].push(ns);
            }
        }
        for (a, b) in self.chains.iter().flat_map(|chain| chain.iter().tuple_windows()) {
            let overrides = |cell: &usize| &self.cells[*cell].0.overrides;
            let cells = if overrides(a) == overrides(b) { Cells::Equal } else { Cells::Different };
            for timed in 0..2 {
                let estimates = times.each_ref().map(|of| {
                    let values = [a, b].map(|cell| of[*cell][timed].iter().copied());
                    let [over, under] = values;
                    statistics::ratio_estimate(&over.zip(under).collect_vec())
                });
                found.ratios.push(Ratio { cells, estimates });
            }
        }
        Ok(())
    }

    fn frame(&mut self, Frame { cell, timed }: Frame) -> anyhow::Result<f64> {
        let stages = self.cells[cell].1.stages();
        for _ in 0..ATTEMPTS {
            let ns = if timed {
                let frame = self.timer.timed(&self.gpu, &stages)?;
                if frame.faults.is_empty() { frame.envelope_ns } else { 0.0 }
            } else {
                self.timer.untimed(&self.gpu, &stages)?
            };
            if ns > 0.0 {
                return Ok(ns);
            }
        }
        bail!("{}: no acceptable reading of the clock", self.cells[cell].0.cell)
    }
}

#[derive(Serialize)]
struct Findings {
    adapter: String,
    /// That this process could run on.
    cores: Vec<usize>,
    /// Of the process that works and rests, where it had one of its own.
    core_beside: Option<usize>,
    cells: usize,
    blocks: usize,
    /// Seconds.
    round_s: f64,
    rows: Vec<Row>,
}

/// Between which cells ratios are taken.
#[derive(Clone, Copy, PartialEq, Eq, Display, EnumIter, Serialize)]
#[serde(rename_all = "snake_case")]
enum Cells {
    #[strum(to_string = "equal")]
    Equal,
    #[strum(to_string = "of different sizes")]
    Different,
    #[strum(to_string = "all")]
    All,
}

#[derive(Serialize)]
struct Row {
    cells: Cells,
    ratios: usize,
    /// Medians of half widths over their ratios, of cells apart and together.
    half_widths: [f64; 2],
    /// Median of the half width together over that of the same ratio apart.
    narrower: Estimate,
    /// Intervals that hold 1, of cells apart and together.
    hold_one: [usize; 2],
}

impl Row {
    fn of(cells: Cells, ratios: &[Ratio]) -> Self {
        let among = |ratio: &&Ratio| match cells {
            Cells::All => true,
            _ => ratio.cells == cells,
        };
        let ratios = ratios.iter().filter(among).collect_vec();
        let widths = |order: Order| {
            ratios
                .iter()
                .map(|ratio| ratio.estimates[order as usize].relative_half_width())
                .collect_vec()
        };
        let holds = |order: Order| {
            let ends = ratios.iter().map(|ratio| ratio.estimates[order as usize].ends());
            ends.filter(|[low, high]| *low <= 1.0 && *high >= 1.0).count()
        };
        let [apart, together] = [Order::Apart, Order::Together].map(widths);
        let quotients = together.iter().zip(&apart).map(|(together, apart)| (*together, *apart));
        Self {
            cells,
            ratios: ratios.len(),
            half_widths: [median(&apart), median(&together)],
            narrower: statistics::ratio_estimate(&quotients.collect_vec()),
            hold_one: [Order::Apart, Order::Together].map(holds),
        }
    }

    fn texts(&self) -> [String; 7] {
        let percent = |share: f64| format!("{} %", three(100.0 * share));
        let held = |held: usize| match self.cells {
            Cells::Equal => percent(held as f64 / self.ratios as f64),
            Cells::Different | Cells::All => "–".to_owned(),
        };
        let [low, high] = self.narrower.ends();
        [
            self.cells.to_string(),
            self.ratios.to_string(),
            percent(self.half_widths[0]),
            percent(self.half_widths[1]),
            format!("{} ({} – {})", three(self.narrower.median), three(low), three(high)),
            held(self.hold_one[0]),
            held(self.hold_one[1]),
        ]
    }
}

impl Findings {
    fn markdown(&self) -> String {
        let beside = match self.core_beside {
            Some(_) => "another core",
            None => "the same core",
        };
        let Self { cells, blocks, round_s, .. } = self;
        let mut table = Table::new([
            "cells",
            "ratios",
            "half width apart",
            "together",
            "together / apart (median, 95 %)",
            "apart: hold 1",
            "together: hold 1",
        ]);
        for row in &self.rows {
            table.row(row.texts());
        }
        format!(
            "# Ratios of times beside a process that works and rests\n\n{}, {cells} cells, {blocks} blocks of {ROUNDS} rounds of each \
             order, a round takes {} s. A process on {beside} works and rests in turns of {} to {} s.\n\nHalf widths are those of 95 % \
             intervals of the median, over the ratio. Each pair of cells gives two ratios a block, of timed and of untimed frames.\n\n{}",
            text::markdown(&self.adapter),
            three(*round_s),
            TURN_S.start,
            TURN_S.end,
            table.markdown()
        )
    }
}

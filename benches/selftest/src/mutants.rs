//! `fathom-selftest mutants`: which faults of shaders does `fathom verify` find?
//!
//! Faults are drawn with a seed. Each is tried by processes of its own, in which a folder with the changed file lies before fathom's shaders:
//! one runs the checks of stages whose shaders hold the file until one fails; if none does, another one asks whether any output of any stage
//! changes at random settings. A fault that changes none is equivalent. The others that no check finds are the survivors.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use clap::Args;
use fathom::embedded::{Folder, Folders, SHADERS};
use fathom::gpu::{Gpu, GpuError, Options, link, shader_paths};
use fathom::print;
use fathom::process::{self, Limits, ProcessError};
use fathom::report::document::Table;
use fathom::verify::{Case, Check, VerifyError, cases, verify};
use itertools::Itertools;
use rand::SeedableRng;
use rand::seq::{IndexedRandom, SliceRandom};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::effect;
use crate::faults::{Fault, faults};

/// Shaders that no stage has: limits of the adapter, and what the clock is audited with.
const OF_NO_STAGE: [&str; 2] = ["ceilings/", "audit/"];
/// Of a process that tries a fault. A loop that does not end is found by it.
const TIME_LIMIT: Duration = Duration::from_secs(900);

#[derive(Args)]
pub struct MutantArgs {
    /// How many faults, of those that compile
    #[arg(long, default_value_t = 100)]
    count: usize,
    /// Which are drawn
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only in files whose paths hold this
    #[arg(long, default_value = "")]
    files: String,
    /// As of `fathom verify`
    #[arg(long)]
    adapter: Option<String>,
    /// Where `mutants.md` is written; what is known of the checks is kept there
    #[arg(long, value_name = "DIR", default_value = "reports/out/mutants")]
    out: PathBuf,
}

/// What a process does; its answer is a line of JSON.
#[derive(Args)]
pub struct WorkerArgs {
    /// Folder that lies before fathom's shaders
    #[arg(long)]
    shaders: Option<PathBuf>,
    #[arg(long)]
    adapter: Option<String>,
    /// Numbers of the cases to run, the first first
    #[arg(long, value_delimiter = ',')]
    cases: Vec<usize>,
    /// Say which stages' outputs this file changes
    #[arg(long)]
    effect: Option<String>,
}

/// What became of a fault.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Outcome {
    /// A check, or how the process ended.
    Found(String),
    Survived(String),
    /// What was tried.
    Equivalent(String),
    /// It does not compile with some values of the host.
    Invalid,
}

/// What a case takes, and the files of the shaders that it runs.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct CaseProfile {
    stage: String,
    seconds: f64,
    files: BTreeSet<String>,
}

/// Checks found 72 of 81 faults of seed 100420; a sample of twenty may have fewer.
const MIN_FOUND: f64 = 0.8;
/// No check fails.
const PASSED: &str = "passed";

fn own_shaders() -> Folders {
    Folders::new(SHADERS)
}

fn with_folder(folder: &Option<PathBuf>) -> Folders {
    match folder {
        Some(folder) => Folders::new(Folder::from_path(folder)).with(SHADERS),
        None => own_shaders(),
    }
}

fn open(adapter: &Option<String>, shaders: Folders) -> Result<Gpu, GpuError> {
    let (adapter, shaders) = (adapter.clone(), Some(shaders));
    Gpu::open(&Options { adapter, shaders, ..Options::default() })
}

/// The files that a shader is linked of, as paths without their endings.
pub fn linked_files(path: &str) -> BTreeSet<String> {
    let (mut files, mut waiting) = (BTreeSet::new(), vec![path.to_owned()]);
    while let Some(path) = waiting.pop() {
        let text = SHADERS.text(&format!("{path}.wgsl")).unwrap_or_default();
        let imports = text.lines().filter_map(|line| line.trim().strip_prefix("#import fathom::"));
        let name =
            |import: &str| import.split([':', ' ']).next().map(|name| format!("shared/{name}"));
        waiting.extend(imports.filter_map(name).filter(|import| !files.contains(import)));
        files.insert(path);
    }
    files
}

/// In a process of its own.
pub fn work(args: &WorkerArgs) -> Result<()> {
    let shaders = with_folder(&args.shaders);
    let answer = match (&args.effect, args.cases.is_empty()) {
        (Some(file), _) => {
            let [own, changed] = [own_shaders(), shaders].map(|from| open(&args.adapter, from));
            serde_json::to_string(&effect::of(&own?, &changed?, file)?)?
        }
        (None, true) => serde_json::to_string(&profile(&args.adapter)?)?,
        (None, false) => serde_json::to_string(&first_failure(args, shaders)?)?,
    };
    print::answer(answer);
    Ok(())
}

/// Each case on a device of its own, so that it links its shaders itself.
fn profile(adapter: &Option<String>) -> Result<Vec<CaseProfile>> {
    let measure = |case: &Case| {
        let gpu = open(adapter, own_shaders())?;
        let begin = Instant::now();
        verify(&gpu, std::slice::from_ref(case), None, |_| ())?;
        let seconds = begin.elapsed().as_secs_f64();
        let shaders = gpu.shader_variants();
        let files = shaders.iter().flat_map(|key| linked_files(&key.path)).collect();
        Ok(CaseProfile { stage: case.stage.to_owned(), seconds, files })
    };
    cases().iter().map(measure).collect()
}

/// The check that is the first to fail, its error, or that all pass.
fn first_failure(args: &WorkerArgs, shaders: Folders) -> Result<Outcome> {
    let (all, gpu) = (cases(), open(&args.adapter, shaders)?);
    for number in &args.cases {
        let case = &all[*number];
        let verified = match verify(&gpu, std::slice::from_ref(case), None, |_| ()) {
            Ok(verified) => verified,
            Err(VerifyError::Gpu(GpuError::Shader { .. })) => return Ok(Outcome::Invalid),
            Err(error) => return Ok(Outcome::Found(format!("{}: {error}", case.stage))),
        };
        let mut checks = verified.checks.iter().filter(|check| !is_stored(check));
        if let Some(check) = checks.find(|check| !check.is_sound()) {
            return Ok(Outcome::Found(format!("{}: {}", check.stage, check.what)));
        }
    }
    Ok(Outcome::Survived(PASSED.to_owned()))
}

/// Whether a check compares with a stored figure of the shader itself, or of a copy of it: such a check finds nothing here.
fn is_stored(check: &Check) -> bool {
    ["=", "f64 copy", "stored"].iter().any(|sign| check.what.contains(sign))
}

/// Faults that compile, of each kind about as many.
fn draw(args: &MutantArgs) -> Vec<(Fault, String)> {
    let texts: BTreeMap<String, String> = own_shaders().texts(".wgsl").into_iter().collect();
    let is_asked = |file: &str| {
        file.contains(&args.files) && OF_NO_STAGE.iter().all(|prefix| !file.starts_with(prefix))
    };
    let mut random = Pcg64::seed_from_u64(args.seed);
    let all = texts.iter().filter(|(file, _)| is_asked(file));
    let all = all.flat_map(|(file, source)| faults(file, source));
    let mut kinds: Vec<Vec<Fault>> =
        all.into_group_map_by(|fault| fault.kind).into_values().collect();
    kinds.sort_unstable();
    kinds.iter_mut().for_each(|faults| faults.shuffle(&mut random));
    let mut drawn = Vec::new();
    while drawn.len() < args.count {
        kinds.retain(|faults| !faults.is_empty());
        let numbers: Vec<usize> = (0..kinds.len()).collect();
        let Some(fault) = numbers.choose(&mut random).and_then(|kind| kinds[*kind].pop()) else {
            break;
        };
        let changed = fault.apply(&texts[&fault.file]);
        if links(&fault, &changed) {
            drawn.push((fault, changed));
        }
    }
    drawn
}

/// A folder with the changed file alone.
fn folder_with(fault: &Fault, changed: &str) -> std::io::Result<tempfile::TempDir> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(format!("{}.wgsl", fault.file));
    std::fs::create_dir_all(path.parent().unwrap_or(Path::new("/")))?;
    std::fs::write(path, changed)?;
    Ok(folder)
}

/// Whether every shader that holds the file links.
fn links(fault: &Fault, changed: &str) -> bool {
    let Ok(folder) = folder_with(fault, changed) else { return false };
    let shaders = with_folder(&Some(folder.path().to_owned()));
    shader_paths(&own_shaders())
        .iter()
        .all(|path| !linked_files(path).contains(&fault.file) || link(&shaders, path, &[]).is_ok())
}

/// Fails if checks find less than [`MIN_FOUND`] of the faults that change an output.
pub fn run(args: &MutantArgs) -> Result<()> {
    std::fs::create_dir_all(&args.out)?;
    let profiles = load_profiles(args)?;
    let drawn = draw(args);
    let outcome = |(number, (fault, changed)): (usize, &(Fault, String))| {
        let outcome = try_fault(args, &profiles, (fault, changed))?;
        print::note(format!("{number} {} {}:{}: {outcome:?}", fault.kind, fault.file, fault.line));
        Ok(outcome)
    };
    let outcomes: Vec<Outcome> =
        drawn.par_iter().enumerate().map(outcome).collect::<Result<_>>()?;
    let path = args.out.join("mutants.md");
    let (text, found) = markdown(args, drawn.iter().map(|(fault, _)| fault).zip(&outcomes));
    std::fs::write(&path, text)?;
    print::status(path.display());
    ensure!(found >= MIN_FOUND, "{:.0} % found of the faults that change an output", 100.0 * found);
    Ok(())
}

/// Measured once for a folder of results.
fn load_profiles(args: &MutantArgs) -> Result<Vec<CaseProfile>> {
    let path = args.out.join("profile.json");
    if !path.is_file() {
        std::fs::write(&path, answer(args, &[])?)?;
    }
    let text = std::fs::read_to_string(&path)?;
    let known: Vec<CaseProfile> = serde_json::from_str(&text).unwrap_or_default();
    let is_same = cases().iter().map(|case| case.stage).eq(known.iter().map(|case| &case.stage));
    ensure!(is_same, "{} is of other checks: remove it to measure anew", path.display());
    Ok(known)
}

/// What a process of these arguments says.
fn answer(args: &MutantArgs, arguments: &[String]) -> Result<String, ProcessError> {
    let mut command = Command::new(std::env::current_exe().map_err(ProcessError::Io)?);
    command.arg("mutant").args(arguments).env("RAYON_NUM_THREADS", "1").env("LP_NUM_THREADS", "1");
    command.args(args.adapter.iter().flat_map(|name| ["--adapter", name]));
    let limits = Limits { time: Some(TIME_LIMIT), interrupted: Some(&crate::INTERRUPT) };
    process::run(&mut command, limits, &mut |_| ())
}

fn try_fault(
    args: &MutantArgs,
    profiles: &[CaseProfile],
    (fault, changed): (&Fault, &str),
) -> Result<Outcome> {
    let folder = folder_with(fault, changed)?;
    // A process that fails or does not end is one of `fathom verify`, or an effect that no check has found.
    let say = |more: [String; 2], failed: fn(String) -> Outcome| {
        let shaders = ["--shaders".to_owned(), folder.path().display().to_string()];
        match answer(args, &[shaders, more].concat()) {
            Err(ProcessError::Interrupted) => Err(ProcessError::Interrupted.into()),
            Err(error) => Ok(failed(format!("the process: {error}"))),
            Ok(answer) => Ok::<_, anyhow::Error>(serde_json::from_str(&answer)?),
        }
    };
    let holding = profiles.iter().enumerate().filter(|(_, case)| case.files.contains(&fault.file));
    let order = holding.sorted_by(|(_, a), (_, b)| {
        let is_other = |case: &CaseProfile| case.stage != fault.file;
        is_other(a).cmp(&is_other(b)).then(a.seconds.total_cmp(&b.seconds))
    });
    let order = order.map(|(number, _)| number).join(",");
    if !order.is_empty() {
        let outcome = say(["--cases".to_owned(), order], Outcome::Found)?;
        if outcome != Outcome::Survived(PASSED.to_owned()) {
            return Ok(outcome);
        }
    }
    say(["--effect".to_owned(), fault.file.clone()], Outcome::Survived)
}

/// Counts, and a row for each fault that was not found; and the share found of those that change an output.
fn markdown<'f>(
    args: &MutantArgs,
    tried: impl Iterator<Item = (&'f Fault, &'f Outcome)>,
) -> (String, f64) {
    let (mut found, mut survived, mut equivalent) = (0, 0, 0);
    let rows = tried.filter_map(|(fault, outcome)| {
        let effect = match outcome {
            Outcome::Found(_) => {
                found += 1;
                return None;
            }
            Outcome::Invalid => return None,
            Outcome::Survived(effect) => {
                survived += 1;
                effect.clone()
            }
            Outcome::Equivalent(tried) => {
                equivalent += 1;
                format!("none in {tried}")
            }
        };
        let source = SHADERS.text(&format!("{}.wgsl", fault.file)).unwrap_or_default();
        let [before, after] = fault.difference(&source).map(|line| format!("`{line}`"));
        let place = format!("{}:{}", fault.file, fault.line);
        Some([place, fault.function.clone(), fault.kind.to_owned(), before, after, effect])
    });
    let header = ["file, line", "function", "fault", "before", "after", "effect"];
    let table = Table::new("Not found", header).with_rows(rows).markdown();
    let altering = found + survived;
    let text = format!(
        "# Faults put into shaders\n\nSeed {}. A check finds {found} of {altering} faults that change an output. {equivalent} more change \
         none.\n\n{table}",
        args.seed
    );
    (text, f64::from(found) / f64::from(altering.max(1)))
}

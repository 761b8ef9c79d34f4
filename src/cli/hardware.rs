//! `fathom hardware`: the first hour on new hardware, as calls of this program that are each limited in time. What has ended stands in
//! a file of the folder, so the command can be stopped at any time and called again.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize};
use strum::Display;

use super::AdapterArgs;
use super::commands::{INTERRUPT, INTERRUPTED, Outcome, SOMETHING_FAILED, watch_interrupts};
use crate::folder::Folder;
use crate::harness::progress::WORKING_ON;
use crate::process::{self, Ended, Limits, ProcessError};
use crate::record::output::RECORDS;
use crate::record::{self, Cell, Record, calendar};
use crate::{tell, text};

const STATE: &str = "hardware.json";
/// The comparison's folder within the other.
const COMPARISON: &str = "comparison";
/// What a run and a comparison tell people.
const SUMMARY: &str = "summary.md";
/// Most bytes of the file of what has ended.
const MOST_STATE: u64 = 1 << 20;
/// A run ends by itself so long before its piece does, or by this share of the piece.
const RESERVE: Duration = Duration::from_secs(60);
const RESERVE_SHARE: f64 = 0.25;
/// A step that twice brought nothing new is given up.
const MOST_ATTEMPTS: u32 = 2;
const LEFT: u8 = 3;

#[derive(Args)]
pub struct HardwareArgs {
    /// Folder to write to, and to go on with
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Longest time of a piece. What does not end by itself is ended, and given up if it brought nothing
    #[arg(long, value_name = "TIME", default_value = "8m", value_parser = calendar::duration)]
    piece: Duration,
    /// Time of the whole command; the next call goes on [default: until all is done]
    #[arg(long = "for", value_name = "TIME", value_parser = calendar::duration)]
    total: Option<Duration>,
    /// Options of a step, without quotes: `run uw-default --profile quick`, `verify caustics`, `compare --gates exact`; may be given
    /// several times [default: `run --profile paper`]
    #[arg(long, value_name = "STEP OPTIONS")]
    with: Vec<String>,
    /// Only these steps
    #[arg(long, value_enum, value_name = "STEP,…", value_delimiter = ',', default_values_t = Step::ALL)]
    steps: Vec<Step>,
    #[command(flatten)]
    adapter: AdapterArgs,
}

/// In this order.
#[derive(Clone, Copy, Debug, Display, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
enum Step {
    Doctor,
    Audit,
    Verify,
    Ceilings,
    Run,
    Compare,
}

impl Step {
    const ALL: [Self; 6] =
        [Self::Doctor, Self::Audit, Self::Verify, Self::Ceilings, Self::Run, Self::Compare];

    /// What it has measured stays when it is ended.
    fn goes_on(self) -> bool {
        matches!(self, Self::Run | Self::Compare)
    }

    /// The file of the folder that says most about how it ended.
    fn answer(self) -> String {
        match self {
            Self::Run => SUMMARY.to_owned(),
            Self::Compare => format!("{COMPARISON}/{SUMMARY}"),
            Self::Doctor | Self::Audit | Self::Verify | Self::Ceilings => format!("{self}.json"),
        }
    }
}

/// A step that is over, or was tried.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Taken {
    step: Step,
    /// Of its last process; none where that did not end by itself.
    status: Option<i32>,
    is_over: bool,
    /// Pieces that brought nothing, one after the other.
    in_vain: u32,
    /// Of all its pieces.
    seconds: f64,
    /// Why it did not end well.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    reason: String,
}

/// What the folder's file holds.
#[derive(Debug, Default, Serialize, Deserialize)]
struct State {
    /// The options of the first call. Others would measure something else.
    options: Vec<String>,
    steps: Vec<Taken>,
    /// Cells in which a process did not end or died.
    given_up: Vec<String>,
}

pub fn hardware(args: &HardwareArgs) -> Outcome {
    watch_interrupts()?;
    let program = std::env::current_exe().context("cannot tell where this program lies")?;
    Hardware::open(args, program)?.measure()
}

struct Hardware<'a> {
    args: &'a HardwareArgs,
    program: PathBuf,
    folder: Folder,
    state: State,
}

/// What became of a piece.
struct Piece {
    status: Option<i32>,
    /// Nothing is left of the step.
    is_over: bool,
    /// It has brought something new.
    is_new: bool,
    reason: String,
}

impl<'a> Hardware<'a> {
    fn open(args: &'a HardwareArgs, program: PathBuf) -> anyhow::Result<Self> {
        let about = || format!("cannot write to {}", args.out.display());
        let folder = Folder::make(&args.out).with_context(about)?;
        let mut options = args.with.clone();
        options.extend(args.adapter.options().words());
        for with in &args.with {
            let known = Step::ALL.iter().any(|step| words_of(*step, with).is_some());
            ensure!(known, "--with \"{}\": there is no such step", text::line(with));
        }
        let state = if folder.has_file(STATE) {
            let bytes = folder.bytes(STATE, MOST_STATE)?;
            let state: State = serde_json::from_slice(&bytes)
                .with_context(|| format!("{} is damaged", args.out.join(STATE).display()))?;
            let before = state.options.join(" ");
            ensure!(state.options == options, "the folder was begun with other options: {before}");
            state
        } else {
            State { options, ..State::default() }
        };
        let hardware = Self { args, program, folder, state };
        hardware.write_state()?;
        Ok(hardware)
    }

    fn write_state(&self) -> anyhow::Result<()> {
        Ok(self.folder.write(STATE, &serde_json::to_vec_pretty(&self.state)?)?)
    }

    fn measure(mut self) -> Outcome {
        let start = Instant::now();
        let mut interrupted = false;
        while let Some(step) = self.left().first().copied() {
            let left = self.args.total.map(|total| total.saturating_sub(start.elapsed()));
            let limit = left.map_or(self.args.piece, |left| left.min(self.args.piece));
            if limit.is_zero() {
                break;
            }
            tell::note(format!("{step}, for at most {:.0} s", limit.as_secs_f64()));
            let begun = Instant::now();
            let Some(piece) = self.piece(step, limit)? else {
                interrupted = true;
                break;
            };
            // The end of the command is no fault of the step.
            let cut_short = limit < self.args.piece && piece.status.is_none();
            self.note(step, piece, begun.elapsed(), cut_short);
            self.write_state()?;
            if cut_short {
                break;
            }
        }
        self.tell();
        Ok(ExitCode::from(if interrupted { INTERRUPTED } else { self.status() }))
    }

    fn taken(&self, step: Step) -> Option<&Taken> {
        self.state.steps.iter().find(|taken| taken.step == step)
    }

    /// Steps that are not over.
    fn left(&self) -> Vec<Step> {
        let is_over = |step| self.taken(step).is_some_and(|taken| taken.is_over);
        let is_left = |step: &Step| self.args.steps.contains(step) && !is_over(*step);
        Step::ALL.into_iter().filter(is_left).collect()
    }

    fn note(&mut self, step: Step, piece: Piece, time: Duration, cut_short: bool) {
        let before = self.taken(step).cloned();
        let mut taken = before.unwrap_or(Taken {
            step,
            status: None,
            is_over: false,
            in_vain: 0,
            seconds: 0.0,
            reason: String::new(),
        });
        let Piece { status, is_over, is_new, reason } = piece;
        taken.seconds += time.as_secs_f64();
        if !cut_short {
            taken.in_vain = if is_new { 0 } else { taken.in_vain + 1 };
            taken.is_over = is_over || taken.in_vain == MOST_ATTEMPTS;
            (taken.status, taken.reason) = (status, reason);
        }
        if !taken.reason.is_empty() {
            tell::note(format!("{step}: {}", taken.reason));
        }
        self.state.steps.retain(|taken| taken.step != step);
        self.state.steps.push(taken);
    }

    /// A process of a step, up to a limit; none where that was interrupted.
    fn piece(&mut self, step: Step, limit: Duration) -> anyhow::Result<Option<Piece>> {
        let before = self.mark(step)?;
        let mut cell = None;
        let mut follow = |line: &str| match line.strip_prefix(WORKING_ON) {
            Some(name) => cell = Some(name.to_owned()),
            None => tell::detail(line),
        };
        let limits = Limits { time: Some(limit), interrupted: Some(&INTERRUPT) };
        let ended = process::ended(&mut self.command(step, limit), limits, &mut follow);
        let is_new = self.mark(step)? > before;
        let reason = match ended {
            Ok(ended) if ended.status.code().is_some() => {
                return self.ended(step, &ended, is_new).map(Some);
            }
            Ok(ended) => format!("it died: {}", ended.status),
            Err(ProcessError::Interrupted) => return Ok(None),
            Err(error) => error.to_string(),
        };
        let mut piece = Piece { status: None, is_over: false, is_new, reason };
        if let Some(cell) = cell.filter(|_| step == Step::Run && limit == self.args.piece) {
            piece.reason = format!("{cell}: given up: {}", piece.reason);
            piece.is_new = true;
            self.state.given_up.push(cell);
        }
        Ok(Some(piece))
    }

    /// Of a process that has ended by itself.
    fn ended(&self, step: Step, ended: &Ended, is_new: bool) -> anyhow::Result<Piece> {
        let Ended { status, answer, complaint } = ended;
        let could_run = status.code() != Some(super::COULD_NOT_RUN.into());
        if !step.goes_on() && !answer.is_empty() {
            self.folder.write(step.answer(), answer.as_bytes())?;
        }
        let cells = if step == Step::Run { self.cells()?.filter(is_left).count() } else { 0 };
        let left = cells > 0;
        // A step that fails early has written no file.
        let has_answer = step.goes_on() || !answer.is_empty();
        let reason = match status.code() {
            _ if could_run && left && !is_new => format!("cells not measured: {cells}"),
            Some(0) => String::new(),
            _ if could_run && has_answer => format!("{} says why", step.answer()),
            _ => complaint.lines().next_back().unwrap_or_default(),
        };
        Ok(Piece { status: status.code(), is_over: could_run && !left, is_new, reason })
    }

    /// It grows while a step brings something new.
    fn mark(&self, step: Step) -> anyhow::Result<u64> {
        Ok(match step {
            Step::Run => self.cells()?.filter(|cell| !is_left(cell)).count() as u64,
            Step::Compare => {
                let records = self.folder.metadata(PathBuf::from(COMPARISON).join(RECORDS));
                records.map_or(0, |file| file.len())
            }
            Step::Doctor | Step::Audit | Step::Verify | Step::Ceilings => 0,
        })
    }

    fn command(&self, step: Step, limit: Duration) -> Command {
        let out = &self.args.out;
        let mut command = Command::new(&self.program);
        command.args(["--verbose", &step.to_string()]).args(self.args.adapter.options().words());
        let given: Vec<&str> =
            self.args.with.iter().filter_map(|with| words_of(step, with)).flatten().collect();
        if step == Step::Run && given.is_empty() {
            command.args(["--profile", "paper"]);
        }
        command.args(given);
        match step {
            Step::Run => {
                let reserve = RESERVE.min(limit.mul_f64(RESERVE_SHARE));
                command.arg("--budget").arg((limit - reserve).as_secs_f64().to_string());
                command.arg("--out").arg(out);
                command.args(self.folder.has_file(RECORDS).then_some("--resume"));
                self.state.given_up.iter().for_each(|cell| {
                    command.args(["--skip", cell]);
                });
            }
            Step::Compare => {
                let out = out.join(COMPARISON);
                let begun = crate::folder::is_there(&out.join(RECORDS));
                command.arg("--base-bin").arg(&self.program).arg("--out").arg(out);
                command.args(begun.then_some("--resume"));
            }
            Step::Doctor | Step::Audit | Step::Verify | Step::Ceilings => {
                command.arg("--json");
            }
        }
        command
    }

    /// The latest records of the run's cells.
    fn cells(&self) -> anyhow::Result<impl Iterator<Item = Cell>> {
        let mut latest = BTreeMap::new();
        if self.folder.has_file(RECORDS) {
            for record in record::read(&self.args.out.join(RECORDS))?.records {
                if let Record::Cell(cell) = record {
                    latest.insert((cell.experiment.clone(), cell.cell.clone()), *cell);
                }
            }
        }
        Ok(latest.into_values())
    }

    /// A line for each step, and what is left.
    fn tell(&self) {
        let rows: Vec<_> = self.state.steps.iter().map(Taken::row).collect();
        text::columns(&rows).iter().for_each(|row| tell::answer(text::line(row)));
        for cell in &self.state.given_up {
            tell::answer(text::line(&format!("given up: {cell}")));
        }
        let left: Vec<String> = self.left().iter().map(Step::to_string).collect();
        let out = self.args.out.display();
        tell::answer(if !left.is_empty() {
            format!("left: {}; call it again with -o {out}", left.join(", "))
        } else if self.status() == 0 {
            format!("all is done: {out} is complete")
        } else {
            format!("all is done: not every step of {out} ended well")
        });
    }

    fn status(&self) -> u8 {
        let ends_well = |step: &Step| {
            self.taken(*step)
                .is_some_and(|taken| taken.status == Some(0) && taken.reason.is_empty())
        };
        if !self.left().is_empty() {
            LEFT
        } else if self.state.given_up.is_empty() && self.args.steps.iter().all(ends_well) {
            0
        } else {
            SOMETHING_FAILED
        }
    }
}

impl Taken {
    fn row(&self) -> [String; 3] {
        let status = match self.status {
            Some(status) => format!("status {status}"),
            None => "did not end".to_owned(),
        };
        let reason = if self.reason.is_empty() { "" } else { "; " };
        let time = format!("{:.0} s{reason}{}", self.seconds, self.reason);
        [self.step.to_string(), status, time]
    }
}

/// The budget has left it.
fn is_left(cell: &Cell) -> bool {
    matches!(cell.outcome, record::Outcome::OverBudget)
}

/// The words of `STEP WORDS` if it is of this step.
fn words_of(step: Step, with: &str) -> Option<Vec<&str>> {
    let mut words = with.split_whitespace();
    (words.next()? == step.to_string()).then(|| words.collect())
}

#[cfg(all(test, unix))]
mod tests;

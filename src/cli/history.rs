//! `fathom history`: runs over commits.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::{Args, Subcommand};

use super::bisect;
use super::commands::Outcome;
use super::compare_args::SearchArgs;
use super::export::write_into;
use crate::compare::candidates::Searched;
use crate::compare::cells::Gates;
use crate::harness::catalog::Catalog;
use crate::history::run::FRAME;
use crate::history::{
    self, Added, Change, DEFAULT_FILE, Findings, History, NewRun, Said, Selection, StoredRuns,
    VARIABLE, on_page, tables,
};
use crate::record::comparison::Gate;
use crate::record::output::RECORDS;
use crate::report::Artifact;
use crate::report::page::Page;
use crate::{folder, tell};

#[derive(Subcommand)]
pub enum HistoryCommand {
    /// Store runs with their commit, branch and machine; runs that are already stored stay unchanged
    Add {
        /// Folders of runs
        #[arg(required = true, value_name = "DIR")]
        folders: Vec<PathBuf>,
        #[command(flatten)]
        said: Said,
        #[command(flatten)]
        place: PlaceArgs,
    },
    /// List the runs
    List {
        #[command(flatten)]
        selection: SelectionArgs,
    },
    /// Show figures over commits as text, or as a page with plots
    Show {
        /// Only figures whose names contain this: `uw-default`, `caustics/trace`
        filter: Option<String>,
        /// Write a page with plots into this folder
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        #[command(flatten)]
        selection: SelectionArgs,
    },
    /// Find between which commits figures changed, by how much and with what certainty
    Changes {
        /// Only figures whose names contain this
        filter: Option<String>,
        /// Print JSON
        #[arg(long)]
        json: bool,
        #[command(flatten)]
        selection: SelectionArgs,
    },
    /// Find the commit between two runs that made a figure worse: `fathom bisect` between the commits around the change
    Bisect {
        /// Only figures whose names contain this; of several changes of theirs the latest
        filter: Option<String>,
        #[command(flatten)]
        search: Box<SearchArgs>,
        #[command(flatten)]
        selection: SelectionArgs,
    },
    /// Restore the records of a run, byte for byte
    Get {
        /// Beginning of the run's name, as `fathom history list` has it
        run: String,
        /// Folder to write records.jsonl to
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        #[command(flatten)]
        place: PlaceArgs,
    },
}

#[derive(Args)]
pub struct PlaceArgs {
    /// File of SQLite [default: FATHOM_HISTORY, or reports/history.sqlite]
    #[arg(long, value_name = "PATH")]
    pub db: Option<String>,
}

impl PlaceArgs {
    fn location(self) -> anyhow::Result<PathBuf> {
        let variable = || std::env::var(VARIABLE).ok().filter(|place| !place.is_empty());
        let place = self.db.or_else(variable);
        history::location(place.as_deref().unwrap_or(DEFAULT_FILE))
    }
}

#[derive(Args)]
pub struct SelectionArgs {
    #[command(flatten)]
    pub selection: Selection,
    #[command(flatten)]
    pub place: PlaceArgs,
}

impl SelectionArgs {
    fn open(self, filter: Option<String>) -> anyhow::Result<(History, Selection)> {
        let selection = Selection { filter, ..self.selection };
        Ok((History::open(&self.place.location()?)?, selection))
    }

    fn stored(self, filter: Option<String>) -> anyhow::Result<StoredRuns> {
        let (mut history, selection) = self.open(filter)?;
        history.stored(&selection)
    }
}

pub fn history(catalog: &Catalog, command: HistoryCommand) -> Outcome {
    match command {
        HistoryCommand::Add { folders, said, place } => add(&folders, said, &place.location()?),
        HistoryCommand::List { selection } => {
            let (mut history, selection) = selection.open(None)?;
            answered(tables::runs(&history.runs(&selection)?))
        }
        HistoryCommand::Show { filter, out, selection } => {
            show(&selection.stored(filter)?, out.as_deref())
        }
        HistoryCommand::Changes { filter, json, selection } => {
            let stored = selection.stored(filter)?;
            let findings = Findings::of(&stored);
            answered(match json {
                true => format!("{:#}", tables::changes_json(&stored, &findings)),
                false => tables::changes(&stored, &findings),
            })
        }
        HistoryCommand::Bisect { filter, search, selection } => {
            let is_named = filter.is_some();
            bisect_change(catalog, &selection.stored(filter)?, is_named, *search)
        }
        HistoryCommand::Get { run, out, place } => get(&run, &out, &place.location()?),
    }
}

fn answered(answer: String) -> Outcome {
    tell::answer(answer);
    Ok(ExitCode::SUCCESS)
}

/// All folders are read before the first is stored, so that a damaged one is told at once.
fn add(folders: &[PathBuf], said: Said, location: &Path) -> Outcome {
    let origin = history::origin(said)?;
    for folder in folders {
        NewRun::read(folder, RECORDS)?;
    }
    let mut history = History::open_or_make(location)?;
    for folder in folders {
        let run = NewRun::read(folder, RECORDS)?;
        let name = format!("{}: run {}", folder.display(), &run.digest[..10]);
        let told = match history.add(&run, &origin)? {
            Added::New => format!("{} cells with {} figures stored", run.cells, run.figures.len()),
            Added::Already => "stored already, nothing changed".to_owned(),
        };
        tell::done(format!("{name} of {} on {}: {told}", origin.commit, origin.branch));
    }
    Ok(ExitCode::SUCCESS)
}

fn show(stored: &StoredRuns, out: Option<&Path>) -> Outcome {
    let findings = Findings::of(stored);
    let Some(out) = out else {
        return answered(tables::series(stored, &findings));
    };
    let shown = Some(on_page::on_page(stored, &findings));
    let page = Page { history: shown, ..Page::new(Vec::new()) }.file();
    write_into(out, vec![page])
}

/// Searches between the commits of a change.
fn bisect_change(
    catalog: &Catalog,
    stored: &StoredRuns,
    is_named: bool,
    mut search: SearchArgs,
) -> Outcome {
    let findings = Findings::of(stored);
    let change = worse(stored, &findings, is_named)?;
    let series = &stored.series[change.series];
    let [before, after] = change.runs.map(|run| &stored.runs[run]);
    let (name, size) = (series.key.name(), tables::size(change, series));
    let told = format!("{name}: {size}, {}", tables::commits(before, after));
    anyhow::ensure!(before.commit != after.commit, "{told}: there is no commit in between");
    if search.json {
        tell::note(told)
    } else {
        tell::answer(told)
    }
    if search.gates.is_empty() {
        let is_time = series.key.is_time();
        search.gates = vec![if is_time { Gate::Time } else { Gate::Exact }];
    }
    let gates = Gates::load(search.cells_file.as_deref(), catalog.gates)?;
    if search.cells.is_none() {
        let figure = &*series.key.figure.figure;
        let is_gated = gates.cells().iter().any(|cell| cell.stage() == figure);
        search.cells = is_gated.then(|| figure.to_owned());
    }
    let (good, bad) = (before.commit.clone(), after.commit.clone());
    let searched = Searched::Revisions { good, bad, by: bisect::building(&search) };
    bisect::search(catalog, searched, &search)
}

/// The latest change for the worse. A stage's goes before its frame's, whose commits are the same.
///
/// # Errors
/// Where there is none, and where there are several and no figure was named.
fn worse<'a>(
    stored: &StoredRuns,
    findings: &'a Findings,
    is_named: bool,
) -> anyhow::Result<&'a Change> {
    let worse = || findings.changes.iter().filter(|change| change.size.estimate().median > 0.0);
    let latest = worse().map(|change| change.runs[1]).max();
    let latest =
        latest.context("no figure became worse in these runs, so there is no commit to find")?;
    let mut last: Vec<&Change> = worse().filter(|change| change.runs[1] == latest).collect();
    let others = worse().find(|change| change.runs[1] != latest);
    if let Some(other) = others.filter(|_| !is_named) {
        let named = |change: &Change| stored.series[change.series].key.name();
        anyhow::bail!(
            "several commits made figures worse: name one figure of `fathom history changes`, such as `{}` or `{}`",
            named(last[0]),
            named(other)
        );
    }
    last.sort_by_key(|change| &*stored.series[change.series].key.figure.figure == FRAME);
    Ok(last[0])
}

fn get(run: &str, out: &Path, location: &Path) -> Outcome {
    let (_, bytes) = History::open(location)?.records(run)?;
    let path = out.join(RECORDS);
    anyhow::ensure!(
        !folder::is_there(&path),
        "{} is there already: choose another folder",
        path.display()
    );
    write_into(out, vec![Artifact { name: RECORDS.to_owned(), bytes }])
}

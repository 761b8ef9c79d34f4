//! `fathom history`: runs over commits.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Subcommand};

use super::commands::{ExitResult, write_into};
use crate::history::{
    self, Added, DEFAULT_FILE, History, HistoryChanges, NewRun, OriginArgs, Selection, StoredRuns,
    VARIABLE, document, tables,
};
use crate::print;
use crate::record::output::RECORDS;
use crate::report::document::terminal;
use crate::report::page::Page;

#[derive(Subcommand)]
pub enum HistoryCommand {
    /// Store runs with their commit, branch and machine; runs that are already stored stay unchanged
    Add {
        /// Folders of runs
        #[arg(required = true, value_name = "DIR")]
        folders: Vec<PathBuf>,
        #[command(flatten)]
        said: OriginArgs,
        #[command(flatten)]
        place: PlaceArgs,
    },
    /// List the runs
    List {
        #[command(flatten)]
        selection: SelectionArgs,
    },
    /// Show figures over commits as a page with plots
    Show {
        /// Only figures whose names contain this: `uw-default`, `caustics/trace`
        filter: Option<String>,
        /// Folder to write the page to
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
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
}

#[derive(Args)]
pub struct PlaceArgs {
    /// File of SQLite [default: FATHOM_HISTORY, or reports/history.sqlite]
    #[arg(long, value_name = "PATH")]
    pub db: Option<PathBuf>,
}

impl PlaceArgs {
    fn location(self) -> PathBuf {
        let variable = || std::env::var_os(VARIABLE).filter(|place| !place.is_empty());
        self.db.or_else(|| variable().map(PathBuf::from)).unwrap_or_else(|| DEFAULT_FILE.into())
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
        Ok((History::open(&self.place.location())?, selection))
    }

    fn load(self, filter: Option<String>) -> anyhow::Result<StoredRuns> {
        let (history, selection) = self.open(filter)?;
        history.load(&selection)
    }
}

pub fn history(command: HistoryCommand) -> ExitResult {
    match command {
        HistoryCommand::Add { folders, said, place } => add(&folders, &said, &place.location()),
        HistoryCommand::List { selection } => {
            let (history, selection) = selection.open(None)?;
            answered(tables::runs(&history.runs(&selection)?))
        }
        HistoryCommand::Show { filter, out, selection } => show(&selection.load(filter)?, &out),
        HistoryCommand::Changes { filter, json, selection } => {
            let stored = selection.load(filter)?;
            let findings = HistoryChanges::find(&stored);
            answered(match json {
                true => format!("{:#}", tables::changes_json(&stored, &findings)),
                false => terminal(&document::changes(&stored, &findings)).trim_end().to_owned(),
            })
        }
    }
}

fn answered(answer: String) -> ExitResult {
    print::answer(answer);
    Ok(ExitCode::SUCCESS)
}

/// All folders are read before the first is stored, so that a damaged one is told at once.
fn add(folders: &[PathBuf], said: &OriginArgs, location: &Path) -> ExitResult {
    for folder in folders {
        history::origin(said, &NewRun::read(folder, RECORDS)?)?;
    }
    let mut history = History::open_or_make(location)?;
    for folder in folders {
        let run = NewRun::read(folder, RECORDS)?;
        let origin = history::origin(said, &run)?;
        let name = format!("{}: run {}", folder.display(), &run.digest[..10]);
        let told = match history.add(&run, &origin)? {
            Added::New => format!("{} cells with {} figures stored", run.cells, run.figures.len()),
            Added::Already => "stored already, nothing changed".to_owned(),
        };
        print::status(format!("{name} of {} on {}: {told}", origin.commit, origin.branch));
    }
    Ok(ExitCode::SUCCESS)
}

fn show(stored: &StoredRuns, out: &Path) -> ExitResult {
    let shown = Some(document::on_page(stored, &HistoryChanges::find(stored)));
    let page = Page { history: shown, ..Page::new(Vec::new()) }.file();
    write_into(out, vec![page])
}

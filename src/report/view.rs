//! Records in the order of a report: the run, then each experiment with its cells, once each.

use std::cell::OnceCell;
use std::cmp::Ordering;
use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use indexmap::IndexMap;
use itertools::Itertools;
use serde_json::Value;

use super::charts::{self, Figure};
use super::colors::StageColors;
use super::document::Span;
use super::facts::{self, Representative};
use fathom_base::private;
use fathom_experiments as experiments;
use fathom_experiments::schema::Claim;
use fathom_experiments::{Experiment, Ruling, label_text};
use fathom_judge::claims::{self, RunCell};
use fathom_judge::run::RunVerdict;
use fathom_record::{Cell, Clock, Damaged, End, Measured, Record, Run, RunProgress};

#[derive(Default)]
pub struct Report<'a> {
    pub runs: Vec<&'a Run>,
    pub ends: Vec<&'a End>,
    pub sections: Vec<Section<'a>>,
    /// Of every stage that was measured, but not of the CPU's part of a frame.
    pub colors: Rc<StageColors>,
    /// See [`Representative`].
    pub representatives: Vec<Representative<'a>>,
    /// Where the run's pictures lie.
    pub folder: Option<PathBuf>,
    /// Of a run that goes on.
    pub standing: Option<RunProgress>,
    /// What of the input it does not hold.
    pub left_out: Vec<SkippedInput>,
    /// Cells that it does not show: a file of their scene was another than when the latest cells were measured.
    pub outdated: usize,
    /// How noisy the run was; none where no cell was timed.
    pub verdict: Option<RunVerdict>,
}

/// Something of the input that a report does not show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedInput {
    /// A folder, a file, or lines of it.
    pub what: String,
    pub reason: String,
}

impl SkippedInput {
    pub fn new(what: impl Display, reason: impl Display) -> SkippedInput {
        SkippedInput { what: what.to_string(), reason: reason.to_string() }
    }

    pub fn line(&self) -> String {
        format!("{}: {}", self.what, self.reason)
    }

    /// The damaged lines of a file.
    pub fn lines(path: &Path, damaged: &Damaged) -> Option<SkippedInput> {
        (!damaged.is_empty()).then(|| SkippedInput::new(path.display(), damaged))
    }
}

/// A file behind the folder that it lies in, which is shown as [`private::path`] does.
pub fn shown_file(path: &Path) -> String {
    let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.map_or(file.clone(), |folder| format!("{}/{file}", private::path(folder)))
}

/// An experiment and its cells in the order of its plan; of a cell that was measured again, the latest.
#[derive(Default)]
pub struct Section<'a> {
    pub id: &'a str,
    /// As defined in the records.
    pub experiment: Option<Experiment>,
    /// Why there is none.
    pub problem: Option<String>,
    pub entries: Vec<RunCell<'a>>,
    /// The latest of the view.
    pub run: Option<&'a Run>,
    /// Of all stages of the view.
    pub colors: Rc<StageColors>,
    /// How many parameters the plan sets in each of its cells.
    settings: HashMap<String, usize>,
    rulings: OnceCell<Vec<Ruling>>,
    figure: OnceCell<Figure>,
}

impl<'a> Report<'a> {
    /// Pictures are shown that lie in `folder`.
    pub fn new(records: &'a [Record], folder: Option<&Path>) -> Report<'a> {
        let mut view = Report { folder: folder.map(Path::to_owned), ..Report::default() };
        let mut sections = IndexMap::<&str, Section<'a>>::new();
        // By experiment and cell: one that was measured again keeps its place.
        let mut entries = IndexMap::<(&str, &str), RunCell<'a>>::new();
        for record in records {
            match record {
                Record::Run(run) => view.runs.push(run),
                Record::End(end) => view.ends.push(end),
                Record::Experiment(definition) => {
                    let parsed = Experiment::parse(&definition.id, &definition.toml);
                    Section::get_or_add(&definition.id, &mut sections).define(parsed);
                }
                Record::Cell(cell) => {
                    let run = view.runs.last().copied();
                    Section::get_or_add(&cell.experiment, &mut sections);
                    entries.insert((&cell.experiment, &cell.cell), RunCell { cell, run });
                }
                Record::Begun(_) | Record::Comparison(_) => {}
            }
        }
        let cells = records.iter().filter_map(Record::try_as_cell_ref);
        let measured = cells.filter(|cell| cell.measured().is_some());
        let latest: HashMap<_, _> = measured.flat_map(|cell| sources(cell)).collect();
        view.outdated = entries.len();
        entries.retain(|_, RunCell { cell, .. }| {
            cell.measured().is_none() || sources(cell).all(|(file, digest)| latest[&file] == digest)
        });
        view.outdated -= entries.len();
        for ((experiment, _), entry) in entries {
            sections[experiment].entries.push(entry);
        }
        view.sections = sections.into_values().collect();
        let stages = view.measured().flat_map(|(_, measured)| &measured.stages);
        let stages = stages.filter(|stage| stage.clock != Clock::Host);
        view.colors = Rc::new(StageColors::new(stages.map(|stage| stage.stage.as_str())));
        let run = view.run();
        let frames = view.timed().map(|(_, measured)| &measured.frame).collect_vec();
        view.verdict = run.and_then(|run| RunVerdict::judge(run, &frames));
        for section in &mut view.sections {
            (section.run, section.colors) = (run, Rc::clone(&view.colors));
            section.finish();
        }
        view.representatives = facts::representatives(&view.sections);
        view
    }

    pub fn run(&self) -> Option<&'a Run> {
        self.runs.last().copied()
    }

    pub fn entries(&self) -> impl Iterator<Item = &RunCell<'a>> {
        self.sections.iter().flat_map(|section| &section.entries)
    }

    pub fn measured(&self) -> impl Iterator<Item = (&'a Cell, &'a Measured)> {
        self.sections.iter().flat_map(Section::measured)
    }

    pub fn timed(&self) -> impl Iterator<Item = (&'a Cell, &'a Measured)> {
        self.sections.iter().flat_map(Section::timed)
    }
}

impl<'a> Section<'a> {
    fn get_or_add<'s>(
        id: &'a str,
        sections: &'s mut IndexMap<&'a str, Section<'a>>,
    ) -> &'s mut Section<'a> {
        sections.entry(id).or_insert_with(|| Section { id, ..Section::default() })
    }

    fn define(&mut self, parsed: Result<Experiment, experiments::ExperimentError>) {
        match parsed {
            Ok(experiment) => {
                self.experiment = Some(experiment);
                self.problem = None;
            }
            Err(error) => self.problem = Some(error.to_string()),
        }
    }

    fn finish(&mut self) {
        let profile = self.run.map(|run| run.profile);
        if self.experiment.is_none() && self.problem.is_none() {
            self.problem = Some("its definition is not among the records".to_owned());
        }
        let plans = self
            .experiment
            .as_ref()
            .and_then(|experiment| experiment.cells(profile?, &[], &[]).ok())
            .unwrap_or_default();
        self.settings = plans.iter().map(|plan| (plan.cell.clone(), plan.settings())).collect();
        let planned: Vec<String> = plans.into_iter().map(|plan| plan.cell).collect();
        let ranks = planned.iter().enumerate().rev();
        let ranks: HashMap<&str, usize> = ranks.map(|(rank, name)| (name.as_str(), rank)).collect();
        let rank = |cell: &Cell| ranks.get(cell.cell.as_str()).copied();
        self.entries.sort_by(|a, b| {
            let [a_rank, b_rank] = [a, b].map(|entry| rank(entry.cell).unwrap_or(planned.len()));
            a_rank.cmp(&b_rank).then_with(|| compare_axes(a.cell, b.cell))
        });
    }

    pub fn cells(&self) -> Vec<&'a Cell> {
        self.entries.iter().map(|entry| entry.cell).collect()
    }

    pub fn measured(&self) -> impl Iterator<Item = (&'a Cell, &'a Measured)> + use<'a, '_> {
        self.entries.iter().filter_map(|entry| Some((entry.cell, entry.cell.measured()?)))
    }

    /// Those of its measured cells whose frames were timed.
    pub fn timed(&self) -> impl Iterator<Item = (&'a Cell, &'a Measured)> + use<'a, '_> {
        self.measured().filter(|(_, measured)| measured.is_timed())
    }

    /// How many parameters the plan sets in a cell; none where the plan does not have it.
    pub fn settings(&self, cell: &Cell) -> Option<usize> {
        self.settings.get(&cell.cell).copied()
    }

    /// Some of its cells were measured on a software driver.
    pub fn software(&self) -> bool {
        claims::is_software(&self.entries)
    }

    pub fn rulings(&self) -> &[Ruling] {
        self.rulings.get_or_init(|| {
            let experiment = self.experiment.as_ref();
            experiment.map_or_else(Vec::new, |of| claims::rulings(of, &self.entries, self.run))
        })
    }

    /// Its claims with their rulings.
    pub fn claims(&self) -> impl Iterator<Item = (&Claim, &Ruling)> {
        self.experiment.iter().flat_map(|experiment| &experiment.claim).zip(self.rulings())
    }

    pub(super) fn figure(&self) -> &Figure {
        self.figure.get_or_init(|| Figure::draw(self))
    }

    /// Its name, with its plots where it has some.
    pub fn span(&self) -> Span {
        let file = self.figure().svg.is_some().then(|| charts::file_name(self));
        Span::Experiment { id: self.id.to_owned(), file }
    }

    pub fn title(&self) -> &str {
        self.experiment.as_ref().map_or(self.id, |experiment| experiment.title.as_str())
    }
}

/// Experiment, scene and name of each file of a cell, and the file's digest.
fn sources(cell: &Cell) -> impl Iterator<Item = ([&str; 3], &str)> {
    let files = cell.sources.iter();
    files.map(|(name, digest)| ([&*cell.experiment, cell.scene_name(), &**name], &**digest))
}

/// Axis by axis: numbers by size, everything else by its text.
fn compare_axes(a: &Cell, b: &Cell) -> Ordering {
    let names = a.axes.keys().cmp(b.axes.keys());
    a.axes
        .values()
        .zip(b.axes.values())
        .fold(names, |order, (a, b)| order.then_with(|| compare(a, b)))
}

fn compare(a: &Value, b: &Value) -> Ordering {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => a.total_cmp(&b),
        _ => label_text(a).cmp(&label_text(b)),
    }
}

//! From experiments to cells with all parameters resolved and checked, before anything is allocated.
//!
//! A parameter's value is the last of: the pipeline's default, the scene file's, the experiment's, the
//! profile's, `--set`'s, the axis's. Axes are never overruled silently: `--set` of a swept parameter is an error.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Result, anyhow, bail};
use serde_json::Value;

use super::catalog::{Catalog, SubjectError};
use super::shard;
use super::subject::{Subject, Subjects};
use super::views;
use fathom_base::private;
use fathom_base::text::did_you_mean;
use fathom_experiments::defaults::{self, CellSettings};
use fathom_experiments::{CellPlan, Experiment, ExperimentError};
use fathom_gpu::Capacity;
use fathom_record as record;
use fathom_record::{Earlier, Outcome, Params, Part, Profile};
use fathom_scene::Scene;

/// Name of the file in a run's folder that holds the experiment that a command made.
pub const GIVEN: &str = "sweep.toml";

/// What to measure.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// Names of built-in experiments or paths of files; none means all built-in ones.
    pub experiments: Vec<String>,
    /// An experiment in place of those, which is written into the run's folder as [`GIVEN`].
    pub given: Option<Experiment>,
    /// Values that replace those of an axis.
    pub axes: Vec<(String, Vec<String>)>,
    /// Parameters of every cell, (dotted path, value).
    pub sets: Vec<(String, Value)>,
    /// Names of the only cells that are wanted; none means all.
    pub cells: Vec<String>,
    /// The only part of these cells that is wanted.
    pub part: Option<Part>,
}

impl Request {
    pub fn load(&self, catalog: &Catalog) -> Result<Vec<Experiment>, ExperimentError> {
        if let Some(given) = &self.given {
            return Ok(vec![given.clone()]);
        }
        let names = if self.experiments.is_empty() {
            Experiment::ids(&catalog.experiments)
        } else {
            self.experiments.clone()
        };
        let load = |name: &String| match Experiment::load_from(&catalog.experiments, name) {
            Err(_) if catalog.scenes.text(&format!("{name}.toml")).is_some() => {
                Err(ExperimentError::new(name, "this is a scene; see `fathom list experiments`"))
            }
            loaded => loaded,
        };
        names.iter().map(load).collect()
    }

    /// The axis values that concern one experiment. A name that no experiment knows is left to all of
    /// them, so that the first says so.
    fn axes_of(&self, experiment: &Experiment, all: &[Experiment]) -> Vec<(String, Vec<String>)> {
        let has = |experiment: &Experiment, name: &str| experiment.axis_names().contains(&name);
        let concerns =
            |name: &str| has(experiment, name) || !all.iter().any(|other| has(other, name));
        self.axes.iter().filter(|(name, _)| concerns(name)).cloned().collect()
    }

    /// Keeps the cells that were asked for by name. A name that no experiment has is an error.
    fn choose(&self, expanded: &mut [Vec<CellPlan>]) -> Result<()> {
        if self.cells.is_empty() {
            return Ok(());
        }
        let names = || expanded.iter().flatten().map(|plan| plan.cell.as_str());
        for name in &self.cells {
            if !names().any(|known| known == name) {
                bail!("no chosen experiment has the cell `{name}`{}", did_you_mean(name, names()));
            }
        }
        for plans in expanded {
            plans.retain(|plan| self.cells.contains(&plan.cell));
        }
        Ok(())
    }
}

pub struct PlannedExperiment {
    pub experiment: Experiment,
    pub cells: Vec<PlannedCell>,
}

impl PlannedExperiment {
    fn is_sweep(&self) -> bool {
        self.experiment.knee_share.is_some()
    }
}

/// A cell ready to be measured, or the reason why it cannot be.
pub struct PlannedCell {
    pub plan: CellPlan,
    /// See [`record::Cell::resume_key`].
    pub resume_key: String,
    pub subject: Subject,
    /// Of a frame, seconds, from the declared work.
    pub declared_s: f64,
    /// Beyond what the adapter can take, with the numbers.
    pub skip: Option<String>,
    /// The run that its result is compared with; see [`CellPlan::reference`].
    pub reference: Option<Subject>,
    /// The same and seen from elsewhere, where the experiment asks for views.
    pub views: Option<Vec<[Subject; 2]>>,
    pub repetitions: Option<Vec<Subject>>,
}

impl PlannedCell {
    pub fn record(&self, outcome: Outcome) -> record::Cell {
        let CellPlan { experiment, cell, axes, pipeline, scene, .. } = self.plan.clone();
        let Scene { stand_ins, digests, .. } = &*self.subject.scene;
        let (stand_ins, sources) = (stand_ins.clone(), digests.clone());
        let params = self.subject.params.clone().into();
        let scene = private::path(Path::new(&scene));
        let outcome = match outcome {
            Outcome::Skipped { reason } => Outcome::Skipped { reason: private::redact(&reason) },
            Outcome::Failed { reason } => Outcome::Failed { reason: private::redact(&reason) },
            other @ (Outcome::Measured(_) | Outcome::OverBudget) => other,
        };
        let cell = record::Cell { experiment, cell, axes, pipeline, ..record::Cell::default() };
        record::Cell { scene, stand_ins, sources, params, outcome, ..cell }
    }
}

/// The cells of each experiment that were asked for, of all shards.
pub fn expand(
    experiments: &[Experiment],
    request: &Request,
    profile: Profile,
) -> Result<Vec<Vec<CellPlan>>> {
    let cells = experiments.iter().map(|experiment| {
        let axes = request.axes_of(experiment, experiments);
        experiment.cells(profile, &axes, &request.sets)
    });
    let mut expanded = cells.collect::<Result<Vec<_>, _>>()?;
    request.choose(&mut expanded)?;
    Ok(expanded)
}

/// Expands and resolves `experiments`, and compares each cell with the adapter's limits. `in_time` is asked before each cell; its error
/// ends this.
pub fn plan(
    experiments: Vec<Experiment>,
    request: &Request,
    profile: Profile,
    capacity: &Capacity,
    catalog: &Catalog,
    in_time: &dyn Fn() -> Result<()>,
) -> Result<Vec<PlannedExperiment>> {
    let mut subjects = Subjects::new(catalog).with_capacity(capacity);
    let mut expanded = expand(&experiments, request, profile)?;
    if let Some(part) = request.part {
        shard::retain_shard(part, &experiments, &mut expanded);
    }
    in_time()?;
    let all = expanded.iter().flatten();
    subjects.make_scenes(all.map(|plan| (&*plan.pipeline, &*plan.scene, &*plan.overrides)));
    let mut planned = Vec::new();
    for (experiment, plans) in experiments.into_iter().zip(expanded) {
        let angles_deg =
            experiment.views.as_ref().map(|views| views.turns_deg.for_profile(profile).as_slice());
        let cell = |plan| {
            in_time()?;
            planned_cell(&mut subjects, plan, angles_deg, capacity)
        };
        let cells: Vec<_> = plans.into_iter().map(cell).collect::<Result<_>>()?;
        if request.cells.is_empty() || !cells.is_empty() {
            planned.push(PlannedExperiment { experiment, cells });
        }
    }
    Ok(planned)
}

fn planned_cell(
    subjects: &mut Subjects,
    plan: CellPlan,
    angles_deg: Option<&[f64]>,
    capacity: &Capacity,
) -> Result<PlannedCell> {
    let CellPlan { experiment, cell, .. } = &plan;
    let error = |error: SubjectError| anyhow!("{experiment}, cell {cell}: {error}");
    let mut subject =
        |overrides: &_| subjects.subject(&plan.pipeline, &plan.scene, overrides).map_err(error);
    let of_cell = subject(&plan.overrides)?;
    let reference = plan.reference.as_ref().map(|run| subject(&run.overrides)).transpose()?;
    let views = angles_deg.and_then(|angles_deg| views::twice(&of_cell, angles_deg));
    let mut repetitions = None;
    if let Some(runs) = &plan.repetitions {
        let repeated = runs.repeated.iter().map(|run| subject(run)).collect::<Result<_>>()?;
        repetitions = Some(repeated);
    }
    let foreseen = of_cell.forecast_s(capacity).map_err(error)?;
    let (declared_s, skip) = (*foreseen.as_ref().unwrap_or(&0.0), foreseen.err());
    let (resume_key, subject) = (String::new(), of_cell);
    let mut planned =
        PlannedCell { plan, resume_key, subject, declared_s, skip, reference, views, repetitions };
    planned.resume_key = planned.record(Outcome::OverBudget).resume_key();
    Ok(planned)
}

/// Cells of sweeps over sizes, which are begun together: experiment and cells.
pub fn sweeps(planned: &[PlannedExperiment]) -> Vec<(usize, Vec<usize>)> {
    let cells = |of: &PlannedExperiment| (0..of.cells.len()).collect();
    let sweeps = planned.iter().enumerate().filter(|(_, of)| of.is_sweep());
    sweeps.map(|(number, of)| (number, cells(of))).collect()
}

/// Of each pipeline the cell that is nearest to its defaults, of those that are timed and of no sweep: its experiment's number and its own.
pub fn first_cells(planned: &[PlannedExperiment]) -> Vec<(usize, usize)> {
    let mut by_pipeline = BTreeMap::<&str, Vec<((usize, usize), CellSettings<'_>)>>::new();
    for (experiment, of) in planned.iter().enumerate().filter(|(_, of)| !of.is_sweep()) {
        for (index, cell) in of.cells.iter().enumerate() {
            let PlannedCell { plan, subject, skip, .. } = cell;
            if skip.is_none() && !plan.errors_only {
                let choice = CellSettings {
                    swept: !plan.axes.is_empty(),
                    settings: Some(plan.settings()),
                    scene: &plan.scene,
                    params: Params::from(subject.params.clone()).to_map(),
                };
                by_pipeline.entry(&plan.pipeline).or_default().push(((experiment, index), choice));
            }
        }
    }
    let nearest = |cells: Vec<((usize, usize), CellSettings<'_>)>| {
        let (places, choices): (Vec<_>, Vec<_>) = cells.into_iter().unzip();
        let distances = defaults::distances(&choices);
        let nearest = places.into_iter().zip(distances).min_by_key(|(_, distance)| *distance);
        nearest.map(|(place, _)| place)
    };
    by_pipeline.into_values().filter_map(nearest).collect()
}

/// Drops the cells that need no second measurement and whose samples cannot be gone on with.
pub fn drop_finished(planned: &mut [PlannedExperiment], earlier: &BTreeMap<String, Earlier<'_>>) {
    let is_done = |earlier: &Earlier<'_>| {
        earlier.is_finished() && !(earlier.is_continued && earlier.cell.measured().is_some())
    };
    for experiment in planned {
        experiment.cells.retain(|cell| !earlier.get(&cell.resume_key).is_some_and(is_done));
    }
}

#[cfg(test)]
mod tests;

//! `fathom list`: what there is, as rows of words or as JSON.

use std::process::ExitCode;

use clap::ValueEnum;
use serde_json::{Map, Value};

use super::commands::{ExitResult, print_json};
use super::{ListArgs, Listing};
use crate::experiments::Experiment;
use crate::gpu::{AdapterEntry, Gpu};
use crate::harness::catalog::Catalog;
use crate::harness::figures::{ALL, PaperFigure};
use crate::harness::subject::Subjects;
use crate::parameter::{self, Allowed, ParamField};
use crate::scene::SceneFile;
use crate::scene::generators::{GENERATORS, fields};
use crate::{exporters, print, text};

/// One thing: short values in columns of their own, its description, and where it was published.
struct Row {
    columns: Vec<(&'static str, Value)>,
    about: String,
    source: Option<String>,
}

impl Row {
    fn new<const N: usize>(columns: [(&'static str, Value); N], about: impl Into<String>) -> Self {
        Self { columns: columns.into(), about: about.into(), source: None }
    }

    fn single(name: &'static str, value: impl Into<Value>, about: impl Into<String>) -> Self {
        Self::new([(name, value.into())], about)
    }

    fn published_in(self, source: &str) -> Self {
        Self { source: Some(source.to_owned()).filter(|source| !source.is_empty()), ..self }
    }

    fn text(&self) -> Vec<String> {
        let about = match &self.source {
            Some(source) => format!("{} ({source})", self.about),
            None => self.about.clone(),
        };
        let values = self.columns.iter().map(|(_, value)| match value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        });
        values.chain([about]).collect()
    }

    fn json(self) -> Value {
        let about = [("about", self.about.into())].into_iter();
        let source = self.source.map(|source| ("source", source.into()));
        let all = self.columns.into_iter().chain(about).chain(source);
        all.map(|(name, value)| (name.to_owned(), value)).collect::<Map<_, _>>().into()
    }
}

pub fn list(catalog: &Catalog, args: &ListArgs) -> ExitResult {
    use Listing::*;
    check_options(args)?;
    let all = [Experiments, Figures, Scenes, Pipelines, Stages, Adapters, Exporters];
    match (args.what, args.json) {
        (Some(what), true) => return print_json(&json(rows(catalog, what, args)?)),
        (Some(what), false) => print(&rows(catalog, what, args)?),
        (None, true) => {
            let listed = all.map(|what| Ok((name(what), json(rows(catalog, what, args)?))));
            return print_json(&listed.into_iter().collect::<anyhow::Result<Map<_, _>>>()?);
        }
        (None, false) => {
            for what in all {
                print::answer(format!("{what:?}"));
                print(&rows(catalog, what, args)?);
                print::answer("");
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn json(rows: Vec<Row>) -> Value {
    rows.into_iter().map(Row::json).collect()
}

fn print(rows: &[Row]) {
    let rows: Vec<Vec<String>> = rows.iter().map(Row::text).collect();
    for row in text::columns(&rows) {
        print::answer(text::line(&format!("  {row}")));
    }
}

/// As the command line calls it.
fn name(what: Listing) -> String {
    what.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// An option that changes nothing in a listing is an error.
fn check_options(args: &ListArgs) -> anyhow::Result<()> {
    let whole = matches!(args.what, Some(Listing::Parameters));
    let of_pipeline = whole || matches!(args.what, Some(Listing::Stages));
    let is_lost = args.scene.is_some() || !args.set.is_empty();
    anyhow::ensure!(whole || !is_lost, "--scene and --set apply to `list parameters` only");
    let is_lost = args.pipeline.is_some();
    anyhow::ensure!(
        of_pipeline || !is_lost,
        "--pipeline applies to `list stages` and `list parameters` only"
    );
    Ok(())
}

fn rows(catalog: &Catalog, what: Listing, args: &ListArgs) -> anyhow::Result<Vec<Row>> {
    let mut rows = all_rows(catalog, what, args)?;
    if let Some(filter) = &args.filter {
        rows.retain(|row| row.text().iter().any(|text| text.contains(filter)));
        anyhow::ensure!(!rows.is_empty(), "`list {}` has no row with `{filter}`", name(what));
    }
    Ok(rows)
}

fn all_rows(catalog: &Catalog, what: Listing, args: &ListArgs) -> anyhow::Result<Vec<Row>> {
    Ok(match what {
        Listing::Experiments => {
            let row = |e: &Experiment| Row::single("id", &*e.id, &*e.title).published_in(&e.source);
            experiments(catalog)?.iter().map(row).collect()
        }
        Listing::Claims => experiments(catalog)?.iter().flat_map(claims).collect(),
        Listing::Figures => {
            let (figures, _) = PaperFigure::find(&catalog.figures, ALL)?;
            let row = |f: PaperFigure| Row::single("id", f.id, f.title).published_in(&f.source);
            figures.into_iter().map(row).collect()
        }
        Listing::Scenes => {
            let row = |name: String| -> anyhow::Result<Row> {
                let scene = SceneFile::load_from(&catalog.scenes, &name)?;
                Ok(Row::single("name", name, scene.description))
            };
            catalog.scenes.stems(".toml").map(row).collect::<Result<_, _>>()?
        }
        Listing::Stages => {
            let stages = match &args.pipeline {
                Some(name) => catalog.stages_of(name)?,
                None => catalog.stages(),
            };
            let stages = stages.into_iter();
            stages.map(|s| Row::single("name", s.name, s.about).published_in(s.source)).collect()
        }
        Listing::Parameters => parameters(catalog, args)?,
        Listing::Generators => generators(),
        Listing::Adapters => Gpu::list().into_iter().enumerate().map(adapter).collect(),
        Listing::Exporters => exporters::listing().into_iter().map(exporter).collect(),
        Listing::Pipelines => {
            let kinds = catalog.kinds.iter();
            kinds.map(|kind| Row::single("name", kind.name, kind.about)).collect()
        }
    })
}

fn experiments(catalog: &Catalog) -> anyhow::Result<Vec<Experiment>> {
    let ids = Experiment::ids(&catalog.experiments).into_iter();
    Ok(ids.map(|id| Experiment::load_from(&catalog.experiments, &id)).collect::<Result<_, _>>()?)
}

fn claims(experiment: &Experiment) -> impl Iterator<Item = Row> + '_ {
    experiment.claim.iter().map(|claim| {
        let names = [("id", claim.id.clone().into()), ("experiment", experiment.id.clone().into())];
        Row::new(names, &*claim.text).published_in(&experiment.source)
    })
}

/// Each parameter with the value that the scene gives it, its unit, what it may be, and its description.
fn parameters(catalog: &Catalog, args: &ListArgs) -> anyhow::Result<Vec<Row>> {
    let pipeline = args.pipeline.as_deref().unwrap_or(super::PIPELINE);
    let scene = args.scene.as_deref().unwrap_or(super::SCENE);
    let subject = Subjects::new(catalog).subject(pipeline, scene, &args.set)?;
    let row = |field: ParamField| {
        let value = parameter::get(&subject.params, &field.path).cloned();
        let value = value.unwrap_or_else(|| "".into());
        let (unit, allowed) = (field.unit.into(), allowed(&field.allowed).into());
        let path = field.path.into();
        Row::new(
            [("path", path), ("value", value), ("unit", unit), ("allowed", allowed)],
            field.about,
        )
    };
    Ok((subject.kind.fields)().into_iter().map(row).collect())
}

/// Each generator of objects with the keys of its `params`, then those of volumes.
fn generators() -> Vec<Row> {
    let row = |name: &str, [key, default, unit, allowed]: [Value; 4], about: &str| {
        let columns = [("key", key), ("default", default), ("unit", unit), ("allowed", allowed)];
        let columns = [("generator", name.into())].into_iter().chain(columns).collect();
        Row { columns, about: about.to_owned(), source: None }
    };
    let none = || std::array::from_fn(|_| "".into());
    let objects = GENERATORS.iter().flat_map(|of| {
        let param = |field: &ParamField| {
            let (unit, allowed) = (field.unit.into(), allowed(&field.allowed).into());
            let default = of.defaults[&field.path].clone();
            row(of.name, [field.path.clone().into(), default, unit, allowed], &field.about)
        };
        std::iter::once(row(of.name, none(), of.about)).chain(of.params.iter().map(param))
    });
    let volumes = fields::all().map(|of| row(of.name, none(), of.about));
    objects.chain(volumes).collect()
}

fn allowed(allowed: &Allowed) -> String {
    match allowed {
        Allowed::Numbers(range) => format!("{} … {}", range.low, range.high),
        Allowed::Names(names) => names.join(", "),
        Allowed::Flag => "true, false".to_owned(),
        Allowed::Free => String::new(),
    }
}

fn adapter((index, AdapterEntry { adapter, lacks }): (usize, AdapterEntry)) -> Row {
    let kind = if adapter.software { "software" } else { "hardware" };
    let columns = [
        ("index", index.into()),
        ("name", adapter.name.into()),
        ("backend", adapter.backend.into()),
        ("kind", kind.into()),
    ];
    let about = match lacks {
        Some(missing) => format!("{}; cannot be used: it lacks {missing}", adapter.driver_info),
        None => adapter.driver_info,
    };
    Row::new(columns, about)
}

fn exporter([name, of, file, written, about]: [String; 5]) -> Row {
    let columns = [("name", name), ("of", of), ("file", file), ("written", written)];
    Row::new(columns.map(|(column, value)| (column, value.into())), about)
}

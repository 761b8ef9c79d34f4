//! From an experiment to the cells that are to be measured.

use indexmap::{IndexMap, IndexSet};
use itertools::Itertools;
use serde_json::{Map, Value, json};

use super::schema::{Axis, Profiles, Sweep};
use super::{Experiment, ExperimentError};
use fathom_base::text::{did_you_mean, line};
use fathom_record::Profile;

/// Most cells that one experiment plans, the reference and the views of each counted too: planned, one takes about 20 KiB.
pub const MAX_CELLS: u64 = 20_000;

#[derive(Clone, Debug, PartialEq)]
pub struct CellPlan {
    pub experiment: String,
    /// `name=value,name=value` over the axes; `base` where there are none.
    pub cell: String,
    pub axes: Map<String, Value>,
    pub pipeline: String,
    pub scene: String,
    /// Dotted path → value, to be set in this order on the pipeline's defaults.
    pub overrides: Vec<(String, Value)>,
    pub reference: Option<ReferencePlan>,
    pub repetitions: Option<RepetitionPlan>,
    /// Those that `fathom compare` compares.
    pub stages: Vec<String>,
    /// It is measured for its errors and counts, not for its times.
    pub errors_only: bool,
}

/// The run that a cell's result is held against: the cell's overrides and then these.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferencePlan {
    /// Name of the relative RMS difference among the record's quantities.
    pub quantity: String,
    /// The first of these stages that runs gives the output that is compared, on either side.
    pub stages: Vec<String>,
    /// The cell's overrides, then those of the reference.
    pub overrides: Vec<(String, Value)>,
}

/// The runs that tell a cell's noise: see [`Repetitions`](super::schema::Repetitions).
#[derive(Clone, Debug, PartialEq)]
pub struct RepetitionPlan {
    /// The cell's overrides, then the place of its photon grids: of each repetition.
    pub repeated: Vec<Vec<(String, Value)>>,
}

/// `name=v1,v2,v3` as a name and its values; commas inside brackets do not divide. `64..512*2` and `0..8+2` stand for the values of a range.
pub fn parse_axis(text: &str) -> Result<(String, Vec<String>), ExperimentError> {
    let error = || unassigned(text, "NAME=VALUE,VALUE,…");
    let (name, list) = on_one_line(text).ok_or_else(error)?;
    let mut values = vec![String::new()];
    let mut depth = 0_i32;
    for c in list.chars() {
        match c {
            '[' => depth += 1,
            ']' => depth -= 1,
            _ => {}
        }
        match values.last_mut() {
            Some(last) if c != ',' || depth > 0 => last.push(c),
            _ => values.push(String::new()),
        }
    }
    let values: Vec<String> = values.iter().map(|value| value.trim().to_owned()).collect();
    if name.trim().is_empty() || values.iter().any(String::is_empty) {
        return Err(error());
    }
    let values: Result<Vec<_>, _> = values.into_iter().map(expand_range).collect();
    Ok((name.trim().to_owned(), values?.concat()))
}

/// The values from the first to the last of `64..512*2` or `0..8+2`; any other text alone.
fn expand_range(text: String) -> Result<Vec<String>, ExperimentError> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let range = text.split_once("..").and_then(|(low, rest)| Some((number(low)?, rest)));
    let Some((low, rest)) = range else { return Ok(vec![text]) };
    let range = rest.find(['*', '+']).and_then(|at| {
        let (high, step) = (number(&rest[..at])?, number(&rest[at + 1..])?);
        let is_factor = rest.as_bytes()[at] == b'*';
        let grows = if is_factor { low > 0.0 && step > 1.0 } else { step > 0.0 };
        (grows && high >= low).then_some((high, step, is_factor))
    });
    let Some((high, step, is_factor)) = range else {
        let form = "LOW..HIGH*FACTOR or LOW..HIGH+STEP, as in 64..512*2";
        return Err(ExperimentError(format!("`{text}` is not of the form {form}")));
    };
    let value = |n: i32| {
        if is_factor { low * step.powi(n) } else { low + step * f64::from(n) }
    };
    // To twelve digits, so that 0.1 + 0.2 is 0.3.
    let rounded = |value: f64| format!("{value:.11e}").parse::<f64>().unwrap_or(value);
    let values = (0..=MAX_CELLS as i32).map(|n| rounded(value(n)));
    Ok(values.take_while(|value| *value <= high).map(|value| value.to_string()).collect())
}

/// `path=value` as a dotted path and a value: JSON where it is JSON, else a string.
pub fn parse_set(text: &str) -> Result<(String, Value), ExperimentError> {
    match on_one_line(text) {
        Some((path, value)) if !path.trim().is_empty() && !value.trim().is_empty() => {
            Ok((path.trim().to_owned(), parse_value(value.trim())))
        }
        _ => Err(unassigned(text, "PATH=VALUE")),
    }
}

fn unassigned(text: &str, form: &str) -> ExperimentError {
    ExperimentError(format!("`{}` is not of the form {form}", text.escape_debug()))
}

/// What stands before and after the first `=` of an argument. No name and no value holds a control character.
fn on_one_line(text: &str) -> Option<(&str, &str)> {
    text.split_once('=').filter(|_| !text.contains(char::is_control))
}

fn parse_value(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|_| Value::from(text))
}

/// A value of an axis: what stands in the cell's key, and what it sets.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AxisValue {
    label: Value,
    set: Vec<(String, Value)>,
}

impl AxisValue {
    fn text(&self) -> String {
        label_text(&self.label)
    }
}

/// An axis value as it stands in keys and tables: `512x512` for an array.
pub fn label_text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(items) => items.iter().map(label_text).join("x"),
        other => other.to_string(),
    }
}

/// Nested tables as dotted paths.
pub fn flatten(map: &Map<String, Value>) -> Vec<(String, Value)> {
    let mut leaves = Vec::new();
    for (name, value) in map {
        match value {
            Value::Object(inner) => leaves.extend(
                flatten(inner).into_iter().map(|(path, leaf)| (format!("{name}.{path}"), leaf)),
            ),
            leaf => leaves.push((name.clone(), leaf.clone())),
        }
    }
    leaves
}

impl Profiles {
    /// These parameters, then those of the profile.
    fn after(&self, params: &Map<String, Value>, profile: Profile) -> Vec<(String, Value)> {
        let own = match profile {
            Profile::Quick => &self.quick.params,
            Profile::Paper => &self.paper.params,
        };
        [flatten(params), flatten(own)].concat()
    }
}

impl Axis {
    pub(super) fn parse(&self, value: &Value) -> Result<AxisValue, String> {
        let name = &self.name;
        let Value::Object(table) = value else { return self.plain(value) };
        let label = table.get("label").filter(|label| !label.is_object());
        let set = table.get("set").and_then(Value::as_object);
        match (label, set) {
            (Some(label), Some(set)) if table.len() == 2 && !set.is_empty() => {
                Ok(AxisValue { label: label.clone(), set: flatten(set) })
            }
            _ => Err(format!(
                "a table among the values of axis `{name}` must be {{ label = …, set = {{ path = value, … }} }}"
            )),
        }
    }

    /// A value that is no table.
    fn plain(&self, value: &Value) -> Result<AxisValue, String> {
        let label = match value {
            Value::Array(_) if !self.sets.is_empty() => label_text(value).into(),
            _ => value.clone(),
        };
        let set = match (self.sets.as_slice(), value) {
            ([], _) => vec![(self.name.clone(), value.clone())],
            ([path], _) => vec![(path.clone(), value.clone())],
            (paths, Value::Array(items)) if items.len() == paths.len() => {
                paths.iter().cloned().zip(items.iter().cloned()).collect()
            }
            (paths, _) => {
                let first = value.as_array().and_then(|items| items.first()).unwrap_or(value);
                return Err(format!(
                    "axis `{}` sets {}: give a value of each, as in `[{}]`, in place of `{value}`",
                    self.name,
                    paths.join(" and "),
                    vec![first; paths.len()].iter().join(", ")
                ));
            }
        };
        Ok(AxisValue { label, set })
    }

    /// Whether this value of the axis sets a name or a choice in place of a number, or is labelled by one. What has a number for a label
    /// is in order by it, whatever it sets.
    pub(super) fn is_named(&self, value: &Value) -> bool {
        let is_name = |value: &Value| value.is_string() || value.is_boolean();
        self.parse(value).is_ok_and(|AxisValue { label, set }| {
            label_text(&label).starts_with(char::is_alphabetic)
                || !label.is_number() && set.iter().any(|(_, value)| is_name(value))
        })
    }

    fn values_of(&self, profile: Profile) -> &[Value] {
        let own = match profile {
            Profile::Quick => &self.quick,
            Profile::Paper => &self.paper,
        };
        own.as_ref().or(self.values.as_ref()).map_or(&[], Vec::as_slice)
    }

    fn every(&self) -> impl Iterator<Item = &Value> {
        [&self.values, &self.quick, &self.paper].into_iter().flatten().flatten()
    }

    /// One value of the command line: a label, or a value of the same type as those in the file where the axis is named after the
    /// parameter that it sets.
    fn choose(&self, text: &str) -> Result<AxisValue, String> {
        let is_labelled = |value: &Value| value.is_object() || !self.sets.is_empty();
        for value in self.every().filter(|value| is_labelled(value)) {
            let known = self.parse(value)?;
            if known.text() == text {
                return Ok(known);
            }
        }
        let label = |value: &Value| label_text(value.get("label").unwrap_or(value));
        let labels: IndexSet<String> = self.every().map(label).collect();
        let plain = self.every().find(|value| !is_labelled(value));
        let Some(example) = plain else {
            let near = did_you_mean(text, labels.iter().map(String::as_str));
            return Err(format!("no value `{text}`{near}"));
        };
        let value = match example {
            Value::String(_) => Value::from(text),
            _ => parse_value(text),
        };
        if kind(&value) != kind(example) {
            return Err(format!("`{text}` is not {}, as `{example}` is", kind(example)));
        }
        self.parse(&value)
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "a number",
        Value::String(_) => "a word",
        Value::Array(_) => "a list",
        Value::Object(_) => "a table",
    }
}

type Overrides = [(String, Vec<String>)];
type ChosenAxis<'a> = (&'a Axis, Vec<AxisValue>);

struct ChosenSweep<'a> {
    sweep: &'a Sweep,
    params: Vec<(String, Value)>,
    axes: Vec<ChosenAxis<'a>>,
}

impl Experiment {
    /// The cells in the order of the file; sweeps that share a cell measure it once.
    ///
    /// `axis_overrides` replaces values of axes, `sets` sets parameters of every cell.
    pub fn cells(
        &self,
        profile: Profile,
        axis_overrides: &Overrides,
        sets: &[(String, Value)],
    ) -> Result<Vec<CellPlan>, ExperimentError> {
        self.check_axes(axis_overrides)?;
        self.check_sets(profile, sets)?;
        let base = self.profile.after(&self.params, profile);
        if self.sweep.is_empty() {
            return Ok(vec![self.cell(profile, None, base, sets, &[])]);
        }
        let mut sweeps = Vec::new();
        for sweep in &self.sweep {
            let params = [base.clone(), sweep.profile.after(&sweep.params, profile)].concat();
            let axes = self.axis_values(sweep, profile, axis_overrides)?;
            sweeps.push(ChosenSweep { sweep, params, axes });
        }
        self.check_size(profile, &sweeps)?;
        let mut cells = IndexMap::new();
        for ChosenSweep { sweep, params, axes } in &sweeps {
            // Every combination of the axes' values; the last axis moves fastest.
            let values =
                axes.iter().map(|(axis, values)| values.iter().map(|value| (*axis, value)));
            for point in values.multi_cartesian_product() {
                let cell = self.cell(profile, Some(sweep), params.clone(), sets, &point);
                cells.entry(cell.cell.clone()).or_insert(cell);
            }
        }
        Ok(cells.into_values().collect())
    }

    /// Names of all axes, without repetition.
    pub fn axis_names(&self) -> Vec<&str> {
        let names: IndexSet<&str> = self.axes().map(|axis| axis.name.as_str()).collect();
        names.into_iter().collect()
    }

    fn check_axes(&self, axis_overrides: &Overrides) -> Result<(), ExperimentError> {
        let names = self.axis_names();
        let unknown = axis_overrides.iter().find(|(name, _)| !names.contains(&name.as_str()));
        let Some((name, _)) = unknown else { return Ok(()) };
        let near = did_you_mean(name, names);
        Err(ExperimentError(format!("experiment `{}` has no axis `{name}`{near}", self.id)))
    }

    fn check_sets(
        &self,
        profile: Profile,
        sets: &[(String, Value)],
    ) -> Result<(), ExperimentError> {
        for axis in self.axes() {
            for value in axis.values_of(profile) {
                let parsed = self.of_axis(axis, axis.parse(value))?;
                let mut swept = parsed.set.iter().map(|(path, _)| path);
                if let Some(path) = swept.find(|path| sets.iter().any(|(set, _)| set == *path)) {
                    let (id, axis) = (&self.id, &axis.name);
                    return Err(ExperimentError(format!(
                        "`{path}` is swept by the axis `{axis}` of `{id}`: choose its values with --axis {axis}=…"
                    )));
                }
            }
        }
        Ok(())
    }

    fn of_axis<T>(&self, axis: &Axis, value: Result<T, String>) -> Result<T, ExperimentError> {
        value.map_err(|fault| {
            let axis = line(&axis.name);
            ExperimentError(format!("axis `{axis}` of `{}`: {}", self.id, line(&fault)))
        })
    }

    fn axis_values<'a>(
        &self,
        sweep: &'a Sweep,
        profile: Profile,
        axis_overrides: &Overrides,
    ) -> Result<Vec<ChosenAxis<'a>>, ExperimentError> {
        let mut axes = Vec::new();
        for axis in &sweep.axis {
            let chosen = axis_overrides.iter().find(|(name, _)| *name == axis.name);
            let values: Result<Vec<AxisValue>, String> = match chosen {
                Some((_, texts)) => texts.iter().map(|text| axis.choose(text)).collect(),
                None => axis.values_of(profile).iter().map(|value| axis.parse(value)).collect(),
            };
            axes.push((axis, self.of_axis(axis, values)?));
        }
        Ok(axes)
    }

    /// Refuses more cells than are planned before one of them is made.
    fn check_size(
        &self,
        profile: Profile,
        sweeps: &[ChosenSweep<'_>],
    ) -> Result<(), ExperimentError> {
        let turns = self.views.as_ref().map(|views| views.turns_deg.for_profile(profile).len());
        let views = turns.map_or(0, |turns| 1 + 2 * turns);
        let repeated =
            self.repetitions.as_ref().map_or(0, |own| u64::from(*own.count.for_profile(profile)));
        let each = 1 + u64::from(self.reference.is_some()) + views as u64 + repeated;
        let points = |sweep: &ChosenSweep<'_>| {
            sweep.axes.iter().fold(each, |n, (_, values)| n.saturating_mul(values.len() as u64))
        };
        let cells = sweeps.iter().map(points).fold(0, u64::saturating_add);
        if cells <= MAX_CELLS {
            return Ok(());
        }
        Err(ExperimentError(format!(
            "experiment `{}` has {cells} cells, references and views counted too: at most {MAX_CELLS} are planned at once",
            self.id
        )))
    }

    fn cell(
        &self,
        profile: Profile,
        sweep: Option<&Sweep>,
        mut params: Vec<(String, Value)>,
        sets: &[(String, Value)],
        point: &[(&Axis, &AxisValue)],
    ) -> CellPlan {
        let mut axes = Map::new();
        params.extend(sets.iter().cloned());
        for (axis, value) in point {
            axes.insert(axis.name.clone(), value.label.clone());
            params.extend(value.set.iter().cloned());
        }
        let id = sweep.and_then(|sweep| sweep.id.clone());
        let values = point.iter().map(|(axis, value)| format!("{}={}", axis.name, value.text()));
        let key: Vec<String> = id.into_iter().chain(values).collect();
        let stages = sweep.map(|sweep| &sweep.stages).filter(|stages| !stages.is_empty());
        // The later of two values for one path replaces the earlier.
        let mut params: IndexMap<String, Value> = params.into_iter().collect();
        let mut chosen = |name, own: &String| {
            params.shift_remove(name).map_or_else(|| own.clone(), |value| label_text(&value))
        };
        let scene = chosen("scene", &self.scene);
        let pipeline = chosen("pipeline", &self.pipeline);
        let starts_from_method = self.starts_from_method && pipeline == self.pipeline;
        let method = if starts_from_method { flatten(&self.method) } else { Vec::new() };
        let overrides = last_of_each(method.into_iter().chain(params).collect());
        CellPlan {
            experiment: self.id.clone(),
            cell: if key.is_empty() { "base".to_owned() } else { key.join(",") },
            axes,
            pipeline,
            scene,
            reference: self.reference_plan(profile, &overrides),
            repetitions: self.repetition_plan(profile, &overrides),
            stages: stages.unwrap_or(&self.stages).clone(),
            errors_only: sweep.is_some_and(|sweep| *sweep.errors_only.for_profile(profile)),
            overrides,
        }
    }

    fn repetition_plan(
        &self,
        profile: Profile,
        cell: &[(String, Value)],
    ) -> Option<RepetitionPlan> {
        let own = self.repetitions.as_ref()?;
        let with = |more: Vec<(String, Value)>| last_of_each([cell, &more].concat());
        let at = |place: [f64; 2]| {
            with(own.vary.iter().map(|path| (path.clone(), json!(place))).collect())
        };
        let count = *own.count.for_profile(profile);
        Some(RepetitionPlan { repeated: places(count).into_iter().map(at).collect() })
    }

    fn reference_plan(&self, profile: Profile, cell: &[(String, Value)]) -> Option<ReferencePlan> {
        let reference = self.reference.as_ref()?;
        let own = reference.profile.after(&reference.params, profile);
        Some(ReferencePlan {
            quantity: reference.quantity.clone(),
            stages: reference.stages.clone(),
            overrides: last_of_each([cell, &own].concat()),
        })
    }
}

/// 1 / ρ and 1 / ρ² of the plastic number ρ, the real root of ρ³ = ρ + 1: steps of the sequence R2, whose points fill the unit
/// square evenly (Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018).
const R2_STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

/// Places in the unit square from its middle on, the default place of a photon grid. The same in every cell, so that cells
/// do not differ by where their grids lay.
fn places(count: u32) -> Vec<[f64; 2]> {
    let place = |i: u32| R2_STEPS.map(|step| (0.5 + f64::from(i) * step).fract());
    (0..count).map(place).collect()
}

/// The later of two values for one path replaces the earlier.
fn last_of_each(params: Vec<(String, Value)>) -> Vec<(String, Value)> {
    params.into_iter().collect::<IndexMap<_, _>>().into_iter().collect()
}

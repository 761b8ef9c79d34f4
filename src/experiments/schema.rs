//! What an experiment's file may hold. Unknown keys are errors.
//!
//! Parameters are named by their dotted paths in the pipeline's tree; a TOML table nests the same way, so
//! `params = { caustics.grid = 200 }` and `"caustics.grid" = 200` mean the same. Two names are not parameters of the
//! pipeline: `scene` and `pipeline` choose what the cell runs on.

mod claim;
mod earlier;
mod named;
mod plot;

use std::collections::{BTreeMap, HashSet};

use serde::{Deserialize, Deserializer, de};
use serde_json::{Map, Value};

use self::named::{Named, tables};
use super::{ExperimentError, Measure};
use fathom_base::text;
use fathom_record::{Cell, Profile};

pub use claim::{
    Balance, Cause, Claim, Direction, EqualTime, FIXED_SHARE, Fault, Least, RISING_SHARE, Ratio,
    Test,
};
pub use plot::{Plot, PlotKind};

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Name on the command line, in every record and of files: see [`text::check_id`].
    pub id: String,
    pub title: String,
    /// The publication's section or figure, such as `UW §4.2`. None of an experiment of one's own.
    #[serde(default)]
    pub source: String,
    /// What is done and why, and where it departs from the publication.
    #[serde(default)]
    pub about: String,
    pub pipeline: String,
    pub scene: String,
    /// Parameters of every cell.
    #[serde(default)]
    pub params: Map<String, Value>,
    #[serde(default)]
    pub profile: Profiles,
    /// Each sweep is the product of its axes; the experiment is their union. None: a single cell.
    #[serde(default, deserialize_with = "tables")]
    pub sweep: Vec<Sweep>,
    /// Stages of every cell that `fathom compare` compares.
    #[serde(default)]
    pub stages: Vec<String>,
    /// `CELL STAGE` that `fathom compare` measures once more with one build on both sides; the first where absent.
    pub control: Option<String>,
    /// A denser run that each cell's result is held against.
    pub reference: Option<Reference>,
    /// The same surface points seen from other places.
    pub views: Option<Views>,
    /// The same frame with its photon grids moved: its noise.
    #[serde(default, deserialize_with = "earlier::repetitions")]
    pub repetitions: Option<Repetitions>,
    /// Time that a cell of this experiment gets, as a multiple of the usual: less than 1 where errors count and times do not.
    #[serde(default = "one")]
    pub weight: f64,
    /// Share of a frame, 0 … 1, from which a stage counts as costly. Where it is set, reports list for each axis what each size
    /// costs and from which size on a stage is costly.
    pub knee_share: Option<f64>,
    #[serde(default)]
    pub pictures: Pictures,
    /// A map of the signed error beside each picture, for pipelines whose error is known point by point.
    #[serde(default)]
    pub error_picture: bool,
    #[serde(default, deserialize_with = "figures")]
    pub published: Vec<Published>,
    /// The publication's own method: parameters and their values. A claim with a source is tested only on cells in which those hold that
    /// the cell's pipeline has. This project's own methods are other cells. `publication = "VAO"` within braces stands for the values that
    /// `METHODS` has, and [`Self::text`] has them in its place.
    #[serde(default)]
    pub method: Map<String, Value>,
    /// Whether cells of the experiment's own pipeline begin with the method's values: `params` and axes change them.
    #[serde(default)]
    pub starts_from_method: bool,
    #[serde(default)]
    pub balance: Vec<PublishedSizes>,
    #[serde(default, deserialize_with = "tables")]
    pub claim: Vec<Claim>,
    #[serde(default, deserialize_with = "earlier::plots")]
    pub plot: Vec<Plot>,
    /// The text this was parsed from.
    #[serde(skip)]
    pub text: String,
}

#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profiles {
    #[serde(default)]
    pub quick: ProfileParams,
    #[serde(default)]
    pub paper: ProfileParams,
}

/// Parameters that replace those of the experiment in one profile.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileParams {
    #[serde(default)]
    pub params: Map<String, Value>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// Name of its cell, or what the names of its cells begin with.
    pub id: Option<String>,
    /// Stages of its cells that `fathom compare` compares, in place of the experiment's.
    #[serde(default)]
    pub stages: Vec<String>,
    /// Parameters of this sweep's cells only.
    #[serde(default)]
    pub params: Map<String, Value>,
    #[serde(default)]
    pub profile: Profiles,
    /// Its cells are there for their errors and counts: they render one frame, and nothing is timed. `{ quick = true, paper = false }`: in one
    /// profile.
    #[serde(default)]
    pub errors_only: ByProfile<bool>,
    /// May be left out where the sweep has an id.
    #[serde(default, deserialize_with = "tables")]
    pub axis: Vec<Axis>,
}

impl Named for Sweep {
    fn set_name(&mut self, name: String) {
        self.id = Some(name);
    }
}

/// An axis: a name and its values, the same in every profile or different ones.
///
/// A scalar or array value is given to the parameter that the axis is named after. A table
/// `{ label = …, set = { path = value, … } }` moves several parameters together.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    #[serde(default)]
    pub name: String,
    /// The parameters that its plain values are given to, where it is not named after one: a single one, or one for each item of
    /// a list. A list's label is its text, such as `640x480`.
    #[serde(default)]
    pub sets: Vec<String>,
    /// What to write beside it in tables and plots, with its unit; the name where absent.
    pub title: Option<String>,
    /// Files of earlier versions have it. Nothing reads it.
    #[serde(default)]
    pub task: bool,
    pub values: Option<Vec<Value>>,
    pub quick: Option<Vec<Value>>,
    pub paper: Option<Vec<Value>>,
}

impl Named for Axis {
    fn set_name(&mut self, name: String) {
        self.name = name;
    }
}

/// The result that the cells' results are held against: the same cell with other parameters.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Name under which the relative RMS difference goes into the record's quantities.
    pub quantity: String,
    /// The first of these stages that runs in the cell gives the output that is compared.
    pub stages: Vec<String>,
    #[serde(default)]
    pub params: Map<String, Value>,
    #[serde(default)]
    pub profile: Profiles,
}

/// Fewest repetitions: an interval takes four.
const MIN_REPETITIONS: u32 = 4;
const MAX_REPETITIONS: u32 = 100;

/// One value for both profiles, or one for each: `4`, `{ quick = 4, paper = 8 }`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "expected a value, or { quick = …, paper = … }")]
pub enum ByProfile<T> {
    Each { quick: T, paper: T },
    Both(T),
}

impl<T: Default> Default for ByProfile<T> {
    fn default() -> Self {
        Self::Both(T::default())
    }
}

impl<T> ByProfile<T> {
    pub fn for_profile(&self, profile: Profile) -> &T {
        match (self, profile) {
            (Self::Both(value), _)
            | (Self::Each { quick: value, .. }, Profile::Quick)
            | (Self::Each { paper: value, .. }, Profile::Paper) => value,
        }
    }
}

/// Tells the noise of a result. The cell's frame is drawn several times with the photon grid at another place each time: how far the
/// results are from their mean is noise.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Repetitions {
    pub count: ByProfile<u32>,
    /// Parameters that are a place in the unit square, `[x, y]`. Each repetition takes another place, the same for all of them.
    pub vary: Vec<String>,
    /// What is compared.
    pub output: Vec<RepeatedOutput>,
}

/// An output whose noise goes into the record, relative to its mean level.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RepeatedOutput {
    /// The first of these stages that runs in the cell gives the output.
    pub stages: Vec<String>,
    /// Name of the RMS difference of a repetition from the mean over the repetitions: a figure for each repetition.
    pub noise: String,
}

impl Repetitions {
    fn check(&self) -> Result<(), String> {
        let counts = Profile::ALL.map(|profile| *self.count.for_profile(profile));
        if let Some(count) =
            counts.iter().find(|count| !(MIN_REPETITIONS..=MAX_REPETITIONS).contains(*count))
        {
            return Err(format!(
                "repetitions.count is {count}: {MIN_REPETITIONS} to {MAX_REPETITIONS} are taken"
            ));
        }
        if self.vary.is_empty() || self.output.is_empty() {
            return Err("repetitions needs parameters to `vary` and an `output`".to_owned());
        }
        let mut names = self.output.iter().map(|output| &output.noise);
        let mut unique = HashSet::new();
        match names.find(|name| !unique.insert(name.as_str())) {
            Some(name) => Err(format!("repetitions names `{name}` twice")),
            None => Ok(()),
        }
    }
}

/// Most turns of a camera: one every 5 degrees.
const MAX_TURNS: usize = 72;

/// How much a result at one surface point changes with the viewer: the camera is turned about its target, and the points of
/// the cell's own view are looked up wherever another view sees them too.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Views {
    /// Name under which the spread goes into the record's quantities: mean over the points of the variance over the views that see
    /// a point, less the variance between two draws of one view, or the standard error of that if it is more. With `_with_noise` and
    /// `_of_noise` behind the name: the two apart.
    pub quantity: String,
    /// Turns of the camera about the vertical through its target, degrees; the cell's own view is not named.
    pub turns_deg: ByProfile<Vec<f64>>,
}

/// Which measured cells leave a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pictures {
    /// The first that is finished.
    #[default]
    First,
    All,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Relation {
    AtLeast,
    About,
    Range,
}

/// A published figure and the cells it speaks of. In a file, a table with a list `figures` stands for as many figures: each has what
/// the table holds, and what its own entry holds.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Axis or parameter → value; all must hold. Cells at other sizes are not compared.
    #[serde(default, rename = "where")]
    pub filter: Map<String, Value>,
    pub comparison: Relation,
    /// Frames per second; the lower end of a range.
    pub fps: f64,
    /// The upper end of a range.
    pub fps_high: Option<f64>,
    pub hardware: String,
    #[serde(default)]
    pub note: String,
}

/// Sizes of the publication's test: its triangles, pixels, voxels, photons. What several of them say of one cell adds up.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedSizes {
    /// Axis or parameter → value; all must hold.
    #[serde(default, rename = "where")]
    pub filter: Map<String, Value>,
    /// What a cell has of it, as a [`Measure`], and the publication's number.
    #[serde(deserialize_with = "sizes")]
    pub sizes: Vec<(Measure, f64)>,
}

fn sizes<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<(Measure, f64)>, D::Error> {
    let mut sizes = Vec::new();
    for (measure, published) in BTreeMap::<String, f64>::deserialize(deserializer)? {
        if !(published.is_finite() && published > 0.0) {
            let fault = format!("the published size of `{measure}` must be positive");
            return Err(de::Error::custom(fault));
        }
        sizes.push((measure.parse().map_err(de::Error::custom)?, published));
    }
    Ok(sizes)
}

fn figures<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Published>, D::Error> {
    let mut published = Vec::new();
    for mut shared in Vec::<Map<String, Value>>::deserialize(deserializer)? {
        let own = match shared.remove("figures") {
            Some(list) => {
                Vec::<Map<String, Value>>::deserialize(list).map_err(de::Error::custom)?
            }
            None => vec![Map::new()],
        };
        for figure in own {
            let whole = shared.clone().into_iter().chain(figure).collect();
            let figure = Published::deserialize(Value::Object(whole));
            published.push(figure.map_err(de::Error::custom)?);
        }
    }
    Ok(published)
}

impl Published {
    /// `> 110`, `20 – 30` or `about 20`.
    pub fn figure(&self) -> String {
        match (self.comparison, self.fps_high) {
            (Relation::AtLeast, _) => format!("> {}", self.fps),
            (Relation::Range, Some(high)) => format!("{} – {high}", self.fps),
            (Relation::About | Relation::Range, _) => format!("about {}", self.fps),
        }
    }

    /// Frame times in milliseconds, from the shortest to the longest that the figure allows for.
    pub fn span_ms(&self) -> [f64; 2] {
        [self.fps_high.unwrap_or(self.fps), self.fps].map(|fps| 1e3 / fps)
    }
}

/// Methods of publications by their names. UW §2 to §4. VAO §5.1 and §6.3: directions are uniform as printed; the printed sum is half of
/// Eq. 1 and doubled. A threshold of 0.65 beside it lies within the band of §6.5 and above what a plane's own voxels reach
/// (docs/volume-ao.md). On one line, so that errors name the lines of the file.
const METHODS: [(&str, &str); 2] = [
    (
        "publication = \"UW\"",
        "caustics = { coverage = \"square\", splatting = \"raster\", intensity = \"paper\", jitter = 0.0, \
         estimator = \"paper\", depth_bias_m = 0.0, filter_depth_share = 1e6 }, \
         godrays = { intensity = \"paper\", jitter = 0.0, estimator = \"paper\" }, \
         compose.add_caustics = true, photons_fitted = false",
    ),
    (
        "publication = \"VAO\"",
        "voxel = { method = \"slicemap\", rasterizer = \"hardware\" }, ao.step = \"paper\", ao.hit = \"sample\", \
         ao.offset_voxels = 0.0, ao.estimator = \"uniform\", ao.sampling = \"random\"",
    ),
];

/// The text with the values of the publication's method in place of its name, so that a record needs no other file.
pub(super) fn with_method(text: &str) -> String {
    METHODS.iter().fold(text.to_owned(), |text, (name, values)| text.replace(name, values))
}

impl Experiment {
    /// Parses and checks an experiment's text; `name` stands in errors.
    pub fn parse(name: &str, text: &str) -> Result<Experiment, ExperimentError> {
        let invalid = |fault: String| ExperimentError::new(name, &fault);
        let text = with_method(text);
        let parsed = toml::from_str(&text).map_err(|error| invalid(one_line(&error, &text)));
        let mut experiment = Experiment { text, ..parsed? };
        experiment.check().map_err(invalid)?;
        experiment.claim = experiment.claim.into_iter().flat_map(Claim::expanded).collect();
        for claim in experiment.claim.iter_mut().filter(|claim| claim.source.is_some()) {
            claim.method.clone_from(&experiment.method);
        }
        Ok(experiment)
    }

    fn check(&self) -> Result<(), String> {
        text::check_id(&self.id)?;
        for axis in self.axes() {
            axis.check()?;
        }
        self.check_sweeps()?;
        if let Some(name) = self.method.get("publication") {
            return Err(format!("the method of publication {name} is not known: UW and VAO are"));
        }
        self.check_claims_and_plots()?;
        if !(self.weight > 0.0 && self.weight <= 10.0) {
            return Err(format!("weight {} must lie within 0 … 10", self.weight));
        }
        if let Some(share) = self.knee_share.filter(|share| !(*share > 0.0 && *share < 1.0)) {
            return Err(format!("knee_share {share} must lie between 0 and 1"));
        }
        let views = self.views.iter();
        for turns_deg in
            views.flat_map(|views| Profile::ALL.map(|of| views.turns_deg.for_profile(of)))
        {
            let count = turns_deg.len();
            if count > MAX_TURNS {
                return Err(format!(
                    "views.turns_deg has {count} turns; at most {MAX_TURNS} are taken"
                ));
            }
            if count == 0 || !turns_deg.iter().all(|turn| turn.abs() <= 180.0) {
                return Err("views.turns_deg needs turns of at most 180 degrees".to_owned());
            }
        }
        if let Some(repetitions) = &self.repetitions {
            repetitions.check()?;
        }
        for published in &self.published {
            if published.comparison == Relation::Range && published.fps_high.is_none() {
                return Err("a published range needs fps_high".to_owned());
            }
            if !(published.fps.is_finite() && published.fps > 0.0) {
                return Err("a published fps must be positive".to_owned());
            }
        }
        Ok(())
    }

    fn check_claims_and_plots(&self) -> Result<(), String> {
        for claim in &self.claim {
            if claim.id.is_empty() {
                return Err("a claim needs an `id`".to_owned());
            }
            let place = format!("claim `{}`", claim.id);
            let axes = claim.each.keys().chain(claim.least.iter().map(|least| &least.over));
            for axis in axes.map(String::as_str).chain(claim.test.over()) {
                self.check_over(Some(axis), &place)?;
            }
            if claim.each.len() > 1 || claim.each.values().any(Vec::is_empty) {
                return Err(format!("{place}: `each` takes one axis with its values"));
            }
            if let Test::Ratio(ratio) = &claim.test {
                ratio.check().map_err(|fault| format!("{place} {fault}"))?;
            }
            if let Test::EqualTime(test) = &claim.test {
                self.check_over(Some(&test.over), &place)?;
            }
            if claim.balance == Some(Balance::Published) && self.balance.is_empty() {
                return Err(format!("{place} needs published sizes in `balance`"));
            }
        }
        for plot in &self.plot {
            let place = format!("plot `{}`", plot.title);
            for axis in plot.axes() {
                self.check_over(Some(axis), &place)?;
            }
            plot.check().map_err(|fault| format!("{place} {fault}"))?;
        }
        Ok(())
    }

    fn check_sweeps(&self) -> Result<(), String> {
        let mut ids = HashSet::new();
        for sweep in &self.sweep {
            match &sweep.id {
                Some(id) => text::check_id(id).map_err(|fault| format!("sweep {fault}"))?,
                None if sweep.axis.is_empty() => {
                    return Err("a sweep needs an `axis` or an `id`".to_owned());
                }
                None => {}
            }
            if let Some(id) = sweep.id.as_ref().filter(|id| !ids.insert(id.as_str())) {
                return Err(format!("sweep `{id}` is there twice"));
            }
        }
        for stages in self.sweep.iter().map(|sweep| &sweep.stages).chain([&self.stages]) {
            let mut unique = HashSet::new();
            if let Some(stage) = stages.iter().find(|stage| !unique.insert(*stage)) {
                return Err(format!("stage `{stage}` is listed twice"));
            }
        }
        Ok(())
    }

    fn check_over(&self, over: Option<&str>, place: &str) -> Result<(), String> {
        match over {
            Some(name) if !self.axes().any(|axis| axis.name == name) => {
                Err(format!("{place} is over `{name}`, which is no axis"))
            }
            _ => Ok(()),
        }
    }

    /// The figure published for a cell of that size, where there is one.
    pub fn published_for(&self, cell: &Cell) -> Option<&Published> {
        self.published.iter().find(|published| super::fits(cell, &published.filter))
    }

    /// What its claims and plots read from a cell.
    pub fn measures(&self) -> Vec<&Measure> {
        let least = self.claim.iter().filter_map(|claim| Some(&claim.least.as_ref()?.y));
        let claims = self.claim.iter().flat_map(|claim| claim.test.measures()).chain(least);
        let plots = self.plot.iter().flat_map(|plot| plot.x.iter().chain(&plot.y));
        claims.chain(plots).collect()
    }

    /// Whether the values of an axis have no order: one of them sets a name, such as a scene or a method, or its label begins with a
    /// letter, as that of `as printed` does.
    pub fn is_category(&self, axis: &str) -> bool {
        self.axes().any(|one| one.name == axis && one.is_category())
    }

    /// All axes of all sweeps; a name may come more than once.
    pub fn axes(&self) -> impl Iterator<Item = &Axis> {
        self.sweep.iter().flat_map(|sweep| &sweep.axis)
    }
}

impl Axis {
    fn is_category(&self) -> bool {
        let lists = [&self.values, &self.quick, &self.paper].into_iter().flatten();
        lists.flatten().any(|value| self.is_named(value))
    }

    fn check(&self) -> Result<(), String> {
        let (name, lists) = (&self.name, [&self.values, &self.quick, &self.paper]);
        if name.is_empty() {
            return Err("an axis needs a `name`".to_owned());
        }
        if !matches!(lists, [Some(_), None, None] | [None, Some(_), Some(_)]) {
            return Err(format!("axis `{name}` needs either `values`, or `quick` and `paper`"));
        }
        for list in lists.into_iter().flatten() {
            if list.is_empty() {
                return Err(format!("axis `{name}` has an empty list of values"));
            }
            for value in list {
                self.parse(value)?;
            }
        }
        Ok(())
    }
}

fn one() -> f64 {
    1.0
}

/// The parser's message with its line number, without the quoted source.
pub fn one_line(error: &toml::de::Error, source: &str) -> String {
    let line =
        error.span().map(|span| source[..span.start.min(source.len())].matches('\n').count() + 1);
    let key = error
        .span()
        .and_then(|span| source.get(span))
        .filter(|_| error.message() == "duplicate key");
    let fault =
        text::fault(error.message()) + &key.map_or_else(String::new, |key| format!(" `{key}`"));
    line.map_or(fault.clone(), |line| format!("line {line}: {fault}"))
}

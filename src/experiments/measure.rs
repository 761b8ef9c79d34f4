//! What a claim or a plot may ask of a measured cell, written as one string:
//!
//! | text | meaning | unit |
//! |---|---|---|
//! | `stage:caustics/trace` | time of a stage | ns |
//! | `stage:voxel/` | the summed times of a family's stages | ns |
//! | `stage:ao/march\|hsao/march` | the same for those of the named ones that run | ns |
//! | `frame` | frame time without per-stage timing | ns |
//! | `fps` | its reciprocal | frames per second |
//! | `work:caustics/trace.photons` | declared work of a stage | count |
//! | `param:caustics.grid` | a parameter; an array counts as the product of its elements | as the parameter |
//! | `axis:caustics.grid` | a number among the cell's axis values | as the axis |
//! | `quantity:caustics_error` | a recorded quantity or error; a repeated quantity has a value for each repetition | as its name says |
//! | `allocated_bytes` | memory allocated by the pipeline | bytes |
//!
//! A stage's time that is below the clock's resolution has no value: nothing can be fitted to it or divided by it.
//!
//! A product is written with `*`, a quotient with ` per `: `param:view.width*param:view.height`,
//! `allocated_bytes per quantity:occupied_voxels`.

use std::fmt;
use std::str::FromStr;

use itertools::Itertools;
use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value};

use crate::expand::flatten;
use crate::words::{self, FigureUnit, Label};
use fathom_base::statistics::{self, ALPHA};
use fathom_base::visits::{self, Scale};
use fathom_record::{Cell, Estimate, FrameRecord, Interval, Measured, StageRecord, Work};

/// A product of terms over another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Measure {
    terms: Vec<Term>,
    per: Vec<Term>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Term {
    /// Time of these of them that run.
    Stages(Vec<StageName>),
    Frame,
    Fps,
    /// A field of the stage's declared work.
    Work(StageName, &'static str),
    Param(String),
    Axis(String),
    Quantity(String),
    AllocatedBytes,
}

/// Stages that a measure speaks of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StageName {
    One(String),
    /// All whose names begin so; it ends in `/`.
    Family(String),
}

impl StageName {
    pub fn covers(&self, stage: &str) -> bool {
        match self {
            StageName::One(name) => stage == name,
            StageName::Family(beginning) => stage.starts_with(beginning.as_str()),
        }
    }
}

impl fmt::Display for StageName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (StageName::One(name) | StageName::Family(name)) = self;
        f.write_str(name)
    }
}

/// The value of a measure in a cell.
#[derive(Clone, Debug, PartialEq)]
pub enum Quantity {
    /// Set, counted, or computed over everything there is: it has no samples.
    Exact(f64),
    /// A value for each round of sampling or for each repetition.
    Sampled(Vec<RoundSample>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoundSample {
    /// Cells that a claim compares are visited together, and their samples have one number.
    pub round: u32,
    /// A repetition is a visit of its own. None in records of before, where every sample counts alone.
    pub visit: Option<u32>,
    /// When it was taken, seconds; not a number of a repetition.
    pub at_s: f64,
    pub value: f64,
}

impl Quantity {
    /// With a value of each frame.
    pub fn from_frames(frame: &FrameRecord, values: &[f64]) -> Quantity {
        let FrameRecord { rounds, visits, sampled_at_s, .. } = frame;
        let sample = |(number, value): (usize, &f64)| {
            Some(RoundSample {
                round: *rounds.get(number)?,
                visit: visits.get(number).copied(),
                at_s: sampled_at_s.get(number).copied().unwrap_or(f64::NAN),
                value: *value,
            })
        };
        Quantity::Sampled(values.iter().enumerate().map_while(sample).collect())
    }

    fn from_repetitions(cell: &FrameRecord, values: &[f64]) -> Quantity {
        let is_earlier = cell.visits.len() < cell.rounds.len();
        let sample = |(number, value): (u32, &f64)| RoundSample {
            round: number,
            visit: (!is_earlier).then_some(number),
            at_s: f64::NAN,
            value: *value,
        };
        Quantity::Sampled((0..).zip(values).map(sample).collect())
    }

    /// Of visits the exponential of the mean logarithm; of records of before the median.
    pub fn median(&self) -> f64 {
        self.figure().median
    }

    /// Of a time, a ratio or an error, with its 95 % interval.
    pub fn figure(&self) -> Estimate {
        self.estimate(Scale::Factors, ALPHA)
    }

    /// Over visits, of records of before over samples. An exact figure has no interval.
    pub fn estimate(&self, scale: Scale, alpha: f64) -> Estimate {
        match (self, self.visits(scale)) {
            (Quantity::Exact(value), _) => Estimate { median: *value, interval: None, n: 1 },
            (Quantity::Sampled(samples), _) if samples.is_empty() => {
                Estimate { median: f64::NAN, interval: None, n: 0 }
            }
            (_, Some(visits)) => visits::estimate(&visits, scale, alpha),
            (_, None) => {
                let values = self.values();
                let interval = statistics::median_interval(&values, alpha);
                Estimate { interval, ..statistics::estimate(&values) }
            }
        }
    }

    /// One value of each visit; none where it has none, or where visits were not told.
    pub fn visits(&self, scale: Scale) -> Option<Vec<f64>> {
        let Quantity::Sampled(samples) = self else { return None };
        let numbers: Option<Vec<u32>> = samples.iter().map(|sample| sample.visit).collect();
        Some(visits::medians(&numbers?, &self.values(), scale))
    }

    /// A sample of each visit, and visits numbered from 0: cells that were visited apart are compared visit by visit. The same where
    /// visits are not told.
    pub(crate) fn in_order_of_visits(&self) -> Quantity {
        let (Quantity::Sampled(samples), Some(values)) = (self, self.visits(Scale::Factors)) else {
            return self.clone();
        };
        let firsts = samples.iter().unique_by(|sample| sample.visit);
        let of = |(round, (first, value)): (u32, (&RoundSample, f64))| RoundSample {
            round,
            visit: Some(round),
            value,
            ..*first
        };
        Quantity::Sampled((0..).zip(firsts.zip(values)).map(of).collect())
    }

    pub fn values(&self) -> Vec<f64> {
        match self {
            Quantity::Exact(value) => vec![*value],
            Quantity::Sampled(samples) => samples.iter().map(|sample| sample.value).collect(),
        }
    }

    /// Visits, in records of before samples; none where the figure is exact.
    pub fn n(&self) -> Option<usize> {
        let Quantity::Sampled(samples) = self else { return None };
        Some(self.visits(Scale::Sums).map_or(samples.len(), |visits| visits.len()))
    }

    /// From the first sample to the last, seconds; none where that is not known.
    pub fn span_s(&self) -> Option<f64> {
        let Quantity::Sampled(samples) = self else { return None };
        let (first, last) = samples.iter().map(|sample| sample.at_s).minmax().into_option()?;
        Some(last - first).filter(|span_s| span_s.is_finite())
    }

    /// Of the same round in both, where both are sampled.
    pub fn with(&self, other: &Quantity, join: impl Fn(f64, f64) -> f64) -> Quantity {
        match (self, other) {
            (Quantity::Exact(a), Quantity::Exact(b)) => Quantity::Exact(join(*a, *b)),
            (Quantity::Exact(a), b) => b.map(|b| join(*a, b)),
            (a, Quantity::Exact(b)) => a.map(|a| join(a, *b)),
            (Quantity::Sampled(a), Quantity::Sampled(b)) => {
                // Of several samples of a round the last.
                let b: Vec<_> = b.iter().copied().sorted_by_key(|s| s.round).collect();
                let joined = a.iter().filter_map(|sample| {
                    let last = b[..b.partition_point(|s| s.round <= sample.round)].last()?;
                    let visit = last.visit.and(sample.visit);
                    let value = join(sample.value, last.value);
                    (last.round == sample.round).then_some(RoundSample { visit, value, ..*sample })
                });
                Quantity::Sampled(joined.collect())
            }
        }
    }

    pub fn map(&self, change: impl Fn(f64) -> f64) -> Quantity {
        match self {
            Quantity::Exact(value) => Quantity::Exact(change(*value)),
            Quantity::Sampled(samples) => {
                let changed = samples.iter().map(|s| RoundSample { value: change(s.value), ..*s });
                Quantity::Sampled(changed.collect())
            }
        }
    }

    /// Paired by round: the two samples of a round are one sample of the ratio.
    pub fn ratio_to(&self, other: &Quantity) -> Quantity {
        self.with(other, |a, b| a / b)
    }
}

impl FromStr for Measure {
    type Err = String;

    fn from_str(text: &str) -> Result<Measure, String> {
        let (terms, per) = text.split_once(" per ").unwrap_or((text, ""));
        let product =
            |text: &str| -> Result<Vec<Term>, String> { text.split('*').map(parse_term).collect() };
        Ok(Measure {
            terms: product(terms)?,
            per: match per {
                "" => Vec::new(),
                per => product(per)?,
            },
        })
    }
}

fn parse_term(text: &str) -> Result<Term, String> {
    let text = text.trim();
    let (head, rest) = text.split_once(':').unwrap_or((text, ""));
    let named = |build: fn(String) -> Term| match rest {
        "" => Err(format!("`{text}` lacks a name after the colon")),
        name => Ok(build(name.to_owned())),
    };
    match (head, rest) {
        ("frame", "") => Ok(Term::Frame),
        ("fps", "") => Ok(Term::Fps),
        ("allocated_bytes", "") => Ok(Term::AllocatedBytes),
        ("stage", _) => named(|names| Term::Stages(names.split('|').map(stage_name).collect())),
        ("param", _) => named(Term::Param),
        ("axis", _) => named(Term::Axis),
        ("quantity", _) => named(Term::Quantity),
        ("work", _) => {
            let known = rest.rsplit_once('.').and_then(|(stage, count)| {
                let count = Work::NAMES.iter().find(|name| **name == count)?;
                Some(Term::Work(stage_name(stage), count))
            });
            known.ok_or_else(|| {
                let counts = Work::NAMES.join(", ");
                format!("`{text}` must be work:STAGE.COUNT with COUNT one of {counts}")
            })
        }
        _ => Err(format!(
            "unknown measure `{text}`; known: stage:, frame, fps, work:, param:, axis:, quantity:, allocated_bytes"
        )),
    }
}

fn stage_name(text: &str) -> StageName {
    if text.ends_with('/') {
        StageName::Family(text.to_owned())
    } else {
        StageName::One(text.to_owned())
    }
}

impl fmt::Display for Measure {
    /// In words, without a unit: `ao/march time per samples per pixel, mean`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let factors = [(" × ", &self.terms), (" per ", &self.per)];
        let terms =
            factors.iter().flat_map(|(sign, terms)| terms.iter().map(move |term| (sign, term)));
        for (index, (sign, term)) in terms.enumerate() {
            if index > 0 {
                f.write_str(sign)?;
            }
            f.write_str(&term.label().words)?;
        }
        Ok(())
    }
}

impl<'de> Deserialize<'de> for Measure {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Measure, D::Error> {
        let text = String::deserialize(deserializer)?;
        text.parse().map_err(serde::de::Error::custom)
    }
}

impl Measure {
    /// Frame time without per-stage timing.
    pub fn frame() -> Measure {
        Measure { terms: vec![Term::Frame], per: Vec::new() }
    }

    /// In words, and what its values are shown in.
    pub fn label(&self) -> Label {
        let unit = match self.only() {
            Some(term) => term.label().unit,
            None if self.is_time() => FigureUnit::Milliseconds,
            None => FigureUnit::One,
        };
        Label::new(self.to_string(), unit)
    }

    fn all(&self) -> impl Iterator<Item = &Term> {
        self.terms.iter().chain(&self.per)
    }

    fn only(&self) -> Option<&Term> {
        match (self.terms.as_slice(), self.per.as_slice()) {
            ([term], []) => Some(term),
            _ => None,
        }
    }

    pub fn stages(&self) -> impl Iterator<Item = &StageName> {
        self.all().flat_map(|term| match term {
            Term::Stages(names) => names.as_slice(),
            Term::Work(name, _) => std::slice::from_ref(name),
            _ => &[],
        })
    }

    /// Dotted paths of the parameters that the measure speaks of.
    pub fn params(&self) -> impl Iterator<Item = &str> {
        self.all()
            .filter_map(|term| if let Term::Param(path) = term { Some(&**path) } else { None })
    }

    pub fn quantities(&self) -> impl Iterator<Item = &str> {
        self.all()
            .filter_map(|term| if let Term::Quantity(name) = term { Some(&**name) } else { None })
    }

    /// A stage's name, where the measure is its time and nothing else: what a plot calls it.
    pub fn stage_name(&self) -> Option<String> {
        let Some(Term::Stages(names)) = self.only() else { return None };
        let [StageName::One(name)] = names.as_slice() else { return None };
        Some(name.clone())
    }

    /// The measure is a time in nanoseconds, perhaps times or over something else.
    pub fn is_time(&self) -> bool {
        let is_time = |term: &&Term| matches!(term, Term::Stages(_) | Term::Frame);
        let [times, per] =
            [&self.terms, &self.per].map(|terms| terms.iter().filter(is_time).count());
        times == 1 && per == 0
    }

    /// It has times in it.
    pub fn reads_times(&self) -> bool {
        self.all().any(|term| matches!(term, Term::Stages(_) | Term::Frame | Term::Fps))
    }

    /// It counts only on hardware: software drivers say nothing of absolute times. A ratio of times is not absolute.
    pub fn is_absolute(&self) -> bool {
        let dimension = |term: &Term| match term {
            Term::Stages(_) | Term::Frame => 1,
            Term::Fps => -1,
            _ => 0,
        };
        let sum = |terms: &[Term]| terms.iter().map(dimension).sum::<i32>();
        sum(&self.terms) != sum(&self.per)
    }

    /// The value in a measured cell; none where the cell lacks it.
    pub fn read(&self, cell: &Cell, measured: &Measured) -> Option<Quantity> {
        let product = |terms: &[Term]| {
            let mut factors = terms.iter().map(|term| term.read(cell, measured));
            let join = |product: Quantity, factor: Option<Quantity>| {
                Some(product.with(&factor?, |a, b| a * b))
            };
            factors.try_fold(Quantity::Exact(1.0), join)
        };
        Some(product(&self.terms)?.ratio_to(&product(&self.per)?))
    }
}

impl Term {
    fn label(&self) -> Label {
        match self {
            Term::Stages(names) => match names.as_slice() {
                [family @ StageName::Family(_)] => {
                    Label::new(format!("all {family} stages"), FigureUnit::Milliseconds)
                }
                names => Label::new(
                    format!("{} time", names.iter().join(" or ")),
                    FigureUnit::Milliseconds,
                ),
            },
            Term::Frame => Label::new("frame time", FigureUnit::Milliseconds),
            Term::Fps => Label::new("frame rate", FigureUnit::FramesPerSecond),
            Term::Work(stage, name) => {
                Label::new(format!("{} of {stage}", name.replace('_', " ")), FigureUnit::One)
            }
            Term::Param(name) | Term::Axis(name) => words::parameter(name),
            Term::Quantity(name) => words::figure(name),
            Term::AllocatedBytes => Label::new("memory allocated", FigureUnit::Mebibytes),
        }
    }

    fn read(&self, cell: &Cell, measured: &Measured) -> Option<Quantity> {
        let frame = &measured.frame;
        let stage = |name: &StageName| measured.stages.iter().find(|s| name.covers(&s.stage));
        match self {
            Term::Stages(names) => stage_time(names, measured),
            Term::Frame if frame.untimed_samples_ns.is_empty() => None,
            Term::Frame => Some(Quantity::from_frames(frame, &frame.untimed_samples_ns)),
            Term::Fps => Some(Term::Frame.read(cell, measured)?.map(|ns| 1e9 / ns)),
            Term::Work(name, count) => {
                let mut counts = stage(name)?.work.fields().into_iter();
                let (_, count) = counts.find(|(known, _)| known == count)?;
                (count > 0).then_some(Quantity::Exact(count as f64))
            }
            Term::Param(path) => number(cell.params.lookup(path)?).map(Quantity::Exact),
            Term::Axis(name) => number(cell.axes.get(name)?).map(Quantity::Exact),
            Term::Quantity(name) => quantity(name, measured),
            Term::AllocatedBytes => Some(Quantity::Exact(measured.allocated_bytes as f64)),
        }
    }
}

/// A repeated quantity has a value for each repetition; any other is exact.
fn quantity(name: &str, measured: &Measured) -> Option<Quantity> {
    match measured.repeated.get(name) {
        Some(values) => Some(Quantity::from_repetitions(&measured.frame, values)),
        None => measured.figures().get(name).copied().map(Quantity::Exact),
    }
}

/// Time of the named stages, summed frame by frame; none where none of them ran, and where it is below the clock's
/// resolution.
fn stage_time(names: &[StageName], measured: &Measured) -> Option<Quantity> {
    let wanted = |stage: &&StageRecord| names.iter().any(|name| name.covers(&stage.stage));
    let stages: Vec<&StageRecord> = measured.stages.iter().filter(wanted).collect();
    let frame = &measured.frame;
    if let [stage] = stages.as_slice() {
        let resolved = !stage.samples_ns.is_empty() && stage.is_resolved();
        return resolved.then(|| Quantity::from_frames(frame, &stage.samples_ns));
    }
    let differences: Vec<Vec<f64>> = stages.iter().map(|s| s.differences_ns()).collect();
    let frames = differences.iter().map(Vec::len).min().filter(|frames| *frames > 0)?;
    let resolution_ns = stages.iter().map(|s| s.resolution_ns().powi(2)).sum::<f64>().sqrt();
    let sum = |frame: usize| differences.iter().map(|ns| ns[frame]).sum::<f64>();
    let sums: Vec<f64> = (0..frames).map(|frame| sum(frame).max(resolution_ns)).collect();
    let reading = Quantity::from_frames(frame, &sums);
    (reading.median() > resolution_ns).then_some(reading)
}

/// Frames per second of a frame time in nanoseconds.
pub fn fps(frame_ns: &Estimate) -> Estimate {
    let rate = |ns: f64| 1e9 / ns;
    let swapped = |Interval { low, high }| Interval { low: rate(high), high: rate(low) };
    Estimate {
        median: rate(frame_ns.median),
        interval: frame_ns.interval.map(swapped),
        n: frame_ns.n,
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Array(items) => items.iter().map(number).product(),
        // The label of a pair, such as `640x480`.
        Value::String(pair) => {
            pair.split('x').map(|side| Some(f64::from(side.parse::<u32>().ok()?))).product()
        }
        other => other.as_f64(),
    }
}

/// A cell fits a filter when each name is an axis, else a parameter (`scene` and `pipeline` included), of the value given.
pub fn fits(cell: &Cell, filter: &Map<String, Value>) -> bool {
    let Cell { axes, scene, pipeline, params, .. } = cell;
    fits_with(filter, axes, [scene, pipeline], |path, wanted| {
        params.lookup(path).is_some_and(|found| same(found, wanted))
    })
}

/// Whether a cell is computed in this way: each of these that is an axis of the cell or a parameter of its pipeline has the value given.
pub fn follows(cell: &Cell, method: &Map<String, Value>) -> bool {
    flatten(method).iter().all(|(name, wanted)| {
        let found = cell.axes.get(name).or_else(|| cell.params.lookup(name));
        found.is_none_or(|found| same(found, wanted))
    })
}

/// The same as [`fits`] of a cell with these axes, whose other parameters `param` tells of.
pub(super) fn fits_with(
    filter: &Map<String, Value>,
    axes: &Map<String, Value>,
    [scene, pipeline]: [&str; 2],
    param: impl Fn(&str, &Value) -> bool,
) -> bool {
    flatten(filter).iter().all(|(name, wanted)| match (axes.get(name), name.as_str()) {
        (Some(value), _) => same(value, wanted),
        (None, "scene") => wanted == scene,
        (None, "pipeline") => wanted == pipeline,
        (None, path) => param(path, wanted),
    })
}

/// Equality that does not tell 5 from 5.0.
pub fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b))
        }
        _ => a == b || (a.is_number() && a.as_f64() == b.as_f64()),
    }
}

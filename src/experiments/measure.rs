//! What a claim or a plot may ask of a measured cell, written as one string:
//!
//! | text | meaning | unit |
//! |---|---|---|
//! | `stage:caustics/trace` | median time of a stage | ns |
//! | `stage:voxel/` | median of the summed times of a family's stages | ns |
//! | `stage:ao/march\|hsao/march` | the same for those of the named ones that run | ns |
//! | `frame` | median frame time without per-stage timing | ns |
//! | `fps` | its reciprocal | frames per second |
//! | `work:caustics/trace.photons` | declared work of a stage | count |
//! | `param:caustics.grid` | a parameter; an array counts as the product of its elements | as the parameter |
//! | `axis:caustics.grid` | a number among the cell's axis values | as the axis |
//! | `quantity:caustics_error` | a recorded quantity; the median of one that was measured several times | as its name says |
//! | `allocated_bytes` | memory allocated by the pipeline | bytes |
//!
//! A stage's time that is below the clock's resolution has no value: nothing can be fitted to it or divided by it.
//!
//! A product is written with `*`, a quotient with ` per `: `param:view.width*param:view.height`,
//! `allocated_bytes per quantity:occupied_voxels`.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer};
use serde_json::Value;

use crate::record::{Cell, Estimate, Measured, StageRecord, Work};
use crate::statistics;

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

/// The value of a measure in a cell. Samples are there where the measure is a time.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredValue<'a> {
    pub estimate: Estimate,
    pub samples: Option<Cow<'a, [f64]>>,
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
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let factors = [(" × ", &self.terms), (" per ", &self.per)];
        let terms =
            factors.iter().flat_map(|(sign, terms)| terms.iter().map(move |term| (sign, term)));
        for (index, (sign, term)) in terms.enumerate() {
            if index > 0 {
                f.write_str(sign)?;
            }
            match term {
                Term::Stages(names) => match names.as_slice() {
                    [family @ StageName::Family(_)] => write!(f, "all {family} stages")?,
                    names => write!(f, "{} time", joined(names, " or "))?,
                },
                Term::Frame => f.write_str("frame time")?,
                Term::Fps => f.write_str("frames per second")?,
                Term::Work(stage, count) => write!(f, "{} of {stage}", count.replace('_', " "))?,
                Term::Param(name) | Term::Axis(name) | Term::Quantity(name) => f.write_str(name)?,
                Term::AllocatedBytes => f.write_str("allocated bytes")?,
            }
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
        self.all().filter_map(|term| match term {
            Term::Param(name) => Some(name.as_str()),
            _ => None,
        })
    }

    pub fn quantities(&self) -> impl Iterator<Item = &str> {
        self.all().filter_map(|term| match term {
            Term::Quantity(name) => Some(name.as_str()),
            _ => None,
        })
    }

    /// A stage's name, where the measure is its time and nothing else: what a legend shows.
    pub fn stage_name(&self) -> Option<String> {
        match self.only() {
            Some(Term::Stages(names)) if !matches!(names.last(), Some(StageName::Family(_))) => {
                Some(joined(names, "|"))
            }
            _ => None,
        }
    }

    /// The measure is a time in nanoseconds, perhaps times or over something else.
    pub fn is_time(&self) -> bool {
        let timed = |terms: &[Term]| {
            let times = terms.iter().filter(|term| matches!(term, Term::Stages(_) | Term::Frame));
            times.count()
        };
        timed(&self.terms) == 1 && timed(&self.per) == 0
    }

    /// It counts only on hardware: software drivers say nothing of absolute times.
    pub fn is_absolute(&self) -> bool {
        let absolute = |term: &Term| matches!(term, Term::Stages(_) | Term::Frame | Term::Fps);
        self.all().any(absolute)
    }

    /// The value in a measured cell; none where the cell lacks it.
    pub fn read<'a>(&self, cell: &Cell, measured: &'a Measured) -> Option<MeasuredValue<'a>> {
        if let Some(term) = self.only() {
            return term.read(cell, measured);
        }
        let product = |terms: &[Term]| {
            let mut factors = terms.iter().map(|term| Some(term.read(cell, measured)?.estimate));
            let one = Estimate { median: 1.0, low: 1.0, high: 1.0, n: 1 };
            factors.try_fold(one, |product, factor: Option<_>| Some(multiplied(product, factor?)))
        };
        let (over, under) = (product(&self.terms)?, product(&self.per)?);
        let estimate = Estimate {
            median: over.median / under.median,
            low: over.low / under.high,
            high: over.high / under.low,
            n: over.n.max(under.n),
        };
        Some(MeasuredValue { estimate, samples: None })
    }
}

fn joined(names: &[StageName], by: &str) -> String {
    names.iter().map(ToString::to_string).collect::<Vec<_>>().join(by)
}

/// The product of two positive figures, its interval as wide as theirs together.
fn multiplied(a: Estimate, b: Estimate) -> Estimate {
    Estimate {
        median: a.median * b.median,
        low: a.low * b.low,
        high: a.high * b.high,
        n: a.n.max(b.n),
    }
}

impl Term {
    fn read<'a>(&self, cell: &Cell, measured: &'a Measured) -> Option<MeasuredValue<'a>> {
        match self {
            Term::Stages(names) => stage_time(names, measured),
            Term::Frame => Some(MeasuredValue {
                estimate: measured.frame.untimed,
                samples: Some(Cow::Borrowed(&measured.frame.untimed_samples_ns)),
            }),
            Term::Fps => {
                Some(MeasuredValue { estimate: fps(&measured.frame.untimed), samples: None })
            }
            Term::Work(name, count) => {
                let stage = measured.stages.iter().find(|stage| name.covers(&stage.stage))?;
                let (_, count) =
                    stage.work.fields().into_iter().find(|(known, _)| known == count)?;
                (count > 0).then(|| exact(count as f64))
            }
            Term::Param(path) => number(lookup(&cell.params, path)?).map(exact),
            Term::Axis(name) => number(cell.axes.get(name)?).map(exact),
            Term::Quantity(name) => match measured.repeated.get(name) {
                Some(repeated) => Some(MeasuredValue {
                    estimate: statistics::estimate(repeated),
                    samples: Some(Cow::Borrowed(repeated)),
                }),
                None => measured.figures().get(name.as_str()).copied().map(exact),
            },
            Term::AllocatedBytes => Some(exact(measured.allocated_bytes as f64)),
        }
    }
}

/// Time of the named stages, summed frame by frame; none where none of them ran, and where it is below the clock's
/// resolution.
fn stage_time<'a>(names: &[StageName], measured: &'a Measured) -> Option<MeasuredValue<'a>> {
    let wanted = |stage: &&StageRecord| names.iter().any(|name| name.covers(&stage.stage));
    let stages: Vec<&StageRecord> = measured.stages.iter().filter(wanted).collect();
    if let [stage] = stages.as_slice() {
        return stage.is_resolved().then(|| MeasuredValue {
            estimate: stage.time,
            samples: Some(Cow::Borrowed(&stage.samples_ns)),
        });
    }
    let differences: Vec<Vec<f64>> = stages.iter().map(|s| s.differences_ns()).collect();
    let frames = differences.iter().map(Vec::len).min()?;
    let resolution_ns = stages.iter().map(|s| s.resolution_ns().powi(2)).sum::<f64>();
    let resolution_ns = resolution_ns.sqrt();
    let sum = |frame: usize| differences.iter().map(|ns| ns[frame]).sum::<f64>();
    let samples: Vec<f64> = (0..frames).map(|f| sum(f).max(resolution_ns)).collect();
    let estimate = statistics::estimate(&samples);
    (estimate.median > resolution_ns)
        .then_some(MeasuredValue { estimate, samples: Some(Cow::Owned(samples)) })
}

/// Frames per second of a frame time in nanoseconds.
pub fn fps(frame_ns: &Estimate) -> Estimate {
    Estimate {
        median: 1e9 / frame_ns.median,
        low: 1e9 / frame_ns.high,
        high: 1e9 / frame_ns.low,
        n: frame_ns.n,
    }
}

fn exact<'a>(value: f64) -> MeasuredValue<'a> {
    MeasuredValue {
        estimate: Estimate { median: value, low: value, high: value, n: 1 },
        samples: None,
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Array(items) => items.iter().map(number).product(),
        other => other.as_f64(),
    }
}

/// A leaf of a parameter tree by its dotted path.
pub fn lookup<'a>(params: &'a Value, path: &str) -> Option<&'a Value> {
    path.split('.').try_fold(params, |value, key| value.get(key))
}

/// A cell fits a filter when each name is an axis, else a parameter (`scene` and `pipeline` included), of the value given.
pub fn fits(cell: &Cell, filter: &serde_json::Map<String, Value>) -> bool {
    super::expand::flatten(filter).iter().all(|(name, wanted)| {
        let scene = Value::from(cell.scene.as_str());
        let pipeline = Value::from(cell.pipeline.as_str());
        let found = match (cell.axes.get(name), name.as_str()) {
            (Some(value), _) => Some(value),
            (None, "scene") => Some(&scene),
            (None, "pipeline") => Some(&pipeline),
            (None, _) => lookup(&cell.params, name),
        };
        found.is_some_and(|found| same(found, wanted))
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

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
//! | `quantity:caustics_error` | a recorded quantity | as its name says |
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

use crate::record::{Cell, Estimate, Measured, Outcome, StageRecord, Work};
use crate::statistics;

/// A product of terms over another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Measure {
    terms: Vec<Term>,
    per: Vec<Term>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Term {
    Stage(String),
    Frame,
    Fps,
    Work(String, String),
    Param(String),
    Axis(String),
    Quantity(String),
    AllocatedBytes,
}

/// The value of a measure in a cell. Samples are there where the measure is a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading<'a> {
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
        ("stage", _) => named(Term::Stage),
        ("param", _) => named(Term::Param),
        ("axis", _) => named(Term::Axis),
        ("quantity", _) => named(Term::Quantity),
        ("work", _) => match rest.rsplit_once('.') {
            Some((stage, count)) if WORK_COUNTS.contains(&count) => {
                Ok(Term::Work(stage.to_owned(), count.to_owned()))
            }
            _ => Err(format!(
                "`{text}` must be work:STAGE.COUNT with COUNT one of {}",
                WORK_COUNTS.join(", ")
            )),
        },
        _ => Err(format!(
            "unknown measure `{text}`; known: stage:, frame, fps, work:, param:, axis:, quantity:, allocated_bytes"
        )),
    }
}

const WORK_COUNTS: [&str; 7] = [
    "photons",
    "triangles",
    "primitives",
    "fragments",
    "texel_fetches",
    "bytes_read",
    "bytes_written",
];

fn work_count(work: &Work, count: &str) -> u64 {
    match count {
        "photons" => work.photons,
        "triangles" => work.triangles,
        "primitives" => work.primitives,
        "fragments" => work.fragments,
        "texel_fetches" => work.texel_fetches,
        "bytes_read" => work.bytes_read,
        _ => work.bytes_written,
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
                Term::Stage(name) if name.ends_with('/') => write!(f, "all {name} stages")?,
                Term::Stage(name) => write!(f, "{} time", name.replace('|', " or "))?,
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

    /// The only term, where there is no other.
    fn only(&self) -> Option<&Term> {
        match (self.terms.as_slice(), self.per.as_slice()) {
            ([term], []) => Some(term),
            _ => None,
        }
    }

    /// Names of the stages that the measure speaks of; a family's ends in `/`.
    pub fn stages(&self) -> impl Iterator<Item = &str> {
        let named = self.all().filter_map(|term| match term {
            Term::Stage(name) | Term::Work(name, _) => Some(name.as_str()),
            _ => None,
        });
        named.flat_map(|names| names.split('|'))
    }

    /// Dotted paths of the parameters that the measure speaks of.
    pub fn params(&self) -> impl Iterator<Item = &str> {
        self.all().filter_map(|term| match term {
            Term::Param(name) => Some(name.as_str()),
            _ => None,
        })
    }

    /// Names of the quantities that the measure speaks of.
    pub fn quantities(&self) -> impl Iterator<Item = &str> {
        self.all().filter_map(|term| match term {
            Term::Quantity(name) => Some(name.as_str()),
            _ => None,
        })
    }

    /// A stage's name, where the measure is its time and nothing else: what a legend shows.
    pub fn stage_name(&self) -> Option<&str> {
        match self.only() {
            Some(Term::Stage(name)) if !name.ends_with('/') => Some(name),
            _ => None,
        }
    }

    /// The measure is a time in nanoseconds, perhaps times or over something else.
    pub fn is_time(&self) -> bool {
        let timed = |terms: &[Term]| {
            let times = terms.iter().filter(|term| matches!(term, Term::Stage(_) | Term::Frame));
            times.count()
        };
        timed(&self.terms) == 1 && timed(&self.per) == 0
    }

    /// It counts only on hardware: software drivers say nothing of absolute times.
    pub fn is_absolute(&self) -> bool {
        let absolute = |term: &Term| matches!(term, Term::Stage(_) | Term::Frame | Term::Fps);
        self.all().any(absolute)
    }

    /// The value in a measured cell; none where the cell lacks it.
    pub fn read<'a>(&self, cell: &Cell, measured: &'a Measured) -> Option<Reading<'a>> {
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
        Some(Reading { estimate, samples: None })
    }
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
    fn read<'a>(&self, cell: &Cell, measured: &'a Measured) -> Option<Reading<'a>> {
        let stage = |name: &str| measured.stages.iter().find(|stage| stage.stage == name);
        match self {
            Term::Stage(names) => stage_time(names, measured),
            Term::Frame => Some(Reading {
                estimate: measured.frame.untimed,
                samples: Some(Cow::Borrowed(&measured.frame.untimed_samples_ns)),
            }),
            Term::Fps => Some(Reading { estimate: fps(&measured.frame.untimed), samples: None }),
            Term::Work(name, count) => {
                let count = work_count(&stage(name)?.work, count);
                (count > 0).then(|| exact(count as f64))
            }
            Term::Param(path) => number(lookup(&cell.params, path)?).map(exact),
            Term::Axis(name) => number(cell.axes.get(name)?).map(exact),
            Term::Quantity(name) => measured.figures().get(name.as_str()).copied().map(exact),
            Term::AllocatedBytes => Some(exact(measured.allocated_bytes as f64)),
        }
    }
}

/// Time of the stages that `names` names, summed frame by frame; none where none of them ran, and where it is below the clock's
/// resolution.
fn stage_time<'a>(names: &str, measured: &'a Measured) -> Option<Reading<'a>> {
    let stages = named(names, measured);
    if let [stage] = stages.as_slice() {
        return stage.is_resolved().then(|| Reading {
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
        .then_some(Reading { estimate, samples: Some(Cow::Owned(samples)) })
}

/// The stages of a cell that `names` names.
fn named<'a>(names: &str, measured: &'a Measured) -> Vec<&'a StageRecord> {
    let wanted = |stage: &&StageRecord| {
        let mut names = names.split('|');
        names.any(|name| match name.ends_with('/') {
            true => stage.stage.starts_with(name),
            false => stage.stage == name,
        })
    };
    measured.stages.iter().filter(wanted).collect()
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

fn exact<'a>(value: f64) -> Reading<'a> {
    Reading { estimate: Estimate { median: value, low: value, high: value, n: 1 }, samples: None }
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

/// The figures of a cell, where it was measured.
pub fn measured(cell: &Cell) -> Option<&Measured> {
    match &cell.outcome {
        Outcome::Measured(measured) => Some(measured),
        Outcome::Skipped { .. } | Outcome::Failed { .. } => None,
    }
}

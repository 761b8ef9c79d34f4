//! The exact gate: what is counted and not timed. Declared work, shader invocations, allocated bytes and errors
//! against references are equal on both sides, or the change did something.

use super::cells::CellId;
use super::store::{CheckFigure, Comparison, ConfigurationFigures, ExactFigures, Side};

/// Share of the base's error by which an error must grow to count: floating-point sums in another order move
/// errors by far less, a lower-quality setting by more.
pub const ERROR_GROWTH: f64 = 0.01;
/// Growth of an error, in its own unit (metres, shares), that is none however small the base's error is.
pub const LEAST_ERROR: f64 = 1e-6;
/// The same for a check, as a share of the check's tolerance.
pub const LEAST_OF_TOLERANCE: f64 = 0.01;

/// What a difference concerns.
#[derive(Clone, Debug, PartialEq)]
pub enum Subject {
    Cell(CellId),
    /// A stage in every configuration.
    Stage(String),
    Configuration(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Work,
    Counter,
    Bytes,
    Error,
    /// Read back, and neither good nor bad.
    Quantity,
}

/// A figure that is not the same on both sides.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    pub subject: Subject,
    pub kind: Kind,
    pub figure: String,
    pub base: f64,
    pub head: f64,
    /// A regression: more work, more bytes, a larger error.
    pub worse: bool,
}

impl Difference {
    /// It tells on this cell.
    pub fn concerns(&self, cell: &CellId) -> bool {
        match &self.subject {
            Subject::Cell(own) => own == cell,
            Subject::Stage(stage) => stage == cell.stage(),
            Subject::Configuration(id) if id == cell.configuration() => match self.kind {
                Kind::Error => concerns_stage(&self.figure, cell),
                _ => false,
            },
            Subject::Configuration(_) => false,
        }
    }
}

/// An error named `FAMILY_…` after a family of the registry's stages concerns that family alone, any other all stages.
fn concerns_stage(error: &str, cell: &CellId) -> bool {
    let family = |stage: &str| stage.split('/').next().unwrap_or_default().to_owned();
    let named = error.split('_').next().unwrap_or_default();
    let mut stages = crate::stages::REGISTRY.iter();
    let known = stages.any(|stage| family(stage.name) == named);
    !known || family(cell.stage()) == named
}

/// Every figure that differs between the sides, in the order of the lines.
pub fn judge(comparison: &Comparison) -> Vec<Difference> {
    let mut found = Vec::new();
    let cells = twins(&comparison.exact, |line| (line.side, &line.cell));
    for (base, head) in cells {
        cell(base, head, &mut found);
    }
    let configurations = twins(&comparison.configurations, |line| {
        (line.side, &line.configuration)
    });
    for (base, head) in configurations {
        configuration(base, head, &mut found);
    }
    let checks = twins(&comparison.checks, |line| {
        (line.side, (&line.stage, &line.what))
    });
    for (base, head) in checks {
        check(base, head, &mut found);
    }
    found
}

/// Lines of the base, each with the head's line of the same key; what one side lacks is left out.
fn twins<'a, T, K: PartialEq>(
    lines: &'a [T],
    key: impl Fn(&'a T) -> (Side, K),
) -> Vec<(&'a T, &'a T)> {
    let keyed: Vec<_> = lines.iter().map(|line| (key(line), line)).collect();
    let side = |wanted| keyed.iter().filter(move |((side, _), _)| *side == wanted);
    side(Side::Base)
        .filter_map(|((_, own), base)| {
            let head = side(Side::Head).find(|((_, other), _)| other == own)?;
            Some((*base, head.1))
        })
        .collect()
}

fn cell(base: &ExactFigures, head: &ExactFigures, found: &mut Vec<Difference>) {
    let mut differ = |kind, figure: &str, base_count: u64, head_count: u64| {
        if base_count != head_count {
            found.push(Difference {
                subject: Subject::Cell(base.cell.clone()),
                kind,
                figure: figure.to_owned(),
                base: base_count as f64,
                head: head_count as f64,
                worse: head_count > base_count,
            });
        }
    };
    let works = base.work.fields().into_iter().zip(head.work.fields());
    for ((name, base), (_, head)) in works {
        differ(Kind::Work, name, base, head);
    }
    for (name, count) in &base.counters {
        if let Some(head) = head.counters.get(name) {
            differ(Kind::Counter, name, *count, *head);
        }
    }
}

fn configuration(
    base: &ConfigurationFigures,
    head: &ConfigurationFigures,
    found: &mut Vec<Difference>,
) {
    let mut differ = |kind, figure: &str, base_value: f64, head_value: f64, worse| {
        found.push(Difference {
            subject: Subject::Configuration(base.configuration.clone()),
            kind,
            figure: figure.to_owned(),
            base: base_value,
            head: head_value,
            worse,
        });
    };
    if base.allocated_bytes != head.allocated_bytes {
        let (b, h) = (base.allocated_bytes, head.allocated_bytes);
        differ(Kind::Bytes, "allocated_bytes", b as f64, h as f64, h > b);
    }
    let figures = [
        (&base.errors, &head.errors),
        (&base.quantities, &head.quantities),
    ];
    for (base, head) in figures {
        for (name, b) in base {
            match head.get(name) {
                Some(h) if is_error(name) && moved(b.abs(), h.abs(), LEAST_ERROR) => {
                    differ(Kind::Error, name, *b, *h, h.abs() > b.abs());
                }
                Some(h) if !is_error(name) && moved(*b, *h, LEAST_ERROR) => {
                    differ(Kind::Quantity, name, *b, *h, false);
                }
                _ => {}
            }
        }
    }
}

/// Names of figures that are the worse the further they are from 0.
pub fn is_error(name: &str) -> bool {
    let parts = [
        "error",
        "rms",
        "bias",
        "miss_rate",
        "false_hit_rate",
        "unconverged",
    ];
    parts.iter().any(|part| name.contains(part))
}

fn check(base: &CheckFigure, head: &CheckFigure, found: &mut Vec<Difference>) {
    let broken = base.sound && !head.sound;
    let least = LEAST_OF_TOLERANCE * base.tolerance;
    if broken || moved(base.measured, head.measured, least) {
        found.push(Difference {
            subject: Subject::Stage(base.stage.clone()),
            kind: Kind::Error,
            figure: format!("{} ({})", base.what, base.unit),
            base: base.measured,
            head: head.measured,
            worse: broken || head.measured > base.measured,
        });
    }
}

/// A difference beyond what the order of floating-point sums makes. What is not a number has moved.
fn moved(base: f64, head: f64, least: f64) -> bool {
    let tolerance = (ERROR_GROWTH * base.abs()).max(least);
    let still = (head - base).abs() <= tolerance;
    !still
}

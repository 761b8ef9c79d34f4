//! The rule of evidence: figures against the bands that they must lie in.

use super::{EARLIER_LOOKS, Verdict};
use crate::measure::Quantity;
use fathom_base::statistics::{ALPHA, Interval};
use fathom_base::text::trim_zeros;
use fathom_base::visits::{MIN_SPAN_S, MIN_VISITS, Scale};

/// Figures that a reason names one by one.
const MAX_NAMED: usize = 3;
/// Visits beyond which none is asked for: the figure lies at the bound.
const MAX_VISITS: f64 = 1e3;

/// A figure without an interval is near a bound of our own within this share of the bound, and within a quarter of a band with two bounds:
/// the middle of a narrow band is near neither.
const NEAR: f64 = 0.1;

/// A figure and the band that it must lie in.
#[derive(Clone, Debug)]
pub(super) struct BoundCheck {
    pub name: String,
    pub figure: ClaimFigure,
    pub band: Interval,
}

#[derive(Clone, Debug)]
pub(super) enum ClaimFigure {
    Reading(Quantity, Scale),
    /// Fitted to exact figures: the interval holds how far they are off the fit.
    Fitted {
        value: f64,
        interval: Interval,
    },
}

impl ClaimFigure {
    fn value(&self) -> f64 {
        match self {
            ClaimFigure::Reading(reading, scale) => reading.estimate(*scale, ALPHA).median,
            ClaimFigure::Fitted { value, .. } => *value,
        }
    }

    /// None where there are too few visits.
    fn interval(&self, alpha: f64) -> Option<Interval> {
        match self {
            ClaimFigure::Reading(Quantity::Exact(value), _) => {
                Some(Interval { low: *value, high: *value })
            }
            ClaimFigure::Reading(reading, scale) => {
                let looks = if self.is_earlier() { EARLIER_LOOKS } else { 1.0 };
                reading.estimate(*scale, alpha / looks).interval
            }
            ClaimFigure::Fitted { interval, .. } => Some(*interval),
        }
    }

    /// Its record does not tell visits.
    fn is_earlier(&self) -> bool {
        let ClaimFigure::Reading(reading, scale) = self else { return false };
        reading.n().is_some() && reading.visits(*scale).is_none()
    }

    /// From its first visit to its last, seconds, where that is too short for a verdict.
    fn short_span_s(&self) -> Option<f64> {
        let ClaimFigure::Reading(reading, _) = self else { return None };
        reading.span_s().filter(|span_s| *span_s < MIN_SPAN_S && !self.is_earlier())
    }
}

impl BoundCheck {
    /// Of a time, a ratio or an error.
    pub fn new(name: impl Into<String>, reading: Quantity, band: [f64; 2]) -> Self {
        Self::on(Scale::Factors, name, reading, band)
    }

    pub fn on(
        scale: Scale,
        name: impl Into<String>,
        reading: Quantity,
        [low, high]: [f64; 2],
    ) -> Self {
        let figure = ClaimFigure::Reading(reading, scale);
        Self { name: name.into(), figure, band: Interval { low, high } }
    }

    #[must_use]
    pub fn prefixed(self, prefix: &str) -> Self {
        Self { name: format!("{prefix}{}", self.name), ..self }
    }

    /// Visits; none where the figure is exact.
    pub fn n(&self) -> Option<usize> {
        match &self.figure {
            ClaimFigure::Reading(reading, _) => reading.n(),
            ClaimFigure::Fitted { .. } => None,
        }
    }

    /// As one of so many comparisons with printed bounds or our own.
    fn verdict(&self, of: usize, has_own_bound: bool) -> Verdict {
        let inside = |i: Interval| i.low >= self.band.low && i.high <= self.band.high;
        let outside = |i: Interval| i.high < self.band.low || i.low > self.band.high;
        let [alone, widened] = [1, of].map(|of| self.figure.interval(ALPHA / of as f64));
        match alone {
            _ if self.figure.short_span_s().is_some() => Verdict::Inconclusive,
            Some(interval) if has_own_bound && self.is_near(interval) => Verdict::NearBound,
            _ if widened.is_some_and(outside) => Verdict::Contradicted,
            Some(interval) if inside(interval) => Verdict::Supported,
            Some(interval) if has_own_bound && outside(interval) && widened.is_some() => {
                Verdict::NearBound
            }
            _ => Verdict::Inconclusive,
        }
    }

    /// The interval holds a bound, or the figure has none and lies within a tenth of one.
    fn is_near(&self, Interval { low, high }: Interval) -> bool {
        let is_exact = matches!(self.figure, ClaimFigure::Reading(Quantity::Exact(_), _));
        let quarter = (self.band.high - self.band.low) / 4.0;
        let room = |bound: f64| (NEAR * bound.abs()).min(quarter) * (1.0 + 1e-9);
        let near = |bound: f64| {
            // No rate lies below 0, which is no bound.
            let is_close = bound != 0.0 && (low - bound).abs() <= room(bound);
            if is_exact { is_close } else { low < bound && bound < high }
        };
        [self.band.low, self.band.high].into_iter().any(|bound| bound.is_finite() && near(bound))
    }

    /// As one of so many comparisons: with the interval that gave the verdict.
    fn ruled(&self, verdict: Verdict, of: usize) -> RuledFigure {
        let of = if verdict == Verdict::Contradicted { of } else { 1 };
        RuledFigure {
            verdict,
            name: self.name.clone(),
            value: self.figure.value(),
            interval: self.figure.interval(ALPHA / of as f64),
            band: self.band,
            n: self.n(),
        }
    }

    /// `slope 1.020 (0.990 – 1.050), n = 6 against 0.900 – 1.100`
    fn text(&self, verdict: Verdict, of: usize) -> String {
        let ruled = self.ruled(verdict, of);
        let n = ruled.n.map_or_else(String::new, |n| format!(", n = {n}"));
        format!("{} {}{n} against {}", self.name, ruled.text(), ruled.limits())
    }

    /// How far the figure lies inside its band; negative outside.
    fn inside(&self) -> f64 {
        let value = self.figure.value();
        (value - self.band.low).min(self.band.high - value)
    }

    /// From the figure to the end of its interval beyond the nearest bound.
    fn reach(&self, interval: Interval) -> f64 {
        let (value, Interval { low, high }) = (self.figure.value(), self.band);
        let near_low = value - low < high - value;
        if near_low == (self.inside() >= 0.0) {
            value - interval.low
        } else {
            interval.high - value
        }
    }

    /// What would settle it, as one of so many comparisons. What lies outside its band is contradicted by the interval that is
    /// widened for their number.
    fn settled_by(&self, of: usize) -> String {
        let Some(n) = self.n() else {
            let is_exact = matches!(self.figure, ClaimFigure::Reading(..));
            let why =
                if is_exact { "within a tenth of" } else { "its spread over the cells straddles" };
            return format!("{why} the bound");
        };
        let of = if self.inside() < 0.0 { of } else { 1 };
        let interval = self.figure.interval(ALPHA / of as f64);
        if interval.is_none() && self.figure.is_earlier() {
            return "more samples are needed".to_owned();
        }
        if n < MIN_VISITS {
            return format!("{MIN_VISITS} visits are needed");
        }
        if let Some(span_s) = self.figure.short_span_s() {
            return format!(
                "its visits lie within {span_s:.0} s, and a verdict takes {MIN_SPAN_S} s"
            );
        }
        // The interval shrinks with the root of n, until its end reaches the bound.
        let reach = interval.map_or(f64::NAN, |i| self.reach(i));
        let needed = n as f64 * (reach / self.inside()).powi(2);
        let unit = if self.figure.is_earlier() { "samples" } else { "visits" };
        if needed.is_finite() && needed <= MAX_VISITS {
            let widened =
                if of > 1 { format!(", widened for {of} comparisons,") } else { String::new() };
            format!(
                "the interval{widened} straddles the bound; about {needed:.0} {unit} would settle it"
            )
        } else {
            "the figure lies at the bound".to_owned()
        }
    }
}

/// A figure that decided a claim's verdict, and the band that it must lie in.
#[derive(Clone, Debug, PartialEq)]
pub struct RuledFigure {
    /// On this comparison alone.
    pub verdict: Verdict,
    /// What it is of, such as `lists / peel`.
    pub name: String,
    pub value: f64,
    /// Of 95 %; of a contradicted claim it is widened for the number of its comparisons. None of too few visits; without width where the
    /// figure is exact.
    pub interval: Option<Interval>,
    /// Infinite where one side is free.
    pub band: Interval,
    /// Visits; none where the figure is exact.
    pub n: Option<usize>,
}

/// In place of a figure of two cells that were never visited together.
pub const NO_VISIT: &str = "no visit has both cells";

impl RuledFigure {
    /// How many times the value lies beyond the nearest bound: more than 1 outside the band; infinite where a ratio to the bound
    /// says nothing.
    pub fn excess(&self) -> f64 {
        let Interval { low, high } = self.band;
        let bound = if self.value > high { high } else { low };
        if (low..=high).contains(&self.value) {
            return 0.0;
        }
        let factor = self.value / bound;
        if factor > 0.0 { factor.max(1.0 / factor) } else { f64::INFINITY }
    }

    /// `1.383 (1.301 – 1.462)`.
    pub fn text(&self) -> String {
        if self.value.is_nan() || self.n == Some(0) {
            return NO_VISIT.to_owned();
        }
        let value = number(self.value);
        match self.interval.map(|i| [i.low, i.high]) {
            Some(ends) if ends[0] < ends[1] || self.n.is_some() => {
                format!("{value} ({})", ends.map(number).join(" – "))
            }
            _ => value,
        }
    }

    /// The band: `0.9 – 1.1`, `at most 1`; of a figure that is not negative also where it begins at 0.
    pub fn limits(&self) -> String {
        let Interval { low, high } = self.band;
        let bound = |bound: f64| trim_zeros(&number(bound)).to_owned();
        let is_signed = self.interval.map_or(self.value, |interval| interval.low) < 0.0;
        match (low.is_finite() && (low != 0.0 || is_signed), high.is_finite()) {
            (true, true) => format!("{} – {}", bound(low), bound(high)),
            (true, false) => format!("at least {}", bound(low)),
            (false, true) => format!("at most {}", bound(high)),
            (false, false) if low.is_finite() => format!("at least {}", bound(low)),
            (false, false) => "anything".to_owned(),
        }
    }
}

/// What became of a claim's comparisons.
pub(super) struct Judgement {
    pub verdict: Verdict,
    pub reason: String,
    /// The figures that decided, the furthest outside or nearest to its bound first.
    pub deciding: Vec<RuledFigure>,
    /// The other comparisons, in their order.
    pub others: Vec<RuledFigure>,
}

/// The verdict on all comparisons of a claim, and the figures that decided; none where there is nothing to compare.
pub(super) fn judge(comparisons: &[BoundCheck], has_own_bound: bool) -> Option<Judgement> {
    let of = comparisons.len();
    let verdicts = comparisons.iter().map(|comparison| comparison.verdict(of, has_own_bound));
    let verdict = verdicts.clone().min()?;
    let (deciding, others): (Vec<_>, Vec<_>) =
        comparisons.iter().zip(verdicts).partition(|(_, v)| *v == verdict);
    let mut deciding: Vec<&BoundCheck> = deciding.into_iter().map(|(c, _)| c).collect();
    deciding.sort_by(|a, b| a.inside().total_cmp(&b.inside()));
    let named = if verdict == Verdict::Contradicted { MAX_NAMED } else { 1 };
    let told = deciding.iter().take(named).map(|comparison| {
        let told = comparison.text(verdict, comparisons.len());
        match verdict {
            Verdict::NearBound | Verdict::Inconclusive => {
                format!("{told}: {}", comparison.settled_by(comparisons.len()))
            }
            _ => told,
        }
    });
    let told = told.collect::<Vec<_>>().join("; ");
    let count = match (comparisons.len(), deciding.len(), verdict) {
        (1, ..) => String::new(),
        (all, _, Verdict::Supported) => format!(" (the nearest to its bound of {all})"),
        (all, some, _) => format!(" ({some} of {all} comparisons)"),
    };
    let reason = told + &count;
    let deciding = deciding.into_iter().map(|c| c.ruled(verdict, comparisons.len())).collect();
    let others = others.into_iter().map(|(c, verdict)| c.ruled(verdict, comparisons.len()));
    Some(Judgement { verdict, reason, deciding, others: others.collect() })
}

/// Three decimals, or three digits of what is small: without an exponent from 0.001 on.
fn number(value: f64) -> String {
    match value.abs() {
        size if size >= 100.0 => format!("{value:.1}"),
        size if size >= 0.1 || size == 0.0 => format!("{value:.3}"),
        size if size >= 0.001 => format!("{value:.*}", if size >= 0.01 { 4 } else { 5 }),
        _ => format!("{value:.3e}"),
    }
}

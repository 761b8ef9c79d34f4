//! Numbers as text.

pub use fathom_base::text::trim_zeros;
use fathom_record::{Estimate, Interval, StageRecord};

pub const NS_PER_MS: f64 = 1e6;

/// Three significant digits, without an exponent in the range of frame times.
pub fn three(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    match value.abs() {
        0.0 => "0".to_owned(),
        size if size >= 1e7 => format!("{value:.2e}"),
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        size if size >= 1.0 => format!("{value:.2}"),
        size if size >= 0.1 => format!("{value:.3}"),
        size if size >= 0.01 => format!("{value:.4}"),
        size if size >= 0.001 => format!("{value:.5}"),
        _ => format!("{value:.2e}"),
    }
}

/// A duration in milliseconds with its interval, `12.3 (12.1 – 12.6)`; where there is none with its visits: `12.3 (n = 2)`.
pub fn ms(ns: &Estimate) -> String {
    let in_ms = ns.scaled(1.0 / NS_PER_MS);
    match ns.interval {
        Some(_) => interval(&in_ms),
        None if ns.n == 0 => "–".to_owned(),
        None => format!("{} (n = {})", three(in_ms.median), ns.n),
    }
}

/// A figure with its interval: `1.38 (1.30 – 1.46)`.
pub fn interval(figure: &Estimate) -> String {
    match figure.interval {
        Some(Interval { low, high }) => {
            format!("{} ({} – {})", three(figure.median), three(low), three(high))
        }
        None => three(figure.median),
    }
}

/// A stage's time in milliseconds with its interval; `< 0.0500` where it is below what the clock can tell from none.
pub fn stage_ms(stage: &StageRecord) -> String {
    if stage.is_resolved() {
        ms(&stage.time)
    } else {
        format!("< {}", three(stage.resolution_ns() / NS_PER_MS))
    }
}

/// `1.2 M`, `340 k`: three significant digits with a decimal prefix.
pub fn si(value: f64) -> String {
    let (scaled, prefix) = match value.abs() {
        size if size >= 1e9 => (value / 1e9, " G"),
        size if size >= 1e6 => (value / 1e6, " M"),
        size if size >= 1e3 => (value / 1e3, " k"),
        _ => (value, ""),
    };
    format!("{}{prefix}", trim_zeros(&three(scaled)))
}

/// `1 cell`, `3 cells`.
pub fn count_noun(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

pub fn mebibytes(bytes: u64) -> String {
    format!("{} MiB", three(bytes as f64 / (1 << 20) as f64))
}

pub fn percent(share: f64) -> String {
    format!("{} %", three(share * 100.0))
}

#[cfg(test)]
mod tests {
    #[test]
    fn shares_are_told_in_percent() {
        assert_eq!([0.125, 1.0, 0.0].map(super::percent), ["12.5 %", "100 %", "0 %"]);
    }
}

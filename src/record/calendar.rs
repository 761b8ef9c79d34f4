//! Moments as text, in UTC.

use std::time::Duration;

use jiff::{SignedDuration, Timestamp, tz::TimeZone};

/// This moment by RFC 3339 to the second, such as `2025-03-01T09:05:00Z`.
pub fn now() -> String {
    Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string()
}

/// This moment for file names: `20250301-090500`. Sorts as time does.
pub fn compact_now() -> String {
    Timestamp::now().to_zoned(TimeZone::UTC).strftime("%Y%m%d-%H%M%S").to_string()
}

/// A time such as `90s`, `1h30m` or `300`, which is seconds.
pub fn duration(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().map(Duration::try_from_secs_f64);
    let time = match seconds {
        Ok(time) => time.ok(),
        Err(_) => text.parse::<SignedDuration>().ok().and_then(|time| time.try_into().ok()),
    };
    time.filter(|time| !time.is_zero())
        .ok_or_else(|| "a time above 0 is needed, such as 90s, 5m, 1h30m or 300".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_times_above_nothing() {
        let seconds = |text: &str| duration(text).map(|time| time.as_secs_f64());
        for (text, expected) in [
            ("90s", 90.0),
            ("5m", 300.0),
            ("1h30m", 5_400.0),
            ("300", 300.0),
            ("0.5", 0.5),
            ("1.5s", 1.5),
        ] {
            assert_eq!(seconds(text), Ok(expected), "{text}");
        }
        let bad = "0 0s -5 -5s m 1e400 inf NaN 5m- 1y 99999999999999999999h".split(' ');
        for text in bad.chain(["", "5 parsecs"]) {
            assert!(seconds(text).is_err_and(|told| told.contains("such as 90s")), "{text}");
        }
    }
}

//! Moments as text, in UTC.

use std::time::{SystemTime, UNIX_EPOCH};

const SECONDS_PER_DAY: u64 = 86_400;

/// Year, month, day, hour, minute, second.
fn fields(moment: SystemTime) -> [u64; 6] {
    let seconds = moment.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (days, second) = (seconds / SECONDS_PER_DAY, seconds % SECONDS_PER_DAY);
    let [year, month, day] = civil(days);
    [year, month, day, second / 3600, second / 60 % 60, second % 60]
}

/// The Gregorian date so many days after 1970-01-01: `civil_from_days` of Howard Hinnant, *chrono-Compatible
/// Low-Level Date Algorithms* (2013), for days that are not negative. Its years begin in March.
fn civil(days: u64) -> [u64; 3] {
    let days = days + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    [year_of_era + 400 * era + u64::from(month <= 2), month, day]
}

/// RFC 3339 to the second, such as `2025-03-01T09:05:00Z`.
pub fn rfc3339(moment: SystemTime) -> String {
    let [year, month, day, hour, minute, second] = fields(moment);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// For file names: `20250301-090500`. Sorts as time does.
pub fn compact(moment: SystemTime) -> String {
    let [year, month, day, hour, minute, second] = fields(moment);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn known_moments() {
        let at = |seconds| UNIX_EPOCH + Duration::from_secs(seconds);
        assert_eq!(rfc3339(UNIX_EPOCH), "1970-01-01T00:00:00Z");
        assert_eq!(rfc3339(at(951_782_399)), "2000-02-28T23:59:59Z");
        assert_eq!(rfc3339(at(951_782_400)), "2000-02-29T00:00:00Z");
        assert_eq!(rfc3339(at(1_234_567_890)), "2009-02-13T23:31:30Z");
        assert_eq!(rfc3339(at(4_107_542_400)), "2100-03-01T00:00:00Z");
        assert_eq!(compact(at(1_234_567_890)), "20090213-233130");
    }
}

//! Moments as text, in UTC.

use jiff::{Timestamp, tz::TimeZone};

/// RFC 3339 to the second, such as `2025-03-01T09:05:00Z`.
pub fn rfc3339(moment: Timestamp) -> String {
    moment.strftime("%Y-%m-%dT%H:%M:%SZ").to_string()
}

/// This moment, as [`rfc3339`] has it.
pub fn now() -> String {
    rfc3339(Timestamp::now())
}

/// For file names: `20250301-090500`. Sorts as time does.
pub fn compact(moment: Timestamp) -> String {
    moment.to_zoned(TimeZone::UTC).strftime("%Y%m%d-%H%M%S").to_string()
}

#[test]
fn known_moments() {
    let at = |seconds| Timestamp::from_second(seconds).unwrap();
    assert_eq!(rfc3339(at(951_782_400)), "2000-02-29T00:00:00Z");
    assert_eq!(rfc3339(at(4_107_542_400)), "2100-03-01T00:00:00Z");
    assert_eq!(compact(at(1_234_567_890)), "20090213-233130");
}

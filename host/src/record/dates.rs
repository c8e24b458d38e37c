//! Points in time as texts: `2026-11-23T12:00:00.125Z`, `2026-11-23 12:00:00,125`, `12:00:00.125`,
//! `23.11.2026 12:00:00.125`, `11/23/2026 12:00:00.125 PM`.

use jiff::Timestamp;
use jiff::civil::{Date, DateTime, Time};
use jiff::tz::TimeZone;

/// Nanoseconds since 1970 of a point in time (without a time zone: as if in UTC; without a date: of
/// that day); none for another text.
///
/// A clock that was put forward or back, as in spring and autumn, leaps here as it did there.
pub(super) fn nanoseconds(text: &str) -> Option<i64> {
    // Numbers are most of what comes here by mistake; a date has at least two separators within.
    if text.len() < 6 || !text.bytes().any(|b| b == b':' || b == b'-' || b == b'.') {
        return None;
    }
    let point = text.replace(',', ".");
    let point = point.as_str();
    if let Ok(t) = point.parse::<Timestamp>() {
        return i64::try_from(t.as_nanosecond()).ok();
    }
    let civil = point.parse::<DateTime>().ok().or_else(|| german(point)).or_else(|| slashed(point));
    let civil = civil.or_else(|| {
        let time: Time = point.parse().ok().filter(|_| point.contains(':'))?;
        Some(DateTime::from_parts(Date::constant(1970, 1, 1), time))
    })?;
    i64::try_from(civil.to_zoned(TimeZone::UTC).ok()?.timestamp().as_nanosecond()).ok()
}

/// Day, month, year: `23.11.2026 12:00:00.125`.
fn german(text: &str) -> Option<DateTime> {
    let (date, time) = text.split_once(' ')?;
    let mut parts = date.split('.').map(str::parse::<i16>);
    let (day, month, year) = (parts.next()?.ok()?, parts.next()?.ok()?, parts.next()?.ok()?);
    let date = Date::new(year, i8::try_from(month).ok()?, i8::try_from(day).ok()?).ok()?;
    Some(DateTime::from_parts(date, time.parse().ok()?))
}

/// Month, day, year, as instruments in their American setting write it; day first where no month
/// has that number, and year first.
fn slashed(text: &str) -> Option<DateTime> {
    let (date, time) = text.split_once(' ')?;
    let mut parts = date.split('/').map(str::parse::<i16>);
    let all = [parts.next()?.ok()?, parts.next()?.ok()?, parts.next()?.ok()?];
    let [year, month, day] = match all {
        [year, month, day] if year > 31 => [year, month, day],
        [day, month, year] if day > 12 => [year, month, day],
        [month, day, year] => [year, month, day],
    };
    let date = Date::new(year, i8::try_from(month).ok()?, i8::try_from(day).ok()?).ok()?;
    parts.next().is_none().then_some(DateTime::from_parts(date, clock(time.trim())?))
}

/// A time of day, of 24 hours or of twice twelve; an hour may have one digit.
fn clock(text: &str) -> Option<Time> {
    let (text, half) = match text.rsplit_once(' ') {
        Some((text, half)) if half.eq_ignore_ascii_case("am") => (text.trim_end(), Some(0)),
        Some((text, half)) if half.eq_ignore_ascii_case("pm") => (text.trim_end(), Some(12)),
        _ => (text, None),
    };
    let padded = if text.find(':') == Some(1) { format!("0{text}") } else { text.to_owned() };
    let time: Time = padded.parse().ok()?;
    let Some(half) = half else { return Some(time) };
    // 12:30 AM is half an hour behind midnight.
    Time::new(time.hour() % 12 + half, time.minute(), time.second(), time.subsec_nanosecond()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_read_in_their_spellings() {
        let noon = 1_000_000_000 * 1_795_435_200;
        for text in [
            "2026-11-23T12:00:00Z",
            "2026-11-23 12:00:00",
            "2026-11-23T13:00:00+01:00",
            "2026-11-23 12:00:00,000",
            "23.11.2026 12:00:00",
            "11/23/2026  12:00:00.000000",
            "23/11/2026 12:00:00",
            "2026/11/23 12:00:00",
            "11/23/2026 12:00:00 PM",
        ] {
            assert_eq!(nanoseconds(text), Some(noon), "{text}");
        }
        assert_eq!(nanoseconds("2026-11-23 12:00:00.002"), Some(noon + 2_000_000));
        assert_eq!(nanoseconds("11/23/2026 1:00:00.5 pm"), Some(noon + 3_600_500_000_000));
        assert_eq!(nanoseconds("11/24/2026 12:00:00 AM"), Some(noon + 43_200_000_000_000));
        assert_eq!(nanoseconds("00:00:01,5"), Some(1_500_000_000));
        for text in ["noon", "12", "0.002", "2026-13-01 00:00:00", "1.5.2", "1/2", "1/2/2026", ""] {
            assert_eq!(nanoseconds(text), None, "{text}");
        }
    }
}

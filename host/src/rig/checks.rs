//! What a rig file's keys may be.

use std::path::Path;

use serde::de::DeserializeOwned;

use super::{Channel, Drive, MOST_A_PERIOD, QUANTITIES, RATES, RigFile, UNITS};
use crate::error::{BadInput, Result};
use crate::record::names::{self, NamedUnit, TimeChoice, per_second, time_units};
use crate::wording::format::rounded;
use crate::wording::toml_words;

/// Greatest gain and offset of a channel: instruments count in millionths or thousands.
const SCALES: core::ops::RangeInclusive<f64> = 1e-15..=1e15;

fn bad<T>(path: &Path, place: &str, found: String, expected: &str) -> Result<T> {
    Err(BadInput::new(found, expected).in_file(path).at(place).remedy("Correct the rig file"))
}

/// The keys of a rig file, none of them looked at yet.
pub(super) fn table(text: &str, path: &Path) -> Result<RigFile> {
    typed(text, path, ["a rig file", "docs/rig-file.md"])
}

/// A file of known keys; `what` it is, and the page that lists them.
///
/// # Errors
/// Names the file, the place, what was found and what was expected.
pub(crate) fn typed<T: DeserializeOwned>(text: &str, path: &Path, what: [&str; 2]) -> Result<T> {
    toml::from_str(text).map_err(|e| toml_words::told(&e, text, what[0], what[1]).in_file(path))
}

/// The error for a rig file without a rate where nothing says it.
pub(super) fn no_rate(path: &Path) -> BadInput {
    BadInput::new("no sample_rate_hz", "the sampling rate in Hz").in_file(path).at("sample_rate_hz").remedy(
        "Add it, such as sample_rate_hz = 500.0: only commands that read a record can take it from the record's time",
    )
}

/// The sampling rate.
pub(super) fn rate(rate: f64, path: &Path) -> Result<()> {
    if RATES.contains(&rate) {
        return Ok(());
    }
    bad(path, "sample_rate_hz", rate.to_string(), "a rate in Hz above 0 (1e-6 to 1e7)")
}

/// The column of the time and its unit.
pub(super) fn time(time: &TimeChoice, path: &Path) -> Result<()> {
    if time.column.as_ref().is_some_and(|c| c.is_empty() || c.chars().any(char::is_control)) {
        return bad(path, "time", "an empty name or a control character".to_owned(), "the name of the time's column");
    }
    match &time.unit {
        Some(unit) if per_second(unit).is_none() => {
            bad(path, "time_unit", format!("\"{unit}\""), &format!("one of {}", time_units()))
        }
        _ => Ok(()),
    }
}

/// The drive beside the sampling rate.
pub(super) fn drive(drive: &Drive, sample_rate_hz: f64, path: &Path) -> Result<()> {
    let f = drive.frequency_hz;
    if !RATES.contains(&f) {
        return bad(
            path,
            "drive.frequency_hz",
            f.to_string(),
            "a frequency in Hz above 0, 1e-6 to 1e7 (leave [drive] out for a free system)",
        );
    }
    if f < sample_rate_hz / MOST_A_PERIOD {
        let expected = format!("at least a millionth of the sampling rate, {} Hz", sample_rate_hz / MOST_A_PERIOD);
        return bad(path, "drive.frequency_hz", f.to_string(), &expected);
    }
    if f > sample_rate_hz / 10.0 {
        let expected = format!("at most a tenth of the sampling rate, {} Hz", sample_rate_hz / 10.0);
        return bad(path, "drive.frequency_hz", f.to_string(), &expected);
    }
    if let Some(a) = drive.amplitude_m
        && a != 0.0
        && !QUANTITIES.contains(&a)
    {
        let expected = "an amplitude in metres, 0 or more (1e-30 to 1e30)";
        return bad(path, "drive.amplitude_m", a.to_string(), expected);
    }
    Ok(())
}

/// The channels, each by itself and beside the others.
pub(super) fn channels(channels: &[Channel], path: &Path) -> Result<()> {
    if channels.is_empty() {
        return bad(path, "channel", "no [[channel]]".to_owned(), "one [[channel]] for each measured column");
    }
    for (i, c) in channels.iter().enumerate() {
        let place = |key: &str| format!("channel {} (\"{}\"), {key}", i + 1, c.name);
        if c.name.is_empty() {
            return bad(path, &place("name"), "an empty name".to_owned(), "the column's name");
        }
        if c.name.chars().any(char::is_control) {
            return bad(path, &place("name"), "a control character".to_owned(), "the column's name, on one line");
        }
        if channels[..i].iter().any(|o| o.name == c.name) {
            return bad(path, &place("name"), format!("\"{}\" a second time", c.name), "a column named once");
        }
        if channels[..i].iter().any(|o| o.measures == c.measures) {
            let found = format!("\"{}\" a second time", c.measures);
            return bad(path, &place("measures"), found, "a quantity measured once");
        }
        if !UNITS.contains(&c.unit.as_str()) {
            let expected = format!("one of {}", UNITS.join(", "));
            let Some(NamedUnit { unit: Some(unit), factor }) = names::unit(&c.unit) else {
                return bad(path, &place("unit"), format!("\"{}\"", c.unit), &expected);
            };
            let scaled = |x: f64| rounded(factor * x, 10);
            let offset = c.offset.map_or_else(String::new, |x| format!(", offset = {}", scaled(x)));
            return Err(BadInput::new(format!("\"{}\"", c.unit), expected)
                .in_file(path)
                .at(place("unit"))
                .remedy(format!("Write unit = \"{unit}\", gain = {}{offset}", scaled(c.gain.unwrap_or(1.0)))));
        }
        counts(c, path, &place)?;
        scale(c, path, &place)?;
    }
    super::computed::sources(channels, path).map(drop)
}

fn counts(c: &Channel, path: &Path, place: &dyn Fn(&str) -> String) -> Result<()> {
    let place = place("counts_per_turn");
    match (c.unit.as_str(), c.counts_per_turn) {
        ("count", None) => bad(path, &place, "nothing".to_owned(), "the encoder's counts a turn (unit is \"count\")"),
        (_, Some(0)) => bad(path, &place, "0".to_owned(), "the encoder's counts a turn, 1 or more"),
        (unit, Some(n)) if unit != "count" => {
            bad(path, &place, n.to_string(), &format!("no such key with unit \"{unit}\""))
        }
        _ => Ok(()),
    }
}

fn scale(c: &Channel, path: &Path, place: &dyn Fn(&str) -> String) -> Result<()> {
    let count = c.unit == "count";
    if let Some(gain) = c.gain
        && !(SCALES.contains(&gain.abs()) && (!count || gain.abs() == 1.0))
    {
        let expected = if count {
            "1, or -1 for an encoder that counts the other way (a gear belongs into counts_per_turn)"
        } else {
            "a number other than 0 (1e-15 to 1e15 in size)"
        };
        return bad(path, &place("gain"), gain.to_string(), expected);
    }
    if let Some(offset) = c.offset
        && !(offset.abs() <= *SCALES.end() && (!count || (offset.fract() == 0.0 && offset.abs() < 2e9)))
    {
        let expected = if count { "a whole number of counts" } else { "a number in the channel's unit" };
        return bad(path, &place("offset"), offset.to_string(), expected);
    }
    if let Some(at) = c.index_at
        && !c.counts_per_turn.is_some_and(|turn| at.abs() <= f64::from(turn))
    {
        let expected = if count { "counts, at most a turn" } else { "no such key: a channel of unit \"count\" has it" };
        return bad(path, &place("index_at"), at.to_string(), expected);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::record::Column;
    use crate::rig::Rig;

    fn rig(unit: &str, more: &str) -> crate::error::Result<Rig> {
        let text = format!(
            "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"q\"\nmeasures = \"q\"\nunit = \"{unit}\"\n{more}"
        );
        Rig::parse(&text, Path::new("rig.toml"))
    }

    #[test]
    fn gain_and_offset_are_applied() {
        let volts = rig("deg", "gain = 36.0\noffset = -180.0\n").unwrap();
        let mut column = Column::Values(vec![0.0, 5.0, f64::NAN]);
        volts.channel[0].apply(&mut column).unwrap();
        let Column::Values(v) = column else { unreachable!() };
        assert!(v[0] == -180.0 && v[1] == 0.0 && v[2].is_nan());
        let back = rig("count", "counts_per_turn = 4096\ngain = -1\noffset = 10.0\n").unwrap();
        let mut column = Column::Counts(vec![0, -1, 7]);
        back.channel[0].apply(&mut column).unwrap();
        // [7, 8) turned about is (−8, −7].
        assert_eq!(column, Column::Counts(vec![9, 10, 2]));
        assert_eq!(back.channel[0].apply(&mut Column::Counts(vec![1, i32::MIN])), Err(1));
    }

    #[test]
    fn gains_that_make_no_sense_are_refused() {
        for (unit, more, part) in [
            ("deg", "gain = 0.0\n", "gain: found 0, expected a number other than 0"),
            ("deg", "gain = nan\n", "gain"),
            ("deg", "offset = inf\n", "offset"),
            ("count", "counts_per_turn = 9\ngain = 0.5\n", "a gear belongs into counts_per_turn"),
            ("count", "counts_per_turn = 9\noffset = 0.5\n", "a whole number of counts"),
            ("count", "counts_per_turn = 9\nindex_at = 9.5\n", "counts, at most a turn"),
            ("count", "counts_per_turn = 9\nindex_at = nan\n", "counts, at most a turn"),
            ("deg", "index_at = 1.0\n", "no such key"),
        ] {
            let message = rig(unit, more).unwrap_err().to_string();
            assert!(message.contains(part), "{more}: {message}");
        }
    }

    #[test]
    fn a_unit_that_is_a_multiple_of_another_is_written_with_a_gain() {
        let message = rig("cm", "gain = 2.0\noffset = 5.0\n").unwrap_err().to_string();
        assert!(message.contains("Write unit = \"m\", gain = 0.02, offset = 0.05"), "{message}");
        let message = rig("furlong", "").unwrap_err().to_string();
        assert!(message.contains("Correct the rig file"), "{message}");
    }

    #[test]
    fn a_rig_file_without_a_rate_says_what_to_add() {
        let text = "name = \"x\"\nmodel = \"other\"\n[[channel]]\nname = \"q\"\nmeasures = \"q\"\nunit = \"m\"\n";
        let message = Rig::parse(text, Path::new("rig.toml")).unwrap_err().to_string();
        assert!(message.contains("sample_rate_hz: found no sample_rate_hz"), "{message}");
        let text = text.replace("model", "time_unit = \"days\"\nmodel");
        let message = Rig::parse(&text, Path::new("rig.toml")).unwrap_err().to_string();
        assert!(message.contains("time_unit: found \"days\", expected one of s, ms, us"), "{message}");
    }

    #[test]
    fn what_the_reader_of_toml_met_has_a_remedy() {
        let head = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n";
        let channel = "[channel]\nname = \"q\"\nmeasures = \"q\"\nunit = \"m\"\n";
        for (text, remedy) in [
            (format!("{head}{channel}"), "Write [[channel]] with two brackets"),
            (format!("{head}{channel}{channel}"), "Write [[channel]] with two brackets"),
            (head.replace("other\"", "other"), "Close the quote"),
            (format!("{head}colour = 1\n"), "the keys of a rig file are listed"),
            (format!("{head}drvie = 1\n"), "found the key \"drvie\", expected one of name, "),
            (format!("{head}drvie = 1\n"), "Did you mean drive?"),
            (
                format!("{head}[{channel}").replace("[channel]", "[channel]]").replace("unit = \"m\"\n", ""),
                "Add unit, such as",
            ),
            (
                format!("{head}[drive]\nfrequency_hz = 5.0\ndirection = \"sideways\"\n"),
                "found \"sideways\", expected \"vertical\" or \"horizontal\"",
            ),
            (
                format!("{head}[{channel}counts_per_turn = \"4096\"\n").replace("[channel]", "[channel]]"),
                "the text \"4096\", expected a whole number",
            ),
        ] {
            let told = Rig::parse(&text, Path::new("rig.toml")).unwrap_err().to_string();
            assert!(told.contains(remedy), "{told}");
        }
    }
}

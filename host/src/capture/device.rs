//! What a device says of itself: whether it fits this program and rig, and what it told people.

use whirl_shared::frame::{Hello, PROTOCOL_VERSION, SCHEMA_HASH};

use crate::error::{BadInput, Result, plain};
use crate::record::DeviceLine;
use crate::rig::Rig;
use crate::warning::Warning;

/// Greatest relative difference of the device's sampling rate from the rig file's.
const RATE_TOLERANCE: f64 = 1e-4;

/// A level of the device's lines, in words.
pub(super) fn level(level: u8) -> &'static str {
    match level {
        0 => "error",
        1 => "warning",
        _ => "information",
    }
}

/// Checks that this program and this rig file fit the device.
pub(super) fn check_hello(hello: &Hello, rig: &Rig) -> Result<()> {
    let firmware = format!("firmware {} on {}", hello.firmware, hello.board);
    if hello.protocol != PROTOCOL_VERSION || hello.schema != SCHEMA_HASH {
        return Err(BadInput::new(
            format!("protocol {}, schema {:08x} ({firmware})", hello.protocol, hello.schema),
            format!("protocol {PROTOCOL_VERSION}, schema {SCHEMA_HASH:08x} (whirl {})", env!("CARGO_PKG_VERSION")),
        )
        .at("the device's hello")
        .remedy("Flash the firmware that belongs to this whirl: `whirl flash`"));
    }
    for (i, (c, &n)) in rig.channel.iter().zip(&hello.counts_per_turn).enumerate() {
        if c.counts_per_turn != Some(n) {
            return Err(BadInput::new(
                format!("counts_per_turn = {}", c.counts_per_turn.map_or("none".to_owned(), |n| n.to_string())),
                format!("{n} as the device says of encoder {} ({firmware})", i + 1),
            )
            .in_file(&rig.path)
            .at(format!("channel \"{}\"", c.name))
            .remedy("Correct the rig file (unit = \"count\"), or set the firmware's counts a turn"));
        }
    }
    let rate = f64::from(hello.sample_rate_millihertz) / 1000.0;
    if (rate / rig.sample_rate_hz - 1.0).abs() > RATE_TOLERANCE || rate <= 0.0 {
        return Err(BadInput::new(
            format!("sample_rate_hz = {}", rig.sample_rate_hz),
            format!("{rate} as the device says ({firmware})"),
        )
        .in_file(&rig.path)
        .at("sample_rate_hz")
        .remedy("Correct the rig file"));
    }
    Ok(())
}

/// Lines of a device: those that are kept, and how many there were.
pub(super) struct Said<'a> {
    pub(super) lines: &'a [DeviceLine],
    pub(super) all: u64,
}

/// What is to be told of its restarts (`behind`: tick of the record at the first) and of its lines.
pub(super) fn warnings(behind: Option<i64>, restarts: u64, said: &Said<'_>) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if let Some(tick) = behind {
        let times = if restarts <= 1 { "once".to_owned() } else { format!("{restarts} times") };
        warnings.push(
            Warning::new(
                "device-restarted",
                format!("the device has restarted {times}, first behind tick {tick} of the record: its counts and ticks began anew"),
                "A new segment begins there, whose encoder zeros are unknown; look after the device's power supply and its log",
            )
            .with("tick", tick)
            .with("restarts", restarts),
        );
    }
    let errors: Vec<&DeviceLine> = said.lines.iter().filter(|line| line.level == level(0)).collect();
    if let Some(first) = errors.first() {
        let word =
            if errors.len() == 1 { "an error".to_owned() } else { format!("{} errors, the first", errors.len()) };
        warnings.push(
            Warning::new(
                "device-error",
                format!("the device reported {word} at tick {}: {}", first.tick, plain(&first.text)),
                "Its lines are in the record's metadata (whirl.log)",
            )
            .with("errors", errors.len()),
        );
    }
    if said.all > said.lines.len() as u64 {
        warnings.push(Warning::new(
            "device-lines-dropped",
            format!("the device sent more than {} lines: the rest is not kept", said.lines.len()),
            "Look at its firmware: it should not say so much",
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn restarts_and_errors_are_told_once_each() {
        let line =
            |level: u8, text: &str| DeviceLine { tick: 5, level: self::level(level).to_owned(), text: text.to_owned() };
        let lines = [line(2, "shaker runs"), line(0, "output \u{7}failed"), line(0, "again")];
        let told = warnings(Some(900), 2, &Said { lines: &lines, all: 4 });
        let ids: Vec<_> = told.iter().map(|w| w.id).collect();
        assert_eq!(ids, ["device-restarted", "device-error", "device-lines-dropped"]);
        assert!(told[0].text.contains("2 times, first behind tick 900"), "{}", told[0].text);
        assert!(told[1].text.contains("2 errors, the first at tick 5: output \\u{7}failed"), "{}", told[1].text);
        assert!(warnings(None, 0, &Said { lines: &lines[..1], all: 1 }).is_empty());
    }
}

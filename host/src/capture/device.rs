//! What a device says of itself: whether it fits this program and rig, and what it told people.

use whirl_shared::frame::{BaseKind, Hello, PROTOCOL_VERSION, SCHEMA_HASH};

use whirl_shared::excitation::WHOLE;

use super::drive::Target;
use crate::error::{BadInput, Result, plain};
use crate::record::{DeviceBoot, DeviceLine};
use crate::rig::Rig;
use crate::rig::measures::BASE;
use crate::warning::Warning;
use crate::wording::format::rounded;

/// Greatest relative difference of the device's sampling rate from the rig file's.
const RATE_TOLERANCE: f64 = 1e-4;
/// The same of what a count of the base's sensor is worth.
const SCALE_TOLERANCE: f64 = 1e-6;

/// A level of the device's lines, in words.
pub(super) fn level(level: u8) -> &'static str {
    match level {
        0 => "error",
        1 => "warning",
        _ => "information",
    }
}

/// Checks that this program speaks the device's protocol.
pub(super) fn check_protocol(hello: &Hello) -> Result<()> {
    if hello.protocol != PROTOCOL_VERSION || hello.schema != SCHEMA_HASH {
        return Err(BadInput::new(
            format!("protocol {}, schema {:08x} ({})", hello.protocol, hello.schema, firmware(hello)),
            format!("protocol {PROTOCOL_VERSION}, schema {SCHEMA_HASH:08x} (whirl {})", env!("CARGO_PKG_VERSION")),
        )
        .at("the device's hello")
        .remedy("Flash the firmware that belongs to this whirl: `whirl flash`"));
    }
    Ok(())
}

fn firmware(hello: &Hello) -> String {
    format!("firmware {} on {}", hello.firmware, hello.board)
}

/// Which of both is to be changed: the device, or the rig file.
fn either(set: &str, line: &str) -> String {
    format!("`whirl device set {set}` changes the device; where it is right, write `{line}` in the rig file")
}

/// Checks that this program and this rig file fit the device.
pub(super) fn check_hello(hello: &Hello, rig: &Rig) -> Result<()> {
    check_protocol(hello)?;
    let encoders = rig.channel.iter().filter(|c| c.measures != BASE);
    if encoders.clone().count() > hello.counts_per_turn.len() {
        return Err(BadInput::new(
            format!("{} channels of encoders", encoders.count()),
            format!("at most {}, as many as the device has ({})", hello.counts_per_turn.len(), firmware(hello)),
        )
        .in_file(&rig.path)
        .at("channel")
        .remedy("The first [[channel]] is encoder 1, the second encoder 2"));
    }
    for (i, (c, &n)) in encoders.zip(&hello.counts_per_turn).enumerate() {
        if c.counts_per_turn != Some(n) {
            let mine = c.counts_per_turn.map_or("none".to_owned(), |n| n.to_string());
            let set = format!("counts_per_turn{}={mine}", i + 1);
            return Err(BadInput::new(
                format!("counts_per_turn = {mine}"),
                format!("{n} as the device says of encoder {} ({})", i + 1, firmware(hello)),
            )
            .in_file(&rig.path)
            .at(format!("channel \"{}\"", c.name))
            .remedy(match c.counts_per_turn {
                Some(_) => either(&set, &format!("counts_per_turn = {n}")),
                None => format!("Write unit = \"count\" and counts_per_turn = {n} in the rig file"),
            }));
        }
    }
    check_base(hello, rig)?;
    let rate = f64::from(hello.sample_rate_millihertz) / 1000.0;
    if (rate / rig.sample_rate_hz - 1.0).abs() > RATE_TOLERANCE || rate <= 0.0 {
        return Err(BadInput::new(
            format!("sample_rate_hz = {}", rig.sample_rate_hz),
            format!("{rate} as the device says ({})", firmware(hello)),
        )
        .in_file(&rig.path)
        .at("sample_rate_hz")
        .remedy(either(&format!("sample_rate_hz={}", rig.sample_rate_hz), &format!("sample_rate_hz = {rate}"))));
    }
    Ok(())
}

/// Checks that the device has the sensor of the base that the rig file has.
fn check_base(hello: &Hello, rig: &Rig) -> Result<()> {
    let Some(c) = rig.channel.iter().find(|c| c.measures == BASE) else { return Ok(()) };
    let position = c.unit != "m/s2";
    // What the rig file says in decimals, without the last digit of a product of binary numbers.
    let worth = rounded((c.gain.unwrap_or(1.0) * c.scale()).abs(), 12);
    let (unit, key) = if position { ("m", "base_scale_m") } else { ("m/s2", "base_scale_m_s2") };
    let set = format!("base={} {key}={worth:e}", if position { "encoder" } else { "acceleration" });
    let bad = |found: String, expected: String, remedy: String| {
        Err(BadInput::new(found, expected).in_file(&rig.path).at(format!("channel \"{}\"", c.name)).remedy(remedy))
    };
    let Some(told) = hello.base.per_count() else {
        return bad(
            "a channel that measures the base".to_owned(),
            format!("none, since the device has no sensor of the base ({})", firmware(hello)),
            format!(
                "`whirl device set {set}` tells the device of one (or base=position for a transducer); otherwise leave the channel out"
            ),
        );
    };
    if position == (hello.base.kind == BaseKind::Acceleration) {
        let what = if position { "an acceleration" } else { "a position" };
        return bad(
            format!("unit \"{}\"", c.unit),
            format!("the unit of {what}, which the device measures ({})", firmware(hello)),
            "Write unit = \"m\" for a position and \"m/s2\" for an acceleration, or set the device's base=…".to_owned(),
        );
    }
    if (told / worth - 1.0).abs() > SCALE_TOLERANCE {
        return bad(
            format!("{worth:e} {unit} a count (gain and unit)"),
            format!("{told:e} as the device says ({})", firmware(hello)),
            either(&format!("{key}={worth:e}"), &format!("unit = \"{unit}\" and gain = {told:e}")),
        );
    }
    Ok(())
}

/// Checks that the device's shaker may do what is asked of it, before it is armed.
pub(super) fn check_drive(hello: &Hello, target: Target, rig: &Rig) -> Result<()> {
    let limits = hello.limits;
    let excitation = &target.0;
    let (highest, base_frequency) =
        (f64::from(excitation.form.highest()), f64::from(excitation.greatest_frequency()) / 1e3);
    let (amplitude, frequency) =
        (f64::from(excitation.amplitudes().iter().copied().max().unwrap_or(0)) / 1e6, highest * base_frequency);
    let acceleration = match target.1.map(|table| table.known()) {
        Some(extent) => {
            let most = extent.frequency_limit(hello.sample_rate_millihertz);
            if excitation.frequency_millihertz > most {
                return Err(BadInput::new(
                    format!("a table of {} points at {base_frequency} Hz", extent.name.points),
                    format!("at most {} Hz: a point for each of the device's samples", f64::from(most) / 1e3),
                )
                .in_file(&rig.path)
                .at("drive")
                .remedy("Give the period fewer points, or set drive.frequency_hz within it"));
            }
            let sharpest = f64::from(extent.sharpest) / f64::from(WHOLE);
            amplitude * (f64::from(extent.name.points) * base_frequency).powi(2) * sharpest
        }
        None => {
            // Of the sum, whatever the phases.
            let sharpness = excitation.form.sharpness() as f64 / f64::from(WHOLE);
            amplitude * (core::f64::consts::TAU * base_frequency).powi(2) * sharpness
        }
    };
    let full_scale = f64::from(hello.full_scale_micrometre) / 1e6;
    for (what, found, limit, key, unit) in [
        ("an amplitude", amplitude, f64::from(limits.amplitude_micrometre) / 1e6, "amplitude_limit_m", "m"),
        ("a frequency", frequency, f64::from(limits.frequency_millihertz) / 1e3, "frequency_limit_hz", "Hz"),
        // The device rounds the amplitude that this allows down to a micrometre.
        (
            "an acceleration",
            (acceleration * 1e3).ceil() / 1e3,
            f64::from(limits.acceleration_millimetre_per_s2) / 1e3,
            "acceleration_limit_m_s2",
            "m/s²",
        ),
        ("an amplitude", amplitude, full_scale, "full_scale_m", "m"),
    ] {
        if found > limit {
            let remedy = if key == "full_scale_m" {
                "Its output cannot show more: take a smaller amplitude, or raise the amplifier's gain and tell the \
                 device by `whirl device set full_scale_m=…` what its highest voltage is then"
                    .to_owned()
            } else {
                format!(
                    "Set drive.amplitude_m (or --amplitude-m, --amplitude-steps) and drive.frequency_hz (or --sweep, --multisine, a smoother --table) within it, or, where the shaker can do \
                     more, `whirl device set {key}={found}`"
                )
            };
            return Err(BadInput::new(
                format!("{what} of {found} {unit}"),
                format!("at most {limit} {unit} ({key} of {})", hello.board),
            )
            .in_file(&rig.path)
            .at("drive")
            .remedy(remedy));
        }
    }
    Ok(())
}

/// Lines of a device: those that are kept, and how many there were.
pub(super) struct Said<'a> {
    pub(super) lines: &'a [DeviceLine],
    pub(super) all: u64,
}

/// What is to be told of its restarts (`behind`: tick of the record at the first) and of its lines.
pub(super) fn warnings(behind: Option<i64>, restarts: u64, boots: &[DeviceBoot], said: &Said<'_>) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if let Some(tick) = behind {
        let times = if restarts <= 1 { "once".to_owned() } else { format!("{restarts} times") };
        let how = boots.windows(2).next().map_or_else(String::new, |pair| format!(" ({})", pair[1].after(&pair[0])));
        let kept = boots.windows(2).all(|pair| pair[1].has_zeros_of(&pair[0], pair[1].zeros.len()));
        let advice = if kept && boots.len() > 1 {
            "A new segment begins there, with the same encoder zeros: all of it is used. Look after the cause"
        } else {
            "A new segment begins there, whose encoder zeros are others; look after the device's power supply and its log"
        };
        warnings.push(
            Warning::new(
                "device-restarted",
                format!("the device has restarted {times}, first behind tick {tick} of the record{how}"),
                advice,
            )
            .with("tick", tick)
            .with("restarts", restarts)
            .with("zeros_kept", kept && boots.len() > 1),
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
    use whirl_shared::frame::BaseSensor;

    use super::*;
    use crate::record::device_boot::EncoderZero;

    #[test]
    fn restarts_and_errors_are_told_once_each() {
        let line =
            |level: u8, text: &str| DeviceLine { tick: 5, level: self::level(level).to_owned(), text: text.to_owned() };
        let lines = [line(2, "shaker runs"), line(0, "output \u{7}failed"), line(0, "again")];
        let told = warnings(Some(900), 2, &[], &Said { lines: &lines, all: 4 });
        let ids: Vec<_> = told.iter().map(|w| w.id).collect();
        assert_eq!(ids, ["device-restarted", "device-error", "device-lines-dropped"]);
        assert!(told[0].text.contains("2 times, first behind tick 900"), "{}", told[0].text);
        assert!(told[1].text.contains("2 errors, the first at tick 5: output \\u{7}failed"), "{}", told[1].text);
        assert!(warnings(None, 0, &[], &Said { lines: &lines[..1], all: 1 }).is_empty());
        // A watchdog's reset over which the counts were kept.
        let zero = EncoderZero { id: 7, ..EncoderZero::default() };
        let boot =
            |reset: &str| DeviceBoot { reset: reset.to_owned(), zeros: vec![zero.clone(); 2], ..DeviceBoot::default() };
        let told = warnings(Some(900), 1, &[boot("power"), boot("watchdog")], &Said { lines: &[], all: 0 });
        assert!(told[0].text.ends_with("of the record (watchdog; its counts were kept)"), "{}", told[0].text);
        assert!(told[0].advice.contains("all of it is used"), "{}", told[0].advice);
    }

    #[test]
    fn a_sensor_of_the_base_is_held_against_the_rig_file() {
        let text = |unit: &str, gain: f64| {
            format!(
                "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n[[channel]]\nname = \"a\"\nmeasures = \"theta1\"\nunit = \"count\"\ncounts_per_turn = 4096\n[[channel]]\nname = \"y\"\nmeasures = \"base\"\nunit = \"{unit}\"\ngain = {gain:e}\n"
            )
        };
        let rig = |unit: &str, gain: f64| Rig::parse(&text(unit, gain), std::path::Path::new("rig.toml")).unwrap();
        let hello = |kind, scale| Hello {
            protocol: PROTOCOL_VERSION,
            schema: SCHEMA_HASH,
            sample_rate_millihertz: 500_000,
            counts_per_turn: [4096].into(),
            base: BaseSensor { kind, scale },
            ..Hello::default()
        };
        let check = |rig: &Rig, kind, scale| check_hello(&hello(kind, scale), rig).map_err(|e| e.to_string());
        for (unit, gain) in [("um", 5.0), ("mm", -5e-3), ("m", 5e-6)] {
            assert_eq!(check(&rig(unit, gain), BaseKind::Encoder, 5_000_000), Ok(()));
            assert_eq!(check(&rig(unit, gain), BaseKind::Position, 5_000_000), Ok(()));
        }
        assert_eq!(check(&rig("m/s2", 2.4e-3), BaseKind::Acceleration, 2_400_000), Ok(()));
        for (unit, gain, kind, scale, part) in [
            ("um", 5.0, BaseKind::None, 5_000_000, "whirl device set base=encoder base_scale_m=5e-6"),
            ("um", 5.0, BaseKind::Acceleration, 5_000_000, "unit \"um\""),
            ("m/s2", 5.0, BaseKind::Encoder, 5_000_000, "unit = \"m\" for a position"),
            ("um", 5.0, BaseKind::Encoder, 5_010_000, "5.01e-6"),
        ] {
            let error = check(&rig(unit, gain), kind, scale).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
        let error = Rig::parse(&text("deg", 1.0), std::path::Path::new("rig.toml")).unwrap_err().to_string();
        assert!(error.contains("m, mm, um, or m/s2 for an accelerometer"), "{error}");
        // A rig of more encoders than the device has.
        let two = text("um", 5.0).replace(
            "\"y\"\nmeasures = \"base\"\nunit = \"um\"\ngain = 5e0",
            "\"b\"\nmeasures = \"theta2\"\nunit = \"count\"\ncounts_per_turn = 4096",
        );
        let two = Rig::parse(&two, std::path::Path::new("rig.toml")).unwrap();
        let error = check(&two, BaseKind::None, 1).unwrap_err();
        assert!(error.contains("2 channels of encoders") && error.contains("at most 1"), "{error}");
    }
}

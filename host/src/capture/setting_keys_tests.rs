//! Settings by name, both ways.

use super::*;
use whirl_shared::frame::{BaseSensor, ShakerLimits};

fn hello() -> Hello {
    Hello {
        counts_per_turn: [4096; 2].into(),
        reversed: [false; 2].into(),
        base: BaseSensor { kind: BaseKind::Encoder, scale: 5_000_000 },
        sample_rate_millihertz: 500_000,
        limits: ShakerLimits {
            amplitude_micrometre: 20_000,
            frequency_millihertz: 20_000,
            ramp_micrometre_per_s: 20_000,
            acceleration_millimetre_per_s2: 40_000,
        },
        host_timeout_ms: 2_000,
        full_scale_micrometre: 25_000,
        baud: 115_200,
        ..Hello::default()
    }
}

#[test]
fn what_is_shown_can_be_set_and_is_then_in_force() {
    let hello = hello();
    let shown = all_of(&hello);
    assert_eq!(shown.len(), 14);
    for setting in &shown {
        let value = setting.value.as_str().map_or_else(|| setting.value.to_string(), str::to_owned);
        let change = parse(&format!("{}={value}", setting.key), 2).unwrap();
        assert_eq!(change.settings.len(), 1, "{}", change.text);
        assert!(in_force(&hello, &change.settings), "{}", change.text);
    }
    for (text, setting) in [
        ("counts_per_turn2=1024", Setting::CountsPerTurn { channel: 1, counts: 1024 }),
        ("reversed1 = true", Setting::Reversed { channel: 0, reversed: true }),
        ("amplitude_limit_m=0.0123", Setting::AmplitudeLimit { micrometre: 12_300 }),
        ("acceleration_limit_m_s2=31.5", Setting::AccelerationLimit { millimetre_per_s2: 31_500 }),
        ("host_timeout_s=0.9", Setting::HostTimeout { ms: 900 }),
        ("base=position", Setting::Base { kind: BaseKind::Position }),
        ("base_scale_m=7.63e-7", Setting::BaseScale { scale: 763_000 }),
        ("base_scale_m_s2=0.0012", Setting::BaseScale { scale: 1_200_000 }),
        ("settings=built-in", Setting::BuiltIn),
    ] {
        let change = parse(text, 2).unwrap();
        assert_eq!(change.settings, [setting], "{text}");
        assert_eq!(in_force(&hello, &change.settings), setting == Setting::BuiltIn, "{text}");
    }
    assert_eq!(parse("counts_per_turn=1024", 2).unwrap().settings.len(), 2);
}

#[test]
fn what_cannot_be_is_refused_with_what_can() {
    for (text, part) in [
        ("counts_per_turn1", "KEY=VALUE"),
        ("counts=4096", "counts_per_turn1, reversed1, sample_rate_hz"),
        ("counts_per_turn3=4096", "an encoder from 1 to 2"),
        ("counts_per_turn0=4096", "an encoder from 1 to 2"),
        ("counts_per_turn1=40.5", "a whole number"),
        ("counts_per_turn1=-1", "a whole number"),
        ("reversed1=yes", "true or false"),
        ("sample_rate_hz=fast", "a number (sampling rate)"),
        ("sample_rate_hz=500.0001", "in steps of 0.001"),
        ("amplitude_limit_m=-0.1", "a number from 0"),
        ("amplitude_limit_m=NaN", "a number from 0"),
        ("baud3=9600", "one of"),
        ("base1=encoder", "one of"),
        ("base=lvdt", "none, encoder, position or acceleration"),
        ("base_scale_m=1e-13", "in steps of"),
        ("settings=mine", "settings=built-in"),
    ] {
        let e = parse(text, 2).unwrap_err().to_string();
        assert!(e.contains(part), "{text}: {e}");
    }
}

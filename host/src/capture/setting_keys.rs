//! A device's settings by name, as `whirl device set KEY=VALUE` takes and `whirl device show`
//! prints them: SI units, channels from 1.
//!
//! The wire carries whole numbers in small units (mHz, µm, ms): a value that is no whole number of
//! them is refused, not rounded. What a value may be the device knows; this knows the names.

use serde::Serialize;
use whirl_shared::frame::{BaseKind, Hello, Setting};

use crate::error::{BadInput, Result};

/// A setting.
pub struct SettingKey {
    /// Its name; one of an encoder has the encoder's number behind it.
    pub id: &'static str,
    /// Unit of its value.
    pub unit: &'static str,
    /// What it is.
    pub about: &'static str,
    kind: Kind,
}

/// How a value gets onto the wire and from there.
enum Kind {
    /// One of each encoder: from the channel (from 0) and the value.
    OfEncoder(fn(u8, u32) -> Setting, fn(&Hello, usize) -> Option<u32>),
    /// The same, true or false.
    Sense,
    /// What the base's sensor is: a word of [`BASES`].
    Base,
    /// One of the device: wire units in one of the SI unit, from the value, of a hello.
    OfDevice(f64, fn(u32) -> Setting, fn(&Hello) -> u32),
}

/// What a sensor of the base may be.
const BASES: [(&str, BaseKind); 4] = [
    ("none", BaseKind::None),
    ("encoder", BaseKind::Encoder),
    ("position", BaseKind::Position),
    ("acceleration", BaseKind::Acceleration),
];

/// All of them as the image has them: `settings=built-in`.
const ALL: &str = "settings";
const BUILT_IN: &str = "built-in";

/// Every setting.
pub static KEYS: &[SettingKey] = &[
    SettingKey {
        id: "counts_per_turn",
        unit: "",
        about: "counts a turn, after decoding",
        kind: Kind::OfEncoder(
            |channel, counts| Setting::CountsPerTurn { channel, counts },
            |h, i| h.counts_per_turn.get(i).copied(),
        ),
    },
    SettingKey { id: "reversed", unit: "", about: "true turns its sense of counting round", kind: Kind::Sense },
    SettingKey {
        id: "sample_rate_hz",
        unit: "Hz",
        about: "sampling rate",
        kind: Kind::OfDevice(1e3, |millihertz| Setting::SampleRate { millihertz }, |h| h.sample_rate_millihertz),
    },
    SettingKey {
        id: "amplitude_limit_m",
        unit: "m",
        about: "greatest amplitude of the base",
        kind: Kind::OfDevice(
            1e6,
            |micrometre| Setting::AmplitudeLimit { micrometre },
            |h| h.limits.amplitude_micrometre,
        ),
    },
    SettingKey {
        id: "frequency_limit_hz",
        unit: "Hz",
        about: "greatest frequency of the drive",
        kind: Kind::OfDevice(
            1e3,
            |millihertz| Setting::FrequencyLimit { millihertz },
            |h| h.limits.frequency_millihertz,
        ),
    },
    SettingKey {
        id: "ramp_limit_m_s",
        unit: "m/s",
        about: "greatest rate at which the amplitude changes",
        kind: Kind::OfDevice(
            1e6,
            |micrometre_per_s| Setting::RampLimit { micrometre_per_s },
            |h| h.limits.ramp_micrometre_per_s,
        ),
    },
    SettingKey {
        id: "acceleration_limit_m_s2",
        unit: "m/s²",
        about: "greatest acceleration of the base, amplitude × (2π × frequency)²",
        kind: Kind::OfDevice(
            1e3,
            |millimetre_per_s2| Setting::AccelerationLimit { millimetre_per_s2 },
            |h| h.limits.acceleration_millimetre_per_s2,
        ),
    },
    SettingKey {
        id: "host_timeout_s",
        unit: "s",
        about: "silence of the host after which the shaker stops",
        kind: Kind::OfDevice(1e3, |ms| Setting::HostTimeout { ms }, |h| h.host_timeout_ms),
    },
    SettingKey {
        id: "full_scale_m",
        unit: "m",
        about: "displacement of the base at the set point's highest voltage",
        kind: Kind::OfDevice(1e6, |micrometre| Setting::FullScale { micrometre }, |h| h.full_scale_micrometre),
    },
    SettingKey {
        id: "baud",
        unit: "baud",
        about: "rate of the serial port",
        kind: Kind::OfDevice(1.0, |rate| Setting::Baud { rate }, |h| h.baud),
    },
    SettingKey {
        id: "base",
        unit: "",
        about: "sensor of the base: none, encoder, position or acceleration",
        kind: Kind::Base,
    },
    SettingKey {
        id: "base_scale_m",
        unit: "m",
        about: "what a count of a position of the base is worth",
        kind: Kind::OfDevice(1e12, |scale| Setting::BaseScale { scale }, |h| h.base.scale),
    },
    SettingKey {
        id: "base_scale_m_s2",
        unit: "m/s²",
        about: "what a count of an acceleration of the base is worth",
        kind: Kind::OfDevice(1e9, |scale| Setting::BaseScale { scale }, |h| h.base.scale),
    },
];

/// A setting of a device with its value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SettingValue {
    /// As `whirl device set` takes it.
    pub key: String,
    /// A number, or true or false.
    pub value: serde_json::Value,
    /// Unit of the value.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub unit: &'static str,
    /// What it is.
    pub about: String,
}

/// A change that was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// As it was given: `KEY=VALUE`.
    pub text: String,
    /// What goes onto the wire: one, or one for each encoder.
    pub settings: Vec<Setting>,
}

/// Whether a key tells something of a device with such a sensor of the base.
fn applies(key: &SettingKey, base: BaseKind) -> bool {
    match key.id {
        "base_scale_m" => matches!(base, BaseKind::Encoder | BaseKind::Position),
        "base_scale_m_s2" => base == BaseKind::Acceleration,
        _ => true,
    }
}

fn base_word(kind: BaseKind) -> &'static str {
    BASES.iter().find(|(_, k)| *k == kind).map_or("none", |(word, _)| word)
}

/// Settings as a hello tells them, in the order of [`KEYS`].
pub fn all_of(hello: &Hello) -> Vec<SettingValue> {
    let encoders = hello.counts_per_turn.len();
    let mut list = Vec::new();
    for key in KEYS.iter().filter(|key| applies(key, hello.base.kind)) {
        let value = |name: String, value: serde_json::Value, about: String| SettingValue {
            key: name,
            value,
            unit: key.unit,
            about,
        };
        match &key.kind {
            Kind::OfDevice(scale, _, of) => {
                list.push(value(key.id.to_owned(), (f64::from(of(hello)) / scale).into(), key.about.to_owned()));
            }
            Kind::Base => {
                list.push(value(key.id.to_owned(), base_word(hello.base.kind).into(), key.about.to_owned()));
            }
            Kind::OfEncoder(_, of) => list.extend((0..encoders).filter_map(|i| {
                Some(value(
                    format!("{}{}", key.id, i + 1),
                    of(hello, i)?.into(),
                    format!("encoder {}: {}", i + 1, key.about),
                ))
            })),
            Kind::Sense => list.extend(hello.reversed.iter().take(encoders).enumerate().map(|(i, &reversed)| {
                value(format!("{}{}", key.id, i + 1), reversed.into(), format!("encoder {}: {}", i + 1, key.about))
            })),
        }
    }
    list
}

/// Names of all keys, for messages.
pub fn names() -> String {
    let name = |key: &SettingKey| match key.kind {
        Kind::OfDevice(..) | Kind::Base => key.id.to_owned(),
        _ => format!("{}1", key.id),
    };
    let mut names: Vec<String> = KEYS.iter().map(name).collect();
    names.push(format!("{ALL}={BUILT_IN}"));
    names.join(", ")
}

/// Reads `KEY=VALUE` for a device with so many encoders. A key of an encoder without a number means
/// all encoders.
///
/// # Errors
/// No such key, no such encoder, a value of another kind or finer than the device keeps.
pub fn parse(text: &str, encoders: usize) -> Result<Change> {
    let bad = |found: String, expected: String| BadInput::new(found, expected).at("KEY=VALUE");
    let Some((name, value)) = text.split_once('=').map(|(k, v)| (k.trim(), v.trim())) else {
        return Err(bad(format!("\"{text}\""), "KEY=VALUE, such as counts_per_turn1=4096".to_owned())
            .remedy("`whirl device show` prints the keys with their values"));
    };
    let change = |settings: Vec<Setting>| Ok(Change { text: format!("{name}={value}"), settings });
    if name == ALL {
        return if value == BUILT_IN {
            change(vec![Setting::BuiltIn])
        } else {
            Err(bad(format!("{name}={value}"), format!("{ALL}={BUILT_IN}"))
                .remedy("That takes all settings as the image has them; the others have keys of their own"))
        };
    }
    let (stem, number) = name.split_at(name.trim_end_matches(|c: char| c.is_ascii_digit()).len());
    // A unit at the end of a key may end with a digit, too.
    let found = KEYS.iter().find(|k| k.id == name).map(|k| (k, "")).or_else(|| {
        let of_encoder = |k: &&SettingKey| k.id == stem && !matches!(k.kind, Kind::OfDevice(..) | Kind::Base);
        KEYS.iter().find(of_encoder).map(|k| (k, number))
    });
    let Some((key, number)) = found else {
        return Err(bad(format!("\"{name}\""), format!("one of {}", names()))
            .remedy("`whirl device show` prints the keys with their values"));
    };
    let channels: Vec<u8> = match number.parse::<usize>() {
        // A device has some encoders.
        _ if number.is_empty() => (0..encoders).map(|i| i as u8).collect(),
        Ok(n) if (1..=encoders).contains(&n) => vec![(n - 1) as u8],
        _ => {
            return Err(bad(name.to_owned(), format!("an encoder from 1 to {encoders}, as in {stem}1"))
                .remedy("Encoders count from 1, in the order of the rig file's channels"));
        }
    };
    let wrong = |expected: &str| {
        Err(bad(format!("{name}={value}"), format!("{expected} ({})", key.about)).remedy("Correct the value"))
    };
    match &key.kind {
        Kind::OfEncoder(make, _) => match value.parse::<u32>() {
            Ok(n) => change(channels.iter().map(|&c| make(c, n)).collect()),
            Err(_) => wrong("a whole number"),
        },
        Kind::Sense => match value.parse::<bool>() {
            Ok(reversed) => change(channels.iter().map(|&channel| Setting::Reversed { channel, reversed }).collect()),
            Err(_) => wrong("true or false"),
        },
        Kind::Base => match BASES.iter().find(|(word, _)| *word == value) {
            Some(&(_, kind)) => change(vec![Setting::Base { kind }]),
            None => wrong("none, encoder, position or acceleration"),
        },
        Kind::OfDevice(scale, make, _) => match value.parse::<f64>() {
            Ok(x) => match wire(x, *scale) {
                Some(n) => change(vec![make(n)]),
                None => wrong(&format!(
                    "a number from 0 to {} {}, in steps of {}",
                    f64::from(u32::MAX) / scale,
                    key.unit,
                    1.0 / scale
                )),
            },
            Err(_) => wrong("a number"),
        },
    }
}

/// A value in the wire's unit; none where it is not a whole number of those.
fn wire(value: f64, scale: f64) -> Option<u32> {
    let (scaled, whole) = (value * scale, (value * scale).round());
    // Decimals that people write are off by rounding only.
    let exact = (scaled - whole).abs() <= 1e-9 * whole.abs().max(1.0);
    (exact && (0.0..=f64::from(u32::MAX)).contains(&whole)).then_some(whole as u32)
}

/// Name, unit, the value on the wire, and a limit on the wire in the setting's unit, for what a
/// device refuses.
pub fn limit(setting: Setting, limit: u32) -> (String, String, u32, f64) {
    let of_encoder = |id: &str, channel: u8, value: u32| {
        (format!("{id}{}", u32::from(channel) + 1), String::new(), value, f64::from(limit))
    };
    match setting {
        Setting::CountsPerTurn { channel, counts } => of_encoder("counts_per_turn", channel, counts),
        Setting::Reversed { channel, reversed } => of_encoder("reversed", channel, reversed.into()),
        Setting::BuiltIn => (ALL.to_owned(), String::new(), 0, f64::from(limit)),
        Setting::Base { kind } => ("base".to_owned(), String::new(), kind as u32, f64::from(limit)),
        Setting::SampleRate { millihertz: value }
        | Setting::AmplitudeLimit { micrometre: value }
        | Setting::FrequencyLimit { millihertz: value }
        | Setting::RampLimit { micrometre_per_s: value }
        | Setting::AccelerationLimit { millimetre_per_s2: value }
        | Setting::HostTimeout { ms: value }
        | Setting::FullScale { micrometre: value }
        | Setting::Baud { rate: value }
        | Setting::BaseScale { scale: value } => KEYS
            .iter()
            .find_map(|key| match key.kind {
                Kind::OfDevice(scale, make, _) if make(value) == setting => {
                    Some((key.id.to_owned(), format!(" {}", key.unit), value, f64::from(limit) / scale))
                }
                _ => None,
            })
            .unwrap_or_default(),
    }
}

/// Whether a hello tells the values of these settings.
pub fn in_force(hello: &Hello, settings: &[Setting]) -> bool {
    settings.iter().all(|&setting| {
        KEYS.iter().all(|key| match &key.kind {
            Kind::OfDevice(_, make, of) => {
                let now = make(of(hello));
                core::mem::discriminant(&now) != core::mem::discriminant(&setting) || now == setting
            }
            Kind::OfEncoder(make, of) => (0..hello.counts_per_turn.len()).all(|i| {
                let Some(n) = of(hello, i) else { return true };
                let same_kind = matches!(setting, Setting::CountsPerTurn { channel, .. } if usize::from(channel) == i);
                !same_kind || make(i as u8, n) == setting
            }),
            Kind::Base => match setting {
                Setting::Base { kind } => kind == hello.base.kind,
                _ => true,
            },
            Kind::Sense => match setting {
                Setting::Reversed { channel, reversed } => hello.reversed.get(usize::from(channel)) == Some(&reversed),
                _ => true,
            },
        })
    })
}

#[cfg(test)]
#[path = "setting_keys_tests.rs"]
mod tests;

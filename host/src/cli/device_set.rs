//! `whirl device set KEY=VALUE…`: settings kept in a board's flash, then in force.
//!
//! The device checks each change together with all others as they will be, keeps it, and takes it
//! at its next start. It is restarted here, and what it then says of itself is held against what
//! was asked for.

use std::time::Duration;

use clap::Args;
use whirl_shared::codec::samples_frame_len;
use whirl_shared::frame::{
    BLOCK_LEN, BaseKind, Command, CommandResult, Hello, MOST_ENCODERS, Setting, SettingsSource, ZeroSource,
};

use super::Answer;
use super::device::{Device, Link, heading, table};
use super::output::print_warnings;
use crate::boards;
use crate::capture::serial::DEFAULT_BAUD;
use crate::capture::setting_keys::{self, Change};
use crate::capture::talk::Talk;
use crate::error::{BadInput, Result};
use crate::warning::Warning;

/// How long a board may take to erase a page of its flash and write it: 2 s on the slowest, and its
/// start.
const KEEPING: Duration = Duration::from_secs(5);
/// Blocks a second that end before they are full, at worst: ten commands, and the ramps that they
/// begin.
const CUT: f64 = 20.0;
/// Bytes a second beside the samples, at worst: statuses, answers, estimates
/// (docs/wire-protocol.md, "What the line must carry").
const BESIDE: f64 = 480.0;

/// Arguments of `device set`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Settings, such as counts_per_turn1=4096; `settings=built-in` takes all as the image has
    /// them.
    #[arg(required = true, value_name = "KEY=VALUE")]
    changes: Vec<String>,
    /// Leave the board running with its present settings; the new ones take force when it starts
    /// next.
    #[arg(long)]
    no_restart: bool,
}

/// Sets, restarts, verifies.
pub fn run(link: &Link, arguments: &Arguments) -> Result<Answer> {
    // Before anything is sent: a typing error in the last one must not leave the others done.
    let parsed = |encoders: usize| -> Result<Vec<Change>> {
        arguments.changes.iter().map(|text| setting_keys::parse(text, encoders)).collect()
    };
    parsed(MOST_ENCODERS)?;
    let (from, mut talk, before) = link.open()?;
    let changes = parsed(before.counts_per_turn.len())?;
    for change in &changes {
        for &setting in &change.settings {
            let result = talk.ask_at_rest(Command::Set(setting))?;
            if result != CommandResult::Done {
                return Err(refused(change, setting, result, &before).in_file(&from));
            }
        }
    }
    let kept = kept(&mut talk, &from)?;
    let is_simulated = talk.is_simulated();
    let wanted = wanted(&changes);
    let mut warnings = Vec::new();
    let after = if arguments.no_restart {
        kept
    } else {
        let baud = baud(&changes);
        restarted(link, &from, talk, &before, &wanted, baud, &mut warnings)?
    };
    warnings.extend(narrow(&after, &wanted));
    let device = Device::of(&after);
    let out = link.out();
    out.write_json(&serde_json::json!({
        "from": from, "set": changes.iter().map(|c| &c.text).collect::<Vec<_>>(),
        "in_force": !arguments.no_restart, "device": device, "warnings": warnings,
    }))?;
    print_warnings(&warnings);
    let done = changes.iter().map(|c| c.text.as_str()).collect::<Vec<_>>().join(", ");
    let mut text = heading(&from, &after);
    if arguments.no_restart {
        let next = if is_simulated {
            "the simulated board ends with this command, and they with it"
        } else {
            "in force when the board starts next"
        };
        text.push_str(&format!("kept: {done}; {next}\n"));
    } else {
        let flash = if is_simulated { " in the simulated board's flash, which ends with this command" } else { "" };
        text.push_str(&format!("kept{flash}, and in force: {done}\n"));
        text.push_str(&table(&after, &device));
    }
    out.say(&text);
    Ok(Answer::Positive)
}

/// What is to be in force at the end: a later change takes an earlier one's place.
fn wanted(changes: &[Change]) -> Vec<Setting> {
    let mut wanted: Vec<Setting> = Vec::new();
    for &setting in changes.iter().flat_map(|c| &c.settings) {
        if setting == Setting::BuiltIn {
            wanted.clear();
            continue;
        }
        wanted.retain(|old| !same_place(*old, setting));
        wanted.push(setting);
    }
    wanted
}

/// Rate of the serial port at the end, where it is among what is changed.
fn baud(changes: &[Change]) -> Option<u32> {
    changes.iter().flat_map(|c| &c.settings).rev().find_map(|setting| match setting {
        Setting::Baud { rate } => Some(*rate),
        Setting::BuiltIn => Some(DEFAULT_BAUD),
        _ => None,
    })
}

/// Warns of a serial port that cannot carry at worst what is sampled, as it will be.
fn narrow(hello: &Hello, wanted: &[Setting]) -> Option<Warning> {
    if boards::of(&hello.board).is_none_or(|board| !board.has_baud) {
        return None;
    }
    let (mut baud, mut millihertz) = (hello.baud, hello.sample_rate_millihertz);
    let mut base = hello.base.kind;
    for setting in wanted {
        match *setting {
            Setting::Baud { rate } => baud = rate,
            Setting::SampleRate { millihertz: rate } => millihertz = rate,
            Setting::Base { kind } => base = kind,
            _ => {}
        }
    }
    let channels = hello.counts_per_turn.len() + usize::from(base != BaseKind::None);
    let blocks = f64::from(millihertz) / 1e3 / BLOCK_LEN as f64 + CUT;
    // Ten bits a byte.
    let needed = 10.0 * (blocks * samples_frame_len(channels) as f64 + BESIDE);
    (needed > f64::from(baud)).then(|| {
        Warning::new(
            "line-narrow",
            format!(
                "{channels} channels at {} Hz take up to {needed:.0} baud, the serial port has {baud}",
                f64::from(millihertz) / 1e3
            ),
            "`whirl device set baud=921600`, which is enough for all: what the line does not take is lost",
        )
        .with("needed_baud", needed.round())
        .with("baud", baud)
    })
}

fn same_place(a: Setting, b: Setting) -> bool {
    let channel = |setting: Setting| match setting {
        Setting::CountsPerTurn { channel, .. } | Setting::Reversed { channel, .. } => channel,
        _ => 0,
    };
    core::mem::discriminant(&a) == core::mem::discriminant(&b) && channel(a) == channel(b)
}

/// Waits until the device says whether it has kept what it was sent.
fn kept(talk: &mut Talk, from: &str) -> Result<Hello> {
    let begun = std::time::Instant::now();
    // A simulated device has a time of its own, which goes on with each hello.
    for _ in 0..100 {
        let hello = talk.hello()?;
        match hello.settings {
            SettingsSource::Changed => return Ok(hello),
            SettingsSource::NotKept => {
                return Err(BadInput::new("settings that the board could not keep", "settings in its flash")
                    .in_file(from)
                    .remedy(
                        "Set them again. On a NUCLEO-G474RE see that its flash has two banks (option DBANK, as delivered)",
                    ));
            }
            _ if begun.elapsed() > KEEPING => break,
            _ => {}
        }
    }
    Err(BadInput::new("no word on whether the settings were kept", "a hello that tells it")
        .in_file(from)
        .remedy("Look with `whirl device show` whether they were, and set them again"))
}

/// Restarts the device and sees that all is in force.
fn restarted(
    link: &Link,
    from: &str,
    mut talk: Talk,
    before: &Hello,
    wanted: &[Setting],
    baud: Option<u32>,
    warnings: &mut Vec<Warning>,
) -> Result<Hello> {
    if talk.ask_at_rest(Command::Restart)? != CommandResult::Done {
        return Err(BadInput::new("a board that does not restart", "a restart")
            .in_file(from)
            .remedy("The settings are kept: unplug the board and plug it in again, then `whirl device show`"));
    }
    let anew = baud.filter(|rate| *rate != before.baud).and_then(|rate| at_baud(from, rate));
    if let Some(from) = &anew {
        drop(talk);
        std::thread::sleep(Duration::from_millis(500));
        talk = Talk::open(from, &link.rig()?, link.handshake_s)?;
        warnings.push(Warning::new(
            "baud-changed",
            "the serial port has another rate now",
            format!("Name the port as {from} from now on"),
        ));
    }
    let begun = std::time::Instant::now();
    let mut hello = talk.hello()?;
    while hello.boot_id == before.boot_id && begun.elapsed() < KEEPING {
        hello = talk.hello()?;
    }
    if hello.boot_id == before.boot_id {
        return Err(BadInput::new("a board that has not restarted", "a restart")
            .in_file(from)
            .remedy("The settings are kept: unplug the board and plug it in again, then `whirl device show`"));
    }
    if hello.settings == SettingsSource::Refused || !setting_keys::in_force(&hello, wanted) {
        return Err(BadInput::new("settings that are kept but not in force", "settings that this board can have")
            .in_file(from)
            .remedy(
                "It runs with those of its image: its timers may not make that sampling rate exactly, or it is not within \
                 250 Hz to 2 kHz. Set another value, or `whirl device set settings=built-in`",
            ));
    }
    let mut pairs = before.zeros.iter().zip(&hello.zeros);
    if let Some((_, new)) = pairs.find(|(old, new)| old.id != new.id) {
        warnings.push(zero_lost(new.source));
    }
    Ok(hello)
}

/// That an encoder's zero is another after the restart, and how it came about.
fn zero_lost(source: ZeroSource) -> Warning {
    let text = match source {
        ZeroSource::Carried => {
            "the encoders' zero was carried over the restart, in which an arm turned, and is off by that turn"
        }
        _ => "the encoders' zero was lost in the restart: the arms turned, or the counts a turn are others",
    };
    Warning::new("zero-lost", text, "Let the arms hang still, then `whirl device zero`")
}

/// The same serial port at another rate; none for other sources.
fn at_baud(from: &str, rate: u32) -> Option<String> {
    let port = from.strip_prefix("serial:")?;
    let port = port.rsplit_once('@').map_or(port, |(port, _)| port);
    Some(format!("serial:{port}@{rate}"))
}

/// Why the device refused a setting.
fn refused(change: &Change, setting: Setting, result: CommandResult, hello: &Hello) -> BadInput {
    let found = change.text.clone();
    let error = |expected: String, remedy: &str| BadInput::new(found.clone(), expected).at("KEY=VALUE").remedy(remedy);
    let CommandResult::OutOfRange { limit } = result else {
        return error(format!("a board that takes it ({result:?})"), "See that the shaker is at rest, and try again");
    };
    let frequency = hello.limits.frequency_millihertz;
    if let Setting::SampleRate { millihertz } = setting
        && frequency > millihertz / 5
    {
        let most = f64::from(millihertz / 5) / 1e3;
        return error(
            format!("at least five samples a period of the frequency limit, {} Hz", f64::from(frequency) / 1e3),
            &format!("First `whirl device set frequency_limit_hz={most}`, or give both, that one first"),
        );
    }
    let (key, unit, value, scaled) = setting_keys::limit(setting, limit);
    let bound = if value < limit { "at least" } else { "at most" };
    error(format!("{key} of {bound} {scaled}{unit}"), "Correct the value")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_of_a_setting_counts() {
        let changes: Vec<Change> =
            ["baud=230400", "settings=built-in", "counts_per_turn=1024", "counts_per_turn2=2048"]
                .iter()
                .map(|text| setting_keys::parse(text, 2).unwrap())
                .collect();
        let counts = |channel, counts| Setting::CountsPerTurn { channel, counts };
        assert_eq!(wanted(&changes), [counts(0, 1024), counts(1, 2048)]);
    }

    #[test]
    fn a_line_that_is_too_narrow_is_told() {
        let told = |change: &str, hello: &Hello| {
            let wanted = if change.is_empty() { Vec::new() } else { setting_keys::parse(change, 2).unwrap().settings };
            narrow(hello, &wanted).map(|warning| format!("{warning:?}"))
        };
        let mut hello = Hello { board: "nucleo-g474re".try_into().unwrap(), baud: 115_200, ..Hello::default() };
        hello.counts_per_turn = [4096, 4096].into_iter().collect();
        hello.sample_rate_millihertz = 500_000;
        // As delivered, and with the base's sensor: docs/wire-protocol.md.
        assert_eq!((told("", &hello), told("base=position", &hello)), (None, None));
        let text = told("sample_rate_hz=2000", &hello).unwrap();
        assert!(text.contains("2 channels at 2000 Hz") && text.contains("baud=921600"), "{text}");
        hello.baud = 921_600;
        assert_eq!(told("sample_rate_hz=2000", &hello), None);
        assert!(told("baud=57600", &hello).is_some());
        let usb = Hello { board: "pico2".try_into().unwrap(), baud: 57_600, ..hello };
        assert_eq!(told("sample_rate_hz=2000", &usb), None);
    }

    #[test]
    fn a_refusal_says_what_could_be() {
        let told = |text: &str, limit: u32, hello: &Hello| {
            let change = setting_keys::parse(text, 2).unwrap();
            refused(&change, change.settings[0], CommandResult::OutOfRange { limit }, hello).to_string()
        };
        let hello = Hello::default();
        let text = told("counts_per_turn1=0", 1, &hello);
        assert!(text.contains("found counts_per_turn1=0, expected counts_per_turn1 of at least 1."), "{text}");
        let text = told("host_timeout_s=100", 60_000, &hello);
        assert!(text.contains("at most 60 s"), "{text}");
        let mut fast = Hello::default();
        fast.limits.frequency_millihertz = 20_000;
        let text = told("sample_rate_hz=50", 10_000, &fast);
        assert!(text.contains("whirl device set frequency_limit_hz=10"), "{text}");
        assert_eq!(at_baud("serial:/dev/ttyACM0@57600", 9), Some("serial:/dev/ttyACM0@9".to_owned()));
        assert_eq!(at_baud("tcp:a:1", 9), None);
    }
}

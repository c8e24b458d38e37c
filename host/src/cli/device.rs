//! `whirl device`: ports and boards, a board's settings, its zero.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Args, Subcommand};
use serde::Serialize;
use whirl_shared::frame::{Command, CommandResult, Hello, SettingsSource, Status, Zero, ZeroSource};

use super::output::{Output, print_warnings};
use super::outputs::Outputs;
use super::{Answer, device_list, device_set};
use crate::capture::setting_keys::{self, SettingValue};
use crate::capture::talk::Talk;
use crate::error::{BadInput, Result, plain};
use crate::record::device_boot::{reset_words, zero_word};
use crate::rig::Rig;
use crate::warning::Warning;

/// The rig behind `--from sim` where no rig file is given.
const SIMULATED: &str = include_str!("../../rigs/chaotic.toml");
/// How long the arms are watched before their place becomes zero.
const WATCHED: Duration = Duration::from_millis(500);
/// Counts by which an encoder trembles about an edge while its arm hangs still.
const STILL: u32 = 2;

/// Arguments of `device`.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
    #[command(flatten)]
    pub(super) link: Link,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Serial ports, and the boards that answer on them.
    List,
    /// A board's settings, zeros, and what ended its last boot.
    Show,
    /// Changes settings, kept in the board's flash: KEY=VALUE as `whirl device show` prints them.
    Set(device_set::Arguments),
    /// Takes the place where the arms are now as zero. Let them hang still before.
    Zero,
}

/// How a device is reached, and where the result goes.
#[derive(Clone, Debug, Args)]
pub struct Link {
    /// Device: serial:/dev/ttyACM0[@BAUD], tcp:HOST:PORT, rtt[:CHIP], sim[:SEED] [default: the one
    /// board that is plugged in].
    #[arg(long, value_name = "SOURCE", global = true)]
    pub(super) from: Option<String>,
    /// Rig file, for --from sim.
    #[arg(long, value_name = "RIG.toml", global = true)]
    rig: Option<PathBuf>,
    /// How long the device may take for an answer, s.
    #[arg(long, value_name = "S", default_value_t = 5.0, global = true)]
    pub(super) handshake_s: f64,
    /// Machine-readable result; `-` for standard output, and nothing else is printed there.
    #[arg(long, value_name = "FILE", global = true)]
    json: Option<PathBuf>,
}

impl Link {
    /// Where results go.
    pub(super) fn out(&self) -> Output {
        Output { json: self.json.clone(), report: None }
    }

    /// The rig file, or the one that stands for it.
    pub(super) fn rig(&self) -> Result<Rig> {
        match &self.rig {
            Some(path) => Rig::read(path),
            None => Rig::parse(SIMULATED, Path::new("rigs/chaotic.toml")),
        }
    }

    /// The source, named or found.
    pub(super) fn source(&self) -> Result<String> {
        match &self.from {
            Some(from) => Ok(from.clone()),
            None => device_list::only_one(),
        }
    }

    /// A conversation with the device, begun by its hello.
    pub(super) fn open(&self) -> Result<(String, Talk, Hello)> {
        let from = self.source()?;
        let mut talk = Talk::open(&from, &self.rig()?, self.handshake_s)?;
        let hello = talk.hello()?;
        Ok((from, talk, hello))
    }
}

/// A device as JSON has it.
#[derive(Debug, Serialize)]
pub(super) struct Device {
    board: String,
    firmware: String,
    protocol: u16,
    boot_id: u32,
    /// What ended the boot before.
    reset: &'static str,
    #[serde(skip_serializing_if = "String::is_empty")]
    panic: String,
    /// Where the settings are from.
    settings_from: &'static str,
    pub(super) settings: Vec<SettingValue>,
    pub(super) encoders: Vec<Encoder>,
}

/// An encoder's zero.
#[derive(Debug, Serialize)]
pub(super) struct Encoder {
    encoder: usize,
    zero_id: u32,
    zero_from: &'static str,
    /// Count within a turn at which the index mark was seen.
    index: Option<u32>,
}

impl Device {
    /// Board and firmware.
    pub(super) fn words(&self) -> String {
        format!("{}, {}", plain(&self.board), plain(&self.firmware))
    }

    pub(super) fn of(hello: &Hello) -> Self {
        Self {
            board: hello.board.as_str().to_owned(),
            firmware: hello.firmware.as_str().to_owned(),
            protocol: hello.protocol,
            boot_id: hello.boot_id,
            reset: reset_words(hello.reset).0,
            panic: hello.panic.as_str().to_owned(),
            settings_from: match hello.settings {
                SettingsSource::BuiltIn => "image",
                SettingsSource::Kept => "flash",
                SettingsSource::Changed => "changed",
                SettingsSource::Refused => "refused",
                SettingsSource::NotKept => "not-kept",
            },
            settings: setting_keys::all_of(hello),
            encoders: hello
                .zeros
                .iter()
                .enumerate()
                .map(|(i, zero)| Encoder {
                    encoder: i + 1,
                    zero_id: zero.id,
                    zero_from: zero_word(zero),
                    index: zero.index,
                })
                .collect(),
        }
    }
}

/// Does what was asked.
pub fn run(arguments: &Arguments) -> Result<Answer> {
    let link = &arguments.link;
    let read = link.rig.iter();
    Outputs::of(&link.out(), None).reads(read).check()?;
    match &arguments.what {
        What::List => device_list::run(link),
        What::Show => show(link),
        What::Set(set) => device_set::run(link, set),
        What::Zero => zero(link),
    }
}

/// What a device's settings are, in a sentence.
fn settings_sentence(source: SettingsSource) -> &'static str {
    match source {
        SettingsSource::BuiltIn => "those of the image",
        SettingsSource::Kept => "those kept in its flash",
        SettingsSource::Changed => "as at its start; others have been kept since and take force at its next start",
        SettingsSource::Refused => "those of the image: those kept in its flash are not possible on this board",
        SettingsSource::NotKept => "as at its start: the last change could not be kept",
    }
}

fn settings_warning(hello: &Hello) -> Option<Warning> {
    let (id, advice) = match hello.settings {
        SettingsSource::Refused => {
            ("settings-refused", "Set what this board can do, or `whirl device set settings=built-in`")
        }
        SettingsSource::NotKept => {
            ("settings-not-kept", "Set it again; where that fails, the board's flash is at fault")
        }
        _ => return None,
    };
    Some(Warning::new(id, format!("the settings are {}", settings_sentence(hello.settings)), advice))
}

/// The board in two lines.
pub(super) fn heading(from: &str, hello: &Hello) -> String {
    format!("{}: {}, protocol {}, at {}\n", plain(&hello.board), plain(&hello.firmware), hello.protocol, plain(from))
}

/// Settings and zeros as a table.
pub(super) fn table(hello: &Hello, device: &Device) -> String {
    let mut text = format!("settings: {}\n", settings_sentence(hello.settings));
    for s in &device.settings {
        // 500 Hz, not 500.0 Hz.
        let number = match (s.value.as_f64(), s.value.as_str()) {
            (Some(x), _) => x.to_string(),
            (None, Some(word)) => word.to_owned(),
            (None, None) => s.value.to_string(),
        };
        let value = format!("{number} {}", s.unit);
        text.push_str(&format!("  {:<24} {value:<14} {}\n", s.key, s.about));
    }
    for zero in device.encoders.iter().zip(&hello.zeros) {
        text.push_str(&format!("encoder {}: {}\n", zero.0.encoder, zero_sentence(zero.1)));
    }
    text
}

fn zero_sentence(zero: &Zero) -> String {
    let from = match zero.source {
        ZeroSource::PowerUp => "zero is where the arm was when the power came (`whirl device zero` sets it)",
        ZeroSource::Commanded => "zero was set by command",
        ZeroSource::Carried => "zero was carried over a reset in which the arm turned, and is off by that turn",
    };
    let index = zero.index.map_or_else(String::new, |index| format!("; index mark at count {index}"));
    format!("{from}; id {:08x}{index}", zero.id)
}

fn show(link: &Link) -> Result<Answer> {
    let (from, mut talk, hello) = link.open()?;
    let (status, counts) = (talk.status()?, talk.counts()?);
    let warnings: Vec<Warning> = settings_warning(&hello).into_iter().collect();
    let device = Device::of(&hello);
    let out = link.out();
    out.write_json(&serde_json::json!({
        "from": from, "device": device, "shaker": shaker_word(&status), "tick": status.tick,
        "counts": counts, "bad_frames": status.bad_frames, "overruns": status.overruns, "warnings": warnings,
    }))?;
    print_warnings(&warnings);
    let rate = f64::from(hello.sample_rate_millihertz.max(1)) / 1e3;
    let mut text = heading(&from, &hello);
    text.push_str(&format!(
        "it has run for {}, since {}; the shaker is {}\n",
        crate::wording::format::duration(f64::from(status.tick) / rate),
        since(&hello),
        shaker_word(&status)
    ));
    text.push_str(&table(&hello, &device));
    let counts: Vec<String> = counts.iter().map(i32::to_string).collect();
    text.push_str(&format!("counts now: {}\n", counts.join(", ")));
    out.say(&text);
    Ok(Answer::Positive)
}

fn since(hello: &Hello) -> String {
    let panic = if hello.panic.is_empty() { String::new() } else { format!(": {}", plain(&hello.panic)) };
    format!("{}{panic}", reset_words(hello.reset).1)
}

fn shaker_word(status: &Status) -> String {
    format!("{:?}", status.shaker).to_lowercase()
}

fn zero(link: &Link) -> Result<Answer> {
    let (from, mut talk, before) = link.open()?;
    let moved = talk.movement(WATCHED);
    match talk.ask(Command::ZeroCounts)? {
        CommandResult::Done => {}
        result => {
            return Err(BadInput::new(format!("{result:?} in answer to ZeroCounts"), "a shaker that does not move")
                .in_file(&from)
                .remedy("End the capture that drives the shaker, let the arms come to rest, and set the zero then"));
        }
    }
    let after = talk.hello()?;
    let same = before.zeros.iter().zip(&after.zeros).any(|(old, new)| old.id == new.id);
    if same || after.zeros.iter().any(|zero| zero.source != ZeroSource::Commanded) {
        return Err(BadInput::new("zeros that are as they were before", "zeros set by command")
            .in_file(&from)
            .remedy("Look at the device's log, and set them again"));
    }
    let mut warnings = Vec::new();
    if let Some(most) = moved.iter().copied().max().filter(|most| *most > STILL) {
        warnings.push(
            Warning::new(
                "arms-move",
                format!(
                    "the arms moved by up to {most} counts in the half second before: zero is where they happened to be"
                ),
                "Let them hang still and set the zero again",
            )
            .with("counts", most),
        );
    }
    if talk.is_simulated() {
        warnings.push(Warning::new(
            "simulated",
            "the simulated board ends with this command, and its zero with it",
            "Name a board, or serve a simulated one over TCP",
        ));
    }
    let device = Device::of(&after);
    let out = link.out();
    let id = after.zeros.first().map_or(0, |zero| zero.id);
    out.write_json(&serde_json::json!({
        "from": from, "zero_id": id, "tick": after.tick, "counts_moved_before": moved,
        "device": device, "warnings": warnings,
    }))?;
    print_warnings(&warnings);
    out.say(&format!(
        "zero set: all encoders count from where they are now (id {id:08x}), until the power goes or zero is set again\n\
         Friction holds an arm beside its lowest point: docs/boards.md tells how to hang it from both sides\n"
    ));
    Ok(Answer::Positive)
}

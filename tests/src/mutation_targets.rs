//! What takes bytes from outside: one entry for each kind of input, as the replays of mutated
//! inputs and the fuzz targets call it.

use std::path::PathBuf;
use std::sync::LazyLock;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;
use whirl::capture::{self, CaptureSettings};
use whirl::error::{BadInput, Result};
use whirl::identify::{self, from_rows};
use whirl::inspect::{InspectSettings, inspect};
use whirl::model::identified::IdentifiedModel;
use whirl::model::model_file::ModelFile;
use whirl::model::model_file::equations_of_motion::EquationsOfMotion;
use whirl::model::model_file::weak_form::WeakForm;
use whirl::record::regression_rows::RowsRecord;
use whirl::record::{ReadOptions, Record, stream};
use whirl::rig::Rig;
use whirl::{simulate, warning::Warning};
use whirl_firmware::{App, QuadratureCounter, Settings, ShakerOutput};
use whirl_hil_sim::Simulation;
use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::frame::{DeviceMessage, Envelope, HostMessage};

use crate::repository;

/// A kind of input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// The wire's decoder, both ways.
    Decoder,
    /// Commands to the firmware.
    Console,
    /// A record as CSV.
    Csv,
    /// A record as gzipped CSV.
    CsvGz,
    /// A record as Parquet.
    Parquet,
    /// A record as NumPy's archive.
    Npz,
    /// A record as MATLAB's file.
    Mat,
    /// A record as HDF5, MATLAB's or another.
    Hdf5,
    /// A record as LabVIEW writes it.
    Lvm,
    /// A rig file.
    Rig,
    /// A model file, or a saved model.
    Model,
    /// The text of an effect.
    Effect,
    /// The wire's bytes, or a journal.
    Frames,
    /// A record of regression rows.
    Rows,
}

impl Input {
    /// Every kind.
    pub const ALL: [Self; 14] = [
        Self::Decoder,
        Self::Console,
        Self::Csv,
        Self::CsvGz,
        Self::Parquet,
        Self::Npz,
        Self::Mat,
        Self::Hdf5,
        Self::Lvm,
        Self::Rig,
        Self::Model,
        Self::Effect,
        Self::Frames,
        Self::Rows,
    ];

    /// Name of its fuzz target.
    pub fn name(self) -> String {
        format!("{self:?}").replace("CsvGz", "csv_gz").to_lowercase()
    }

    fn file(self) -> &'static str {
        match self {
            Self::Csv => "r.csv",
            Self::CsvGz => "r.csv.gz",
            Self::Parquet => "r.parquet",
            Self::Npz => "r.npz",
            Self::Mat => "r.mat",
            Self::Hdf5 => "r.h5",
            Self::Lvm => "r.lvm",
            Self::Rows => "r.rows.jsonl",
            _ => "r.frames",
        }
    }
}

/// How an input is read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Depth {
    /// With `--recover`.
    pub recover: bool,
    /// A record that was read is inspected and identified, too.
    pub analyse: bool,
}

/// A folder and a rig to read inputs with.
pub struct Bench {
    folder: TempDir,
    /// The rig of the records: `rigs/chaotic.toml`, without the time that it takes to settle.
    pub rig: Rig,
}

impl Default for Bench {
    fn default() -> Self {
        Self::new()
    }
}

impl Bench {
    /// A new one, in a folder of its own.
    ///
    /// # Panics
    /// Without a shipped rig file or a folder for temporary files.
    pub fn new() -> Self {
        let path = repository("rigs/chaotic.toml");
        let text = std::fs::read_to_string(&path).expect("a shipped rig file");
        let rig = Rig::parse(&text.replace("settle_s = 20.0", "settle_s = 0.0"), &path).expect("a shipped rig file");
        Self { folder: tempfile::tempdir().expect("a temporary folder"), rig }
    }

    fn written(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join(name);
        std::fs::write(&path, bytes).expect("a temporary file");
        path
    }

    /// Reads an input: it must end in an answer, or in an error of one line. Whether it was read.
    ///
    /// # Panics
    /// Where a message is longer than a line, or brings control characters along.
    pub fn check(&self, input: Input, bytes: &[u8], depth: Depth) -> bool {
        let one_line = |text: &str| {
            assert!(!text.chars().any(char::is_control) && text.len() < 4000, "no single line: {text:?}");
        };
        match self.read(input, bytes, depth) {
            Ok(warnings) => {
                warnings.iter().for_each(|w| one_line(&format!("{} {}", w.text, w.advice)));
                true
            }
            Err(e) => {
                one_line(&e.to_string());
                false
            }
        }
    }

    fn read(&self, input: Input, bytes: &[u8], depth: Depth) -> Result<Vec<Warning>> {
        let text = || String::from_utf8(bytes.to_vec()).map_err(|_| BadInput::new("bytes that are no text", "UTF-8"));
        match input {
            Input::Decoder => Ok(decoder(bytes)),
            Input::Console => Ok(console(bytes)),
            Input::Csv | Input::CsvGz | Input::Parquet | Input::Npz | Input::Mat | Input::Hdf5 | Input::Lvm => {
                self.record(input, bytes, depth)
            }
            Input::Rig => self.rig(&text()?),
            Input::Model => model(&text()?),
            Input::Effect => self.effect(&text()?),
            Input::Frames => self.frames(bytes),
            Input::Rows => {
                let options = ReadOptions { recover: depth.recover, ..ReadOptions::default() };
                let rows = RowsRecord::read(&self.written(input.file(), bytes), &options)?;
                Ok(from_rows::identify(&[rows], &self.rig)?.warnings)
            }
        }
    }

    fn record(&self, input: Input, bytes: &[u8], depth: Depth) -> Result<Vec<Warning>> {
        let path = self.written(input.file(), bytes);
        let options = ReadOptions { recover: depth.recover, ..ReadOptions::default() };
        if matches!(input, Input::Csv | Input::CsvGz | Input::Parquet) {
            let mut samples = 0;
            let summary = stream::read(&path, &self.rig, &options, &mut |block| samples += block.columns[0].len());
            if let Ok(summary) = summary {
                assert_eq!(summary.losses.received, samples as u64);
            }
        }
        let record = Record::read(&path, &self.rig, &options)?;
        let mut warnings = record.warnings.clone();
        if depth.analyse {
            for answer in [
                inspect(&record, &self.rig, &InspectSettings::default()).map(|i| i.warnings),
                identify::identify(&[record], &self.rig, &identify::Settings::default()).map(|i| i.warnings),
            ] {
                match answer {
                    Ok(found) => warnings.extend(found),
                    Err(e) => warnings.push(Warning::new("refused", e.to_string(), "")),
                }
            }
        }
        Ok(warnings)
    }

    fn rig(&self, text: &str) -> Result<Vec<Warning>> {
        let rig = Rig::parse(text, &repository("rigs/mutated.toml"))?;
        if rig.bound.is_some() {
            // A system of a model file: it is not simulated in physical units.
            return Ok(Vec::new());
        }
        let mut settings = simulate::settings(&rig, &[], 0.02, 1)?;
        // A day of settling is allowed, and takes its time.
        settings.settle_s = settings.settle_s.min(0.1);
        run(&settings)
    }

    fn effect(&self, text: &str) -> Result<Vec<Warning>> {
        run(&simulate::settings(&self.rig, &[text.to_owned()], 0.02, 1)?)
    }

    fn frames(&self, bytes: &[u8]) -> Result<Vec<Warning>> {
        let path = self.written("wire.frames", bytes);
        let output = self.folder.path().join("made.parquet");
        // Whatever the round before left.
        let _ = std::fs::remove_file(&output);
        let settings = CaptureSettings::new(format!("file:{}", path.display()), &output);
        Ok(capture::run(&settings, &self.rig, &mut |_| {})?.warnings)
    }
}

/// Tries an input as a fuzz target does: in a bench of the process's own.
///
/// # Panics
/// As [`Bench::check`].
pub fn one(input: Input, bytes: &[u8]) {
    static BENCH: LazyLock<Bench> = LazyLock::new(Bench::new);
    BENCH.check(input, bytes, Depth { recover: bytes.len() % 2 == 1, analyse: false });
}

/// A few samples of a simulation, if it can be had at all.
fn run(settings: &whirl_hil_sim::SimulationSettings) -> Result<Vec<Warning>> {
    let fail = |e: whirl_hil_sim::SimulationError| BadInput::new(e.to_string(), "");
    let mut simulation = Simulation::new(settings).map_err(fail)?;
    for _ in 0..3 {
        simulation.next_sample().map_err(fail)?;
    }
    Ok(Vec::new())
}

fn model(text: &str) -> Result<Vec<Warning>> {
    let saved = IdentifiedModel::parse(text);
    match ModelFile::parse(text, &repository("models/mutated.toml")) {
        Ok(model) => {
            EquationsOfMotion::new(&model, 2.0)?;
            WeakForm::new(&model, 2.0, &vec![Vec::new(); model.equations.len()])?;
            Ok(Vec::new())
        }
        Err(e) => {
            let told = e.to_string();
            assert!(!told.chars().any(char::is_control), "no single line: {told:?}");
            saved.map(|_| Vec::new())
        }
    }
}

/// Both decoders: every byte is accounted for, whatever decodes encodes again.
fn decoder(bytes: &[u8]) -> Vec<Warning> {
    let mut device: Decoder<DeviceMessage> = Decoder::new();
    let mut host: Decoder<HostMessage> = Decoder::new();
    let mut out = [0; MAX_FRAME];
    for &byte in bytes {
        if let Some(Ok(envelope)) = device.push(byte) {
            encode(&envelope, &mut out).expect("a decoded message fits into the longest frame");
        }
        if let Some(Ok(envelope)) = host.push(byte) {
            encode(&envelope, &mut out).expect("a decoded message fits into the longest frame");
        }
    }
    for (counters, pending) in [(device.counters(), device.pending_bytes()), (host.counters(), host.pending_bytes())] {
        assert!(counters.bytes_discarded + pending <= bytes.len() as u64);
    }
    Vec::new()
}

struct Still;

impl QuadratureCounter for Still {
    fn count(&mut self) -> u16 {
        0
    }
}

/// The base's greatest displacement that was asked for, nm.
struct Displacement(i64);

impl ShakerOutput for Displacement {
    type Error = core::convert::Infallible;

    fn write(&mut self, displacement_nanometre: i32) -> core::result::Result<(), Self::Error> {
        self.0 = self.0.max(i64::from(displacement_nanometre).abs());
        Ok(())
    }
}

/// The firmware, which gets these bytes between its ticks: the base never leaves its limits, and
/// what is sent decodes.
fn console(bytes: &[u8]) -> Vec<Warning> {
    let settings = Settings::default();
    let mut app = App::new(settings.clone(), (Still, Still), Displacement(0)).expect("the default settings");
    let mut host: Decoder<DeviceMessage> = Decoder::new();
    let mut out = [0; MAX_FRAME];
    // What came at once, then what comes slowly; then half a second for a command to take effect.
    for part in bytes.chunks(64).chain(std::iter::repeat_n(&[][..], 50)) {
        app.receive(part);
        for _ in 0..5 {
            app.tick(0, 0);
        }
        while let Some(n) = app.poll_transmit(&mut out) {
            for &byte in &out[..n] {
                assert!(host.push(byte).is_none_or(|frame| frame.is_ok()), "the firmware sends what does not decode");
            }
        }
    }
    let most = i64::from(settings.limits.amplitude_micrometre) * 1000;
    assert!(app.output_mut().0 <= most + 1, "{} nm", app.output_mut().0);
    Vec::new()
}

/// The wire's bytes with what its messages say changed, each frame whole: the decoder lets them
/// through.
pub fn rewritten(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut decoder: Decoder<DeviceMessage> = Decoder::new();
    let mut messages: Vec<Envelope<DeviceMessage>> =
        bytes.iter().filter_map(|byte| decoder.push(*byte)?.ok()).collect();
    let numbers = [0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX, rng.random()];
    for _ in 0..rng.random_range(1..=4) {
        let (i, j) = (rng.random_range(0..messages.len()), rng.random_range(0..messages.len()));
        let x = numbers[rng.random_range(0..numbers.len())];
        match rng.random_range(0..5) {
            0 => messages.swap(i, j),
            1 => messages.insert(i, messages[j].clone()),
            2 => drop((messages.len() > 1).then(|| messages.remove(i))),
            3 => messages[i].sequence = x as u16,
            _ => rewrite(&mut messages[i].message, x, rng),
        }
    }
    let mut out = vec![0];
    for message in &messages {
        let mut frame = [0; MAX_FRAME];
        if let Ok(n) = encode(message, &mut frame) {
            out.extend(&frame[..n]);
        }
    }
    out
}

fn rewrite(message: &mut DeviceMessage, x: u32, rng: &mut ChaCha8Rng) {
    match message {
        DeviceMessage::Hello(h) => match rng.random_range(0..6) {
            0 => h.boot_id = x,
            1 => h.tick = x,
            2 => h.sample_rate_millihertz = x,
            3 => h.protocol = x as u16,
            4 => h.counts_per_turn.iter_mut().for_each(|n| *n = x),
            // Longer texts do not fit, which is as good.
            _ => drop(h.firmware.push_str("\x1b[2J\n\u{202e}")),
        },
        DeviceMessage::Samples(s) | DeviceMessage::Restored(s) => match rng.random_range(0..6) {
            0 => s.first_tick = x,
            1 => s.phase_increment = x,
            2 => s.amplitude_nanometre = x,
            3 => s.first.iter_mut().take(1).for_each(|c| *c = x.cast_signed()),
            4 => s.deltas.iter_mut().skip(1).step_by(2).for_each(|d| *d = x as i16),
            _ => s.deltas.truncate(x as usize % 8),
        },
        DeviceMessage::Status(s) => match rng.random_range(0..5) {
            0 => s.tick = x,
            1 => s.overruns = x,
            2 => s.dropped_samples = x,
            3 => s.kept_from = x,
            _ => s.samples_sent = x,
        },
        DeviceMessage::Log(l) => drop(l.text.push_str("\x1b[2J\nINFO all is well")),
        DeviceMessage::Ack(a) => a.command_sequence = x as u16,
        _ => {}
    }
}

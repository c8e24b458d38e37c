//! An input of every kind that is whole: what mutations start from.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use flate2::write::GzEncoder;
use flate2::{Compression, Crc};
use parquet::basic::Compression as Codec;
use parquet::data_type::{DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use whirl::capture::{self, CaptureSettings, journal};
use whirl::record::{Column, ReadOptions, Record};
use whirl_shared::codec::{MAX_FRAME, encode};
use whirl_shared::frame::{Command, Envelope, HostMessage, Streamed};

use crate::mutation::mutated;
use crate::mutation_targets::{Bench, Input, rewritten};
use crate::repository;

/// Texts of effects.
const EFFECTS: [&str; 6] = [
    "quadratic-drag@arm2=2e-7",
    "stribeck-friction@joint1=1e-4,v_s=0.5",
    "cogging@joint1=1e-4,n=7,psi=0.3",
    "channel-delay@encoder2=0.002",
    "eccentricity@encoder1=0.01,psi=1",
    "amplitude-drift@drive=0.02",
];

/// A saved model with effects.
const SAVED: &str = r#"name = "double pendulum on a shaker"
model = "double-pendulum"
method = "weak"
drive_frequency_hz = 5.0
nominal = ["coulomb-friction@joint1", "viscous-friction@joint2"]

[parameters]
B11 = { value = 0.1695, std_error = 1e-4, unit = "1" }
B21 = { value = 1.68, std_error = 1e-3, unit = "1" }
C2 = { value = 0.0485, std_error = 5e-324, unit = "1" }

[[effect]]
id = "quadratic-drag"
at = "arm2"
value = 2.0e-7
std_error = 5.0e-10
unit = "N m s²"
strengths = [0.0051, -1e-17]
parameters = { v_s = 0.5 }
"#;

/// Whole inputs.
pub struct Samples {
    csv: Vec<u8>,
    own_csv: Vec<u8>,
    parquet: Vec<u8>,
    foreign: Vec<u8>,
    columns: [Vec<f64>; 3],
    frames: Vec<u8>,
    rows: Vec<u8>,
    rigs: Vec<Vec<u8>>,
    models: Vec<Vec<u8>>,
    hdf5: Vec<Vec<u8>>,
    lvm: Vec<u8>,
    commands: Vec<u8>,
}

impl Samples {
    /// Makes them: a short capture of the simulated rig, and the files that ship.
    ///
    /// # Panics
    /// Where that cannot be done.
    pub fn new(bench: &Bench) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let captured = |name: &str, seconds: f64, rows: bool| {
            let output = folder.path().join(name);
            let settings = CaptureSettings {
                seconds: Some(seconds),
                rows,
                keep_frames: true,
                ..CaptureSettings::new("sim:1", &output)
            };
            capture::run(&settings, &bench.rig, &mut |_| {}).expect("a capture");
            std::fs::read(output).expect("a record")
        };
        let parquet = captured("r.parquet", 10.0, false);
        let own_csv = captured("r.csv", 2.0, false);
        let rows = captured("r.rows.jsonl", 14.0, true);
        let path = folder.path().join("r.parquet");
        let record = Record::read(&path, &bench.rig, &ReadOptions::default()).expect("a record");
        let segment = &record.segments[0];
        let column = |k: usize| match &segment.columns[k] {
            Column::Counts(c) => c.iter().map(|c| f64::from(*c)).collect(),
            Column::Values(v) => v.clone(),
        };
        let columns: [Vec<f64>; 3] = [(0..segment.len()).map(|i| segment.time(i)).collect(), column(0), column(1)];
        let mut csv = b"t,count1,count2\n".to_vec();
        for ((t, a), b) in columns[0].iter().zip(&columns[1]).zip(&columns[2]) {
            csv.extend(format!("{t:.3},{a},{b}\n").bytes());
        }
        Self {
            csv,
            own_csv,
            parquet,
            foreign: foreign(&folder.path().join("f.parquet"), &columns),
            lvm: lvm(&columns),
            columns,
            hdf5: shipped("tests/golden/records", &["plain-7.3.mat", "octave.h5"]),
            frames: std::fs::read(journal::path_of(&path)).expect("a journal"),
            rows,
            rigs: shipped("rigs", &["chaotic.toml", "seed.toml", "single-pendulum.toml", "emps.toml"]),
            models: shipped("models", &["positioning-drive.toml", "triple-pendulum.toml", "duffing.toml"]),
            commands: commands(),
        }
    }

    /// The whole input that round `rng` starts from.
    pub fn whole(&self, input: Input, rng: &mut ChaCha8Rng) -> Vec<u8> {
        let any = |of: &[Vec<u8>], rng: &mut ChaCha8Rng| of[rng.random_range(0..of.len())].clone();
        match input {
            Input::Decoder | Input::Frames => self.frames.clone(),
            Input::Console => self.commands.clone(),
            Input::Csv => if rng.random() { &self.csv } else { &self.own_csv }.clone(),
            Input::CsvGz => gzip(&self.csv),
            Input::Parquet => if rng.random() { &self.parquet } else { &self.foreign }.clone(),
            Input::Npz => npz(&self.columns.each_ref().map(|c| npy(c))),
            Input::Mat => mat(&self.columns, rng.random()),
            Input::Hdf5 => any(&self.hdf5, rng),
            Input::Lvm => self.lvm.clone(),
            Input::Rig => any(&self.rigs, rng),
            Input::Model if rng.random_range(0..3) == 0 => SAVED.as_bytes().to_vec(),
            Input::Model => any(&self.models, rng),
            Input::Effect => EFFECTS[rng.random_range(0..EFFECTS.len())].as_bytes().to_vec(),
            Input::Rows => self.rows.clone(),
        }
    }

    /// A spoilt input. Where a checksum or a compression stands around the contents, these are
    /// spoilt before in half of the rounds.
    pub fn spoilt(&self, input: Input, rng: &mut ChaCha8Rng) -> Vec<u8> {
        match input {
            Input::CsvGz if rng.random() => gzip(&mutated(&self.csv, rng)),
            Input::Npz if rng.random() => {
                let mut arrays = self.columns.each_ref().map(|c| npy(c));
                let k = rng.random_range(0..3);
                arrays[k] = mutated(&arrays[k], rng);
                npz(&arrays)
            }
            Input::Frames if rng.random() => rewritten(&self.frames, rng),
            _ => mutated(&self.whole(input, rng), rng),
        }
    }
}

fn shipped(folder: &str, names: &[&str]) -> Vec<Vec<u8>> {
    let read = |name: &&str| std::fs::read(repository(folder).join(name)).expect("a shipped file");
    names.iter().map(read).collect()
}

fn commands() -> Vec<u8> {
    let start = Command::Start { amplitude_micrometre: 5000, frequency_millihertz: 5000 };
    let list = [
        Command::Hello,
        Command::SetRamp { micrometre_per_s: 20_000 },
        Command::SetHostTimeout { ms: 2000 },
        Command::ZeroCounts,
        Command::Arm,
        start,
        Command::KeepAlive,
        Command::Stream(Streamed::Rows),
        Command::Status,
        Command::Start { amplitude_micrometre: u32::MAX, frequency_millihertz: 1 },
        Command::Stop,
        Command::Disarm,
    ];
    let mut out = Vec::new();
    for (sequence, command) in (0..).zip(list) {
        let mut frame = [0; MAX_FRAME];
        let envelope = Envelope { sequence, message: HostMessage::Command(command) };
        let n = encode(&envelope, &mut frame).expect("a command fits");
        out.extend(&frame[..n]);
    }
    out
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = GzEncoder::new(Vec::new(), Compression::fast());
    out.write_all(bytes).and_then(|()| out.finish()).expect("memory")
}

/// A Parquet file as others write it: row groups of 2000 rows in pages of 500, through
/// dictionaries.
fn foreign(path: &Path, columns: &[Vec<f64>; 3]) -> Vec<u8> {
    let schema = "message m { required double t; required int64 count1; optional double count2; }";
    let schema = Arc::new(parse_message_type(schema).expect("a schema"));
    let properties = WriterProperties::builder()
        .set_compression(Codec::SNAPPY)
        .set_data_page_row_count_limit(500)
        .set_write_batch_size(500)
        .build();
    let file = File::create(path).expect("a temporary file");
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties)).expect("a Parquet file");
    let n = columns[0].len();
    for from in (0..n).step_by(2000) {
        let rows = from..(from + 2000).min(n);
        let whole: Vec<i64> = columns[1][rows.clone()].iter().map(|c| *c as i64).collect();
        let mut group = writer.next_row_group().expect("a row group");
        let mut t = group.next_column().expect("a column").expect("a column");
        t.typed::<DoubleType>().write_batch(&columns[0][rows.clone()], None, None).expect("a page");
        t.close().expect("a column");
        let mut first = group.next_column().expect("a column").expect("a column");
        first.typed::<Int64Type>().write_batch(&whole, None, None).expect("a page");
        first.close().expect("a column");
        let mut second = group.next_column().expect("a column").expect("a column");
        let there = vec![1; rows.len()];
        second.typed::<DoubleType>().write_batch(&columns[2][rows], Some(&there), None).expect("a page");
        second.close().expect("a column");
        group.close().expect("a row group");
    }
    writer.close().expect("a footer");
    std::fs::read(path).expect("a Parquet file")
}

fn npy(column: &[f64]) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({},), }}", column.len());
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.bytes());
    out.extend(column.iter().flat_map(|x| x.to_le_bytes()));
    out
}

/// An archive of the arrays t, count1 and count2, stored.
fn npz(arrays: &[Vec<u8>; 3]) -> Vec<u8> {
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    for (name, data) in ["t.npy", "count1.npy", "count2.npy"].iter().zip(arrays) {
        let mut crc = Crc::new();
        crc.update(data);
        let length = (data.len() as u32).to_le_bytes();
        let mut common = vec![20, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        common.extend(crc.sum().to_le_bytes());
        common.extend([length, length].concat());
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0; 2]);
        let offset = out.len() as u32;
        out.extend(b"PK\x03\x04");
        out.extend(&common);
        out.extend(name.bytes());
        out.extend(data);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&common);
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.bytes());
    }
    let (at, size) = (out.len() as u32, directory.len() as u32);
    out.extend(directory);
    out.extend(b"PK\x05\x06\0\0\0\0\x03\0\x03\0");
    out.extend(size.to_le_bytes());
    out.extend(at.to_le_bytes());
    out.extend([0; 2]);
    out
}

/// A LabVIEW measurement of the columns t, count1 and count2, in two segments.
fn lvm(columns: &[Vec<f64>; 3]) -> Vec<u8> {
    let end = "***End_of_Header***\t\n";
    let mut out = format!(
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n{end}\t\n"
    );
    for i in 0..1000 {
        if i % 500 == 0 {
            out += &format!(
                "Channels\t2\nDate\t2026/11/23\nTime\t12:00:0{}.25\nX0\t0\nDelta_X\t0.002\n{end}X_Value\tcount1\tcount2\tComment\n",
                i / 500
            );
        }
        out += &format!("{:.3}\t{}\t{}\n", columns[0][i % 500], columns[1][i], columns[2][i]);
    }
    out.into_bytes()
}

/// A MATLAB file of version 5 with the variables t, count1 and count2, or with t and a structure of
/// the two others.
fn mat(columns: &[Vec<f64>; 3], structure: bool) -> Vec<u8> {
    let element = |kind: u32, data: &[u8]| {
        let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
        out.extend(data);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    };
    let head = |class: u32, rows: usize, name: &str| {
        let sizes = [(rows as u32).to_le_bytes(), 1_u32.to_le_bytes()].concat();
        [element(6, &[class.to_le_bytes(), [0; 4]].concat()), element(5, &sizes), element(1, name.as_bytes())].concat()
    };
    let array = |name: &str, column: &[f64]| {
        let numbers: Vec<u8> = column.iter().flat_map(|x| x.to_le_bytes()).collect();
        element(14, &[head(6, column.len(), name), element(9, &numbers)].concat())
    };
    let mut out = b"MATLAB 5.0 MAT-file, written by a test".to_vec();
    out.resize(124, b' ');
    out.extend([0, 1, b'I', b'M']);
    out.extend(array("t", &columns[0]));
    if structure {
        let names = [&b"count1\0\0"[..], b"count2\0\0"].concat();
        let fields = [element(5, &8_u32.to_le_bytes()), element(1, &names)].concat();
        let parts = [array("", &columns[1]), array("", &columns[2])].concat();
        out.extend(element(14, &[head(2, 1, "run"), fields, parts].concat()));
    } else {
        out.extend(array("count1", &columns[1]));
        out.extend(array("count2", &columns[2]));
    }
    out
}

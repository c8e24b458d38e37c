//! The wire's documentation: a decoder in Python that was written from it (`tests/wire/decode.py`)
//! reads what the firmware sends as the program's own does.

use std::io::Write;
use std::process::{Command as Process, Stdio};

use serde_json::{Value, json};
use whirl::capture::excite::Excite;
use whirl::capture::{self, CaptureSettings};
use whirl::rig::Rig;
use whirl_firmware::Settings;
use whirl_hil_sim::emulated::{Script, on_this_machine};
use whirl_hil_sim::{BaseQuantity, BaseSettings, RigSettings, VirtualRig};
use whirl_shared::codec::Decoder;
use whirl_shared::excitation::{Component, Excitation, Glide, Law, Table};
use whirl_shared::frame::regression::{EquationEstimate, Unknown};
use whirl_shared::frame::{
    BaseKind, BaseSensor, Command, CommandResult, DeviceMessage, Excited, Hello, PROTOCOL_VERSION, SCHEMA, SCHEMA_HASH,
    SampleBlock, Setting, Status, Streamed, Zero,
};

/// What the Python decoder reads, a value each frame; none where there is no Python.
fn in_python(frames: &[u8]) -> Option<Vec<Value>> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/wire/decode.py");
    let started = Process::new("python3").arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let Ok(mut python) = started else {
        eprintln!("did not run: no python3");
        return None;
    };
    let mut input = python.stdin.take().unwrap();
    let bytes = frames.to_vec();
    let writer = std::thread::spawn(move || input.write_all(&bytes));
    let output = python.wait_with_output().unwrap();
    writer.join().unwrap().unwrap();
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    Some(text.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
}

fn hello(h: &Hello) -> Value {
    let zero = |zero: &Zero| json!([zero.id, zero.source as u32, zero.index]);
    let limits = h.limits;
    json!([
        [u32::from(h.protocol), h.schema, h.boot_id, h.tick],
        h.firmware,
        h.board,
        h.sample_rate_millihertz,
        h.counts_per_turn,
        h.block_len,
        [
            limits.amplitude_micrometre,
            limits.frequency_millihertz,
            limits.ramp_micrometre_per_s,
            limits.acceleration_millimetre_per_s2,
            h.host_timeout_ms
        ],
        h.zeros.iter().map(zero).collect::<Vec<_>>(),
        h.reset as u32,
        h.panic,
        h.reversed.iter().copied().map(u8::from).collect::<Vec<_>>(),
        [h.full_scale_micrometre, h.baud, h.settings as u32],
        [h.base.kind as u32, h.base.scale],
    ])
}

fn block(b: &SampleBlock) -> Value {
    json!([[b.first_tick, b.phase, b.phase_increment, b.amplitude_nanometre], b.first, b.deltas])
}

fn status(s: &Status) -> Value {
    let counters = [s.tick, s.overruns, s.dropped_samples, s.dropped_frames, s.bad_frames, s.rejected_commands];
    let rest = [
        s.samples_sent,
        s.shaker as u32,
        s.stop_cause as u32,
        s.amplitude_nanometre,
        s.frequency_millihertz,
        s.latency_max_us,
    ];
    let counters = [&counters[..], &rest[..]].concat();
    json!([counters, s.rms_angle_mrad, s.turns_per_minute_milli, s.kept_from])
}

fn excited(excited: &Excited) -> Value {
    let e = &excited.excitation;
    let glide = &e.glide;
    let mut words = vec![glide.to_millihertz, glide.ms];
    words.extend(e.amplitudes_micrometre);
    let form: Vec<Value> = e.form.0.iter().map(|c| json!([c.harmonic, c.share, c.phase])).collect();
    json!([
        [excited.tick, e.frequency_millihertz, glide.law as u32],
        u8::from(glide.back),
        words,
        e.steps,
        e.hold_ms,
        form,
        u8::from(e.on_trigger),
        [u32::from(e.table.points), e.table.check]
    ])
}

fn equation<const N: usize>(equation: &EquationEstimate<[Unknown; N]>) -> Value {
    let float = |bytes: [u8; 4]| f64::from(f32::from_le_bytes(bytes));
    match equation {
        EquationEstimate::Known { unknowns, condition, residual_rms } => {
            let mut all = vec![json!(0)];
            all.extend(unknowns.iter().flat_map(|u| [u.value, u.std_error]).map(|x| json!(float(x.0))));
            all.extend([condition, residual_rms].map(|x| json!(float(x.0))));
            json!(all)
        }
        EquationEstimate::TooFewWindows => json!([1]),
        EquationEstimate::Undetermined(place) => json!([2, place]),
        EquationEstimate::Repeating => json!([3]),
    }
}

fn in_rust(frames: &[u8]) -> Vec<Value> {
    let mut decoder = Decoder::<DeviceMessage>::new();
    let envelopes = frames.iter().filter_map(|&byte| decoder.push(byte)).map(Result::unwrap);
    let fields = |message: &DeviceMessage| match message {
        DeviceMessage::Hello(h) => (0, hello(h)),
        DeviceMessage::Samples(b) => (1, block(b)),
        DeviceMessage::Restored(b) => (7, block(b)),
        DeviceMessage::BackFilled(end) => (8, json!([end.first_tick, end.ticks, end.samples])),
        DeviceMessage::Excited(e) => (9, excited(e)),
        DeviceMessage::Status(s) => (2, status(s)),
        DeviceMessage::Ack(ack) => {
            let command = ack.command_sequence;
            let told = match ack.result {
                CommandResult::Done => json!([command, 0]),
                CommandResult::OutOfRange { limit } => json!([command, 1, limit]),
                CommandResult::WrongState => json!([command, 2]),
                CommandResult::Unsupported => json!([command, 3]),
            };
            (3, told)
        }
        DeviceMessage::Log(log) => (4, json!([log.tick, log.level, log.text])),
        DeviceMessage::Estimate(e) => {
            let head = [
                e.tick,
                e.window_ticks,
                e.windows,
                e.forget_per_mille.into(),
                e.phase_increment,
                e.amplitude_nanometre,
            ];
            (5, json!([head, equation(&e.first), equation(&e.second)]))
        }
        DeviceMessage::Rows(r) => {
            let float = |b: [u8; 3]| f64::from(f32::from_le_bytes([0, b[0], b[1], b[2]]));
            let rows: Vec<Vec<f64>> = r.rows.iter().map(|row| row.iter().map(|x| float(x.0)).collect()).collect();
            let head = [r.tick, r.window_ticks, r.window, r.phase_increment, r.amplitude_nanometre];
            let m = [r.frequency, r.last_frequency];
            (6, json!([head, m, rows]))
        }
    };
    envelopes
        .map(|envelope| {
            let (id, fields) = fields(&envelope.message);
            json!([envelope.sequence, id, fields])
        })
        .collect()
}

/// Floats went through decimal digits: they are to be the same as single ones.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
        (Value::Number(x), Value::Number(y)) if x.is_f64() || y.is_f64() => {
            x.as_f64().map(|x| x as f32) == y.as_f64().map(|y| y as f32)
        }
        _ => a == b,
    }
}

#[test]
fn a_decoder_written_from_the_documentation_reads_every_message() {
    let settings = Command::Set(Setting::AmplitudeLimit { micrometre: 30_000_000 });
    let script = Script::new()
        .command(10, settings)
        .command(20, Command::Set(Setting::Reversed { channel: 1, reversed: true }))
        .command(30, Command::ZeroCounts)
        .drive(40, 9_000, 400, 15_525, 5_000)
        .command(5_000, Command::Stream(Streamed::Rows))
        .command(7_500, Command::Stream(Streamed::Samples))
        .command(7_600, Command::ZeroCounts)
        .command(8_000, Command::BackFill { boot_id: 1, first_tick: 3_995, ticks: 60 });
    let mut frames = on_this_machine(&RigSettings::default(), &script, 12_000).unwrap();
    // After a silence of the host, and a restart by the watchdog: log lines.
    let mut rig = VirtualRig::new(&RigSettings::default()).unwrap();
    rig.restart().unwrap();
    (0..100).for_each(|_| rig.step().unwrap());
    frames.extend(rig.take_output());
    // A third channel: the base's.
    let sensor =
        BaseSettings { quantity: BaseQuantity::Position, scale: 1e-6, gain: 1.0, offset: 2e-3, noise: 5e-6, seed: 1 };
    let base = BaseSensor { kind: BaseKind::Position, scale: 1_000_000 };
    let device = Settings { base, ..RigSettings::default().device };
    let three = RigSettings { base: Some(sensor), device, ..RigSettings::default() };
    frames.extend(on_this_machine(&three, &Script::new().drive(10, 900, 400, 9_000, 5_000), 1_000).unwrap());
    // Something else than a sine.
    let mut excitation = Excitation::sine(5_000, 2_000);
    excitation.glide = Glide { law: Law::Logarithmic, back: true, to_millihertz: 4_000, ms: 1_500 };
    (excitation.steps, excitation.hold_ms, excitation.amplitudes_micrometre[1]) = (2, 400, 3_000);
    excitation.form.0[0].share = 20_000;
    excitation.form.0[1] = Component { harmonic: 3, share: 10_000, phase: 40_000 };
    let script = Script::new().command(10, Command::Arm);
    let all = excitation.commands().into_iter().zip(20..);
    let script = all.fold(script, |script, (command, tick)| script.command(tick, command));
    frames.extend(on_this_machine(&RigSettings::default(), &script, 900).unwrap());
    // And a table.
    let points: Vec<i16> = (0..20_i16).map(|j| 700 * (j - 10).abs()).collect();
    let table = Table::of(&points).unwrap();
    let named = Excitation { table: table.known().name, ..Excitation::sine(4_000, 2_000) };
    let all = table.parts().map(Command::Prepare).chain(named.commands());
    let script = Script::new().command(10, Command::Arm);
    let script = all.zip(20..).fold(script, |script, (command, tick)| script.command(tick, command));
    frames.extend(on_this_machine(&RigSettings::default(), &script, 900).unwrap());
    let Some(read) = in_python(&frames) else { return };
    let wanted = in_rust(&frames);
    assert_eq!(read.len(), wanted.len());
    for (n, (read, wanted)) in read.iter().zip(&wanted).enumerate() {
        assert!(same(read, wanted), "frame {n}: {read} for {wanted}");
    }
    let channels = |frame: &&Value| frame[1] == 1 && frame[2][1].as_array().is_some_and(|first| first.len() == 3);
    assert!(read.iter().filter(channels).count() > 90);
    // Its points and FNV-1a, which the documentation names.
    let check = points.iter().fold(0x811c_9dc5_u32, |h, c| (h ^ u32::from(*c as u16)).wrapping_mul(0x0100_0193));
    assert!(read.iter().any(|frame| frame[1] == 9 && frame[2][7] == json!([20, check])));
    let seen: std::collections::BTreeSet<u64> = read.iter().map(|frame| frame[1].as_u64().unwrap()).collect();
    assert_eq!(seen.into_iter().collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
}

/// A capture's journal: its header is what the page says, and what follows are the wire's frames.
#[test]
fn a_journal_s_header_and_frames_are_read_by_the_same_decoder() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let rig = Rig::read(root.join("rigs/measured-base.toml")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let points = folder.path().join("table.csv");
    std::fs::write(&points, (0..16).map(|j| format!("{}\n", 1e-4 * f64::from((j - 8_i32).abs()))).collect::<String>())
        .unwrap();
    let mut settings = CaptureSettings::new("sim", folder.path().join("record.parquet"));
    (settings.seconds, settings.settle_s, settings.keep_frames) = (Some(2.0), Some(0.5), true);
    settings.amplitude_m = Some(0.001);
    settings.excite = Excite { table: Some(points), ..Excite::default() };
    capture::run(&settings, &rig, &mut |_| {}).unwrap();
    let journal = std::fs::read(folder.path().join("record.parquet.frames")).unwrap();
    let body = journal.iter().position(|&byte| byte == 0).unwrap() + 1;
    assert!(journal.starts_with(b"whirl-frames 1 {") && body <= 65_536);
    let Some(read) = in_python(&journal) else { return };
    let (header, frames) = (&read[0], &read[1..]);
    assert_eq!((&header["source"], &header["seconds"], &header["settle_s"]), (&json!("sim"), &json!(2.0), &json!(0.5)));
    // Amplitude and frequency, and the control points that the device was brought: it tells them, too.
    let told = frames.iter().find(|frame| frame[1] == 9).unwrap();
    assert_eq!(header["from_drive"], json!([told[2][2][2], told[2][0][1]]));
    assert_eq!(header["table"].as_array().map(Vec::len), told[2][7][0].as_u64().map(|n| n as usize));
    let text = include_str!("../../docs/wire-protocol.md").split_once("\n## In a file\n").unwrap().1;
    for key in header.as_object().unwrap().keys() {
        assert!(text.contains(&format!("`{key}`")), "the page does not tell of \"{key}\"");
    }
    let wanted = in_rust(&journal[body..]);
    assert!(frames.len() == wanted.len() && frames.iter().zip(&wanted).all(|(read, wanted)| same(read, wanted)));
    let samples = frames.iter().filter(|frame| frame[1] == 1).count();
    assert!(samples > 100 && frames.iter().all(|frame| frame[1] != 3), "{samples} blocks, and answers");
    // Zeros that stand alone, as where a link was lost, are no frames.
    let (head, rest) = journal.split_at(body);
    assert_eq!(in_python(&[head, b"\0\0", rest].concat()).unwrap().len(), read.len());
}

#[test]
fn the_documentation_names_the_protocol_and_its_schema() {
    let text = include_str!("../../docs/wire-protocol.md");
    assert!(text.starts_with(&format!("# Wire protocol {PROTOCOL_VERSION}\n")));
    assert!(text.contains(&format!("`{SCHEMA_HASH:08x}`")), "the schema's hash is {SCHEMA_HASH:08x}");
    // Every command by its number.
    for n in 0..=15 {
        assert!(text.contains(&format!("\n| {n} |")), "command {n}");
    }
    assert!(SCHEMA.starts_with("whirl 6;"));
}

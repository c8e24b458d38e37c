//! Excitation beyond one sine on the emulated board: what stands at the shaker's output is, tick by
//! tick and bit for bit, what the firmware on this machine puts there and what a host makes of the
//! stream.

use whirl_firmware::lock_step::Order;
use whirl_hil_sim::emulated::{
    Emulation, EmulatorSettings, Script, Sent, board_settings, run, watched_on_this_machine,
};
use whirl_hil_sim::shaker::CommandShape;
use whirl_shared::block::samples;
use whirl_shared::codec::Decoder;
use whirl_shared::excitation::{Component, Excitation, Form, Glide, Law, MOST_COMPONENTS, Table, WHOLE};
use whirl_shared::frame::{Command, CommandResult, DeviceMessage, SampleBlock, ShakerState};

use crate::image;

/// Ticks of each excitation: its commands, its motion, its stop.
const EACH: u32 = 2_400;
/// When it is told to stop; the ramp down takes 225 ticks.
const STOP: u32 = 2_100;

/// As sharp as the limits allow about, an offset, and a number of points that a chunk does not
/// divide.
fn table() -> Table {
    let points: Vec<i16> = (0..100_i32).map(|j| (j * 7_919 % 401 - 200 + 200 * (j - 50).abs()) as i16).collect();
    Table::of(&points).unwrap()
}

fn excitations() -> Vec<(Excitation, Option<Table>)> {
    let sweep = |law| Excitation {
        glide: Glide { law, back: true, to_millihertz: 8_000, ms: 1_500 },
        ..Excitation::sine(5_000, 2_000)
    };
    let mut form = Form::SINE;
    for (component, k) in form.0.iter_mut().zip(1..) {
        *component = Component { harmonic: k, share: WHOLE / 6, phase: 9_000 * (u16::from(k) - 1) };
    }
    assert_eq!(form.components().count(), MOST_COMPONENTS);
    let six = Excitation { form, ..Excitation::sine(4_500, 2_000) };
    let mut steps = Excitation { steps: 3, hold_ms: 800, ..Excitation::sine(3_000, 5_000) };
    steps.amplitudes_micrometre[1..3].copy_from_slice(&[9_000, 6_000]);
    let table = table();
    let named = Excitation { table: table.known().name, ..Excitation::sine(6_000, 4_000) };
    let several_swept = Excitation { glide: sweep(Law::Logarithmic).glide, ..six };
    let several_swept = Excitation { glide: Glide { to_millihertz: 3_000, ..several_swept.glide }, ..several_swept };
    let plain = [sweep(Law::Linear), sweep(Law::Logarithmic), six, steps, several_swept];
    let mut all: Vec<_> = plain.map(|excitation| (excitation, None)).into();
    all.push((named, Some(table)));
    all
}

fn blocks(frames: &[u8]) -> Vec<SampleBlock> {
    let mut decoder = Decoder::<DeviceMessage>::new();
    let messages = frames.iter().filter_map(|&byte| decoder.push(byte)?.ok());
    let block = |message| if let DeviceMessage::Samples(block) = message { Some(block) } else { None };
    messages.filter_map(|envelope| block(envelope.message)).collect()
}

/// All of them one after the other, in one run.
fn script(excitations: &[(Excitation, Option<Table>)]) -> (Script, u32) {
    let mut script = Script::new().command(0, Command::Arm);
    let mut from = 10;
    for (excitation, table) in excitations {
        script = script.excite(from, excitation, table.as_ref()).command(from + STOP, Command::Stop);
        from += EACH;
    }
    (script, from)
}

/// What the board put out against what a host makes of the blocks and of what it was told; how many
/// samples of each excitation were compared.
fn as_told(emulation: &Emulation, sent: &Sent, tables: &[(Excitation, Option<Table>)]) -> Vec<usize> {
    let mut compared = vec![0; tables.len()];
    for block in blocks(&emulation.frames).iter().filter(|block| block.phase_increment != 0) {
        for sample in samples(block) {
            let told = sent.excited.iter().rev().find(|excited| excited.tick <= sample.tick).unwrap();
            let place = tables.iter().position(|(excitation, _)| *excitation == told.excitation).unwrap();
            let shape = match &tables[place].1 {
                Some(table) => CommandShape::Table(*table),
                None => CommandShape::Sines(told.excitation.form),
            };
            // What is written in a tick stands at the next one's request. Amplitudes on their ramps
            // are told for a block's first sample only.
            if sample.tick == block.first_tick {
                let found = emulation.set_points[sample.tick as usize + 1];
                assert_eq!(found, shape.displacement(block.amplitude_nanometre, sample.phase), "{}", sample.tick);
                compared[place] += 1;
            }
        }
    }
    compared
}

#[test]
fn set_points_are_those_of_the_firmware_on_this_machine_bit_for_bit() {
    let Some(image) = image::image() else { return };
    let excitations = excitations();
    let (script, ticks) = script(&excitations);
    let folder = tempfile::tempdir().unwrap();
    let mut settings = EmulatorSettings { script, ..EmulatorSettings::new(image, folder.path(), ticks) };
    let emulation = run(&settings).unwrap();
    assert_eq!(emulation.status, Some(0), "{}", emulation.console);
    let sent = Sent::of(&emulation.frames);
    assert!(sent.acks.iter().all(|ack| ack.result == CommandResult::Done), "{:?}", sent.acks);
    assert_eq!((sent.bad, sent.sequence.lost, sent.samples.missing), (0, 0, 0));
    // It has come to rest behind each, or the next one would have been refused.
    assert_eq!((emulation.last.phase_increment, emulation.last.displacement_nanometre), (0, 0));

    settings.rig.device = board_settings(&sent.firmware);
    let mut here = Vec::new();
    let frames = watched_on_this_machine(&settings.rig, &settings.script, ticks, |rig| here.push(rig.set_point()));
    let first = here.iter().zip(&emulation.set_points).position(|(a, b)| a != b);
    assert_eq!((first, here.len()), (None, emulation.set_points.len()));
    assert!(frames.unwrap() == emulation.frames, "the streams differ");
    assert!(here.iter().filter(|&&y| y != 0).count() > 2_000 * excitations.len());
    // A block of ten, of some 2300 moving ticks each.
    let compared = as_told(&emulation, &sent, &excitations);
    assert!(compared.iter().all(|&n| n > 200), "{compared:?}");
}

#[test]
fn ticks_that_are_missed_in_a_sweep_and_a_reset_leave_the_plant_in_step() {
    let Some(image) = image::image() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (excitation, table) = excitations().pop().unwrap();
    // After the reset the board is at the sine again, and says so by saying nothing.
    let script = Script::new()
        .command(0, Command::Arm)
        .excite(10, &excitation, table.as_ref())
        .order(900, Order::Stall(7))
        .order(1_500, Order::Reset(false))
        .command(2_000, Command::Arm)
        .command(2_002, Command::Start { amplitude_micrometre: 5_000, frequency_millihertz: 5_000 });
    let emulation = run(&EmulatorSettings { script, ..EmulatorSettings::new(image, folder.path(), 3_000) }).unwrap();
    assert_eq!((emulation.status, emulation.resets), (Some(0), 1), "{}", emulation.console);
    let sent = Sent::of(&emulation.frames);
    assert_eq!(sent.statuses.last().unwrap().shaker, ShakerState::Running);
    assert!(sent.acks.iter().all(|ack| ack.result == CommandResult::Done), "{:?}", sent.acks);
    assert!(emulation.moving_ticks() > 2_000, "{}", emulation.moving_ticks());
}

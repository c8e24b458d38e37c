//! A table that moves the base: brought whole or not at all, within the limits, ramped at both ends,
//! ended by silence and by the emergency stop.

use std::vec::Vec;

use whirl_shared::excitation::{Component, Glide, Law, Part};

use super::excite_tests::{armed, excite, run};
use super::*;
use crate::testing::Recorder;
use whirl_shared::frame::{Command, CommandResult};

/// As many points as fill no chunk: an even curve with one steep part.
fn table() -> Table {
    let points: Vec<i16> =
        (0..40_i32).map(|j| if j < 20 { 1_600 * (j - 10) } else { 16_000 - 1_600 * (j - 20) } as i16).collect();
    Table::of(&points).unwrap()
}

fn excitation(table: &Table) -> Excitation {
    Excitation { table: table.known().name, ..Excitation::sine(4_000, 2_000) }
}

fn bring(shaker: &mut Shaker<Recorder>, parts: impl Iterator<Item = Part>) {
    for part in parts {
        assert_eq!(shaker.command(Command::Prepare(part)), CommandResult::Done);
    }
}

fn moved() -> (Shaker<Recorder>, Table) {
    let (mut shaker, table) = (armed(), table());
    bring(&mut shaker, table.parts());
    assert_eq!(excite(&mut shaker, excitation(&table)), CommandResult::Done);
    (shaker, table)
}

#[test]
fn it_is_written_to_the_last_bit_and_ramped_at_both_ends() {
    let (mut shaker, table) = moved();
    let mut drives = run(&mut shaker, 1_000);
    shaker.command(Command::Stop);
    drives.extend(run(&mut shaker, 120));
    assert_eq!(shaker.state(), ShakerState::Armed);
    // 4 mm at 20 mm/s are 100 ticks.
    let at = [0, 50, 100, 999, 1_050].map(|tick| drives[tick].amplitude_nanometre);
    assert_eq!(at, [0, 2_000_000, 4_000_000, 4_000_000, 2_000_000]);
    let written: Vec<i32> =
        drives[..1_101].iter().map(|d| table.displacement(d.amplitude_nanometre, d.phase)).collect();
    assert_eq!(shaker.output.writes[2..], written);
    assert_eq!(written.last(), Some(&0));
    assert!(written[200..900].iter().any(|y| *y > 1_800_000));
    // A sine afterwards is a sine.
    let start = Command::Start { amplitude_micrometre: 1_000, frequency_millihertz: 5_000 };
    assert_eq!(shaker.command(start), CommandResult::Done);
    let drive = run(&mut shaker, 200)[199];
    let sine = whirl_shared::waveform::displacement(1_000_000, drive.phase);
    assert_eq!(shaker.output.writes.last(), Some(&sine));
    // And then the table once more, whose points are still there.
    shaker.command(Command::Stop);
    run(&mut shaker, 100);
    assert_eq!(excite(&mut shaker, excitation(&table)), CommandResult::Done);
}

#[test]
fn a_table_that_did_not_come_whole_moves_nothing() {
    let table = table();
    let parts: Vec<Part> = table.parts().collect();
    for lost in 0..parts.len() {
        let mut shaker = armed();
        bring(&mut shaker, parts.iter().enumerate().filter(|(i, _)| *i != lost).map(|(_, part)| *part));
        let result = excite(&mut shaker, excitation(&table));
        assert!(matches!(result, CommandResult::OutOfRange { limit } if limit != table.known().name.check));
        run(&mut shaker, 50);
        assert_eq!((shaker.state(), shaker.output.writes.len()), (ShakerState::Armed, 2));
        // The missing part mends it; twice does no harm.
        bring(&mut shaker, [parts[lost]; 2].into_iter());
        assert_eq!(excite(&mut shaker, excitation(&table)), CommandResult::Done);
    }
    let mut shaker = armed();
    bring(&mut shaker, parts.iter().copied());
    let Part::Points { place, mut points } = parts[1] else { panic!() };
    points[5] += 1;
    bring(&mut shaker, core::iter::once(Part::Points { place, points }));
    assert!(matches!(excite(&mut shaker, excitation(&table)), CommandResult::OutOfRange { .. }));
    let beyond = Command::Prepare(Part::Points { place: 43, points });
    assert_eq!(shaker.command(beyond), CommandResult::OutOfRange { limit: 42 });
}

#[test]
fn limits_hold_and_it_is_alone() {
    let table = table();
    let mut shaker = armed();
    bring(&mut shaker, table.parts());
    let good = excitation(&table);
    // 3200/32768 · 40² · 2² Hz²: 0.625 µm of 1/s² each; 40 m/s².
    let most = table.known().amplitude_limit(40_000, 4_000);
    let name = |points| whirl_shared::excitation::TableName { points, ..good.table };
    let glide = Glide { law: Law::Linear, back: false, to_millihertz: 3_000, ms: 1_000 };
    let mut form = good.form;
    form.0[0] = Component { harmonic: 2, share: 9_000, phase: 0 };
    for (refused, limit) in [
        (Excitation { frequency_millihertz: 4_000, amplitudes_micrometre: [most + 1; 8], ..good }, most),
        (Excitation { frequency_millihertz: 12_501, ..good }, 12_500),
        (Excitation { amplitudes_micrometre: [20_001; 8], ..good }, 20_000),
        (Excitation { table: name(7), ..good }, 8),
        (Excitation { table: name(257), ..good }, 256),
        (Excitation { glide, ..good }, 32_768),
        (Excitation { form, ..good }, 32_768),
    ] {
        assert_eq!(excite(&mut shaker, refused), CommandResult::OutOfRange { limit });
        assert_eq!(shaker.state(), ShakerState::Armed);
    }
    // By brute force: the differences of what is written keep the limit that it is just within.
    let just = Excitation { frequency_millihertz: 4_000, amplitudes_micrometre: [most; 8], ..good };
    assert_eq!(excite(&mut shaker, just), CommandResult::Done);
    run(&mut shaker, 3_000);
    let steady = &shaker.output.writes[1_200..];
    // Nanometres, ticks of 2 ms.
    let bend = steady.windows(3).map(|w| (w[0] - 2 * w[1] + w[2]).unsigned_abs()).max().unwrap();
    let acceleration = f64::from(bend) * 1e-9 / 4e-6;
    assert!((30.0..40.1).contains(&acceleration), "{acceleration}");
}

#[test]
fn amplitudes_one_after_the_other_scale_it() {
    let (mut shaker, table) = (armed(), table());
    bring(&mut shaker, table.parts());
    let mut steps = Excitation { steps: 2, hold_ms: 1_000, ..excitation(&table) };
    steps.amplitudes_micrometre[1] = 2_000;
    assert_eq!(excite(&mut shaker, steps), CommandResult::Done);
    let drives = run(&mut shaker, 1_000);
    assert_eq!([400, 900].map(|tick| drives[tick].amplitude_nanometre), [4_000_000, 2_000_000]);
    assert_eq!(shaker.output.writes.last(), Some(&table.displacement(2_000_000, drives[999].phase)));
}

#[test]
fn it_cannot_be_changed_while_it_moves_or_waits() {
    let (mut shaker, table) = moved();
    let part = Command::Prepare(Part::Points { place: 0, points: [0; 6] });
    run(&mut shaker, 300);
    assert_eq!(shaker.command(part), CommandResult::WrongState);
    assert_eq!(shaker.command(Command::Prepare(Part::Table(table.known().name))), CommandResult::WrongState);
    shaker.command(Command::Stop);
    run(&mut shaker, 200);
    assert_eq!(excite(&mut shaker, Excitation { on_trigger: true, ..excitation(&table) }), CommandResult::Done);
    run(&mut shaker, 10);
    assert_eq!((shaker.command(part), shaker.state()), (CommandResult::WrongState, ShakerState::Armed));
    shaker.output.triggered = true;
    let drives = run(&mut shaker, 400);
    assert_eq!(shaker.output.writes.last(), Some(&table.displacement(4_000_000, drives[399].phase)));
}

#[test]
fn silence_and_the_emergency_stop_end_it() {
    let (mut shaker, _) = moved();
    run(&mut shaker, 400);
    (0..1_300).for_each(|_| shaker.tick());
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Disarmed, StopCause::HostSilent));
    assert_eq!((shaker.output.writes.last(), shaker.output.enabled), (Some(&0), false));
    // Along a ramp: no step is greater than that of the table at its amplitude, and of the ramp.
    let steps = shaker.output.writes.windows(2).map(|w| w[0].abs_diff(w[1])).max().unwrap();
    let own = 4e6 * 1_600.0 / 32_768.0 * 40.0 * 2.0 / 500.0;
    assert!(f64::from(steps) < own + 40_001.0, "{steps} nm, {own} nm of its own");
    let (mut shaker, _) = moved();
    run(&mut shaker, 400);
    shaker.output.cut = true;
    let writes = shaker.output.writes.len();
    run(&mut shaker, 3);
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Faulted, StopCause::EmergencyStop));
    assert_eq!(shaker.output.writes[writes..], [0]);
}

//! Excitation beyond one sine: set points at the ticks and the points between them, by their bits.

use whirl_firmware::shaker::Shaker;
use whirl_firmware::sweep::{BEYOND, Scale, Sweep};
use whirl_firmware::{Settings, ShakerOutput};
use whirl_shared::excitation::{Component, Excitation, Form, Glide, Law, Table, WHOLE};
use whirl_shared::frame::{Command, CommandResult, ShakerState};

/// 40 kHz at 500 Hz.
const POINTS: usize = 80;
const SCALE: Scale = Scale { max: 4_095, full_nanometre: 25_000_000 };

/// Plays every tick's points in time, and keeps a hash of set points and points.
struct Stage {
    points: [u16; POINTS + BEYOND],
    hash: u32,
}

impl Stage {
    fn fold(&mut self, word: u32) {
        self.hash =
            word.to_le_bytes().iter().fold(self.hash, |hash, &byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    }
}

impl ShakerOutput for Stage {
    type Error = ();

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), ()> {
        self.points = [SCALE.code(displacement_nanometre).ok_or(())?; POINTS + BEYOND];
        Ok(())
    }

    fn sweep(&mut self, sweep: &Sweep<'_>) -> Result<(), ()> {
        let standing = self.points[POINTS];
        SCALE.fill(sweep, &mut self.points, POINTS, 0, standing).ok_or(())?;
        self.fold(sweep.start().cast_unsigned());
        let points = self.points;
        points[1..].iter().for_each(|&point| self.fold(u32::from(point)));
        Ok(())
    }
}

/// Four seconds of it, and the way back to rest.
fn hash(excitation: &Excitation, table: Option<&Table>) -> u32 {
    let mut shaker = Shaker::new(&Settings::default(), Stage { points: [2_048; POINTS + BEYOND], hash: 0x811c_9dc5 });
    let points = table.into_iter().flat_map(Table::parts).map(Command::Prepare);
    for command in core::iter::once(Command::Arm).chain(points).chain(excitation.commands()) {
        assert_eq!(shaker.command(command), CommandResult::Done, "{command:?}");
    }
    for tick in 0..2_600 {
        let command = if tick == 2_000 { Command::Stop } else { Command::KeepAlive };
        assert_eq!(shaker.command(command), CommandResult::Done);
        shaker.tick();
    }
    assert_eq!(shaker.state(), ShakerState::Armed);
    shaker.output_mut().hash
}

fn sweep(law: Law) -> Excitation {
    Excitation { glide: Glide { law, back: true, to_millihertz: 8_000, ms: 1_500 }, ..Excitation::sine(5_000, 2_000) }
}

pub fn sweeps_have_the_same_bits() {
    let found = [Law::Linear, Law::Logarithmic].map(|law| hash(&sweep(law), None));
    assert_eq!(found, SWEEPS, "{found:#010x?}");
}

pub fn several_sines_have_the_same_bits() {
    let mut form = Form::SINE;
    for (component, k) in form.0.iter_mut().zip(1_u8..) {
        *component = Component { harmonic: k, share: WHOLE / 6, phase: 9_000 * (u16::from(k) - 1) };
    }
    let found = hash(&Excitation { form, ..Excitation::sine(4_500, 2_000) }, None);
    assert_eq!(found, SEVERAL, "{found:#010x}");
}

pub fn steps_of_amplitude_have_the_same_bits() {
    let mut steps = Excitation { steps: 3, hold_ms: 800, ..Excitation::sine(3_000, 5_000) };
    steps.amplitudes_micrometre[1..3].copy_from_slice(&[9_000, 6_000]);
    let found = hash(&steps, None);
    assert_eq!(found, STEPS, "{found:#010x}");
}

pub fn a_table_has_the_same_bits() {
    let points: [i16; 100] = core::array::from_fn(|j| {
        let j = j as i16;
        (i32::from(j) * 7_919 % 401) as i16 - 200 + 200 * (j - 50).abs()
    });
    let Some(table) = Table::of(&points) else { panic!("no table") };
    let named = Excitation { table: table.known().name, ..Excitation::sine(6_000, 4_000) };
    let found = hash(&named, Some(&table));
    assert_eq!(found, TABLE, "{found:#010x}");
}

/// Of x86-64 and Cortex-M4F alike.
const SWEEPS: [u32; 2] = [0xc5ec_a006, 0xae68_b03c];
const SEVERAL: u32 = 0x81ca_3c5e;
const STEPS: u32 = 0x014a_f967;
const TABLE: u32 = 0x8c84_c53e;

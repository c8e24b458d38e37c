//! Excitation beyond one sine: what the firmware writes, the simulated base does and a host makes of
//! the wire's bytes is the same, to the last bit.

use whirl_shared::block::samples;
use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::excitation::{Component, Excitation, Form, Glide, Law, Table, WHOLE};
use whirl_shared::frame::{
    CommandResult, DeviceMessage, Envelope, Excited, HostMessage, SampleBlock, ShakerState, StopCause,
};

use super::*;
use crate::shaker::{CommandShape, Shaker};

/// A rig, its bytes decoded, and what stood at the shaker's output at each tick.
struct Bench {
    rig: VirtualRig,
    decoder: Decoder<DeviceMessage>,
    sequence: u16,
    blocks: Vec<SampleBlock>,
    excited: Vec<Excited>,
    estimates: usize,
    results: Vec<CommandResult>,
    logs: Vec<String>,
    /// What the host has brought.
    table: Option<Table>,
    /// Set point (nm), command to the simulated base, whether it is running.
    ticks: Vec<(i32, Command, bool)>,
}

impl Bench {
    fn armed() -> Self {
        let rig = VirtualRig::new(&RigSettings::default()).unwrap();
        let mut bench = Self {
            rig,
            decoder: Decoder::new(),
            sequence: 0,
            blocks: Vec::new(),
            excited: Vec::new(),
            estimates: 0,
            results: Vec::new(),
            logs: Vec::new(),
            table: None,
            ticks: Vec::new(),
        };
        bench.command(whirl_shared::frame::Command::Arm);
        bench.run(10);
        bench
    }

    fn command(&mut self, command: whirl_shared::frame::Command) {
        let mut buffer = [0; MAX_FRAME];
        let envelope = Envelope { sequence: self.sequence, message: HostMessage::Command(command) };
        let length = encode(&envelope, &mut buffer).unwrap();
        self.sequence = self.sequence.wrapping_add(1);
        self.rig.give_input(&buffer[..length]);
    }

    fn excite(&mut self, excitation: Excitation) {
        excitation.commands().into_iter().for_each(|command| self.command(command));
    }

    fn run(&mut self, ticks: u32) {
        for tick in 0..ticks {
            if tick % 400 == 0 {
                self.command(whirl_shared::frame::Command::KeepAlive);
            }
            self.silent(1);
        }
    }

    fn silent(&mut self, ticks: u32) {
        for _ in 0..ticks {
            let before = self.rig.app.drive().state;
            self.rig.step().unwrap();
            let running = before == ShakerState::Running && self.rig.app.drive().state == before;
            // The base is a tick behind while it ramps.
            let command = self.rig.command();
            let running = running && command.amplitude_nanometre[0] == command.amplitude_nanometre[1];
            self.ticks.push((self.rig.set_point(), command, running));
            for byte in self.rig.take_output() {
                match self.decoder.push(byte).map(|result| result.unwrap().message) {
                    Some(DeviceMessage::Samples(block)) => self.blocks.push(block),
                    Some(DeviceMessage::Excited(excited)) => self.excited.push(excited),
                    Some(DeviceMessage::Estimate(_)) => self.estimates += 1,
                    Some(DeviceMessage::Ack(ack)) => self.results.push(ack.result),
                    Some(DeviceMessage::Log(log)) => self.logs.push(log.text.as_str().to_owned()),
                    _ => {}
                }
            }
        }
    }

    /// What a host takes for the shape.
    fn shape(&self, told: Option<&Excited>) -> CommandShape {
        let Some(excitation) = told.map(|told| told.excitation) else { return CommandShape::default() };
        if !excitation.table.is_some() {
            return CommandShape::Sines(excitation.form);
        }
        let table = self.table.filter(|table| table.known().name == excitation.table);
        CommandShape::Table(table.expect("the table that is told"))
    }

    fn bring(&mut self, table: Table) -> Excitation {
        table.parts().for_each(|part| {
            self.command(whirl_shared::frame::Command::Prepare(part));
            self.run(2);
        });
        self.table = Some(table);
        Excitation { table: table.known().name, ..Excitation::sine(6_000, 4_000) }
    }

    /// Compares set point, base and what the blocks and the excitation told make of it; how many
    /// samples of a running shaker there are.
    fn compare(&self) -> usize {
        let mut compared = 0;
        for block in &self.blocks {
            for sample in samples(block) {
                let told = self.excited.iter().rev().find(|excited| excited.tick <= sample.tick);
                let shape = self.shape(told);
                let (written, base, running) = self.ticks[sample.tick as usize];
                if !running {
                    continue;
                }
                let y = shape.displacement(block.amplitude_nanometre, sample.phase);
                assert_eq!(y, written, "tick {}", sample.tick);
                assert_eq!((base.phase, base.phase_increment), (sample.phase, block.phase_increment));
                assert_eq!((base.shape, base.amplitude_nanometre), (shape, [block.amplitude_nanometre; 2]));
                let [_, y] = Shaker::default().motion(base, 1.0, 0.002).displacement(0.0);
                assert!((y * 1e9 - f64::from(written)).abs() < 8.0, "{y} m for {written} nm");
                compared += 1;
            }
        }
        compared
    }
}

fn sweep(law: Law) -> Excitation {
    Excitation { glide: Glide { law, back: true, to_millihertz: 8_000, ms: 5_000 }, ..Excitation::sine(5_000, 2_000) }
}

fn three() -> Excitation {
    let mut form = Form::SINE;
    for (i, component) in form.0.iter_mut().take(3).enumerate() {
        *component = Component { harmonic: 1 + i as u8, share: WHOLE / 3, phase: 9_000 * i as u16 };
    }
    Excitation { form, ..Excitation::sine(6_000, 3_000) }
}

#[test]
fn device_simulator_and_host_agree_to_the_last_bit() {
    let mut steps = Excitation { steps: 3, hold_ms: 2_000, ..Excitation::sine(3_000, 5_000) };
    steps.amplitudes_micrometre[1..3].copy_from_slice(&[9_000, 6_000]);
    for excitation in [sweep(Law::Linear), sweep(Law::Logarithmic), three(), steps, Excitation::sine(9_000, 5_000)] {
        let mut bench = Bench::armed();
        bench.excite(excitation);
        bench.run(5_000);
        assert!(bench.results.iter().all(|result| *result == CommandResult::Done));
        assert!(bench.compare() > 4_000);
        // Told when it begins, then once a second; a constant sine needs no telling.
        let told = if excitation.is_constant() { 0 } else { 11 };
        assert_eq!(bench.excited.len(), told);
        assert!(bench.excited.iter().all(|told| told.excitation == excitation && told.tick < 20));
    }
}

/// A rough triangle with an offset, of as many points as a chunk does not divide.
fn table() -> Table {
    let points: Vec<i16> = (0..100_i32).map(|j| (j * 7_919 % 401 - 200 + 200 * (j - 50).abs()) as i16).collect();
    Table::of(&points).unwrap()
}

#[test]
fn a_table_is_the_same_on_device_simulator_and_host_to_the_last_bit() {
    let mut bench = Bench::armed();
    let excitation = bench.bring(table());
    bench.excite(excitation);
    bench.run(3_000);
    bench.rig.miss_ticks(7);
    bench.run(1_500);
    assert!(bench.results.iter().all(|result| *result == CommandResult::Done));
    assert!(bench.compare() > 4_000);
    assert!(bench.excited.len() >= 9 && bench.excited.iter().all(|told| told.excitation == excitation));
    assert_eq!(bench.estimates, 0);
    // Acceleration and velocity of the base are the displacement's derivatives, ramps too.
    let shaker = Shaker { psi: 0.7, ..Shaker::default() };
    for (_, base, _) in bench.ticks.iter().skip(60).step_by(7) {
        let motion = shaker.motion(*base, 1.0, 0.002);
        let h = 2e-5;
        // Whole numbers of this would meet the corners of the second derivative.
        for t in [0.000_37, 0.001_13] {
            let [a, b, c] = [t - h, t, t + h].map(|t| motion.displacement(t)[1]);
            let (slope, bend) = ((c - a) / (2.0 * h), (a - 2.0 * b + c) / (h * h));
            assert!((motion.velocity(t)[1] - slope).abs() < 1e-4, "{slope}");
            assert!((motion.acceleration(t)[1] - bend).abs() < 1.0 + 0.02 * bend.abs(), "{bend}");
        }
    }
    // Silence ends it along a ramp.
    bench.silent(1_600);
    let status = bench.rig.status();
    assert_eq!((status.shaker, status.stop_cause), (ShakerState::Disarmed, StopCause::HostSilent));
    assert_eq!(bench.rig.set_point(), 0);
}

#[test]
fn a_shaker_s_gain_moves_the_base_farther_than_commanded() {
    let additions = crate::plant::DriveAdditions { gain_error: -0.2, ..Default::default() };
    let motion = Shaker { additions, ..Shaker::default() };
    let base = Command { amplitude_nanometre: [1_000_000; 2], phase_increment: 1 << 20, ..Command::default() };
    assert!((motion.motion(base, 0.0, 0.002).displacement(0.0)[1] - 0.8e-3).abs() < 1e-12);
}

#[test]
fn missed_ticks_leave_nothing_that_the_record_does_not_tell() {
    let mut bench = Bench::armed();
    bench.excite(sweep(Law::Logarithmic));
    for missed in [1, 7, 30, 95] {
        bench.run(400);
        bench.rig.miss_ticks(missed);
        bench.run(400);
    }
    assert!(bench.compare() > 2_500);
}

#[test]
fn a_sweep_costs_no_more_blocks_than_a_sine_and_the_device_estimates_of_a_sine_alone() {
    let mut bench = Bench::armed();
    bench.excite(Excitation::sine(5_000, 5_000));
    bench.run(10_000);
    let (blocks, estimates) = (bench.blocks.len(), bench.estimates);
    assert!(estimates >= 2, "{estimates}");
    for excitation in [sweep(Law::Linear), three()] {
        let mut bench = Bench::armed();
        bench.excite(excitation);
        bench.run(10_000);
        assert!(bench.blocks.len() <= blocks + 10, "{} blocks, {blocks} of a sine", bench.blocks.len());
        assert_eq!(bench.estimates, 0);
        bench.command(whirl_shared::frame::Command::Stop);
        bench.run(500);
        bench.excite(Excitation::sine(5_000, 5_000));
        bench.run(10_000);
        assert!(bench.estimates >= 2);
        assert_eq!(bench.excited.last().map(|told| told.excitation), Some(Excitation::sine(5_000, 5_000)));
    }
}

#[test]
fn silence_and_the_emergency_stop_end_a_sweep() {
    let mut bench = Bench::armed();
    bench.excite(sweep(Law::Linear));
    bench.run(1_000);
    bench.silent(2_000);
    let status = bench.rig.status();
    assert_eq!((status.shaker, status.stop_cause), (ShakerState::Disarmed, StopCause::HostSilent));
    assert_eq!(bench.rig.set_point(), 0);
    bench.command(whirl_shared::frame::Command::Arm);
    bench.excite(sweep(Law::Linear));
    bench.run(1_000);
    assert!(bench.rig.trigger_output());
    bench.rig.press_emergency_stop(true);
    bench.run(2);
    let status = bench.rig.status();
    assert_eq!((status.shaker, status.stop_cause), (ShakerState::Faulted, StopCause::EmergencyStop));
    assert_eq!((bench.rig.set_point(), bench.rig.trigger_output()), (0, false));
    bench.run(20);
    assert_eq!(bench.logs.last().map(String::as_str), Some("emergency stop: amplifier cut off"));
}

#[test]
fn a_trigger_starts_a_sweep_at_the_tick_that_is_told() {
    let mut bench = Bench::armed();
    bench.excite(Excitation { on_trigger: true, ..sweep(Law::Linear) });
    bench.run(300);
    assert_eq!(bench.rig.status().shaker, ShakerState::Armed);
    bench.rig.trigger(true);
    let at = bench.rig.ticks() as u32;
    bench.run(1_000);
    // Seen at that tick; the first displacement is that of the next.
    assert_eq!(bench.excited.last().map(|told| told.tick), Some(at + 1));
    assert!(bench.compare() > 800);
    let first = bench.blocks.iter().find(|block| block.phase_increment != 0).unwrap();
    assert_eq!((first.first_tick, first.phase), (at + 1, 0));
}

#[test]
fn the_velocity_of_a_swept_base_is_that_of_its_displacement() {
    // ∫ acceleration dt from tick to tick against the displacement's own slope.
    let mut bench = Bench::armed();
    bench.excite(Excitation { glide: Glide { ms: 1_000, ..sweep(Law::Linear).glide }, ..sweep(Law::Linear) });
    bench.run(600);
    let shaker = Shaker::default();
    let motions: Vec<_> = bench.ticks[200..].iter().map(|(_, base, _)| shaker.motion(*base, 1.0, 0.002)).collect();
    let mut velocity = motions[0].velocity(0.0)[1];
    for pair in motions.windows(2) {
        let [a, b, c] = [0.0, 0.001, 0.002].map(|t| pair[0].acceleration(t)[1]);
        velocity += 0.002 / 6.0 * (a + 4.0 * b + c);
        // A corner of the frequency, before it is spread over its tick, is 5 mm · 2π · 0.12 Hz.
        let before = pair[0].velocity(0.002)[1];
        assert!((velocity - before).abs() < 2e-5, "{velocity} m/s for {before}");
    }
}

use whirl_shared::block::{self, samples};
use whirl_shared::codec::{Decoder, encode};
use whirl_shared::frame::{self, CommandResult, DeviceMessage, Envelope, HostMessage, ShakerState};

use super::*;
use crate::base_sensor::{BaseQuantity, BaseSettings};
use crate::plant::effects::Effect;
use crate::shaker::Hum;
use crate::{Simulation, SimulationSettings};

/// A host that listens and keeps the watchdog quiet.
struct Host {
    rig: VirtualRig,
    decoder: Decoder<DeviceMessage>,
    sequence: u16,
    samples: Vec<block::Sample>,
    boots: Vec<u32>,
    hellos: Vec<frame::Hello>,
    results: Vec<CommandResult>,
}

impl Host {
    fn new(settings: &RigSettings) -> Self {
        let rig = VirtualRig::new(settings).unwrap();
        let (samples, boots, hellos, results) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { rig, decoder: Decoder::new(), sequence: 0, samples, boots, hellos, results }
    }

    fn command(&mut self, command: frame::Command) {
        let mut buffer = [0; MAX_FRAME];
        let envelope = Envelope { sequence: self.sequence, message: HostMessage::Command(command) };
        let length = encode(&envelope, &mut buffer).unwrap();
        self.sequence = self.sequence.wrapping_add(1);
        self.rig.give_input(&buffer[..length]);
    }

    fn run(&mut self, ticks: u32) {
        for tick in 0..ticks {
            if tick % 400 == 0 {
                self.command(frame::Command::KeepAlive);
            }
            self.rig.step().unwrap();
            for byte in self.rig.take_output() {
                match self.decoder.push(byte).map(|result| result.unwrap().message) {
                    Some(DeviceMessage::Samples(block)) => self.samples.extend(samples(&block)),
                    Some(DeviceMessage::Hello(hello)) => {
                        self.boots.push(hello.boot_id);
                        self.hellos.push(hello);
                    }
                    Some(DeviceMessage::Ack(ack)) => self.results.push(ack.result),
                    _ => {}
                }
            }
        }
    }

    fn start(&mut self) {
        self.command(frame::Command::Arm);
        self.command(frame::Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_000 });
    }
}

#[test]
fn counts_are_those_of_the_direct_simulation() {
    for counts_per_turn in [4096, 1024] {
        let device = Settings { counts_per_turn: [counts_per_turn; 2].into(), ..RigSettings::default().device };
        let effects = vec![Effect::parse("quadratic-drag@arm2=2e-6").unwrap()];
        let mut host = Host::new(&RigSettings { device, effects: effects.clone(), ..RigSettings::default() });
        host.start();
        host.run(1_000);
        assert_eq!(host.rig.status().shaker, ShakerState::Running);
        // The state at the tick that is sampled next, and the phase that it will carry.
        let (state, last) = (host.rig.plant().unwrap().within_turn(), host.rig.command());
        let first = host.rig.status().tick;
        let mut direct = Simulation::new(&SimulationSettings {
            initial: state,
            initial_phase: last.phase.wrapping_add(last.phase_increment),
            settle_s: 0.0,
            seed: None,
            effects,
            counts_per_turn: [counts_per_turn; 2],
            ..SimulationSettings::default()
        })
        .unwrap();
        host.run(10_000);
        let streamed: Vec<_> = host.samples.iter().filter(|s| s.tick >= first).collect();
        assert!(streamed.len() > 9_900);
        // Twenty seconds, a hundred periods of chaos: one differing bit would show.
        let mut whole_turns = None;
        for sample in streamed {
            let expected = direct.next_sample().unwrap();
            let turns = [0, 1].map(|i| sample.counts[i] - expected.counts[i]);
            assert_eq!(*whole_turns.get_or_insert(turns), turns, "tick {}", sample.tick);
            assert!(turns.iter().all(|t| t % counts_per_turn as i32 == 0), "{turns:?}");
            assert_eq!(sample.phase, expected.phase);
        }
    }
}

#[test]
fn nothing_moves_until_it_is_told_to_and_it_stops_when_the_host_is_silent() {
    let rest = RigSettings { initial: [0.0; 4], ..RigSettings::default() };
    let mut host = Host::new(&rest);
    host.run(500);
    assert_eq!(host.rig.plant().unwrap().state(), [0.0; 4]);
    assert_eq!(host.rig.command().amplitude_nanometre, [0, 0]);
    host.start();
    host.run(1_000);
    assert_eq!(host.rig.command().amplitude_nanometre, [15_525_000; 2]);
    assert_eq!(host.results.iter().filter(|&&r| r == CommandResult::Done).count(), host.results.len());
    for _ in 0..3_000 {
        host.rig.step().unwrap();
    }
    assert_eq!(host.rig.command().amplitude_nanometre, [0, 0]);
    assert_eq!(host.rig.status().shaker, ShakerState::Disarmed);
}

#[test]
fn the_ramp_s_amplitude_has_no_jumps() {
    let mut host = Host::new(&RigSettings::default());
    host.start();
    let mut last = 0;
    for _ in 0..1_000 {
        host.run(1);
        let [from, to] = host.rig.command().amplitude_nanometre;
        assert_eq!(from, last);
        assert!(to >= from && to - from <= 40_001, "{from} {to}");
        last = to;
    }
}

#[test]
fn missed_ticks_are_counted_and_the_phase_goes_on() {
    let mut host = Host::new(&RigSettings::default());
    host.start();
    host.run(1_000);
    host.rig.miss_ticks(7);
    host.run(200);
    assert_eq!(host.rig.status().overruns, 7);
    let gap = host.samples.windows(2).find(|pair| pair[1].tick != pair[0].tick + 1).unwrap();
    assert_eq!(gap[1].tick - gap[0].tick, 8);
    assert_eq!(gap[1].phase.wrapping_sub(gap[0].phase), 8 * 42_949_673);
    assert_eq!(host.rig.ticks(), 1_200);
    // The plant saw the same phase all along.
    let last = host.samples[host.samples.len() - 1];
    let behind = host.rig.status().tick - 1 - last.tick;
    assert_eq!(host.rig.command().phase, last.phase.wrapping_add(behind * 42_949_673));
}

#[test]
fn a_restart_has_a_new_boot_id_tick_zero_and_the_same_angles() {
    let mut host = Host::new(&RigSettings::default());
    host.run(700);
    let before = host.samples[host.samples.len() - 1];
    host.rig.restart().unwrap();
    host.run(100);
    assert_eq!(host.boots, [1, 2]);
    let after = host.samples.iter().rev().find(|s| s.tick == 0).unwrap();
    for i in 0..2 {
        let moved = (after.counts[i] - before.counts[i] + 2048).rem_euclid(4096) - 2048;
        assert!(moved.abs() < 400, "{before:?} {after:?}");
    }
}

#[test]
fn a_restart_keeps_the_zeros_of_arms_that_rest_and_a_power_cycle_none() {
    let at_rest = RigSettings { initial: [0.0; 4], ..RigSettings::default() };
    let mut host = Host::new(&at_rest);
    host.run(1_000);
    host.rig.restart().unwrap();
    host.run(100);
    host.rig.power_cycle().unwrap();
    host.run(100);
    let [first, reset, cycled] = &host.hellos[..] else { panic!("{:?}", host.hellos) };
    assert_eq!((reset.reset, cycled.reset), (ResetCause::Watchdog, ResetCause::Power));
    assert_eq!(first.zeros, reset.zeros);
    assert!(cycled.zeros.iter().all(|zero| zero.id == 3), "{cycled:?}");

    let mut host = Host::new(&RigSettings::default());
    host.run(700);
    host.rig.restart().unwrap();
    host.run(100);
    assert!(host.hellos[1].zeros.iter().all(|zero| zero.id == 2), "{:?}", host.hellos[1]);
    // Where the power goes under turning arms, zero is where they are when it comes back.
    host.rig.power_cycle().unwrap();
    host.run(20);
    let first = host.samples.iter().rev().find(|sample| sample.tick == 0).unwrap();
    assert_eq!(first.counts, [0, 0]);
}

#[test]
fn settings_are_in_force_after_a_restart_by_command() {
    let mut host = Host::new(&RigSettings::default());
    host.run(10);
    host.command(frame::Command::Set(frame::Setting::FrequencyLimit { millihertz: 7_000 }));
    host.run(10);
    host.command(frame::Command::Restart);
    host.run(600);
    let told: Vec<_> = host.hellos.iter().map(|h| (h.boot_id, h.limits.frequency_millihertz, h.settings)).collect();
    assert_eq!(
        told,
        [(1, 20_000, SettingsSource::BuiltIn), (1, 20_000, SettingsSource::Changed), (2, 7_000, SettingsSource::Kept)]
    );
}

#[test]
fn output_that_nobody_takes_is_bounded_and_what_is_lost_is_counted() {
    let mut rig = VirtualRig::new(&RigSettings { output_limit: 4_096, ..RigSettings::default() }).unwrap();
    for _ in 0..5_000 {
        rig.step().unwrap();
        assert!(rig.output_len() <= 4_096);
    }
    let status = rig.status();
    assert!(status.dropped_samples > 3_000, "{status:?}");
    let taken = rig.take_output();
    assert!(taken.ends_with(&[0]));
}

#[test]
fn a_broken_power_stage_stops_the_drive() {
    let mut host = Host::new(&RigSettings::default());
    host.start();
    host.run(1_000);
    host.rig.break_shaker(true);
    host.run(10);
    assert_eq!(host.rig.status().shaker, ShakerState::Faulted);
    assert_eq!(host.rig.command().amplitude_nanometre[1], 0);
}

#[test]
fn what_a_device_cannot_do_is_refused() {
    let refused = |settings: RigSettings| VirtualRig::new(&settings).unwrap_err().to_string();
    let effects = vec![Effect::parse("channel-delay@encoder2=-0.001").unwrap()];
    assert!(refused(RigSettings { effects, ..RigSettings::default() }).contains("channel-delay"));
    let device = Settings { counts_per_turn: [0, 4096].into(), ..RigSettings::default().device };
    assert!(refused(RigSettings { device, ..RigSettings::default() }).contains("counts_per_turn"));
}

/// Arms that turn evenly, each at its own rate.
#[derive(Debug)]
struct Even(Vec<f64>);

impl Arms for Even {
    fn advance(&mut self) -> Result<(), SimulationError> {
        self.0.iter_mut().enumerate().for_each(|(i, angle)| *angle += 1e-2 * (i as f64 - 1.5));
        Ok(())
    }

    fn angles(&self) -> &[f64] {
        &self.0
    }
}

#[test]
fn one_to_six_encoders_are_sampled_at_250_hz_to_2_khz() {
    for (encoders, rate) in (1..=6).zip([250, 320, 500, 1_000, 1_600, 2_000]) {
        let device = Settings {
            counts_per_turn: (0..encoders).map(|_| 4_096).collect(),
            reversed: (0..encoders).map(|_| false).collect(),
            sample_rate_millihertz: 1_000 * rate,
            ..RigSettings::default().device
        };
        let settings = RigSettings { device, ..RigSettings::default() };
        let rig = VirtualRig::with_arms(&settings, Box::new(Even(vec![0.0; encoders]))).unwrap();
        assert!((rig.tick_s() * f64::from(rate) - 1.0).abs() < 1e-12 && rig.plant().is_none());
        let mut host = Host { rig, ..Host::new(&RigSettings::default()) };
        host.start();
        host.run(2 * rate);
        assert_eq!(host.hellos[0].counts_per_turn.len(), encoders);
        assert!(host.samples.len() as u32 > 2 * rate - 10, "{encoders}");
        for (tick, sample) in host.samples.iter().enumerate() {
            assert_eq!((sample.tick as usize, sample.counts.len()), (tick, encoders));
            for (i, count) in sample.counts.iter().enumerate() {
                let angle = 1e-2 * (i as f64 - 1.5) * tick as f64;
                let want = angle * 4_096.0 / core::f64::consts::TAU;
                assert!((f64::from(*count) - want).abs() < 1.01, "{encoders} {tick} {count} {want}");
            }
        }
        // Frames of the shaker's commands were answered as ever.
        assert_eq!(host.results[..2], [CommandResult::Done; 2]);
    }
    let wrong = VirtualRig::with_arms(&RigSettings::default(), Box::new(Even(vec![0.0; 3]))).unwrap_err();
    assert!(wrong.to_string().contains("encoders"), "{wrong}");
}

/// What a sensor of the base shows beside the drive: the mains' hum, at its own frequency, at rest
/// and in motion.
#[test]
fn hum_of_the_base_is_measured_beside_the_drive() {
    const HUM: Hum = Hum { amplitude_m: 2e-5, frequency_hz: 50.3 };
    let sensor =
        BaseSettings { quantity: BaseQuantity::Position, scale: 1e-7, gain: 1.0, offset: 0.0, noise: 0.0, seed: 1 };
    let base = frame::BaseSensor { kind: frame::BaseKind::Position, scale: 100_000 };
    let device = Settings { base, ..RigSettings::default().device };
    let still = RigSettings { base: Some(sensor), device, ..RigSettings::default() };
    let mut host = Host::new(&RigSettings { hum: HUM, ..still.clone() });
    let mut quiet = Host::new(&still);
    for host in [&mut host, &mut quiet] {
        host.run(1_000);
        host.command(frame::Command::Arm);
        host.command(frame::Command::Start { amplitude_micrometre: 2_000, frequency_millihertz: 5_000 });
        host.run(3_000);
    }
    // Amplitude and phase of the tone by its own time, of what remains of the drive's displacement.
    for (from, moving) in [(0, false), (2_000, true)] {
        let window = &host.samples[from..from + 1_000];
        assert_eq!(window[0].phase != window[1].phase, moving);
        let (mut sin, mut cos, mut square) = (0.0, 0.0, 0.0);
        for (hum, without) in window.iter().zip(&quiet.samples[from..]) {
            assert_eq!(hum.tick, without.tick);
            let away = f64::from(hum.counts[2] - without.counts[2]) * 1e-7;
            let angle = std::f64::consts::TAU * HUM.frequency_hz * f64::from(hum.tick) * 0.002;
            sin += 2.0 / 1_000.0 * away * angle.sin();
            cos += 2.0 / 1_000.0 * away * angle.cos();
            square += away * away / 1_000.0;
        }
        assert!((sin / HUM.amplitude_m - 1.0).abs() < 0.01 && cos.abs() < 0.01 * HUM.amplitude_m, "{sin} {cos}");
        // And nothing else: rounding is a two-hundredth of it.
        assert!((2.0 * square).sqrt() < 1.01 * HUM.amplitude_m, "{square}");
    }
    // The arms feel it.
    let state = |host: &Host| host.rig.plant().unwrap().state();
    assert_ne!(state(&host), state(&quiet));
}

//! The base's motion as a third channel of the emulated board.

use whirl_firmware::Settings;
use whirl_hil_sim::emulated::{EmulatorSettings, Script, Sent, run};
use whirl_hil_sim::{BaseQuantity, BaseSettings, RigSettings, VirtualRig};
use whirl_shared::block::samples;
use whirl_shared::codec::{Decoder, encode};
use whirl_shared::frame::{BaseKind, BaseSensor, Command, DeviceMessage, Envelope, HostMessage, SampleBlock, Setting};
use whirl_shared::waveform::displacement;

use crate::image;

const SENSOR: BaseSettings =
    BaseSettings { quantity: BaseQuantity::Position, scale: 1e-6, gain: 1.0, offset: 0.0, noise: 0.0, seed: 1 };

fn blocks(frames: &[u8]) -> Vec<SampleBlock> {
    let mut decoder = Decoder::<DeviceMessage>::new();
    let messages = frames.iter().filter_map(|&byte| decoder.push(byte)?.ok());
    let block = |message| if let DeviceMessage::Samples(block) = message { Some(block) } else { None };
    messages.filter_map(|envelope| block(envelope.message)).collect()
}

/// Samples of three channels in which the base is where the drive has it at that tick, µm.
fn on_the_drive(blocks: &[SampleBlock], amplitude_nanometre: u32) -> usize {
    let mut found = 0;
    for block in blocks.iter().filter(|b| b.amplitude_nanometre == amplitude_nanometre && b.phase_increment != 0) {
        for sample in samples(block) {
            let [_, _, base] = sample.counts[..] else { panic!("{:?}", sample.counts) };
            let want = f64::from(displacement(amplitude_nanometre, sample.phase)) * 1e-3;
            assert!((f64::from(base) - want).abs() < 1.0, "tick {}: {base} for {want}", sample.tick);
            found += 1;
        }
    }
    found
}

#[test]
fn it_is_set_kept_and_sampled_at_the_ticks_of_the_encoders() {
    let Some(image) = image::image() else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = Script::new()
        .command(50, Command::Set(Setting::Base { kind: BaseKind::Position }))
        .command(100, Command::Set(Setting::BaseScale { scale: 1_000_000 }))
        .command(200, Command::Restart)
        .drive(500, 3_000, 400, 9_000, 5_000);
    let mut settings = EmulatorSettings { script, ..EmulatorSettings::new(image, folder.path(), 3_000) };
    settings.rig.base = Some(SENSOR);
    let emulation = run(&settings).unwrap();
    assert_eq!((emulation.status, emulation.resets), (Some(0), 1), "{}", emulation.console);
    let sent = Sent::of(&emulation.frames);
    assert_eq!((sent.bad, sent.sequence.lost, sent.samples.missing), (0, 0, 0));
    let base = BaseSensor { kind: BaseKind::Position, scale: 1_000_000 };
    assert_eq!((sent.hellos[0].base.kind, sent.hellos.last().unwrap().base), (BaseKind::None, base));
    let found = on_the_drive(&blocks(&emulation.frames), 9_000_000);
    assert!(found > 1_800, "{found}");
}

/// The virtual rig shows the same, and an encoder that is zeroed where the base rests.
#[test]
fn the_virtual_rig_s_base_is_where_the_drive_has_it() {
    for (kind, quantity) in [(BaseKind::Encoder, BaseQuantity::Counted), (BaseKind::Position, BaseQuantity::Position)] {
        let base = BaseSensor { kind, scale: 1_000_000 };
        let device = Settings { base, ..RigSettings::default().device };
        let sensor = BaseSettings { quantity, ..SENSOR };
        let mut rig = VirtualRig::new(&RigSettings { base: Some(sensor), device, ..RigSettings::default() }).unwrap();
        let (mut frames, mut sequence) = (Vec::new(), 0);
        let mut say = |rig: &mut VirtualRig, command| {
            let mut out = [0; 64];
            let length = encode(&Envelope { sequence, message: HostMessage::Command(command) }, &mut out).unwrap();
            sequence += 1;
            rig.give_input(&out[..length]);
        };
        say(&mut rig, Command::Arm);
        say(&mut rig, Command::Start { amplitude_micrometre: 9_000, frequency_millihertz: 5_000 });
        for tick in 0..2_000 {
            if tick % 400 == 0 {
                say(&mut rig, Command::KeepAlive);
            }
            rig.step().unwrap();
            frames.extend(rig.take_output());
        }
        assert!(on_the_drive(&blocks(&frames), 9_000_000) > 1_500);
    }
}

//! An hour of the driven rig through a link with every kind of fault: what came out against the
//! link's own account.
//!
//! `cargo run --release -p whirl-hil-sim --example faulty_hour [SEED]`

use std::error::Error;
use std::io::{Read, Write};
use std::time::Instant;

use whirl_hil_sim::transport::lock_step::LockStep;
use whirl_hil_sim::{FaultSettings, FaultyLink, RigSettings, VirtualRig};
use whirl_shared::block::samples;
use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::frame::{Command, DeviceMessage, Envelope, HostMessage};

const TICKS: u64 = 1_800_000;

fn command(sequence: u16, command: Command) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut buffer = [0; MAX_FRAME];
    let length = encode(&Envelope { sequence, message: HostMessage::Command(command) }, &mut buffer)?;
    Ok(buffer[..length].to_vec())
}

fn main() -> Result<(), Box<dyn Error>> {
    let seed = std::env::args().nth(1).map_or(Ok(1), |text| text.parse())?;
    let start = Instant::now();
    let link = FaultyLink::new(FaultSettings::EVERYTHING, seed);
    let mut port = LockStep::new(VirtualRig::new(&RigSettings::default())?, Some(link));
    port.write_all(&command(0, Command::Arm)?)?;
    port.write_all(&command(1, Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_000 })?)?;
    let mut decoder: Decoder<DeviceMessage> = Decoder::new();
    let mut seen = vec![0_u8; TICKS as usize + 1000];
    let (mut sequence, mut next_sign) = (2, 0);
    let mut take = |bytes: &[u8]| {
        for &byte in bytes {
            if let Some(Ok(Envelope { message: DeviceMessage::Samples(block), .. })) = decoder.push(byte) {
                for sample in samples(&block) {
                    if let Some(count) = seen.get_mut(sample.tick as usize) {
                        *count = count.saturating_add(1);
                    }
                }
            }
        }
    };
    let mut buffer = [0; 4096];
    while port.rig().ticks() < TICKS {
        if port.rig().ticks() >= next_sign {
            next_sign = port.rig().ticks() + 400;
            port.write_all(&command(sequence, Command::KeepAlive)?)?;
            sequence = sequence.wrapping_add(1);
        }
        match port.read(&mut buffer) {
            Ok(n) => take(&buffer[..n]),
            // The plug was out for longer than a second.
            Err(error) if error.kind() == std::io::ErrorKind::TimedOut => {}
            Err(error) => return Err(error.into()),
        }
    }
    let rest = port.finish();
    take(&rest);
    let report = port.faults().ok_or("the link is gone")?.report();
    let once = seen.iter().filter(|&&count| count > 0).count() as u64;
    let again = seen.iter().map(|&count| u64::from(count.saturating_sub(1))).sum::<u64>();
    println!("link: {:?}", report.samples);
    println!("host: {once} samples, {again} repeated, {} bad frames", decoder.counters().bad_frames());
    println!(
        "{:.1} s, drawn {:?} {:?}, unplugged {}",
        start.elapsed().as_secs_f64(),
        report.drawn_frames,
        report.drawn_bytes,
        report.unplugged
    );
    if once != report.samples.survived || again != report.samples.repeated {
        return Err("the accounts differ".into());
    }
    Ok(())
}

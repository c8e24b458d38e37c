//! Serves the virtual rig (the firmware's logic, the printed double pendulum, 4096 counts a turn,
//! 500 Hz, in real time) where a capture can find it, until it is ended with Ctrl-C:
//!
//! ```text
//! cargo run --release -p whirl-hil-sim --example serve -- --tcp 127.0.0.1:7777
//! cargo run --release -p whirl-hil-sim --example serve -- --pty /tmp/whirl-rig
//! ```
//!
//! and then `whirl capture --from tcp:127.0.0.1:7777 …` or `--from serial:/tmp/whirl-rig …`. With
//! `--faults SEED` the line drops, flips, doubles, truncates and reorders; with `--unplug-every S`
//! it is unplugged for a second that often. Each start has a boot id of its own, as a device has;
//! `--boot-id N` gives a certain one.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::process::ExitCode;
use std::time::Duration;

use whirl_hil_sim::transport::server::{Pace, Server};
use whirl_hil_sim::transport::tcp::TcpServer;
use whirl_hil_sim::{FaultSettings, FaultyLink, RigSettings, VirtualRig};

const USAGE: &str =
    "usage: serve --tcp HOST:PORT | --pty PATH [--seed N] [--faults SEED] [--unplug-every S] [--boot-id N]";

#[derive(Default)]
struct Arguments {
    tcp: Option<String>,
    pty: Option<String>,
    seed: Option<u64>,
    faults: Option<u64>,
    unplug_every_s: Option<u64>,
    boot_id: Option<u32>,
}

fn arguments() -> Option<Arguments> {
    let mut a = Arguments::default();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let value = words.next()?;
        match word.as_str() {
            "--tcp" => a.tcp = Some(value),
            "--pty" => a.pty = Some(value),
            "--seed" => a.seed = Some(value.parse().ok()?),
            "--faults" => a.faults = Some(value.parse().ok()?),
            "--unplug-every" => a.unplug_every_s = Some(value.parse::<u64>().ok()?.max(2)),
            "--boot-id" => a.boot_id = Some(value.parse().ok()?),
            _ => return None,
        }
    }
    (a.tcp.is_some() != a.pty.is_some()).then_some(a)
}

fn start(a: &Arguments) -> Result<Server, Box<dyn std::error::Error>> {
    let mut settings = RigSettings { seed: a.seed, ..RigSettings::default() };
    // Drawn anew in every process; the upper half is as random as the lower one.
    settings.device.boot_id = a.boot_id.unwrap_or_else(|| RandomState::new().build_hasher().finish() as u32);
    let rig = VirtualRig::new(&settings)?;
    let faults = a.faults.map(|seed| FaultyLink::new(FaultSettings { unplug: 0.0, ..FaultSettings::EVERYTHING }, seed));
    if let Some(address) = &a.tcp {
        let transport = TcpServer::bind(address)?;
        println!("the virtual rig listens: whirl capture --from tcp:{}", transport.address()?);
        return Ok(Server::start(rig, transport, faults, Pace::RealTime)?);
    }
    pty(rig, a.pty.as_deref().unwrap_or_default(), faults)
}

#[cfg(unix)]
fn pty(rig: VirtualRig, path: &str, faults: Option<FaultyLink>) -> Result<Server, Box<dyn std::error::Error>> {
    let transport = whirl_hil_sim::transport::pty::PseudoTerminal::new(path)?;
    println!("the virtual rig is plugged in: whirl capture --from serial:{path}");
    Ok(Server::start(rig, transport, faults, Pace::RealTime)?)
}

#[cfg(not(unix))]
fn pty(_: VirtualRig, _: &str, _: Option<FaultyLink>) -> Result<Server, Box<dyn std::error::Error>> {
    Err("pseudo-terminals need a Unix: use --tcp".into())
}

fn main() -> ExitCode {
    let Some(arguments) = arguments() else {
        eprintln!("{USAGE}");
        return ExitCode::from(2);
    };
    let server = match start(&arguments) {
        Ok(server) => server,
        Err(e) => {
            eprintln!("serve: {e}");
            return ExitCode::from(2);
        }
    };
    let mut seconds = 0;
    while server.is_running() {
        std::thread::sleep(Duration::from_secs(1));
        seconds += 1;
        if arguments.unplug_every_s.is_some_and(|every| seconds % every == 0) {
            println!("unplugged for a second at tick {}", server.ticks());
            server.unplug_for(500);
        }
    }
    match server.stop() {
        Ok(_) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("serve: {e}");
            ExitCode::FAILURE
        }
    }
}

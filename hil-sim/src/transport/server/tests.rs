use std::io::{Read, Write};
use std::net::TcpStream;

use whirl_shared::block::samples;
use whirl_shared::codec::{Decoder, MAX_FRAME, encode};
use whirl_shared::frame::{Command, DeviceMessage, Envelope, HostMessage};

use super::*;
use crate::transport::tcp::TcpServer;
use crate::virtual_rig::RigSettings;

fn rig() -> VirtualRig {
    VirtualRig::new(&RigSettings::default()).unwrap()
}

/// Reads until so many samples have come; their ticks, and whether a status said that commands were
/// heard.
fn read_ticks(port: &mut impl Read, decoder: &mut Decoder<DeviceMessage>, number: usize) -> (Vec<u32>, u32) {
    let (mut ticks, mut acks) = (Vec::new(), 0);
    let mut buffer = [0; 4096];
    while ticks.len() < number {
        let n = port.read(&mut buffer).unwrap();
        assert!(n > 0, "the line ended after {} samples", ticks.len());
        for &byte in &buffer[..n] {
            match decoder.push(byte) {
                Some(Ok(Envelope { message: DeviceMessage::Samples(block), .. })) => {
                    ticks.extend(samples(&block).map(|sample| sample.tick));
                }
                Some(Ok(Envelope { message: DeviceMessage::Ack(_), .. })) => acks += 1,
                _ => {}
            }
        }
    }
    (ticks, acks)
}

fn tcp(pace: Pace) -> (Server, std::net::SocketAddr) {
    let transport = TcpServer::bind("127.0.0.1:0").unwrap();
    let address = transport.address().unwrap();
    (Server::start(rig(), transport, None, pace).unwrap(), address)
}

fn connect(address: std::net::SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    stream
}

#[test]
fn tcp_at_the_client_s_pace_loses_nothing_and_never_runs_away() {
    let (server, address) = tcp(Pace::Client);
    std::thread::sleep(Duration::from_millis(20));
    assert_eq!(server.ticks(), 0, "nobody is connected");
    let mut port = connect(address);
    let mut command = [0; MAX_FRAME];
    let envelope = Envelope { sequence: 0, message: HostMessage::Command(Command::Hello) };
    let length = encode(&envelope, &mut command).unwrap();
    port.write_all(&command[..length]).unwrap();
    let (ticks, acks) = read_ticks(&mut port, &mut Decoder::new(), 100_000);
    assert!(ticks.iter().copied().eq(0..ticks.len() as u32));
    assert_eq!(acks, 1);
    // A client that stops reading stops the rig.
    let mut last = server.ticks();
    let mut still = 0;
    while still < 5 {
        std::thread::sleep(Duration::from_millis(20));
        let now = server.ticks();
        still = if now == last { still + 1 } else { 0 };
        last = now;
        assert!(now < 5_000_000, "the rig runs away");
    }
    server.stop().unwrap();
}

#[test]
fn a_second_client_is_turned_away_and_the_next_one_goes_on() {
    let (server, address) = tcp(Pace::Client);
    let mut first = connect(address);
    let (ticks, _) = read_ticks(&mut first, &mut Decoder::new(), 1_000);
    let mut second = connect(address);
    let mut buffer = [0; 16];
    assert!(matches!(second.read(&mut buffer), Ok(0) | Err(_)));
    drop(first);
    // The server notices that the first has gone at its next look.
    let mut third = loop {
        let mut port = connect(address);
        if matches!(port.read(&mut [0; 1]), Ok(1)) {
            break port;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let (later, _) = read_ticks(&mut third, &mut Decoder::new(), 1_000);
    assert!(later[0] > ticks[ticks.len() - 1]);
    assert!(later.windows(2).all(|pair| pair[1] == pair[0] + 1), "one stretch without a gap");
    server.stop().unwrap();
}

#[test]
fn real_time_follows_the_clock_whoever_listens() {
    let (server, address) = tcp(Pace::RealTime);
    let start = Instant::now();
    std::thread::sleep(Duration::from_millis(200));
    let mut port = connect(address);
    let (ticks, _) = read_ticks(&mut port, &mut Decoder::new(), 50);
    let elapsed = start.elapsed().as_secs_f64();
    let last = f64::from(ticks[ticks.len() - 1]);
    assert!(last / 500.0 <= elapsed + 0.05 && ticks[0] >= 50, "{ticks:?} after {elapsed} s");
    server.stop().unwrap();
}

#[cfg(unix)]
#[test]
fn a_pseudo_terminal_is_unplugged_and_replugged() {
    use crate::transport::pty::PseudoTerminal;
    let link = std::env::temp_dir().join(format!("whirl-server-{}", std::process::id()));
    let server = Server::start(rig(), PseudoTerminal::new(&link).unwrap(), None, Pace::Client).unwrap();
    let mut port = std::fs::File::options().read(true).write(true).open(&link).unwrap();
    let (before, _) = read_ticks(&mut port, &mut Decoder::new(), 2_000);
    assert!(before.windows(2).all(|pair| pair[1] == pair[0] + 1));
    server.unplug_for(1_500);
    // The line dies under the reader.
    let mut buffer = [0; 4096];
    while matches!(port.read(&mut buffer), Ok(1..)) {}
    drop(port);
    let mut port = loop {
        match std::fs::File::options().read(true).write(true).open(&link) {
            Ok(port) => break port,
            Err(_) => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let (after, _) = read_ticks(&mut port, &mut Decoder::new(), 2_000);
    assert!(after[0] >= before[before.len() - 1] + 1_400, "{} {}", before[before.len() - 1], after[0]);
    assert!(after.windows(2).all(|pair| pair[1] == pair[0] + 1));
    server.stop().unwrap();
}

#[test]
fn orders_reach_the_rig_and_faults_are_accounted_for() {
    use crate::faults::{FaultSettings, FaultyLink};
    let transport = TcpServer::bind("127.0.0.1:0").unwrap();
    let address = transport.address().unwrap();
    let link = FaultyLink::new(FaultSettings { drop_frame: 0.1, ..FaultSettings::default() }, 1);
    let server = Server::start(rig(), transport, Some(link), Pace::Client).unwrap();
    server.with_rig(|rig| {
        rig.miss_ticks(100);
        Ok(())
    });
    let mut port = connect(address);
    let (ticks, _) = read_ticks(&mut port, &mut Decoder::new(), 3_000);
    assert!(ticks[0] >= 100);
    let report = server.stop().unwrap();
    assert!(report.samples.vanished > 100 && report.samples.survived >= ticks.len() as u64, "{report:?}");
}

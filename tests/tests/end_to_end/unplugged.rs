//! A rig on a serial line (a pseudo-terminal) that is unplugged and plugged in again, and on TCP.

use std::net::SocketAddr;
use std::path::Path;

use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl_hil_sim::transport::server::{Pace, Server};
use whirl_hil_sim::transport::tcp::TcpServer;
use whirl_hil_sim::{RigSettings, VirtualRig};

use super::program::{Run, command, json, rig_file};

fn virtual_rig() -> VirtualRig {
    VirtualRig::new(&RigSettings::default()).unwrap()
}

/// Holds a record's gaps against its account: continuous ticks, received + missing = all. The
/// record, and its longest gap.
fn accounted(folder: &Path, run: &Run) -> (Record, serde_json::Value, i64) {
    assert_eq!(run.status, 0, "{run:?}");
    let out = json(&folder.join("out.json"));
    let rig = Rig::read(folder.join("rig.toml")).unwrap();
    let record = Record::read(folder.join("r.parquet"), &rig, &ReadOptions::default()).unwrap();
    let l = &record.losses;
    let number = |key: &str| out[key].as_i64().unwrap();
    assert_eq!(l.received as usize, record.samples());
    assert_eq!(
        (l.received + l.lost()) as i64,
        number("last_tick") - number("first_tick") + 1,
        "{l:?} {out} {}",
        run.stderr
    );
    let gaps: Vec<i64> =
        record.segments.windows(2).map(|w| w[1].first_tick - w[0].first_tick - w[0].len() as i64).collect();
    assert_eq!(gaps.iter().sum::<i64>(), l.lost() as i64, "{gaps:?}");
    assert!(gaps.iter().all(|g| *g > 0) && l.gaps == gaps.len() as u64, "{gaps:?} {l:?}");
    assert_eq!((l.restarts, l.bad_frames > 1000), (0, false));
    let longest = gaps.iter().copied().max().unwrap_or(0);
    (record, out, longest)
}

#[cfg(unix)]
#[test]
fn a_serial_port_that_is_unplugged_for_a_moment_leaves_nothing_out_and_the_clock_goes_on() {
    use whirl_hil_sim::transport::pty::PseudoTerminal;
    let folder = tempfile::tempdir().unwrap();
    rig_file(folder.path(), "chaotic.toml", "rig.toml", &[]);
    let port = folder.path().join("tty");
    let server = Server::start(virtual_rig(), PseudoTerminal::new(&port).unwrap(), None, Pace::RealTime).unwrap();
    let child = command()
        .current_dir(folder.path())
        .arg("capture")
        .args(["--from", &format!("serial:{}", port.display())])
        .args("--rig rig.toml --amplitude-m 0.0155 --seconds 5 -o r.parquet --json out.json".split(' '))
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // Once the drive runs (a ramp of 0.8 s) and some of it is recorded.
    let journal = folder.path().join("r.parquet.frames");
    let start = std::time::Instant::now();
    while std::fs::metadata(&journal).map_or(0, |m| m.len()) < 9_000 {
        assert!(start.elapsed().as_secs() < 60, "nothing is captured");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    server.unplug_for(400);
    let run = Run::from(child.wait_with_output().unwrap());
    let (record, out, longest) = accounted(folder.path(), &run);
    server.stop().unwrap();
    // The plug was out for 400 ticks; the device has sent them again.
    assert_eq!((longest, record.segments.len()), (0, 1));
    assert!(out["losses"]["restored"].as_u64().unwrap() >= 300, "{out}");
    assert!(out["reconnections"].as_u64().unwrap() >= 1, "{out}");
    assert!(out["duration_s"].as_f64().unwrap() >= 5.0 && out["complete"] == true, "{out}");
    // The device's clock and phase go on through the outage: 5 Hz at 500 Hz, 2³²/100 a tick.
    let phase = record.segments[0].phase.as_ref().unwrap();
    let ticks = phase.len() as u64 - 1;
    let turned = u64::from(phase[phase.len() - 1]).wrapping_sub(u64::from(phase[0])) & 0xffff_ffff;
    // The device may have stopped and started the shaker if its host was silent for 2 s, which it
    // was not.
    let expected = (ticks as f64 * 0.01).fract() * 4_294_967_296.0;
    let off = (turned as f64 - expected).rem_euclid(4_294_967_296.0);
    assert!(off.min(4_294_967_296.0 - off) < 2.0 * ticks as f64, "{turned} after {ticks} ticks, expected {expected}");
}

#[cfg(unix)]
#[test]
fn a_capture_that_was_killed_has_what_the_device_still_keeps_when_it_is_resumed() {
    use whirl_hil_sim::transport::pty::PseudoTerminal;
    let folder = tempfile::tempdir().unwrap();
    rig_file(folder.path(), "chaotic.toml", "rig.toml", &[]);
    let port = folder.path().join("tty");
    let server = Server::start(virtual_rig(), PseudoTerminal::new(&port).unwrap(), None, Pace::RealTime).unwrap();
    let start = |more: &[&str]| {
        let mut command = command();
        command.current_dir(folder.path()).arg("capture").args(["--from", &format!("serial:{}", port.display())]);
        command.args("--rig rig.toml --no-drive --seconds 6 -o r.parquet --json out.json".split(' ')).args(more);
        command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap()
    };
    let mut child = start(&[]);
    let journal = folder.path().join("r.parquet.frames");
    let begun = std::time::Instant::now();
    while std::fs::metadata(&journal).map_or(0, |m| m.len()) < 9_000 {
        assert!(begun.elapsed().as_secs() < 60, "nothing is captured");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    // The device goes on meanwhile.
    std::thread::sleep(std::time::Duration::from_millis(1_500));
    let run = Run::from(start(&["--resume"]).wait_with_output().unwrap());
    let (record, out, longest) = accounted(folder.path(), &run);
    server.stop().unwrap();
    assert_eq!((longest, record.segments.len(), record.samples()), (0, 1, 3_000), "{out}");
    // Of the 750 ticks the line itself has held some.
    assert!(record.losses.restored >= 300, "{out}");
}

#[test]
fn tcp_as_fast_as_the_host_reads() {
    let folder = tempfile::tempdir().unwrap();
    rig_file(folder.path(), "chaotic.toml", "rig.toml", &[]);
    let transport = TcpServer::bind("127.0.0.1:0").unwrap();
    let address: SocketAddr = transport.address().unwrap();
    let server = Server::start(virtual_rig(), transport, None, Pace::Client).unwrap();
    let run = Run::from(
        command()
            .current_dir(folder.path())
            .args(["capture", "--from", &format!("tcp:{address}")])
            .args("--rig rig.toml --no-drive --seconds 60 -o r.parquet --json out.json --strict".split(' '))
            .output()
            .unwrap(),
    );
    let (record, _, longest) = accounted(folder.path(), &run);
    assert_eq!((record.samples(), longest), (30_000, 0));
    server.stop().unwrap();
}

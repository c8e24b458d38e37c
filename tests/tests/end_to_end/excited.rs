//! The trigger and the emergency stop of a rig on TCP, as a capture sees them; a sweep that is
//! measured.

use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use whirl_hil_sim::transport::server::{Pace, Server};
use whirl_hil_sim::transport::tcp::TcpServer;
use whirl_hil_sim::{RigSettings, VirtualRig};

use super::program::{Run, command, done, json, rig_file, whirl};

/// A rig, and a capture of 3 s from it that has begun.
fn begun(folder: &Path, more: &str) -> (Server, Child) {
    rig_file(folder, "chaotic.toml", "rig.toml", &[]);
    let transport = TcpServer::bind("127.0.0.1:0").unwrap();
    let address = transport.address().unwrap();
    let rig = VirtualRig::new(&RigSettings::default()).unwrap();
    let server = Server::start(rig, transport, None, Pace::RealTime).unwrap();
    let child = command()
        .current_dir(folder)
        .args(["capture", "--from", &format!("tcp:{address}")])
        .args("--rig rig.toml --amplitude-m 0.0155 --seconds 3 -o r.parquet --json out.json".split(' '))
        .args(more.split_whitespace())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    (server, child)
}

/// Waits until so many bytes have been journaled.
fn journaled(folder: &Path, bytes: u64) {
    let start = Instant::now();
    while std::fs::metadata(folder.join("r.parquet.frames")).map_or(0, |m| m.len()) < bytes {
        assert!(start.elapsed() < Duration::from_secs(60), "nothing is captured");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_capture_waits_for_the_trigger() {
    let folder = tempfile::tempdir().unwrap();
    let (server, mut child) = begun(folder.path(), "--on-trigger");
    // Far longer than a capture that waits for nothing takes.
    std::thread::sleep(Duration::from_secs(6));
    assert!(child.try_wait().unwrap().is_none(), "it ended without its trigger");
    server.with_rig(|rig| {
        rig.trigger(true);
        Ok(())
    });
    let run = Run::from(child.wait_with_output().unwrap());
    server.stop().unwrap();
    assert_eq!(run.status, 0, "{run:?}");
    let out = json(&folder.path().join("out.json"));
    assert!(out["complete"] == true && out["duration_s"].as_f64().unwrap() >= 3.0, "{out}");
}

#[test]
fn a_capture_ends_on_the_emergency_stop_and_keeps_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let (server, child) = begun(folder.path(), "");
    journaled(folder.path(), 6_000);
    server.with_rig(|rig| {
        rig.press_emergency_stop(true);
        Ok(())
    });
    let run = Run::from(child.wait_with_output().unwrap());
    server.stop().unwrap();
    assert!(run.status != 0 && run.stderr.contains("a shaker whose emergency stop is pressed"), "{run:?}");
    let kept = ["r.parquet", "r.parquet.frames"].iter().any(|f| folder.path().join(f).exists());
    assert!(kept && run.stderr.contains("r.parquet"), "{run:?}");
}

/// What moves the base need not be one sine where it is measured: a sweep is no wrong frequency.
#[test]
fn a_sweep_that_is_measured_is_identified() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "measured-base.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 2.0")]);
    // Stays at its end: the mean frequency is not the rig file's.
    done(at, "capture --from sim:1 --rig rig.toml --sweep 3..7 --sweep-s 10 --seconds 30 -o sweep.parquet");
    done(at, "identify sweep.parquet --rig rig.toml --json out.json");
    let out = json(&at.join("out.json"));
    assert_eq!(out["method"], "shooting", "{out}");
    let b22 = out["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "B22").unwrap();
    // m2 e2 g/(J_o2 Ω²) of the rig file.
    let truth = 0.040 * 0.0267 * 9.81 / (4.033e-5 * (10.0 * std::f64::consts::PI).powi(2));
    let off = (b22["value"].as_f64().unwrap() - truth) / b22["std_error"].as_f64().unwrap();
    assert!(off.abs() < 4.0, "{b22} for {truth}");
    let run = whirl(at, "inspect sweep.parquet --rig rig.toml --json out.json");
    let warnings = json(&at.join("out.json"))["warnings"].to_string();
    assert!(run.status == 0 && !warnings.contains("\"drive-"), "{run:?} {warnings}");
}

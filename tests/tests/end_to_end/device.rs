//! `whirl device` against the firmware on a simulated rig behind TCP, and what a restart within a
//! record does.

use std::path::Path;
use std::time::{Duration, Instant};

use whirl::identify::boots::of_known_zero;
use whirl::record::cut::Part;
use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl_hil_sim::transport::server::{Pace, Server};
use whirl_hil_sim::transport::tcp::TcpServer;
use whirl_hil_sim::{RigSettings, VirtualRig};

use super::program::{Run, command, done, json, rig_file, whirl};

/// A rig in real time, from a state, and its source.
fn served(initial: [f64; 4]) -> (Server, String) {
    let transport = TcpServer::bind("127.0.0.1:0").unwrap();
    let from = format!("tcp:{}", transport.address().unwrap());
    let rig = VirtualRig::new(&RigSettings { initial, ..RigSettings::default() }).unwrap();
    (Server::start(rig, transport, None, Pace::RealTime).unwrap(), from)
}

fn value(out: &serde_json::Value, key: &str) -> serde_json::Value {
    let settings = out["device"]["settings"].as_array().unwrap();
    settings.iter().find(|s| s["key"] == key).unwrap()["value"].clone()
}

#[test]
fn settings_are_shown_set_checked_at_capture_and_set_back() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[]);
    let (server, from) = served([0.0; 4]);
    let list = done(at, &format!("device list --from {from} --json list.json"));
    assert!(list.contains(&from) && list.contains("virtual rig, whirl-firmware"), "{list}");
    assert_eq!(json(&at.join("list.json"))["ports"][0]["device"]["board"], "virtual rig");
    let text = done(at, &format!("device show --from {from} --json show.json"));
    for part in [
        "counts_per_turn1 ",
        "4096",
        "amplitude_limit_m ",
        "500 Hz",
        "0.02 m",
        "those of the image",
        "encoder 2: zero is where",
        "counts now: ",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let shown = json(&at.join("show.json"));
    assert_eq!((value(&shown, "sample_rate_hz"), shown["format"].clone()), (500.0.into(), 1.into()));

    // Kept and in force at once, or at the next start.
    done(at, &format!("device set counts_per_turn2=1024 frequency_limit_hz=12.5 --from {from} --json set.json"));
    let set = json(&at.join("set.json"));
    assert_eq!(value(&set, "counts_per_turn2"), 1024);
    assert_eq!(set["device"]["settings_from"], "flash");
    let later = done(at, &format!("device set counts_per_turn1=2048 --no-restart --from {from}"));
    assert!(later.contains("in force when the board starts next"), "{later}");
    done(at, &format!("device show --from {from} --json show.json"));
    let shown = json(&at.join("show.json"));
    assert_eq!((value(&shown, "counts_per_turn1"), value(&shown, "counts_per_turn2")), (4096.into(), 1024.into()));
    assert_eq!(shown["device"]["settings_from"], "changed");

    // The rig file says otherwise: the message names the command that mends it, and so does that of
    // the drive.
    let capture = format!("capture --from {from} --rig rig.toml --amplitude-m 0.0155 --seconds 1 -o r.parquet");
    let run = whirl(at, &capture);
    assert_eq!(run.status, 2, "{run:?}");
    assert!(run.stderr.contains("`whirl device set counts_per_turn2=4096` changes the device"), "{}", run.stderr);
    assert!(run.stderr.contains("`counts_per_turn = 1024` in the rig file"), "{}", run.stderr);
    done(at, &format!("device set counts_per_turn=4096 amplitude_limit_m=0.012 --from {from}"));
    let run = whirl(at, &capture);
    assert_eq!(run.status, 2, "{run:?}");
    assert!(run.stderr.contains("found an amplitude of 0.0155 m, expected at most 0.012 m"), "{}", run.stderr);
    assert!(run.stderr.contains("whirl device set amplitude_limit_m=0.0155"), "{}", run.stderr);
    done(at, &format!("device set settings=built-in --from {from}"));
    let run = whirl(at, &capture);
    assert_eq!(run.status, 0, "{run:?}");

    // What cannot be, before and by the device.
    for (set, part) in [
        ("counts_per_turn1", "KEY=VALUE"),
        ("counts_per_turn1=0", "at least 1"),
        ("host_timeout_s=100", "at most 60 s"),
        ("sample_rate_hz=50", "frequency_limit_hz=10"),
    ] {
        let run = whirl(at, &format!("device set {set} --from {from}"));
        assert!(run.status == 2 && run.stderr.contains(part), "{set}: {run:?}");
    }
    assert!(done(at, &format!("device show --from {from}")).contains("counts_per_turn1         4096"));
    server.stop().unwrap();
    let gone = whirl(at, &format!("device show --from {from}"));
    assert!(gone.status == 2 && gone.stderr.contains(&from), "{gone:?}");
}

#[test]
fn zero_is_set_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (server, from) = served([0.0; 4]);
    let run = whirl(at, &format!("device zero --from {from} --json zero.json"));
    assert!(run.status == 0 && run.stderr.is_empty(), "{run:?}");
    let out = json(&at.join("zero.json"));
    assert_eq!(out["counts_moved_before"], serde_json::json!([0, 0]));
    assert_eq!(out["device"]["encoders"][1]["zero_from"], "command");
    let id = out["zero_id"].clone();
    done(at, &format!("device show --from {from} --json show.json"));
    assert_eq!(json(&at.join("show.json"))["device"]["encoders"][0]["zero_id"], id);
    server.stop().unwrap();
    // Arms that swing are told.
    let run = whirl(at, "device zero --from sim --json zero.json");
    assert!(run.status == 0 && run.stderr.contains("Let them hang still"), "{run:?}");
    assert_eq!(json(&at.join("zero.json"))["warnings"][0]["id"], "arms-move");
}

/// A capture of some seconds of a rig without drive, after two of which something happens to the
/// rig.
fn captured(at: &Path, seconds: u32, initial: [f64; 4], order: fn(&mut VirtualRig)) -> (Run, Record) {
    let (server, from) = served(initial);
    let child = command()
        .current_dir(at)
        .args(["capture", "--from", &from])
        .args("--rig rig.toml --no-drive --force -o r.parquet --json out.json --seconds".split(' '))
        .arg(seconds.to_string())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let journal = at.join("r.parquet.frames");
    let start = Instant::now();
    // More than a second of rest, so that the counts are kept.
    while std::fs::metadata(&journal).map_or(0, |m| m.len()) < 4_000 {
        assert!(start.elapsed() < Duration::from_secs(60), "nothing is captured");
        std::thread::sleep(Duration::from_millis(10));
    }
    server.with_rig(move |rig| {
        order(rig);
        Ok(())
    });
    let run = Run::from(child.wait_with_output().unwrap());
    server.stop().unwrap();
    let rig = Rig::read(at.join("rig.toml")).unwrap();
    (run, Record::read(at.join("r.parquet"), &rig, &ReadOptions::default()).unwrap())
}

#[test]
fn counts_that_were_kept_over_a_watchdog_s_reset_are_pooled_and_others_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[]);
    let boots = |record: &Record| {
        let metadata = record.metadata.clone().unwrap();
        metadata.device.iter().map(|boot| (boot.reset.clone(), boot.zeros[0].id)).collect::<Vec<_>>()
    };
    let (run, record) = captured(at, 4, [0.0; 4], |rig| rig.restart().unwrap());
    assert_eq!(run.status, 0, "{run:?}");
    assert!(run.stderr.contains("the device has restarted once"), "{}", run.stderr);
    assert!(run.stderr.contains("(watchdog; its counts were kept)"), "{}", run.stderr);
    let told = boots(&record);
    assert!(told.len() == 2 && told[1].0 == "watchdog" && told[0].1 == told[1].1, "{told:?}");
    assert_eq!(record.segments.last().unwrap().boot, 1);
    let (used, warnings) = of_known_zero(core::slice::from_ref(&record));
    assert!(used[0].samples() == record.samples() && warnings.is_empty(), "{warnings:?}");

    // Power takes the zero away; so does a reset in which the arms turn.
    for (seconds, initial, order, part) in [
        (4, [0.0; 4], (|rig| rig.power_cycle().unwrap()) as fn(&mut VirtualRig), "power; its counts began anew"),
        (8, [0.3, 2.0, 0.0, 0.0], |rig| rig.restart().unwrap(), "watchdog; its arms turned meanwhile"),
    ] {
        let (run, record) = captured(at, seconds, initial, order);
        assert!(run.status == 0 && run.stderr.contains(part), "{part}: {run:?}");
        let told = boots(&record);
        assert!(told.len() == 2 && told[0].1 != told[1].1, "{told:?}");
        let (used, warnings) = of_known_zero(core::slice::from_ref(&record));
        assert_eq!(warnings.len(), 1);
        let of_boot = |boot: u32| record.segments.iter().filter(|s| s.boot == boot).map(|s| s.len()).sum::<usize>();
        assert_eq!(used[0].samples(), of_boot(0).max(of_boot(1)), "{}", warnings[0].text);
        assert!(used[0].segments.iter().all(|s| s.boot == used[0].segments[0].boot));
        // The other part is to be had, too.
        let other = record.segments.iter().find(|s| s.boot != used[0].segments[0].boot).unwrap();
        let (from_s, to_s) = (Some(other.start_s), Some(other.start_s + other.duration_s()));
        let mut part = record.clone();
        part.cut(&Part { from_s, to_s }).unwrap();
        assert_eq!((part.samples(), part.segments.len()), (other.len(), 1));
    }
    let shown = whirl(at, "inspect r.parquet --rig rig.toml");
    assert!(
        shown.stdout.contains("restart") && shown.stdout.contains("watchdog; its arms turned meanwhile"),
        "{shown:?}"
    );
}

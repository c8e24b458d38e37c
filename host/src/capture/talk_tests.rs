use std::path::Path;

use whirl_shared::frame::{Setting, SettingsSource, ZeroSource};

use super::*;

fn rig() -> Rig {
    Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml")).unwrap()
}

#[test]
fn settings_are_kept_and_in_force_after_a_restart() {
    let mut talk = Talk::open("sim", &rig(), 5.0).unwrap();
    let before = talk.hello().unwrap();
    assert_eq!((before.settings, &before.counts_per_turn[..]), (SettingsSource::BuiltIn, &[4096; 2][..]));
    let set = Command::Set(Setting::CountsPerTurn { channel: 1, counts: 1024 });
    assert_eq!(talk.ask_at_rest(set).unwrap(), CommandResult::Done);
    let told = talk.hello().unwrap();
    assert_eq!((told.settings, &told.counts_per_turn[..]), (SettingsSource::Changed, &[4096; 2][..]));
    assert_eq!(talk.ask_at_rest(Command::Restart).unwrap(), CommandResult::Done);
    let after = talk.hello().unwrap();
    assert_eq!((after.settings, &after.counts_per_turn[..]), (SettingsSource::Kept, &[4096, 1024][..]));
    assert_ne!(after.boot_id, before.boot_id);
    let refused = talk.ask(Command::Set(Setting::HostTimeout { ms: 5 })).unwrap();
    assert_eq!(refused, CommandResult::OutOfRange { limit: 100 });
}

#[test]
fn an_armed_shaker_is_disarmed_and_one_that_moves_is_left() {
    let mut talk = Talk::open("sim", &rig(), 5.0).unwrap();
    assert_eq!(talk.ask(Command::Arm).unwrap(), CommandResult::Done);
    let set = Command::Set(Setting::Baud { rate: 230_400 });
    assert_eq!(talk.ask(set).unwrap(), CommandResult::WrongState);
    assert_eq!(talk.ask_at_rest(set).unwrap(), CommandResult::Done);
    assert_eq!(talk.status().unwrap().shaker, ShakerState::Disarmed);
    talk.ask(Command::Arm).unwrap();
    let start = Command::Start { amplitude_micrometre: 5_000, frequency_millihertz: 5_000 };
    assert_eq!(talk.ask(start).unwrap(), CommandResult::Done);
    let e = talk.ask_at_rest(set).unwrap_err().to_string();
    assert!(e.contains("a shaker that moves"), "{e}");
    assert_eq!(talk.ask(Command::ZeroCounts).unwrap(), CommandResult::WrongState);
}

#[test]
fn zero_has_a_new_id_and_a_moving_arm_is_seen() {
    let mut talk = Talk::open("sim", &rig(), 5.0).unwrap();
    let before = talk.hello().unwrap().zeros;
    let moved = talk.movement(Duration::from_millis(500));
    assert!(moved.len() == 2 && moved.iter().all(|n| *n > 20), "{moved:?}");
    assert_eq!(talk.ask(Command::ZeroCounts).unwrap(), CommandResult::Done);
    let after = talk.hello().unwrap().zeros;
    assert!(after.iter().zip(&before).all(|(new, old)| new.id != old.id && new.source == ZeroSource::Commanded));
}

#[test]
fn what_is_no_device_is_told() {
    let told = |from: &str| Talk::open(from, &rig(), 0.3).and_then(|mut t| t.hello()).unwrap_err().to_string();
    assert!(told("file:Cargo.toml").contains("A file answers nothing"));
    assert!(told("usb").contains("serial:/dev/ttyACM0"));
    assert!(Talk::open("sim", &rig(), f64::NAN).err().unwrap().to_string().contains("--handshake-s"));
    // A port that is open and silent.
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let from = format!("tcp:{}", silent.local_addr().unwrap());
    let e = told(&from);
    assert!(e.contains("no byte in 0.3 s") && e.contains(&from), "{e}");
}

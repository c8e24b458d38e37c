//! `whirl capture --live` on a terminal: what is on the screen, and that the end is in order.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use rustix::termios::Winsize;

use super::program::{command, json, rig_file, whirl};

/// How long anything may take to appear.
const PATIENCE: Duration = Duration::from_secs(60);

/// The program on a terminal of its own.
struct OnTerminal {
    child: Child,
    keys: std::fs::File,
    bytes: Receiver<Vec<u8>>,
    screen: vt100::Parser,
}

impl OnTerminal {
    /// Starts it; `setsid` makes the terminal its own, as a login does.
    fn start(folder: &Path, arguments: &str, (columns, rows): (u16, u16)) -> Self {
        let size = Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
        let pair = rustix_openpty::openpty(None, Some(&size)).unwrap();
        let user = std::fs::File::from(pair.user);
        let child = Command::new("setsid")
            .arg("--ctty")
            .arg(command().get_program())
            .args(arguments.split_whitespace())
            .current_dir(folder)
            .env("TERM", "xterm-256color")
            .stdin(user.try_clone().unwrap())
            .stdout(user.try_clone().unwrap())
            .stderr(user)
            .spawn()
            .expect("setsid, of util-linux");
        let keys = std::fs::File::from(pair.controller);
        let mut reader = keys.try_clone().unwrap();
        let (sender, bytes) = channel();
        std::thread::spawn(move || {
            let mut buffer = [0; 4096];
            while let Ok(n @ 1..) = reader.read(&mut buffer) {
                if sender.send(buffer[..n].to_vec()).is_err() {
                    return;
                }
            }
        });
        Self { child, keys, bytes, screen: vt100::Parser::new(rows, columns, 0) }
    }

    /// The screen once every part stands on it: it arrives in pieces.
    fn until(&mut self, parts: &[&str]) -> String {
        let begun = Instant::now();
        loop {
            if let Ok(bytes) = self.bytes.recv_timeout(Duration::from_millis(50)) {
                self.screen.process(&bytes);
            }
            let text = self.screen.screen().contents().replace('\u{202f}', " ");
            let Some(missing) = parts.iter().find(|part| !text.contains(*part)) else {
                return text;
            };
            assert!(begun.elapsed() < PATIENCE, "no {missing}:\n{text}");
        }
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }

    /// The exit status, and what stands on the terminal behind the view.
    fn end(mut self) -> (Option<i32>, String) {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status.code();
            }
            if begun.elapsed() > PATIENCE {
                self.child.kill().unwrap();
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        while let Ok(bytes) = self.bytes.recv_timeout(Duration::from_millis(300)) {
            self.screen.process(&bytes);
        }
        assert!(!self.screen.screen().alternate_screen(), "the terminal was not given back");
        (status, self.screen.screen().contents().replace('\u{202f}', " "))
    }
}

fn dots(text: &str) -> usize {
    text.chars().filter(|c| ('\u{2801}'..='\u{28ff}').contains(c)).count()
}

/// The chaotic rig, which is let alone for half a second only.
fn quick_rig(folder: &Path) {
    rig_file(folder, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 0.5")]);
}

#[test]
fn the_view_shows_a_capture_and_q_ends_it_in_order() {
    for (size, portrait) in [((80, 24), "phase θ₁"), ((160, 50), "phase portrait of θ₂")] {
        let folder = tempfile::tempdir().unwrap();
        quick_rig(folder.path());
        let arguments = "capture --live --from sim --rig rig.toml -o r.parquet --until C2=0.002% --json r.json";
        let mut run = OnTerminal::start(folder.path(), arguments, size);
        run.until(&["recording", "recorded, until q"]);
        // A rig in real time would need minutes for its first estimate.
        run.press("f");
        let text = run.until(&[
            "B11",
            "still",
            "C2 to ±0.002",
            portrait,
            "θ₂",
            "°/s",
            "section",
            "points",
            "missing",
            "0 gaps",
            "lost 0 times",
            "enabled, running",
            "15.525 mm of 15.525 asked",
            "5.000 Hz",
            "end in order",
            "now",
        ]);
        run.press("f");
        println!("{text}");
        assert!(dots(&text) > 40, "{text}");
        run.press("\t");
        println!("{}", run.until(&["first light", "THE SHAKER IS ON", "encoder 2: θ₂"]));
        run.press("q");
        let (status, after) = run.end();
        assert_eq!(status, Some(0), "{after}");
        assert!(after.contains("samples over") && after.contains("until C2"), "{after}");
        let out = json(&folder.path().join("r.json"));
        assert_eq!((&out["losses"]["lost_on_link"], &out["until"]["reached"]), (&0.into(), &false.into()));
        assert!(!folder.path().join("r.parquet.frames").exists());
        let inspected = whirl(folder.path(), "inspect r.parquet --rig rig.toml --to 20");
        assert_eq!(inspected.status, 0, "{inspected:?}");
    }
}

#[test]
fn control_c_ends_it_too_and_a_small_terminal_says_so() {
    let folder = tempfile::tempdir().unwrap();
    quick_rig(folder.path());
    let arguments = "capture --live --no-drive --from sim --rig rig.toml -o r.parquet";
    let mut run = OnTerminal::start(folder.path(), arguments, (40, 10));
    run.until(&["40 × 10", "80 × 24"]);
    std::thread::sleep(Duration::from_secs(3));
    run.press("\x03");
    let (status, after) = run.end();
    assert_eq!(status, Some(0), "{after}");
    assert!(folder.path().join("r.parquet").exists() && !folder.path().join("r.parquet.frames").exists());
}

#[test]
fn the_precision_asked_for_ends_a_capture() {
    let folder = tempfile::tempdir().unwrap();
    quick_rig(folder.path());
    let loose = whirl(
        folder.path(),
        "capture --until C2=0.04% --seconds 600 --from sim --rig rig.toml -o loose.parquet --json loose.json --strict",
    );
    assert_eq!(loose.status, 0, "{loose:?}");
    let out = json(&folder.path().join("loose.json"));
    let (percent, loose_s) = (out["until"]["percent"].as_f64().unwrap(), out["duration_s"].as_f64().unwrap());
    assert!(percent <= 0.04 && loose_s < 600.0 && out["until"]["reached"] == true && out["complete"] == true, "{out}");
    // Half of that takes about four times as long.
    let half = format!(
        "capture --until C2={}% --seconds 900 --from sim --rig rig.toml -o half.parquet --json half.json",
        percent / 2.0
    );
    assert_eq!(whirl(folder.path(), &half).status, 0);
    let half = json(&folder.path().join("half.json"));
    let ratio = half["duration_s"].as_f64().unwrap() / loose_s;
    assert!((2.0..8.0).contains(&ratio), "{ratio}: {half}");
    // Not reached in the time: said, and not what was asked for.
    let short = whirl(
        folder.path(),
        "capture --until C2=0.001% --seconds 30 --from sim --rig rig.toml -o short.parquet --strict",
    );
    assert_eq!(short.status, 1, "{short:?}");
    assert!(short.stderr.contains("the capture ended before C2 to ±0.001"), "{short:?}");
}

#[test]
fn what_cannot_be_is_refused_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    quick_rig(folder.path());
    rig_file(folder.path(), "measured-double-pendulum.toml", "free.toml", &[]);
    for (arguments, parts) in [
        ("--live --from sim", ["--live", "a terminal to draw on"]),
        ("--until C2=1 --from sim", ["--until", "NAME=X%"]),
        ("--until mass=1% --from sim", ["--until", "B11, B12"]),
        ("--until C2=1% --from file:rig.toml", ["--until", "a device"]),
    ] {
        let run = whirl(folder.path(), &format!("capture {arguments} --rig rig.toml -o r.parquet"));
        assert_eq!(run.status, 2, "{run:?}");
        assert!(parts.iter().all(|part| run.stderr.contains(part)), "{run:?}");
    }
    let unfit = whirl(folder.path(), "capture --until C2=1% --from sim --rig free.toml -o r.parquet");
    assert!(unfit.status == 2 && unfit.stderr.contains("--seconds"), "{unfit:?}");
    assert!(!folder.path().join("r.parquet").exists());
}

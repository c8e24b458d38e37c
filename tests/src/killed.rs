//! Captures that are killed (SIGKILL) at any moment, made records, and resumed; held against one
//! that was not interrupted.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use whirl::record::{Column, ReadOptions, Record};
use whirl::rig::Rig;
use whirl_shared::block::sample_count;
use whirl_shared::codec::Decoder;
use whirl_shared::frame::DeviceMessage;

use crate::repository;

/// What stands in for every kill: the rig and the record that was not interrupted.
pub struct Whole {
    program: PathBuf,
    folder: tempfile::TempDir,
    rig: Rig,
    seconds: f64,
    /// Tick and counts of each sample.
    rows: Vec<(i64, i32, i32)>,
    /// How long it took.
    took: Duration,
}

/// What one kill left.
#[derive(Clone, Copy, Debug, Default)]
pub struct Killed {
    /// Bytes of the journal.
    pub journal: u64,
    /// Samples of the record that it holds.
    pub samples: usize,
    /// The capture had ended before.
    pub ended: bool,
}

fn rows(record: &Record) -> Vec<(i64, i32, i32)> {
    let mut rows = Vec::new();
    for s in &record.segments {
        let [Column::Counts(a), Column::Counts(b)] = &s.columns[..] else { panic!("two columns of counts") };
        rows.extend(a.iter().zip(b).enumerate().map(|(i, (a, b))| (s.first_tick + i as i64, *a, *b)));
    }
    rows
}

impl Whole {
    /// Captures `seconds` of the chaotic rig without an interruption.
    ///
    /// # Panics
    /// If that fails.
    pub fn new(program: &Path, seconds: f64) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let text = std::fs::read_to_string(repository("rigs/chaotic.toml")).expect("a shipped rig file");
        std::fs::write(folder.path().join("rig.toml"), text.replace("settle_s = 20.0", "settle_s = 0.0"))
            .expect("a rig file");
        let rig = Rig::read(folder.path().join("rig.toml")).expect("a rig");
        let mut whole =
            Self { program: program.to_owned(), folder, rig, seconds, rows: Vec::new(), took: Duration::ZERO };
        let begun = Instant::now();
        let (status, told) = whole.run(&["--from", "sim:3", "--seconds", &seconds.to_string()], "whole.parquet");
        assert_eq!(status, Some(0), "{told}");
        whole.took = begun.elapsed();
        whole.rows = rows(&whole.read("whole.parquet"));
        whole
    }

    fn command(&self, arguments: &[&str], record: &str) -> Command {
        let mut command = Command::new(&self.program);
        command.current_dir(self.folder.path()).args(["capture", "--rig", "rig.toml", "-o", record]).args(arguments);
        command
    }

    /// Status and standard error of a capture.
    fn run(&self, arguments: &[&str], record: &str) -> (Option<i32>, String) {
        let output = self.command(arguments, record).output().expect("the program starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }

    fn read(&self, record: &str) -> Record {
        Record::read(self.folder.path().join(record), &self.rig, &ReadOptions::default()).expect("a record")
    }

    /// Samples in a journal that belong to the record, by its bytes alone.
    fn journalled(&self, journal: &[u8]) -> usize {
        let Some(line) = journal.iter().position(|b| *b == 0) else { return 0 };
        let (first, last) = (self.rows[0].0, self.rows[self.rows.len() - 1].0);
        let mut decoder = Decoder::<DeviceMessage>::new();
        let blocks = journal[line + 1..].iter().filter_map(|b| match decoder.push(*b)?.ok()?.message {
            DeviceMessage::Samples(block) => Some((i64::from(block.first_tick), i64::from(sample_count(&block)))),
            _ => None,
        });
        blocks.map(|(at, n)| ((at + n).min(last + 1) - at.max(first)).max(0) as usize).sum()
    }

    /// Kills a capture at a random moment, makes its record of a copy, and resumes it.
    ///
    /// # Panics
    /// Where a sample whose bytes were journalled is not in a record, a step fails, or a message
    /// does not tell the next one.
    pub fn kill(&self, seed: u64) -> Killed {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // From the first instruction to a little behind the end.
        let moment = self.took.mul_f64(1.1 * f64::from(random.next_u32()) / f64::from(u32::MAX));
        let (record, copy) = (format!("{seed}.parquet"), format!("{seed}-copy.parquet"));
        let at = |name: &str| self.folder.path().join(name);
        let asked = self.seconds.to_string();
        let live = ["--from", "sim:3", "--seconds", &asked];
        let mut child =
            self.command(&live, &record).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a child");
        std::thread::sleep(moment);
        child.kill().expect("a kill");
        child.wait().expect("an end");
        let frames = at(&format!("{record}.frames"));
        let Ok(journal) = std::fs::read(&frames) else {
            // Before its first file, or behind its end.
            if at(&record).exists() {
                assert_eq!(rows(&self.read(&record)), self.rows, "seed {seed}");
            }
            return Killed { ended: at(&record).exists(), ..Killed::default() };
        };
        let samples = self.journalled(&journal);
        // The next capture is told what to do, or nothing is in its way; the journal stays as it
        // is.
        if samples > 0 {
            let (status, told) = self.run(&live, &record);
            assert!(
                status == Some(2) && told.contains("--resume") && told.contains("--from file:"),
                "seed {seed}: {told}"
            );
            assert!(std::fs::read(&frames).expect("the journal") == journal, "seed {seed}");
        }
        // The record of what there is: each sample, as without an interruption.
        std::fs::copy(&frames, at(&format!("{copy}.frames"))).expect("a copy");
        let (status, told) = self.run(&["--from", &format!("file:{copy}.frames")], &copy);
        if samples == 0 {
            assert!(status == Some(2) && told.contains("capture again"), "seed {seed}: {status:?} {told}");
        } else {
            assert_eq!(status, Some(0), "seed {seed}: {told}");
            assert!(
                rows(&self.read(&copy)) == self.rows[..samples],
                "seed {seed}: not the {samples} samples of its journal"
            );
            assert!(!at(&format!("{copy}.frames")).exists(), "seed {seed}");
        }
        // Resumed, it goes on behind them; a simulated device has restarted.
        let (status, told) = self.run(
            &["--from", "sim:3", "--resume"].into_iter().chain(live[2..].iter().copied()).collect::<Vec<_>>(),
            &record,
        );
        assert_eq!(status, Some(0), "seed {seed}: {told}");
        let resumed = self.read(&record);
        assert!(rows(&resumed).starts_with(&self.rows[..samples]), "seed {seed}");
        // What is missing of the ticks of a device that has restarted may reach beyond the end.
        if samples == 0 || samples + 200 < self.rows.len() {
            let l = &resumed.losses;
            assert_eq!((l.received + l.lost()) as usize, self.rows.len(), "seed {seed}: {l:?}");
            assert_eq!(
                resumed.segments.last().map(|s| s.boot),
                Some(u32::from(samples > 0)),
                "seed {seed}: {samples} samples"
            );
            assert!(!frames.exists(), "seed {seed}");
        }
        Killed { journal: journal.len() as u64, samples, ended: false }
    }
}

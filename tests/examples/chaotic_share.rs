//! The share of chaotic motions that a plan expects, against the simulator's own plant, over a grid
//! of ten frequencies and ten amplitudes: the table of docs/plan.md.
//! `cargo run --release -p whirl-tests --example chaotic_share [RIG [PLANT_DRAWS]]`; RIG is the name
//! of a file in `rigs` (chaotic).
//!
//! The plan has a model that was identified of one record, and its variational equations. The
//! plant has the rig's true parameters, an integrator of its own, and two motions that start
//! [`APART`] from one another and are set back to it after each period (Benettin and others 1980).

use indicatif::ProgressBar;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use statrs::stats_tests::{Alternative, fishers_exact};
use whirl::error::Result;
use whirl::identify::model_file::identified_model;
use whirl::identify::{Settings, identify};
use whirl::plan::{Setting, Share, chaotic_share};
use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl::rig::plant::Plant as Truth;
use whirl::simulate;
use whirl_hil_sim::plant::{Additions, Plant, State};
use whirl_hil_sim::shaker::{Command, Shaker, phase_increment};
use whirl_tests::repository;

/// Draws of the plan at each setting, as those that it tells of what it proposes.
const DRAWS: usize = 12;
/// Settings along each axis, and their ends in units of the rig's frequency and amplitude: those
/// between which a plan looks where nothing else is said.
const GRID: usize = 10;
const FREQUENCIES: [f64; 2] = [0.6, 1.6];
const AMPLITUDES: [f64; 2] = [0.5, 1.6];
/// Periods that are not counted, and those that are.
const SETTLE: usize = 80;
const PERIODS: usize = 120;
/// Distance of the two motions, rad and rad/s; far above [`TOLERANCE`].
const APART: f64 = 1e-6;
const TOLERANCE: f64 = 1e-10;
/// Growth a period, and its standard errors, above which a motion is chaotic, as in a plan.
const LEAST: f64 = 0.02;
const SIGNIFICANT: f64 = 3.0;
/// How far from hanging a motion begins in every other draw, rad.
const NEAR_REST: f64 = 0.3;

fn wrong(e: impl std::fmt::Display) -> String {
    e.to_string()
}

/// Two motions of the plant under a drive at its full amplitude.
struct Pair {
    plants: [Plant; 2],
    shaker: Shaker,
    command: Command,
    period_s: f64,
}

impl Pair {
    fn new(truth: &Truth, frequency_hz: f64, amplitude_m: f64, start: State) -> std::result::Result<Self, String> {
        let parameters = simulate::parameters(truth);
        let mut beside = start;
        beside[0] += APART;
        let plant = |state| Plant::new(&parameters, &Additions::default(), state, TOLERANCE).map_err(wrong);
        let nm = (amplitude_m * 1e9).round() as u32;
        // One tick of the drive's clock is a hundredth of a period.
        let phase_increment = phase_increment(frequency_hz, 100.0 * frequency_hz).ok_or("no such frequency")?;
        Ok(Self {
            plants: [plant(start)?, plant(beside)?],
            shaker: Shaker::default(),
            command: Command {
                phase_increment,
                increment_before: phase_increment,
                amplitude_nanometre: [nm; 2],
                ..Command::default()
            },
            period_s: 1.0 / frequency_hz,
        })
    }

    /// Logarithm of the growth over one period of the drive.
    fn period(&mut self) -> std::result::Result<f64, String> {
        let base = self.shaker.motion(self.command, 0.0, 0.01 * self.period_s);
        for plant in &mut self.plants {
            plant.advance(&base, self.period_s).map_err(wrong)?;
        }
        let [one, other] = [self.plants[0].state(), self.plants[1].state()];
        let difference: State = core::array::from_fn(|k| other[k] - one[k]);
        let growth = difference.iter().map(|d| d * d).sum::<f64>().sqrt() / APART;
        if growth > 0.0 {
            let inside = self.plants[0].within_turn();
            self.plants[0].set_state(inside);
            self.plants[1].set_state(core::array::from_fn(|k| inside[k] + difference[k] / growth));
            return Ok(growth.ln());
        }
        // Both stick: they begin anew beside one another.
        let mut beside = self.plants[0].within_turn();
        beside[0] += APART;
        self.plants[1].set_state(beside);
        Ok(0.0)
    }
}

/// Whether one motion of the plant is chaotic.
fn is_chaotic(truth: &Truth, frequency_hz: f64, amplitude_m: f64, start: State) -> std::result::Result<bool, String> {
    let mut pair = Pair::new(truth, frequency_hz, amplitude_m, start)?;
    for _ in 0..SETTLE {
        pair.period()?;
    }
    let logs = (0..PERIODS).map(|_| pair.period()).collect::<std::result::Result<Vec<f64>, String>>()?;
    let blocks: Vec<f64> = logs.chunks(PERIODS / 20).map(|b| b.iter().sum::<f64>() / b.len() as f64).collect();
    let n = blocks.len() as f64;
    let mean = blocks.iter().sum::<f64>() / n;
    let error = (blocks.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
    Ok(mean > LEAST.max(SIGNIFICANT * error))
}

/// Initial states: at rest, in every other draw near hanging, in the others anywhere.
fn start(rng: &mut ChaCha8Rng, draw: usize) -> State {
    let uniform = |rng: &mut ChaCha8Rng| rng.random_range(-1.0..1.0_f64);
    // The sum of twelve uniform numbers is nearly normal, of standard deviation two.
    let mut angle = |_| match draw % 2 {
        0 => NEAR_REST * 0.5 * (0..12).map(|_| uniform(rng)).sum::<f64>(),
        _ => core::f64::consts::PI * uniform(rng),
    };
    let [one, two] = [angle(0), angle(1)];
    [one, two, 0.0, 0.0]
}

/// One setting: as the plan expects it, and how many of how many motions of the plant are chaotic.
struct Row {
    frequency_hz: f64,
    amplitude_m: f64,
    expected: Share,
    chaotic: usize,
    of: usize,
}

impl Row {
    /// Probability of numbers as far apart as these or further, were the two shares one: Fisher's
    /// exact test.
    fn probability(&self) -> f64 {
        let Share { draws, chaotic, .. } = self.expected;
        let table = [chaotic, self.chaotic, draws - chaotic, self.of - self.chaotic].map(|n| n as u64);
        fishers_exact(&table, Alternative::TwoSided).unwrap_or(f64::NAN)
    }

    /// Whether the plant's share lies in the interval that the plan tells.
    fn is_inside(&self) -> bool {
        let share = self.chaotic as f64 / self.of as f64;
        (self.expected.interval[0]..=self.expected.interval[1]).contains(&share)
    }
}

fn main() -> Result<()> {
    let name = std::env::args().nth(1).unwrap_or_else(|| "chaotic".to_owned());
    let plant_draws: usize = std::env::args().nth(2).and_then(|s| s.parse().ok()).unwrap_or(40);
    let rig = Rig::read(repository("rigs").join(format!("{name}.toml")))?;
    let truth = Truth::of(&rig)?;
    let folder = tempfile::tempdir().expect("a folder for a record");
    let path = folder.path().join("record.parquet");
    simulate::record(&rig, &[], 120.0, 1, &path, &ProgressBar::hidden())?;
    let record = Record::read(&path, &rig, &ReadOptions::default())?;
    let model = identified_model(&identify(std::slice::from_ref(&record), &rig, &Settings::default())?, &rig)?;
    let drive = rig.drive.expect("a driven rig");
    let at = |[low, high]: [f64; 2], k: usize| low + (high - low) * k as f64 / (GRID - 1) as f64;
    let of = |k: usize| -> Result<Option<Row>> {
        let (f, a) = (at(FREQUENCIES, k / GRID), at(AMPLITUDES, k % GRID));
        let frequency_hz = drive.frequency_hz * f;
        let setting = Setting { frequency_hz: Some(frequency_hz), amplitude_factor: Some(a), ..Setting::default() };
        let Some(expected) = chaotic_share(&rig, &model, &setting, 1, DRAWS)? else { return Ok(None) };
        let amplitude_m = truth.amplitude_m * a;
        let mut rng = ChaCha8Rng::seed_from_u64(1_000 + k as u64);
        let all: Vec<bool> = (0..plant_draws)
            .filter_map(|draw| is_chaotic(&truth, frequency_hz, amplitude_m, start(&mut rng, draw)).ok())
            .collect();
        let chaotic = all.iter().filter(|c| **c).count();
        Ok(Some(Row { frequency_hz, amplitude_m, expected, chaotic, of: all.len() }))
    };
    let rows = (0..GRID * GRID).into_par_iter().map(of).collect::<Result<Vec<_>>>()?;
    let rows: Vec<Row> = rows.into_iter().flatten().collect();
    println!("| Hz | mm | plan: chaotic of draws, 95 % interval | plant: chaotic of draws | probability |");
    println!("|---|---|---|---|---|");
    for r in &rows {
        let e = &r.expected;
        println!(
            "| {:.2} | {:.2} | {} of {}, {:.2} to {:.2} | {} of {} | {:.3} |",
            r.frequency_hz,
            1e3 * r.amplitude_m,
            e.chaotic,
            e.draws,
            e.interval[0],
            e.interval[1],
            r.chaotic,
            r.of,
            r.probability()
        );
    }
    let inside = rows.iter().filter(|r| r.is_inside()).count();
    let apart = rows.iter().filter(|r| r.probability() < 0.05).count();
    println!(
        "\n{inside} of {}: the plant's share lies in the plan's 95 % interval; {apart} differ at 5 % (Fisher)",
        rows.len()
    );
    Ok(())
}

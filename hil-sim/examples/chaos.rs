//! What the presets do: largest Lyapunov exponent, how often arm 1 is beyond 90°, how often arm 2
//! turns over.
//!
//! The exponent is that of two neighbouring trajectories, renormalised once a drive period (G.
//! Benettin, L. Galgani, J.-M. Strelcyn, Phys. Rev. A 14 (1976) 2338), over 600 periods (120 s)
//! after 100 of settling, for each of 20 seeds: mean and range over the seeds. Long records differ:
//! a chaotic history now and then spends minutes near an orbit on which arm 1 whirls.
//!
//! `cargo run --release -p whirl-hil-sim --example chaos [AMPLITUDE_CM …]`

use std::error::Error;

use whirl_hil_sim::plant::{Additions, Parameters, Plant, State, TOLERANCE};
use whirl_hil_sim::shaker::{Command, Shaker, phase_increment};
use whirl_hil_sim::simulate::perturbed;

const RATE_HZ: f64 = 500.0;
const PERIOD: usize = 100;
const SEPARATION: f64 = 1e-7;

struct Found {
    exponent: f64,
    beyond_90: f64,
    turns_a_minute: f64,
}

fn measure(amplitude_m: f64, periods: usize, seed: u64) -> Result<Found, Box<dyn Error>> {
    let mut plant =
        Plant::new(&Parameters::PRINTED, &Additions::default(), perturbed([0.3, 2.0, 0.0, 0.0], seed), TOLERANCE)?;
    let mut neighbour = plant.clone();
    let shaker = Shaker::default();
    let phase_increment = phase_increment(5.0, RATE_HZ).ok_or("no such frequency")?;
    let amplitude_nanometre = [(amplitude_m * 1e9).round() as u32; 2];
    let mut command = Command { phase: 0, phase_increment, amplitude_nanometre, ..Command::default() };
    let (mut sum, mut beyond, mut turned, settle) = (0.0, 0_usize, 0.0, 100);
    for period in 0..settle + periods {
        let start = plant.state();
        for _ in 0..PERIOD {
            let motion = shaker.motion(command, 0.0, 1.0 / RATE_HZ);
            command.phase = command.phase.wrapping_add(phase_increment);
            plant.advance(&motion, 1.0 / RATE_HZ)?;
            neighbour.advance(&motion, 1.0 / RATE_HZ)?;
            if period >= settle && plant.state()[0].cos() < 0.0 {
                beyond += 1;
            }
        }
        let (here, there) = (plant.state(), neighbour.state());
        let distance = (0..4).map(|i| (there[i] - here[i]).powi(2)).sum::<f64>().sqrt();
        if period >= settle {
            sum += (distance / SEPARATION).ln();
            turned += (here[1] - start[1]).abs() / std::f64::consts::TAU;
        }
        let scale = if distance > 0.0 { SEPARATION / distance } else { 0.0 };
        let mut next: State = here;
        for i in 0..4 {
            next[i] += scale * (there[i] - here[i]);
        }
        if distance == 0.0 {
            next[1] += SEPARATION;
        }
        neighbour.set_state(next);
    }
    let n = periods as f64;
    Ok(Found {
        exponent: sum / n,
        beyond_90: beyond as f64 / (n * PERIOD as f64),
        turns_a_minute: turned / n * 5.0 * 60.0,
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut amplitudes: Vec<f64> = Vec::new();
    for text in std::env::args().skip(1) {
        amplitudes.push(text.parse().map_err(|_| format!("\"{text}\" is no amplitude in cm"))?);
    }
    if amplitudes.is_empty() {
        amplitudes = vec![1.15, 1.5525, 1.61, 1.84, 2.07];
    }
    println!("{:>8} {:>32} {:>28} {:>18}", "a, cm", "exponent a period", "arm 1 > 90 deg, %", "arm 2, turns/min");
    for amplitude in amplitudes {
        let found: Vec<Found> = (1..=20).map(|seed| measure(amplitude * 0.01, 600, seed)).collect::<Result<_, _>>()?;
        let (exponent, beyond) = (summary(&found, |f| f.exponent), summary(&found, |f| 100.0 * f.beyond_90));
        let turns = found.iter().map(|f| f.turns_a_minute).sum::<f64>() / found.len() as f64;
        println!("{amplitude:>8} {exponent:>32} {beyond:>28} {turns:>18.1}");
    }
    Ok(())
}

/// Mean, least and greatest.
fn summary(found: &[Found], of: impl Fn(&Found) -> f64) -> String {
    let mut values: Vec<f64> = found.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let (least, middle, most) = (values[0], values[values.len() / 2], values[values.len() - 1]);
    format!("{mean:.3} ({least:.2} .. {middle:.2} .. {most:.2})")
}

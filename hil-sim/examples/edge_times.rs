//! What the times of an encoder's edges would add to its counts: the errors of C11 and B12 with and
//! without them, for an even encoder and for uneven ones.
//!
//! `cargo run --release -p whirl-hil-sim --example edge_times -- [RECORDS]`
//!
//! Method. A record of the chaotic rig is read twice: as counts at the ticks, and as angles at the
//! ticks interpolated between the edges before and after (a cubic through two on either side,
//! within the present count). An efficient estimator is taken, to first order: with r the errors of
//! the angles that were read, the errors of the parameters are
//!
//! ```text
//! (Σ Jᵀ P J)⁻¹ Σ Jᵀ P r
//! ```
//!
//! over pieces of a second, J the derivatives of the trajectory by what is unknown in all pieces
//! (S1, H, S2, J_o2, τ_c1, c_r2, the drive's amplitude and phase, both zeros), P the projection
//! that takes out the piece's own initial state. This is what multiple shooting comes to where the
//! errors are small.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use whirl_hil_sim::{Parameters, Simulation, SimulationError, SimulationSettings};

const RATE_HZ: f64 = 500.0;
const COUNTS: i64 = 4_096;
const STEP: f64 = TAU / COUNTS as f64;
const ARC_MINUTE: f64 = TAU / 21_600.0;
/// Samples of a piece, and pieces of a record.
const PIECE: usize = 500;
const PIECES: usize = 60;
/// Unknowns of a piece's own, and those of all pieces: e1 l1 e2 J_o2 τ_c1 c_r2 amplitude phase zero
/// 1, zero 2.
const OWN: usize = 4;
const COMMON: usize = 10;
const ALL: usize = OWN + COMMON;

/// Where the edges lie beside their places, rad.
struct Disc {
    /// Four edges of each line: A and B are not a quarter apart, nor as long high as low.
    within_line: [f64; 4],
    /// Amplitude and phase of waves a turn: the pattern's centre beside the shaft's, its rings
    /// uneven.
    waves: Vec<(f64, f64)>,
}

impl Disc {
    /// Edges within a line off by up to so much, waves of up to so much in all.
    fn new(within_line: f64, waves: f64, random: &mut ChaCha8Rng) -> Self {
        let mut unit = || f64::from(random.next_u32()) / f64::from(u32::MAX);
        let within_line = [(); 4].map(|()| within_line * (2.0 * unit() - 1.0));
        let mut disc = Self { within_line, waves: (0..6).map(|_| (unit(), TAU * unit())).collect() };
        let most = (0..COUNTS).map(|edge| disc.wave(edge).abs()).fold(0.0, f64::max);
        disc.waves.iter_mut().for_each(|wave| wave.0 *= waves / most);
        disc
    }

    fn wave(&self, edge: i64) -> f64 {
        let turn = edge.rem_euclid(COUNTS) as f64 * STEP;
        let harmonics = self.waves.iter().zip(1_u8..);
        harmonics.map(|(&(amplitude, phase), h)| amplitude * (f64::from(h) * turn + phase).cos()).sum()
    }

    /// Where an edge is.
    fn edge(&self, edge: i64) -> f64 {
        edge as f64 * STEP + self.within_line[edge.rem_euclid(4) as usize] + self.wave(edge)
    }

    /// The count of an angle: the last edge at or below it.
    fn count(&self, angle: f64) -> i64 {
        let mut count = (angle / STEP).floor() as i64;
        while self.edge(count) > angle {
            count -= 1;
        }
        while self.edge(count + 1) <= angle {
            count += 1;
        }
        count
    }
}

/// Edges that a motion passes: time in ticks, and the place that one believes the edge to have.
fn edges(disc: &Disc, motion: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut found = Vec::new();
    for (tick, pair) in motion.windows(2).enumerate() {
        // The cubic with the angles and rates of both ticks, in parts so short that it turns back
        // in few of them.
        let [(y0, d0), (y1, d1)] = [pair[0], pair[1]].map(|(angle, rate)| (angle, rate / RATE_HZ));
        let (c2, c3) = (3.0 * (y1 - y0) - 2.0 * d0 - d1, 2.0 * (y0 - y1) + d0 + d1);
        let at = |u: f64| y0 + u * (d0 + u * (c2 + u * c3));
        const PARTS: u32 = 16;
        for part in 0..PARTS {
            let (from, to) = (f64::from(part) / f64::from(PARTS), f64::from(part + 1) / f64::from(PARTS));
            let (first, last) = (disc.count(at(from)), disc.count(at(to)));
            let up = last > first;
            let passed: Vec<i64> = if up { (first + 1..=last).collect() } else { (last + 1..=first).rev().collect() };
            for edge in passed {
                let (mut low, mut high) = (from, to);
                for _ in 0..40 {
                    let middle = 0.5 * (low + high);
                    if (at(middle) >= disc.edge(edge)) == up { high = middle } else { low = middle }
                }
                found.push((tick as f64 + 0.5 * (low + high), edge as f64 * STEP));
            }
        }
    }
    found
}

/// Angles at the ticks as counts give them, and as edges do, less the true ones.
fn errors(disc: &Disc, motion: &[(f64, f64)]) -> [Vec<f64>; 2] {
    let edges = edges(disc, motion);
    let mut next = 0;
    let (mut by_counts, mut by_edges) = (Vec::new(), Vec::new());
    for (tick, &(angle, _)) in motion.iter().enumerate() {
        let (now, below) = (tick as f64, disc.count(angle) as f64 * STEP);
        by_counts.push(below + 0.5 * STEP - angle);
        while edges.get(next).is_some_and(|edge| edge.0 <= now) {
            next += 1;
        }
        let around = edges.get(next.saturating_sub(2)..(next + 2).min(edges.len())).unwrap_or(&[]);
        let lagrange = |&(time, place): &(f64, f64)| {
            let others = around.iter().filter(|other| other.0 != time);
            place * others.map(|other| (now - other.0) / (time - other.0)).product::<f64>()
        };
        let between: f64 = around.iter().map(lagrange).sum();
        by_edges.push(between.clamp(below, below + STEP) - angle);
    }
    [by_counts, by_edges]
}

fn settings(unknowns: &[f64; 8]) -> SimulationSettings {
    let mut settings = SimulationSettings { seed: None, settle_s: 0.0, ..SimulationSettings::default() };
    let p = &mut settings.parameters;
    [p.e1, p.l1, p.e2, p.j_o2, p.tau_c1, p.c_r2] = core::array::from_fn(|i| unknowns[i]);
    if let Some(drive) = &mut settings.drive {
        (drive.amplitude_m, drive.psi) = (unknowns[6], unknowns[7]);
    }
    settings
}

const PRINTED: [f64; 8] = {
    let p = Parameters::PRINTED;
    [p.e1, p.l1, p.e2, p.j_o2, p.tau_c1, p.c_r2, 0.015_525, 0.0]
};

/// Both angles over a piece.
fn piece(unknowns: &[f64; 8], initial: [f64; 4], phase: u32) -> Result<Vec<[f64; 2]>, SimulationError> {
    let settings = SimulationSettings { initial, initial_phase: phase, tolerance: 1e-10, ..settings(unknowns) };
    let mut simulation = Simulation::new(&settings)?;
    (0..PIECE).map(|_| simulation.next_sample().map(|sample| sample.angles)).collect()
}

/// Derivatives of a piece by all unknowns, the piece's own first, as differences.
fn derivatives(initial: [f64; 4], phase: u32) -> Result<Vec<[[f64; 2]; ALL]>, SimulationError> {
    let base = piece(&PRINTED, initial, phase)?;
    let mut table = vec![[[0.0; 2]; ALL]; PIECE];
    for k in 0..ALL {
        let (mut unknowns, mut initial) = (PRINTED, initial);
        // Small against what bends the trajectory, large against its tolerance; the amplitude in
        // whole nanometres.
        let step = match k {
            10 => 1e-7,
            0..OWN | 11.. => 1e-6,
            _ => 1e-6 * PRINTED[k - OWN],
        };
        match k {
            0..OWN => initial[k] += step,
            OWN..12 => unknowns[k - OWN] += step,
            _ => {
                // A zero moves its encoder's angles and nothing else.
                table.iter_mut().for_each(|row| row[k][k - 12] = 1.0);
                continue;
            }
        }
        for ((row, moved), base) in table.iter_mut().zip(piece(&unknowns, initial, phase)?).zip(&base) {
            row[k] = [0, 1].map(|i| (moved[i] - base[i]) / step);
        }
    }
    Ok(table)
}

/// Solves the normal equations of several right sides in place, by Gauss's elimination from the
/// first unknown on. Of the first `upto` unknowns only, they are taken out of the others.
fn eliminate<const R: usize>(matrix: &mut [[f64; ALL]; ALL], right: &mut [[f64; R]; ALL], upto: usize) {
    for k in 0..upto {
        for row in k + 1..ALL {
            let share = matrix[row][k] / matrix[k][k];
            for column in k..ALL {
                matrix[row][column] -= share * matrix[k][column];
            }
            for r in 0..R {
                right[row][r] -= share * right[k][r];
            }
        }
    }
}

/// Relative errors of B12 and C11 by each of the readings.
fn parameter_errors<const R: usize>(
    states: &[[f64; 4]],
    phases: &[u32],
    readings: &[[Vec<f64>; 2]; R],
) -> Result<[[f64; 2]; R], SimulationError> {
    let (mut whole, mut right_of_all) = ([[0.0; ALL]; ALL], [[0.0; R]; ALL]);
    for n in 0..PIECES {
        let from = n * PIECE;
        let table = derivatives(states[from], phases[from])?;
        let (mut matrix, mut right) = ([[0.0; ALL]; ALL], [[0.0; R]; ALL]);
        for (sample, row) in table.iter().enumerate() {
            for i in 0..2 {
                for a in 0..ALL {
                    for b in 0..ALL {
                        matrix[a][b] += row[a][i] * row[b][i];
                    }
                    for r in 0..R {
                        right[a][r] += row[a][i] * readings[r][i][from + sample];
                    }
                }
            }
        }
        eliminate(&mut matrix, &mut right, OWN);
        for a in OWN..ALL {
            for b in OWN..ALL {
                whole[a][b] += matrix[a][b];
            }
            for r in 0..R {
                right_of_all[a][r] += right[a][r];
            }
        }
    }
    // Of all pieces' sums the first unknowns are gone.
    for k in 0..OWN {
        whole[k][k] = 1.0;
    }
    eliminate(&mut whole, &mut right_of_all, ALL);
    let mut values = [[0.0; R]; ALL];
    for k in (OWN..ALL).rev() {
        for r in 0..R {
            let known: f64 = (k + 1..ALL).map(|j| whole[k][j] * values[j][r]).sum();
            values[k][r] = (right_of_all[k][r] - known) / whole[k][k];
        }
    }
    let p = Parameters::PRINTED;
    Ok(core::array::from_fn(|r| {
        // B12 = g S1/(J_o1 Ω²), S1 = m1 e1 + m2 l1; C11 = τ_c1/(J_o1 Ω²).
        [(p.m1 * values[OWN][r] + p.m2 * values[OWN + 1][r]) / p.s1(), values[OWN + 4][r] / p.tau_c1]
    }))
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value * value, n + 1.0));
    f64::sqrt(sum / n)
}

fn main() -> Result<(), SimulationError> {
    let records = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(12_u64).max(1);
    let kinds =
        [("even", 0.0, 0.0), ("edges of a line", 0.18 * STEP, 0.0), ("10' a turn", 0.18 * STEP, 10.0 * ARC_MINUTE)];
    // By kind and reading: rms of the angle's error, and the errors of both parameters in each
    // record.
    let mut angle = [[0.0; 2]; 3];
    let mut found: [[Vec<[f64; 2]>; 2]; 3] = Default::default();
    for seed in 1..=records {
        let mut simulation =
            Simulation::new(&SimulationSettings { seed: Some(seed), ..SimulationSettings::default() })?;
        let (mut states, mut phases) = (Vec::new(), Vec::new());
        for _ in 0..=PIECE * PIECES {
            states.push(simulation.plant().state());
            phases.push(simulation.next_sample()?.phase);
        }
        let motions = [
            states.iter().map(|s| (s[0], s[2])).collect::<Vec<_>>(),
            states.iter().map(|s| (s[1] - s[0], s[3] - s[2])).collect(),
        ];
        let mut random = ChaCha8Rng::seed_from_u64(1_000 + seed);
        let mut readings: [[Vec<f64>; 2]; 6] = Default::default();
        for (kind, &(_, within_line, waves)) in kinds.iter().enumerate() {
            for encoder in 0..2 {
                let disc = Disc::new(within_line, waves, &mut random);
                for (way, error) in errors(&disc, &motions[encoder]).into_iter().enumerate() {
                    angle[kind][way] += rms(error.iter().copied()).powi(2);
                    readings[2 * kind + way][encoder] = error;
                }
            }
        }
        for (reading, errors) in parameter_errors(&states, &phases, &readings)?.into_iter().enumerate() {
            found[reading / 2][reading % 2].push(errors);
        }
    }
    println!(
        "encoder           read by   angle, arc min   B12, %    C11, %   (rms of {records} records of {PIECES} s)"
    );
    for (kind, (name, ..)) in kinds.iter().enumerate() {
        for (way, read_by) in ["counts", "edges"].into_iter().enumerate() {
            let angle = f64::sqrt(angle[kind][way] / (2 * records) as f64) / ARC_MINUTE;
            let [b12, c11] = [0, 1].map(|i| 100.0 * rms(found[kind][way].iter().map(|errors| errors[i])));
            println!("{name:<17} {read_by:<8} {angle:>10.2} {b12:>14.5} {c11:>9.4}");
        }
    }
    Ok(())
}

//! Coordinates of a record: unwrapped displacements, derived absolute angles, velocities.
//!
//! Angles live on the circle. Between two samples an angle that is known modulo a turn moves by the
//! shorter way round (so a rig that turns by half a turn between samples is beyond this program);
//! one that is counted on stands. Where joint k's angle is measured relative to the arm before
//! (`theta2`), the absolute angle φ_k = φ_{k−1} + θ_k is derived; φ1 is θ1.
//!
//! Velocities for rms values and portraits are slopes of a cubic fitted to 2m + 1 samples (Savitzky
//! and Golay 1964): v_n = Σ_i c_i x_{n+i}/h, c_i = (S6 i − S4 i³)/(S2 S6 − S4²), S_p = Σ i^p; m = 2
//! is the five-point rule (3.29). Spectra use mean velocities over one sample instead, see
//! [`Motion::increments`].

use serde::Serialize;
use std::f64::consts::{PI, TAU};

use crate::record::unwrap::Turns;
use crate::record::{Column, Record};
use crate::rig::Channel;
use crate::statistics::median;

/// Where a coordinate lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Space {
    /// An angle on the circle, rad.
    S1,
    /// A number on the line.
    R,
}

/// One coordinate over the whole record.
#[derive(Clone, Debug)]
pub struct Motion {
    /// The model's name of it.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// Circle or line.
    pub space: Space,
    /// Sum of measured coordinates rather than measured.
    pub derived: bool,
    /// Quantisation step in the SI unit, 0 where there is none.
    pub step: f64,
    /// What counting in these steps alone leaves, rms: of a sum the root of the sum of squares.
    pub quantisation_noise: f64,
    /// One unwrapped series for each segment of the record.
    pub stretches: Vec<Vec<f64>>,
}

/// Unwraps stretches of an angle, rad, that was recorded modulo a turn.
pub fn unwrap_all(stretches: &mut [Vec<f64>]) {
    let mut turns = Turns::new(TAU);
    stretches.iter().for_each(|x| turns.add(x, true));
    if turns.wrap() {
        stretches.iter_mut().for_each(|x| unwrap(x));
    }
}

/// Unwraps in place: each step goes the shorter way round.
fn unwrap(angles: &mut [f64]) {
    let mut turns = 0.0;
    for n in 1..angles.len() {
        let raw = angles[n] + turns;
        let step = raw - angles[n - 1];
        let correction = -TAU * ((step + PI) / TAU).floor();
        turns += correction;
        angles[n] = raw + correction;
    }
}

/// The quantisation step of a channel, SI: 2π/N for counts; for numbers, the step of which nearly
/// all differences between distinct values are multiples, where there is one; otherwise 0.
pub fn quantisation_step(column_parts: &[&Column], scale: f64) -> f64 {
    let mut distinct: Vec<f64> = Vec::new();
    for part in column_parts {
        match part {
            Column::Counts(_) => return scale.abs(),
            // At most 200 000 values are looked at: enough to see a grid, bounded for long records.
            Column::Values(v) => distinct.extend(v.iter().take(200_000_usize.saturating_sub(distinct.len()))),
        }
    }
    distinct.sort_by(f64::total_cmp);
    distinct.dedup();
    let mut gaps: Vec<f64> = distinct.windows(2).map(|w| w[1] - w[0]).filter(|g| *g > 0.0).collect();
    if gaps.len() < 4 {
        return 0.0;
    }
    gaps.sort_by(f64::total_cmp);
    // Rounding makes the smallest gaps of a printed grid uneven; the tenth percentile is one step
    // wherever the grid is finer than the motion between samples.
    let coarse = gaps[gaps.len() / 10];
    let near: Vec<f64> = gaps.iter().copied().filter(|g| (0.6..1.4).contains(&(g / coarse))).collect();
    let step = near.iter().sum::<f64>() / near.len().max(1) as f64;
    let on_grid = gaps.iter().filter(|g| ((*g / step) - (*g / step).round()).abs() < 0.1 && **g < 50.0 * step).count();
    if step > 0.0 && on_grid * 10 >= gaps.len() * 9 { step * scale.abs() } else { 0.0 }
}

/// Whether a channel's sensor counts, in its own unit or in angles that were made of counts.
///
/// A grid of a power of ten in the file's unit is its last digit: that says nothing of the sensor.
pub fn counts(channel: &Channel, motion: &Motion) -> bool {
    let decades = (motion.step / channel.step().abs()).log10();
    channel.unit == "count"
        || (motion.space == Space::S1 && motion.step > 0.0 && (decades - decades.round()).abs() > 0.02)
}

/// The record's coordinates: measured ones in the channels' order, then derived absolute angles.
pub fn motions(record: &Record) -> Vec<Motion> {
    let mut all: Vec<Motion> = Vec::new();
    for (c, channel) in record.channels.iter().enumerate() {
        let angle = matches!(channel.unit.as_str(), "count" | "rad" | "deg");
        let parts: Vec<&Column> = record.segments.iter().filter_map(|s| s.columns.get(c)).collect();
        let mut stretches: Vec<Vec<f64>> = parts.iter().map(|column| column.angle(channel)).collect();
        if angle {
            unwrap_all(&mut stretches);
        }
        let step = quantisation_step(&parts, channel.step());
        all.push(Motion {
            name: channel.measures.clone(),
            unit: channel.si_unit().to_owned(),
            space: if angle { Space::S1 } else { Space::R },
            derived: false,
            step,
            quantisation_noise: step / 12f64.sqrt(),
            stretches,
        });
    }
    for k in 2..=9 {
        let find = |name: String| all.iter().find(|m| m.name == name && m.space == Space::S1);
        let before = find(format!("phi{}", k - 1)).or_else(|| if k == 2 { find("theta1".to_owned()) } else { None });
        let (Some(before), Some(relative), None) = (before, find(format!("theta{k}")), find(format!("phi{k}"))) else {
            continue;
        };
        let sum = before.stretches.iter().zip(&relative.stretches);
        let derived = Motion {
            name: format!("phi{k}"),
            unit: "rad".to_owned(),
            space: Space::S1,
            derived: true,
            step: before.step.max(relative.step),
            quantisation_noise: before.quantisation_noise.hypot(relative.quantisation_noise),
            stretches: sum.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a + b).collect()).collect(),
        };
        all.push(derived);
    }
    all
}

impl Motion {
    /// The series whose spectrum is taken: for an angle the mean velocity over each sample,
    /// (x_{n+1} − x_n)/h, which needs no choice of a reference turn; for a number the number
    /// itself.
    ///
    /// A mean over one sample multiplies the velocity's spectrum by sinc(f h): see
    /// [`Motion::response`].
    pub fn increments(&self, rate_hz: f64) -> Vec<Vec<f64>> {
        match self.space {
            Space::R => self.stretches.clone(),
            Space::S1 => {
                self.stretches.iter().map(|x| x.windows(2).map(|w| (w[1] - w[0]) * rate_hz).collect()).collect()
            }
        }
    }

    /// Magnitude of the response of [`Motion::increments`] to the velocity at a frequency:
    /// sin(πf h)/(πf h) for angles (0.64 at the Nyquist frequency), 1 for numbers.
    pub fn response(&self, frequency_hz: f64, rate_hz: f64) -> f64 {
        let x = PI * frequency_hz / rate_hz;
        if self.space == Space::R || x == 0.0 { 1.0 } else { x.sin() / x }
    }

    /// Standard deviation of white noise in the displacement, from differences of rising order:
    /// σ_p = rms(Δ^p x)/√C(2p, p), the least over p = 1 … 8 and over the middle of blocks of 256
    /// samples.
    ///
    /// Differences remove the smooth motion and keep white noise; coloured noise is underestimated.
    /// A record shorter than 16 samples has 0.
    pub fn noise(&self) -> f64 {
        let mut per_order = vec![Vec::new(); 8];
        for x in &self.stretches {
            for block in x.chunks(256).filter(|b| b.len() >= 16) {
                let mut d = block.to_vec();
                let mut gain = 1.0;
                for (p, values) in per_order.iter_mut().enumerate() {
                    d = d.windows(2).map(|w| w[1] - w[0]).collect();
                    let order = (p + 1) as f64;
                    gain *= (2.0 * order) * (2.0 * order - 1.0) / (order * order);
                    values.push(d.iter().map(|d| d * d).sum::<f64>() / d.len() as f64 / gain);
                }
            }
        }
        if per_order[0].is_empty() {
            return 0.0;
        }
        per_order.iter_mut().map(|v| median(v).sqrt()).fold(f64::INFINITY, f64::min)
    }

    /// Velocities by cubic slopes over 2m + 1 samples; sample n of a stretch's result belongs to
    /// sample n + m of the stretch. Stretches shorter than 2m + 1 have none.
    pub fn velocities(&self, rate_hz: f64, m: usize) -> Vec<Vec<f64>> {
        let weights = slope_weights(m);
        self.stretches
            .iter()
            .map(|x| {
                x.windows(2 * m + 1)
                    .map(|w| {
                        // Relative to the middle, so that turns of a whirling arm cost no digits.
                        let middle = w[m];
                        w.iter().zip(&weights).map(|(x, c)| c * (x - middle)).sum::<f64>() * rate_hz
                    })
                    .collect()
            })
            .collect()
    }
}

/// Weights c_{−m} … c_m of the cubic slope.
fn slope_weights(m: usize) -> Vec<f64> {
    let m = m.max(2) as i64;
    let moment = |p: i32| (-m..=m).map(|i| (i as f64).powi(p)).sum::<f64>();
    let (s2, s4, s6) = (moment(2), moment(4), moment(6));
    let determinant = s2 * s6 - s4 * s4;
    (-m..=m).map(|i| (s6 * i as f64 - s4 * (i as f64).powi(3)) / determinant).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::angles::wrap;

    #[test]
    fn unwraps_a_whirl_either_way() {
        for rate in [0.4, -0.4] {
            let truth: Vec<f64> = (0..200).map(|n| 1.0 + rate * f64::from(n)).collect();
            let x: Vec<f64> = truth.iter().map(|&a| wrap(a)).collect();
            let mut all = vec![x];
            unwrap_all(&mut all);
            assert!(all[0].iter().zip(&truth).all(|(a, b)| (a - b).abs() < 1e-9));
        }
        // Counted on, four radians a sample.
        let truth: Vec<f64> = (0..200).map(|n| 4.0 * f64::from(n)).collect();
        let mut all = vec![truth.clone()];
        unwrap_all(&mut all);
        assert_eq!(all[0], truth);
    }

    #[test]
    fn slope_of_two_is_the_five_point_rule_and_cubics_are_exact() {
        let w = slope_weights(2);
        for (w, want) in w.iter().zip([1.0, -8.0, 0.0, 8.0, -1.0]) {
            assert!((w - want / 12.0).abs() < 1e-14);
        }
        let x = |t: f64| 2.0 - t + 3.0 * t * t - 0.5 * t.powi(3);
        for m in [2, 5, 9] {
            let slope: f64 = slope_weights(m).iter().enumerate().map(|(i, c)| c * x(1.0 + i as f64 - m as f64)).sum();
            assert!((slope - (-1.0 + 6.0 - 1.5)).abs() < 1e-9, "{m}: {slope}");
        }
    }

    #[test]
    fn noise_of_a_smooth_quantised_motion_is_the_step_over_root_twelve() {
        let step = TAU / 4096.0;
        let x: Vec<f64> =
            (0..5000).map(|n| ((3.0 * (0.031 * f64::from(n)).sin() / step).floor() + 0.5) * step).collect();
        let motion = Motion {
            name: "x".into(),
            unit: "rad".into(),
            space: Space::S1,
            derived: false,
            step,
            quantisation_noise: step / 12f64.sqrt(),
            stretches: vec![x],
        };
        let ratio = motion.noise() / (step / 12f64.sqrt());
        assert!((0.85..1.1).contains(&ratio), "{ratio}");
    }

    #[test]
    fn finds_the_grid_of_printed_values_and_none_in_smooth_ones() {
        let grid: Vec<f64> = (0..3000)
            .map(|n| ((0.7 * (0.01 * f64::from(n)).sin() / 0.00153).round() * 0.00153 * 1e6).round() / 1e6)
            .collect();
        let step = quantisation_step(&[&Column::Values(grid)], 1.0);
        assert!((step - 0.00153).abs() < 2e-6, "{step}");
        let smooth: Vec<f64> = (0..3000).map(|n| (0.7123 * f64::from(n)).sin()).collect();
        assert_eq!(quantisation_step(&[&Column::Values(smooth)], 1.0), 0.0);
        assert_eq!(quantisation_step(&[&Column::Counts(vec![1])], 0.25), 0.25);
    }
}

//! Noise that a spectrum's upper end does not show: of records that were smoothed before they were
//! given (a zero-phase low-pass, a running polynomial), and of sensors that are slow themselves.
//!
//! Above its corner a filter has taken the noise away, and the level that is read there is too low
//! by decades. What the right model leaves is then noise of a flat spectrum up to the corner and
//! hardly anything above. What a model lacks is a function of the motion, and has the motion's
//! lines and its decay: no flat spectrum; where a random force moves it, its spectrum is flat as
//! well, but the motion itself stands far above it up to the corner. With D_k the mean periodogram
//! (Hann) of what is left in the windows of shooting and f_c the frequency below which nine tenths
//! of its power lie, the flatness exp(mean ln D)/mean D over the bins up to f_c (Gray and Markel
//! 1974) is 1 − 1/ν for white noise and ν degrees of freedom. Next to the corner the record must
//! hold little else.

use core::f64::consts::{PI, TAU};

use realfft::{RealFftPlanner, RealToComplex};

use super::super::exchange::MISSES;
use super::super::setting::Setting;
use super::super::state::State;
use crate::identify::remeasured::Sensors;

/// Share of the power that lies below the corner.
const BELOW: f64 = 0.9;
/// Corner over half the sampling rate beyond which a spectrum's upper end shows the noise.
const WHITE: f64 = 0.6;
/// Least flatness: a spectrum that decays exponentially has 0.81 up to nine tenths of its power,
/// whatever its rate (0.88 to 1.03 of nine smoothed channels of other simulators; 0.17 to 0.71 of
/// what seven models lacked, 0.85 of one that a random force moved).
const FLAT: f64 = 0.85;
/// Fewest bins up to the corner: of fewer, any spectrum is flat.
const BINS: usize = 8;
/// Bins of a window at the lower end that its own state takes.
const OWN: usize = 2;
/// What the record has in the last quarter below the corner, over what is left of it there, at most
/// (a motion that a model misses by a tenth has a hundred).
const ALONE: f64 = 5.0;
/// Segments that a record gives.
const SEGMENTS: usize = 8;

/// A sensor whose noise is told by what the model leaves.
#[derive(Clone, Debug, PartialEq)]
pub struct Coloured {
    /// Sensor.
    pub sensor: usize,
    /// Standard deviation of the noise, SI.
    pub sigma: f64,
    /// What the spectrum's upper end said.
    pub before: f64,
    /// Frequency above which there is hardly any, Hz.
    pub corner_hz: f64,
}

/// What is left of a sensor: its summed periodogram.
struct Rest {
    density: Vec<f64>,
    /// The same of what the sensor showed.
    record: Vec<f64>,
    segments: usize,
    /// Bins that the windows' own states take.
    own: usize,
    /// Mean square.
    square: f64,
}

impl Rest {
    /// Corner as a bin; none of what is white, or has too few bins below it.
    fn corner(&self) -> Option<usize> {
        let shown = self.density.get(self.own..)?;
        let whole: f64 = shown.iter().sum();
        let mut sum = 0.0;
        let below = shown.iter().position(|d| {
            sum += d;
            sum >= BELOW * whole
        })?;
        let corner = self.own + below;
        let is_low = (corner as f64) < WHITE * self.density.len() as f64;
        (is_low && below >= BINS && whole > 0.0).then_some(corner)
    }

    /// Whether next to the corner the record holds what is left and hardly anything else.
    fn is_alone(&self, corner: usize) -> bool {
        let top = self.own + 3 * (corner - self.own) / 4..=corner;
        let sum = |of: &[f64]| of[top.clone()].iter().sum::<f64>();
        sum(&self.record) < ALONE * sum(&self.density)
    }

    /// exp(mean ln D)/mean D up to a bin, over what white noise of so many segments has.
    fn flatness(&self, corner: usize) -> f64 {
        let shown = &self.density[self.own..=corner];
        let count = shown.len() as f64;
        let (logs, mean) = shown.iter().fold((0.0, 0.0), |(l, m), d| (l + d.ln() / count, m + d / count));
        (logs.exp() / mean) / (1.0 - 0.5 / self.segments as f64)
    }
}

/// The sensors' noise where it is coloured, and which; none where none is. What counts has the noise
/// of its grid.
pub fn coloured(setting: &Setting<'_>, state: &State) -> Option<(Sensors, Vec<Coloured>)> {
    let step_s = setting.raw.first()?.step_s;
    let mut out = setting.sensors.clone();
    let mut told = Vec::new();
    for k in (0..out.sigma.len()).filter(|&k| setting.sensors.count[k].is_none()) {
        let rest = rest(setting, state, k)?;
        let sigma = rest.square.sqrt() / state.gains[k];
        if sigma * sigma <= MISSES * out.sigma[k] * out.sigma[k] {
            continue;
        }
        let corner = rest.corner()?;
        if rest.flatness(corner) < FLAT || !rest.is_alone(corner) {
            return None;
        }
        let bin_hz = 1.0 / (2.0 * step_s * (rest.density.len() - 1) as f64);
        told.push(Coloured { sensor: k, sigma, before: out.sigma[k], corner_hz: corner as f64 * bin_hz });
        // As many independent values as the band holds.
        out.sigma[k] = sigma;
        out.square_error[k] = (1.0 / (rest.segments * (corner - rest.own)) as f64).sqrt();
    }
    (!told.is_empty()).then_some((out, told))
}

/// What is left of a sensor along each stretch where the motion was followed, and what it showed.
fn left(setting: &Setting<'_>, state: &State, sensor: usize) -> Option<Vec<[Vec<f64>; 2]>> {
    let followed = state.followed.as_ref()?;
    let n = setting.circle.len();
    let weights = setting.bound.shown.row(sensor);
    let shown: Vec<Vec<f64>> = state.stretches.iter().map(|s| s.sensors(&setting.bound).swap_remove(sensor)).collect();
    let mut runs: Vec<(usize, usize, [Vec<f64>; 2])> = Vec::new();
    for w in followed.kept(setting)? {
        let path = &followed.paths[w.stretch];
        let of = |at: usize| {
            let state = &path.states[2 * n * at..2 * n * at + n];
            let predicted: f64 = weights.iter().zip(state).map(|(w, q)| w * q).sum();
            shown[w.stretch][path.first + at] - predicted
        };
        let own = (w.first..w.first + w.count).map(of);
        let record = &shown[w.stretch][path.first + w.first..path.first + w.first + w.count];
        match runs.last_mut() {
            Some((stretch, end, [left, shown])) if (*stretch, *end) == (w.stretch, w.first) => {
                left.extend(own);
                shown.extend(record);
                *end += w.count;
            }
            _ => runs.push((w.stretch, w.first + w.count, [own.collect(), record.to_vec()])),
        }
    }
    Some(runs.into_iter().map(|r| r.2).collect())
}

/// Adds the periodogram (Hann) of the second difference of a segment, which whirling leaves
/// stationary, to a sum of them.
fn add(segment: &[f64], fft: &dyn RealToComplex<f64>, to: &mut [f64]) -> Option<()> {
    let (mut input, mut output) = (fft.make_input_vec(), fft.make_output_vec());
    let length = input.len();
    for (i, (x, s)) in input.iter_mut().zip(segment.windows(3)).enumerate() {
        let hann = 0.5 - 0.5 * (TAU * i as f64 / length as f64).cos();
        *x = (s[0] - 2.0 * s[1] + s[2]) * hann;
    }
    fft.process(&mut input, &mut output).ok()?;
    to.iter_mut().zip(&output).for_each(|(d, z)| *d += z.norm_sqr());
    Some(())
}

/// Spectrum of what is left of a sensor in segments of several windows.
fn rest(setting: &Setting<'_>, state: &State, sensor: usize) -> Option<Rest> {
    let runs = left(setting, state, sensor)?;
    let window = state.followed.as_ref()?.samples();
    let whole: usize = runs.iter().map(|[left, _]| left.len()).sum();
    let longest = runs.iter().map(|[left, _]| left.len()).max()?;
    let length = (whole / SEGMENTS).max(window).min(longest) & !1;
    if length < window.max(4) {
        return None;
    }
    let fft = RealFftPlanner::<f64>::new().plan_fft_forward(length - 2);
    let bins = length / 2;
    let (mut density, mut record, mut segments) = (vec![0.0; bins], vec![0.0; bins], 0);
    for [left, shown] in &runs {
        for (left, shown) in left.chunks_exact(length).zip(shown.chunks_exact(length)) {
            add(left, &*fft, &mut density)?;
            add(shown, &*fft, &mut record)?;
            segments += 1;
        }
    }
    for (k, (d, r)) in density.iter_mut().zip(&mut record).enumerate() {
        let shape = (2.0 * (PI * k.max(1) as f64 / (length - 2) as f64).sin()).powi(4);
        (*d, *r) = (*d / shape, *r / shape);
    }
    let square = runs.iter().flat_map(|[left, _]| left).map(|r| r * r).sum::<f64>() / whole as f64;
    let own = (OWN * length).div_ceil(window);
    (segments > 0).then_some(Rest { density, record, segments, own, square })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight segments' periodogram whose mean is the square of `shape` at each of 200 bins.
    fn of(shape: impl Fn(usize) -> f64) -> Rest {
        let noise = |k: usize, m: usize| {
            let chance = (43_758.545 * (12.9898 * (k + 977 * m) as f64).sin()).fract().abs();
            -(chance.max(1e-9)).ln()
        };
        let density: Vec<f64> = (0..200).map(|k| (0..8).map(|m| noise(k, m)).sum::<f64>() * shape(k).powi(2)).collect();
        let record = (0..200).map(|k| if k < 20 { 1e6 } else { 1.0 }).zip(&density).map(|(f, d): (f64, &f64)| f * d);
        Rest { record: record.collect(), density, segments: 8, own: 4, square: 1.0 }
    }

    #[test]
    fn smoothed_noise_is_flat_up_to_its_corner_and_a_motion_is_not() {
        // Zero-phase, second order twice, corner at bin 40.
        let smoothed = of(|k| 1.0 / (1.0 + (k as f64 / 40.0).powi(4)));
        let corner = smoothed.corner().unwrap();
        assert!((30..50).contains(&corner) && smoothed.flatness(corner) > FLAT, "{corner}");
        assert!(smoothed.is_alone(corner) && !smoothed.is_alone(22));
        // White noise has no corner below its end.
        assert_eq!(of(|_| 1.0).corner(), None);
        // What a model lacks decays with the motion, or has its lines.
        for missing in [of(|k| (-0.06 * k as f64).exp()), of(|k| if k % 9 == 0 && k < 90 { 1.0 } else { 0.1 })] {
            let flat = missing.corner().map_or(0.0, |c| missing.flatness(c));
            assert!(flat < FLAT, "{flat}");
        }
    }
}

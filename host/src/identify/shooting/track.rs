//! Records cut into pieces, with a first guess of each piece's initial state.

use core::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};

use super::problem::Piece;

/// An unbroken stretch of a record, as its sensors measured it.
pub struct MeasuredStretch<'a> {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Values, one list for each sensor.
    pub sensors: Vec<Vec<f64>>,
    /// Phase of the drive at a sample, rad.
    pub tau: Box<dyn Fn(usize) -> f64 + Sync + 'a>,
}

/// What the sensors measure, and which coordinates are angles that may whirl.
pub struct Geometry<'a> {
    /// Weights of the coordinates for each sensor.
    pub sensors: &'a [Vec<f64>],
    /// Whether each coordinate is an angle: then whole turns are taken off at the start of a piece.
    pub angles: &'a [bool],
    /// Spacing of the samples, s.
    pub spacing_s: f64,
    /// Samples for the guess of a state.
    pub guess: usize,
}

/// Coordinates from sensors: the pseudo-inverse of the sensors' weights.
fn pseudo_inverse(sensors: &[Vec<f64>]) -> Option<DMatrix<f64>> {
    let n = sensors.first()?.len();
    let m = DMatrix::from_fn(sensors.len(), n, |i, j| sensors[i][j]);
    (m.transpose() * &m).try_inverse().map(|inverse| inverse * m.transpose())
}

/// Pieces of `length` samples, one after the other; what is left of a stretch makes a shorter one
/// if it has at least `shortest`. With each piece a guess of its initial state: the parabola
/// through its first samples. None where the sensors do not give the coordinates.
pub fn cut(
    stretches: &[MeasuredStretch<'_>],
    geometry: &Geometry<'_>,
    length: usize,
    shortest: usize,
) -> Option<(Vec<Piece>, Vec<Vec<f64>>)> {
    let inverse = pseudo_inverse(geometry.sensors)?;
    let (n, channels) = (geometry.angles.len(), geometry.sensors.len());
    let (mut pieces, mut states) = (Vec::new(), Vec::new());
    let fit = parabola(geometry.guess, geometry.spacing_s)?;
    for (k, stretch) in stretches.iter().enumerate() {
        let all = stretch.sensors.iter().map(Vec::len).min().unwrap_or(0);
        let mut first = 0;
        while first < all {
            let count = length.min(all - first);
            if count < shortest.max(geometry.guess) {
                break;
            }
            let at = |i: usize| DVector::from_fn(channels, |k, _| stretch.sensors[k][first + i]);
            let here = &inverse * at(0);
            let turns =
                DVector::from_fn(n, |j, _| if geometry.angles[j] { (here[j] / TAU).round() * TAU } else { 0.0 });
            let offset: Vec<f64> =
                geometry.sensors.iter().map(|w| w.iter().zip(turns.iter()).map(|(w, t)| w * t).sum()).collect();
            let measured: Vec<f64> = (first..first + count)
                .flat_map(|i| (0..channels).map(move |k| (i, k)))
                .map(|(i, k)| stretch.sensors[k][i] - offset[k])
                .collect();
            let mut state = vec![0.0; 2 * n];
            for i in 0..geometry.guess {
                let y = DVector::from_fn(channels, |k, _| measured[i * channels + k]);
                let q = &inverse * y;
                for j in 0..n {
                    state[j] += fit[(0, i)] * q[j];
                    state[n + j] += fit[(1, i)] * q[j];
                }
            }
            pieces.push(Piece {
                start_s: stretch.start_s + first as f64 * geometry.spacing_s,
                tau: (stretch.tau)(first),
                stretch: k,
                measured,
            });
            states.push(state);
            first += count;
        }
    }
    Some((pieces, states))
}

/// Weights that give value and slope at the first of `count` samples from a least-squares parabola
/// (a line for fewer than five samples).
fn parabola(count: usize, spacing_s: f64) -> Option<DMatrix<f64>> {
    let order = if count < 5 { 2 } else { 3 };
    let design = DMatrix::from_fn(count, order, |i, j| (i as f64 * spacing_s).powi(j as i32));
    // Scaled so that the powers of short times do not spoil the solution.
    let scale =
        DMatrix::from_fn(
            order,
            order,
            |i, j| {
                if i == j { (count.max(2) as f64 * spacing_s).powi(-(i as i32)) } else { 0.0 }
            },
        );
    let scaled = design * &scale;
    let inverse = (scaled.transpose() * &scaled).try_inverse()?;
    Some(scale * inverse * scaled.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_follow_each_other_and_states_are_guessed() {
        // φ1 = t + t², φ2 = 400 − 3t; the second sensor is relative.
        let h = 0.01;
        let t = |i: usize| i as f64 * h;
        let phi1: Vec<f64> = (0..105).map(|i| t(i) + t(i) * t(i)).collect();
        let relative: Vec<f64> = (0..105).map(|i| 400.0 - 3.0 * t(i) - phi1[i]).collect();
        let stretch =
            MeasuredStretch { start_s: 5.0, sensors: vec![phi1, relative], tau: Box::new(|i| 0.1 * i as f64) };
        let sensors = [vec![1.0, 0.0], vec![-1.0, 1.0]];
        let geometry = Geometry { sensors: &sensors, angles: &[true, true], spacing_s: h, guess: 6 };
        let (pieces, states) = cut(&[stretch], &geometry, 40, 20).unwrap();
        assert_eq!(pieces.iter().map(|p| p.measured.len() / 2).collect::<Vec<_>>(), [40, 40, 25]);
        assert!((pieces[1].start_s - 5.4).abs() < 1e-12 && (pieces[1].tau - 4.0).abs() < 1e-12);
        let turns = (400.0 / TAU).round() * TAU;
        assert!((states[0][1] - (400.0 - turns)).abs() < 1e-9 && (states[0][3] + 3.0).abs() < 1e-9);
        assert!((states[2][0] - 1.44).abs() < 1e-9 && (states[2][2] - 2.6).abs() < 1e-8, "{:?}", states[2]);
        let blind = Geometry { sensors: &[vec![1.0, 0.0]], ..geometry };
        assert!(cut(&[], &blind, 40, 20).is_none());
    }
}

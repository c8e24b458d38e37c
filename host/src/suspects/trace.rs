//! A channel as the checks see it: its unbroken stretches, and the step of what it can show.
//!
//! Counts have the step 1. Values have the step q where at least 95 % of the increments that are
//! not zero are multiples of the smallest, within 2 % of q: an encoder printed in radians.
//! Otherwise q = 0.

/// The samples of one stretch.
#[derive(Clone, Copy, Debug)]
pub enum Samples<'a> {
    /// Counts.
    Counts(&'a [i32]),
    /// Values in the channel's unit.
    Values(&'a [f64]),
}

impl Samples<'_> {
    /// How many.
    pub fn len(&self) -> usize {
        match self {
            Self::Counts(x) => x.len(),
            Self::Values(x) => x.len(),
        }
    }

    /// Sample i as a number.
    pub fn at(&self, i: usize) -> f64 {
        match self {
            Self::Counts(x) => f64::from(x[i]),
            Self::Values(x) => x[i],
        }
    }

    /// Samples from `first` on as numbers.
    pub fn copy(&self, first: usize, to: &mut [f64]) {
        let n = to.len();
        match self {
            Self::Counts(x) => to.iter_mut().zip(&x[first..first + n]).for_each(|(a, b)| *a = f64::from(*b)),
            Self::Values(x) => to.copy_from_slice(&x[first..first + n]),
        }
    }
}

/// A measured channel.
#[derive(Clone, Debug)]
pub struct Trace<'a> {
    /// Its stretches.
    pub stretches: Vec<Samples<'a>>,
    /// Step of the values, in the channel's unit; 0 where there is none.
    pub quantum: f64,
}

/// Increments looked at for the step of values.
const LOOKED_AT: usize = 4096;

impl<'a> Trace<'a> {
    /// Finds the step.
    pub fn new(stretches: Vec<Samples<'a>>) -> Self {
        let counts = stretches.iter().all(|s| matches!(s, Samples::Counts(_)));
        let quantum = if counts { 1.0 } else { step_of(&stretches) };
        Self { stretches, quantum }
    }

    /// Samples in all.
    pub fn len(&self) -> usize {
        self.stretches.iter().map(Samples::len).sum()
    }
}

fn step_of(stretches: &[Samples<'_>]) -> f64 {
    let total: usize = stretches.iter().map(Samples::len).sum();
    let stride = (total / LOOKED_AT).max(1);
    let mut steps = Vec::new();
    for s in stretches {
        for i in (1..s.len()).step_by(stride) {
            let d = (s.at(i) - s.at(i - 1)).abs();
            if d > 0.0 {
                steps.push(d);
            }
        }
    }
    let smallest = steps.iter().copied().fold(f64::INFINITY, f64::min);
    let whole = |d: &&f64| ((**d / smallest) - (**d / smallest).round()).abs() < 0.02;
    let large = steps.iter().filter(|d| **d > 1.5 * smallest).count();
    // Steps that are all as small as the smallest say nothing, nor do a few.
    let multiples = steps.iter().filter(whole).count();
    if steps.len() >= 32 && large >= 8 && multiples * 20 >= steps.len() * 19 { smallest } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_encoder_in_radians_shows_its_step_and_a_smooth_sensor_none() {
        let q = core::f64::consts::TAU / 1024.0;
        let smooth: Vec<f64> = (0..5000).map(|i| (f64::from(i) * 0.01).sin()).collect();
        let steps: Vec<f64> = smooth.iter().map(|x| (1e6 * (x / q).floor() * q).round() / 1e6).collect();
        let found = Trace::new(vec![Samples::Values(&steps)]).quantum;
        assert!((found / q - 1.0).abs() < 1e-3, "{found}");
        assert_eq!(Trace::new(vec![Samples::Values(&smooth)]).quantum, 0.0);
        let counts = [1, 2, 3];
        assert_eq!(Trace::new(vec![Samples::Counts(&counts)]).quantum, 1.0);
    }
}

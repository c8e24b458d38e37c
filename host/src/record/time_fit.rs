//! The evenly spaced clock behind a column of rounded times.
//!
//! Times in files are rounded (1.6384 ms printed as 0.001638), so that no single difference is the
//! step. Within a segment of n rows, t_i = start + i·step is fitted by least squares: with rows
//! centred, step = Σ (i − ī) t_i / (n (n² − 1)/12) and start = t̄ − step·ī, whose errors fall as
//! n^{−3/2} and n^{−1/2}. A short segment (below [`OWN_STEP`] rows) borrows the step pooled over
//! all segments, weighted by n (n² − 1).

/// Rows from which a segment's own step is used.
const OWN_STEP: usize = 100;

/// Sums of one segment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums {
    n: usize,
    first: f64,
    mean: f64,
    /// Σ (i − ī)(t_i − t_0).
    cross: f64,
    /// n (n² − 1)/12.
    spread: f64,
}

/// A fitted clock: start (s), step (s), rms deviation (s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Clock {
    pub(super) start_s: f64,
    pub(super) step_s: f64,
    pub(super) jitter_s: f64,
}

/// Sums over the times of one segment.
pub(super) fn sums(t: &[f64]) -> Sums {
    let n = t.len();
    let first = t.first().copied().unwrap_or(0.0);
    let centre = (n.max(1) - 1) as f64 / 2.0;
    let (mut sum, mut cross) = (0.0, 0.0);
    for (i, &t) in t.iter().enumerate() {
        sum += t - first;
        cross += (i as f64 - centre) * (t - first);
    }
    let nf = n as f64;
    Sums { n, first, mean: sum / nf.max(1.0), cross, spread: nf * (nf * nf - 1.0) / 12.0 }
}

/// Step pooled over segments, s; none where no segment has two rows.
pub(super) fn pooled_step(segments: &[Sums]) -> Option<f64> {
    let (cross, spread) = segments.iter().fold((0.0, 0.0), |(c, s), x| (c + x.cross, s + x.spread.max(0.0)));
    (spread > 0.0).then(|| cross / spread).filter(|s| s.is_finite() && *s > 0.0)
}

/// Sums over the times of a stretch that come one by one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Running {
    n: f64,
    first: f64,
    sum: f64,
    /// Σ i (t_i − t_0).
    turned: f64,
}

impl Running {
    /// The next time.
    pub(super) fn add(&mut self, t: f64) {
        if self.n == 0.0 {
            self.first = t;
        }
        self.sum += t - self.first;
        self.turned += self.n * (t - self.first);
        self.n += 1.0;
    }
}

/// The step pooled over such stretches.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pool {
    cross: f64,
    spread: f64,
}

impl Pool {
    /// A stretch that has ended.
    pub(super) fn add(&mut self, of: &Running) {
        if of.n > 1.0 {
            self.cross += of.turned - 0.5 * (of.n - 1.0) * of.sum;
            self.spread += of.n * (of.n * of.n - 1.0) / 12.0;
        }
    }

    /// As [`pooled_step`].
    pub(super) fn step(&self) -> Option<f64> {
        (self.spread > 0.0).then(|| self.cross / self.spread).filter(|s| s.is_finite() && *s > 0.0)
    }
}

/// The clock of one segment.
pub(super) fn clock(t: &[f64], sums: &Sums, pooled: f64) -> Clock {
    let step_s = if sums.n >= OWN_STEP { sums.cross / sums.spread } else { pooled };
    let offset = sums.mean - step_s * (sums.n.max(1) - 1) as f64 / 2.0;
    let square: f64 = t
        .iter()
        .enumerate()
        .map(|(i, &t)| {
            let r = t - sums.first - (offset + i as f64 * step_s);
            r * r
        })
        .sum();
    Clock { start_s: sums.first + offset, step_s, jitter_s: (square / sums.n.max(1) as f64).sqrt() }
}

/// The step of a record before its gaps are known: the mean over neighbours that are about one
/// nominal step apart, or, where fewer than a tenth are, the median of all. None below two rows.
pub(super) fn rough_step(t: &[f64], nominal: f64) -> Option<f64> {
    let (mut sum, mut n) = (0.0, 0usize);
    for w in t.windows(2) {
        let d = w[1] - w[0];
        if d > 0.5 * nominal && d <= 1.5 * nominal {
            sum += d;
            n += 1;
        }
    }
    if n > 0 && n >= (t.len() - 1) / 10 {
        return Some(sum / n as f64);
    }
    let mut differences: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    if differences.is_empty() {
        return None;
    }
    let middle = differences.len() / 2;
    let (_, median, _) = differences.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*median)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_of_the_times_does_not_reach_the_step() {
        let step = 1.0 / 610.3516;
        let t: Vec<f64> = (0..20_000).map(|i| ((7.0 + i as f64 * step) * 1e6).round() / 1e6).collect();
        let s = sums(&t);
        let c = clock(&t, &s, pooled_step(&[s]).unwrap());
        assert!((c.step_s / step - 1.0).abs() < 1e-9, "{}", c.step_s / step - 1.0);
        assert!((c.start_s - 7.0).abs() < 2e-8, "{}", c.start_s);
        assert!((c.jitter_s - 1e-6 / 12f64.sqrt()).abs() < 2e-8, "{}", c.jitter_s);
    }

    #[test]
    fn a_short_segment_borrows_the_pooled_step() {
        let long: Vec<f64> = (0..1000).map(|i| i as f64 * 0.002).collect();
        let short = [5.0004, 5.0016, 5.0044];
        let (a, b) = (sums(&long), sums(&short));
        let step = pooled_step(&[a, b]).unwrap();
        let c = clock(&short, &b, step);
        assert!((c.step_s - 0.002).abs() < 1e-9 && (c.start_s - 5.000_133_3).abs() < 1e-6, "{c:?}");
        assert!(pooled_step(&[sums(&[1.0])]).is_none());
    }
}

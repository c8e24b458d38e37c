//! Whether a break has one height, whatever it is looked at with: a swing faster than the record's
//! others leaves a polynomial a step, and the top of a smooth one a spike as wide, another one in each
//! window. Samples in a row that are off begin or end with a step; a whole swing does not.

use super::breaks::{Found, Kind, LIKE, NARROW, WINDOWS};
use super::local_fit::{Shape, Window, fit};
use super::trace::Trace;

/// Share of its height by which it may differ from window to window beside its error (by hand).
const OFF: f64 = 0.5;

/// Share of its height by which a spike of many samples steps where it begins or ends (by hand).
const EDGE: f64 = 0.1;

/// Whether a spike so wide that a few samples show its edge by itself steps there.
pub fn has_an_edge(trace: &Trace<'_>, found: &Found) -> bool {
    let narrow = NARROW[0];
    if found.kind != Kind::Spike || found.to - found.from <= narrow.0 {
        return true;
    }
    [found.from, found.to].into_iter().any(|at| {
        let edge = Found { kind: Kind::Slip, from: at, to: at, ..*found };
        let step = heights(trace, &edge, &[], narrow);
        step.is_none_or(|(height, error)| height[0].abs() > (LIKE * error).max(EDGE * found.size.abs()))
    })
}

/// Whether what was found with a window of that half width and degree has its height in every one, as
/// far as each tells it.
pub fn is_its_own(trace: &Trace<'_>, found: &Found, judge: (usize, usize)) -> bool {
    let samples: Vec<usize> = (found.from..found.to).collect();
    let of = |samples: &[usize], window: (usize, usize)| heights(trace, found, samples, window);
    let own = of(&samples, judge);
    let top = own.iter().flat_map(|o| &o.0).enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).map(|t| t.0);
    // The top last, whose error is known then.
    let rotated: Vec<usize> = match top {
        Some(k) if !samples.is_empty() => samples[k + 1..].iter().chain(&samples[..=k]).copied().collect(),
        _ => samples,
    };
    WINDOWS.iter().chain(&NARROW).all(|&window| {
        let Some((all, error)) = of(&rotated, window) else { return true };
        let height = all.last().copied().unwrap_or(0.0);
        (height - found.size).abs() <= LIKE * error + OFF * found.size.abs()
    })
}

/// Heights of a spike at its samples, or that of a step, beside a polynomial, and the last one's
/// standard error; none where the window does not fit in or tells nothing.
fn heights(
    trace: &Trace<'_>,
    found: &Found,
    samples: &[usize],
    (half, degree): (usize, usize),
) -> Option<(Vec<f64>, f64)> {
    let s = &trace.stretches[found.stretch];
    let first = found.from.checked_sub(half)?;
    let count = found.to + half - first;
    if first + count > s.len() {
        return None;
    }
    let window = Window::new(count, degree);
    let at = half as f64 - 0.5;
    let shapes: Vec<Vec<f64>> = match found.kind {
        Kind::Spike => samples.iter().map(|i| window.shape(Shape::Sample(i - first))).collect(),
        Kind::Slip => vec![window.shape(Shape::Step(at))],
        Kind::Break => [Shape::Bend(at), Shape::Curvature(at), Shape::Step(at)].map(|s| window.shape(s)).into(),
    };
    let mut x = vec![0.0; count];
    s.copy(first, &mut x);
    window.reduce(&mut x);
    let fitted = fit(&x, &shapes.iter().map(Vec::as_slice).collect::<Vec<_>>());
    let freedom = window.freedom().saturating_sub(shapes.len()).max(1) as f64;
    let variance = (fitted.rest / freedom).max(trace.quantum * trace.quantum / 12.0);
    Some((fitted.values, variance.sqrt() * fitted.error))
}

#[cfg(test)]
mod tests {
    use super::super::breaks::Judge;
    use super::super::screen::screen;
    use super::super::trace::Samples;
    use super::*;

    fn of(x: &[f64]) -> Vec<Found> {
        let trace = Trace::new(vec![Samples::Values(x)]);
        Judge::new(&trace).map_or_else(Vec::new, |judge| judge.judge(&trace, &screen(&trace)))
    }

    /// Numbers of a simulation, without noise: slow and fast parts of one smooth motion.
    #[test]
    fn the_top_of_a_fast_swing_is_no_spike() {
        let swing = |t: f64| 2.0 * (0.4 * t + 6.0 * (0.11 * t).sin()).cos() + 0.3 * (1.7 * t).sin();
        let mut x: Vec<f64> = (0..5000).map(|i| swing(0.02 * f64::from(i))).collect();
        assert_eq!(of(&x), []);
        // A sample that is off, and a short dropout.
        x[1500] += 0.05;
        x[3000..3004].iter_mut().for_each(|v| *v = 9.0);
        let found: Vec<(Kind, usize, usize)> = of(&x).iter().map(|f| (f.kind, f.from, f.to)).collect();
        assert_eq!(found, [(Kind::Spike, 1500, 1501), (Kind::Spike, 3000, 3004)]);
    }

    #[test]
    fn whole_swings_of_a_smooth_chaotic_motion_are_no_spikes() {
        let [x, _, z] = crate::phase_space::test_series::lorenz(20_000, 10);
        for (shown, mut x) in [("x", x), ("z", z)] {
            assert_eq!(of(&x), [], "{shown}");
            // Thirty rows of another value.
            x[7000..7030].iter_mut().for_each(|v| *v = 60.0);
            let found = of(&x);
            let is_found = |at: usize| found.iter().any(|f| f.from == at || f.to == at);
            assert!(is_found(7000) && is_found(7030), "{shown}: {found:?}");
        }
    }
}

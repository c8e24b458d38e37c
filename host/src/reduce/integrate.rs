//! Free motion of a system by extrapolation of the modified midpoint rule (Gragg, Bulirsch and
//! Stoer; E. Hairer, S. P. Nørsett, G. Wanner, *Solving Ordinary Differential Equations I*, 1993,
//! section II.9), order 12, adaptive steps.

/// Substeps of the midpoint rule.
const SUBSTEPS: [usize; 6] = [2, 4, 6, 8, 10, 12];
/// Most steps of one call.
const MOST: usize = 200_000;

/// Moves the state y from `start` to `end` with relative local error `tolerance`; false where it
/// leaves the finite numbers.
pub fn advance(
    f: &mut impl FnMut(f64, &[f64], &mut [f64]),
    y: &mut [f64],
    start: f64,
    end: f64,
    tolerance: f64,
    step: &mut f64,
) -> bool {
    let n = y.len();
    let mut t = start;
    let mut before: Vec<Vec<f64>> = Vec::new();
    let (mut slope, mut first) = (vec![0.0; n], vec![0.0; n]);
    let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
    for _ in 0..MOST {
        let left = end - t;
        if left <= 0.0 {
            return true;
        }
        let whole = *step >= left || !step.is_finite() || *step <= 0.0;
        let h = if whole { left } else { *step };
        f(t, y, &mut first);
        let mut error = f64::INFINITY;
        for (k, &count) in SUBSTEPS.iter().enumerate() {
            let small = h / count as f64;
            a.copy_from_slice(y);
            for i in 0..n {
                b[i] = y[i] + small * first[i];
            }
            for s in 1..count {
                f(t + s as f64 * small, &b, &mut slope);
                for i in 0..n {
                    let next = a[i] + 2.0 * small * slope[i];
                    a[i] = b[i];
                    b[i] = next;
                }
            }
            f(t + h, &b, &mut slope);
            // Aitken–Neville in h²: T_k0 the midpoint rule's, T_kj from T_k,j−1 and T_k−1,j−1.
            let mut now: Vec<Vec<f64>> = Vec::with_capacity(k + 1);
            now.push((0..n).map(|i| 0.5 * (a[i] + b[i] + small * slope[i])).collect());
            for j in 1..=k {
                let ratio = (count as f64 / SUBSTEPS[k - j] as f64).powi(2) - 1.0;
                let next = (0..n).map(|i| now[j - 1][i] + (now[j - 1][i] - before[j - 1][i]) / ratio).collect();
                now.push(next);
            }
            if k + 1 == SUBSTEPS.len() {
                let size = y.iter().chain(&now[k]).fold(0.0_f64, |m, v| m.max(v.abs())).max(1e-300);
                error = (0..n).map(|i| (now[k][i] - now[k - 1][i]).abs()).fold(0.0, f64::max) / size;
            }
            before = now;
        }
        let ok = error.is_finite() && error <= tolerance;
        let factor =
            if error.is_finite() { (0.25 * tolerance / error.max(1e-3 * tolerance)).powf(1.0 / 11.0) } else { 0.2 };
        if ok {
            y.copy_from_slice(&before[SUBSTEPS.len() - 1]);
            t = if whole { end } else { t + h };
            if !whole || factor < 1.0 {
                *step = h * factor.clamp(0.3, 3.0);
            } else {
                *step = step.max(h * factor.clamp(1.0, 3.0));
            }
        } else {
            *step = h * factor.clamp(0.1, 0.8);
            if *step < 1e-13 * (end - start).abs() {
                return false;
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pendulum_returns_after_its_period() {
        // Released at 2 rad: T = 4 K(sin 1), K by the arithmetic–geometric mean.
        let (mut p, mut q) = (1.0_f64, 1.0_f64.cos());
        for _ in 0..8 {
            (p, q) = ((p + q) / 2.0, (p * q).sqrt());
        }
        let period = std::f64::consts::TAU / p;
        let mut y = vec![2.0, 0.0];
        let mut step = 0.1;
        assert!(advance(
            &mut |_, y, d| {
                d[0] = y[1];
                d[1] = -y[0].sin();
            },
            &mut y,
            0.0,
            10.0 * period,
            1e-12,
            &mut step
        ));
        assert!((y[0] - 2.0).abs() < 1e-9 && y[1].abs() < 1e-9, "{y:?}");
    }
}

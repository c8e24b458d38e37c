//! Series whose exponents, dimensions and orbits are known.

/// Coordinates of Hénon's map (a = 1.4, b = 0.3) after each step.
pub fn henon(steps: usize) -> Vec<f64> {
    let mut state = (0.1_f64, 0.1_f64);
    (0..steps)
        .map(|_| {
            state = (1.0 - 1.4 * state.0 * state.0 + state.1, 0.3 * state.0);
            state.0
        })
        .collect()
}

/// Lorenz's x, y and z (σ = 10, r = 28, b = 8/3) every 0.01 after the first 20, by so many
/// classical Runge–Kutta steps a sample.
pub fn lorenz(samples: usize, steps: usize) -> [Vec<f64>; 3] {
    let rates = |[x, y, z]: [f64; 3]| [10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z];
    let h = 0.01 / steps as f64;
    let mut q = [1.0, 1.0, 20.0];
    let mut out = [Vec::new(), Vec::new(), Vec::new()];
    for i in 0..samples + 2000 {
        if i >= 2000 {
            (0..3).for_each(|k| out[k].push(q[k]));
        }
        for _ in 0..steps {
            let moved = |k: [f64; 3], share: f64| core::array::from_fn(|i| q[i] + share * h * k[i]);
            let a = rates(q);
            let b = rates(moved(a, 0.5));
            let c = rates(moved(b, 0.5));
            let d = rates(moved(c, 1.0));
            (0..3).for_each(|i| q[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
    }
    out
}

//! Small linear systems A x = b with several right-hand sides, by Gaussian elimination with partial
//! pivoting, in place.

/// Solves an n × n system with `sides` right-hand sides in the columns behind it, row after row;
/// `out` holds the solutions likewise. False where it is singular or not finite.
pub fn solve(a: &mut [f64], n: usize, sides: usize, out: &mut [f64]) -> bool {
    let w = n + sides;
    match n {
        1 => return solve_one(a, sides, out),
        2 => return solve_two(a, sides, out),
        _ => {}
    }
    let size = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !a.iter().all(|x| x.is_finite()) || size == 0.0 {
        return false;
    }
    for k in 0..n {
        let row_size = (0..n).map(|j| a[k * w + j].abs()).fold(0.0, f64::max);
        let pivot = (k..n).max_by(|&i, &j| a[i * w + k].abs().total_cmp(&a[j * w + k].abs())).unwrap_or(k);
        if a[pivot * w + k].abs() <= 1e-12 * row_size || a[pivot * w + k] == 0.0 {
            return false;
        }
        if pivot != k {
            (0..w).for_each(|j| a.swap(k * w + j, pivot * w + j));
        }
        for i in k + 1..n {
            let f = a[i * w + k] / a[k * w + k];
            if f != 0.0 {
                (k..w).for_each(|j| a[i * w + j] -= f * a[k * w + j]);
            }
        }
    }
    // Row after row, so that all right-hand sides of one lie side by side.
    for k in (0..n).rev() {
        let (rows, below) = out.split_at_mut((k + 1) * sides);
        let row = &mut rows[k * sides..];
        row.copy_from_slice(&a[k * w + n..(k + 1) * w]);
        for (j, found) in (k + 1..n).zip(below.chunks_exact(sides)) {
            let f = a[k * w + j];
            row.iter_mut().zip(found).for_each(|(x, y)| *x -= f * y);
        }
        let pivot = a[k * w + k];
        row.iter_mut().for_each(|x| *x /= pivot);
    }
    out[..n * sides].iter().all(|x| x.is_finite())
}

/// The same of one row.
fn solve_one(a: &[f64], sides: usize, out: &mut [f64]) -> bool {
    let pivot = a[0];
    out[..sides].iter_mut().zip(&a[1..]).for_each(|(x, b)| *x = b / pivot);
    pivot != 0.0 && pivot.is_finite() && out[..sides].iter().all(|x| x.is_finite())
}

/// The same of two rows: [`solve`] without its loops, which are most of the work there.
fn solve_two(a: &mut [f64], sides: usize, out: &mut [f64]) -> bool {
    let w = 2 + sides;
    let (first, second) = a.split_at_mut(w);
    let (top, low) = if first[0].abs() >= second[0].abs() { (first, second) } else { (second, &mut *first) };
    let size = |row: &[f64]| row[0].abs().max(row[1].abs());
    let f = low[0] / top[0];
    let pivot = low[1] - f * top[1];
    if !(top[0] != 0.0 && pivot.abs() > 1e-12 * size(low)) {
        return false;
    }
    let (x, y) = out.split_at_mut(sides);
    for (k, (x, y)) in x.iter_mut().zip(&mut y[..sides]).enumerate() {
        *y = (low[2 + k] - f * top[2 + k]) / pivot;
        *x = (top[2 + k] - top[1] * *y) / top[0];
    }
    out[..2 * sides].iter().all(|x| x.is_finite())
}

//! Windows that are lost to rounding.
//!
//! With the initial state S eliminated a window leaves of a column C the square
//! CᵀC − CᵀS (SᵀS)⁻¹ SᵀC ≥ 0, in units of the noise. Where a motion loses itself within the window both
//! terms are so large that nothing exact is left of their difference, and it comes out negative. One
//! such window makes the Gram matrix of all indefinite. Lost digits that leave a square positive are not
//! seen.

use super::blocks::Part;
use crate::statistics::median;

/// Negative square of a column, over the median of the windows', from which nothing of a window is
/// believed (by hand).
const NEGATIVE: f64 = 0.1;
/// Share of the windows that may be lost (by hand): where the states take a column up altogether, all
/// its squares are nothing but rounding, of either sign.
const FEW: f64 = 0.1;

/// Leaves out the few windows in which the square of one of the `own` columns is negative; each is a
/// list of blocks, and these of parts.
pub fn leave_out(windows: &mut [Option<Vec<Vec<Part>>>], own: usize) {
    let least = |window: &[Vec<Part>], column: usize| {
        window.iter().flatten().map(|p| p.gram.square(column)).fold(f64::INFINITY, f64::min)
    };
    for column in 0..own {
        let mut squares: Vec<f64> = windows.iter().flatten().map(|w| least(w, column)).collect();
        let negative = squares.iter().filter(|s| **s < 0.0).count();
        if negative == 0 || negative as f64 > (FEW * squares.len() as f64).max(1.0) {
            continue;
        }
        let limit = -NEGATIVE * median(&mut squares).max(0.0);
        for window in windows.iter_mut() {
            if window.as_ref().is_some_and(|w| least(w, column) < limit) {
                *window = None;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::super::gram::Gram;
    use super::*;

    #[test]
    fn a_window_with_a_negative_square_is_left_out() {
        let window = |square: f64| {
            let gram = Gram::of_own(DMatrix::from_row_slice(2, 2, &[square, 0.5, 0.5, 9.0]));
            Some(vec![vec![Part { gram, freedom: 8.0 }]])
        };
        let mut all = [window(2.0), window(-4.0), None, window(3.0), window(2.5)];
        leave_out(&mut all, 1);
        assert_eq!(all.map(|w| w.is_some()), [true, false, false, true, true]);
        // Nothing but rounding.
        let mut all = [window(2e-9), window(-4e-9), window(-1e-9), window(3e-9)];
        leave_out(&mut all, 1);
        assert!(all.iter().all(Option::is_some));
    }
}

//! Windows that are lost to rounding: where a motion loses itself within a window, products of its
//! sensitivities are so large that nothing exact is left of them once the states are eliminated, and
//! the square of a column comes out negative. One such window makes the Gram matrix of all indefinite.

use super::blocks::Part;

/// Negative square of a column, over the greatest of the windows', from which nothing of a window is
/// believed (by hand; where the states take a column up altogether, its square is nothing but
/// rounding).
const NEGATIVE: f64 = 1e-6;

/// Leaves out the windows in which the square of one of the `own` columns is negative; each is a list
/// of blocks, and these of parts.
pub fn leave_out(windows: &mut [Option<Vec<Vec<Part>>>], own: usize) {
    let least = |window: &[Vec<Part>], column: usize| {
        window.iter().flatten().map(|p| p.gram.square(column)).fold(f64::INFINITY, f64::min)
    };
    for column in 0..own {
        let limit = -NEGATIVE * windows.iter().flatten().map(|w| least(w, column)).fold(0.0, f64::max);
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
        let mut all = [window(2.0), window(-0.1), None, window(3.0), window(-1e-9)];
        leave_out(&mut all, 1);
        assert_eq!(all.map(|w| w.is_some()), [true, false, false, true, true]);
    }
}

//! Where within a step something passes zero, as a share of the step: the root of the cubic through
//! its values and slopes (times the step) at both ends. Two passages within one step are seen where
//! the cubic shows them.

use core::f64::consts::{PI, TAU};

/// Where a form leaves the turn that it is in, from its values and slopes (times the step) at both
/// ends of [0, 1].
pub fn turned_over(turns: f64, ends: [f64; 2], slopes: [f64; 2]) -> Option<f64> {
    let up = crossing(ends.map(|x| TAU * turns + PI - x), slopes.map(|v| -v));
    let down = crossing(ends.map(|x| x - (TAU * turns - PI)), slopes);
    match (up, down) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}

/// Where the cubic through values and slopes (times the step) at both ends of [0, 1] first passes
/// from above to below zero.
pub fn crossing(ends: [f64; 2], slopes: [f64; 2]) -> Option<f64> {
    let value = |u: f64| {
        let (u2, u3) = (u * u, u * u * u);
        ends[0] * (1.0 - 3.0 * u2 + 2.0 * u3)
            + slopes[0] * (u - 2.0 * u2 + u3)
            + ends[1] * (3.0 * u2 - 2.0 * u3)
            + slopes[1] * (u3 - u2)
    };
    let (mut low, mut high) = (0.0, 1.0);
    if ends[1] >= 0.0 {
        // Down and up again within the step: look at the lowest point.
        if !(ends[0] > 0.0 && slopes[0] < 0.0 && slopes[1] > 0.0) {
            return None;
        }
        // A cubic stays within its control points.
        if ends[0] + slopes[0] / 3.0 > 0.0 && ends[1] - slopes[1] / 3.0 > 0.0 {
            return None;
        }
        let (mut a, mut b) = (0.0, 1.0);
        for _ in 0..40 {
            let (c, d) = (a + (b - a) / 3.0, b - (b - a) / 3.0);
            if value(c) < value(d) { b = d } else { a = c }
        }
        high = 0.5 * (a + b);
        // A dip of the size of rounding is none: a joint that comes free starts at such a rate.
        let size = ends[1].abs().max(slopes[0].abs()).max(slopes[1].abs());
        if value(high) >= -1e-12 * size {
            return None;
        }
    }
    // A rate that starts at zero (a turn just before) and falls below it turns at once.
    if ends[0] <= 0.0 && slopes[0] <= 0.0 {
        return Some(0.0);
    }
    if ends[0] <= 0.0 {
        // It rises first: the crossing lies after the highest point.
        let (mut a, mut b) = (0.0, high);
        for _ in 0..40 {
            let (c, d) = (a + (b - a) / 3.0, b - (b - a) / 3.0);
            if value(c) > value(d) { b = d } else { a = c }
        }
        low = 0.5 * (a + b);
        if value(low) <= 0.0 {
            return Some(low);
        }
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if value(middle) > 0.0 { low = middle } else { high = middle }
    }
    Some(high)
}

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

/// Most halvings or steps of Newton's method to a root.
const MOST_ROUNDS: usize = 60;

/// The cubic d + c u + b u² + a u³ through values and slopes (times the step) at both ends of
/// [0, 1].
struct Cubic {
    a: f64,
    b: f64,
    c: f64,
    d: f64,
}

impl Cubic {
    fn through(ends: [f64; 2], slopes: [f64; 2]) -> Self {
        let rise = ends[1] - ends[0];
        Self {
            a: slopes[0] + slopes[1] - 2.0 * rise,
            b: 3.0 * rise - 2.0 * slopes[0] - slopes[1],
            c: slopes[0],
            d: ends[0],
        }
    }

    fn value(&self, u: f64) -> f64 {
        self.d + u * (self.c + u * (self.b + u * self.a))
    }

    fn slope(&self, u: f64) -> f64 {
        self.c + u * (2.0 * self.b + u * 3.0 * self.a)
    }

    /// Half the square root of the slope's discriminant; none where the slope has no zero.
    fn root(&self) -> Option<f64> {
        let square = self.b * self.b - 3.0 * self.a * self.c;
        (square >= 0.0).then(|| square.sqrt())
    }

    /// Where the slope passes zero upward, in a form that loses no digits where it falls first.
    fn lowest(&self) -> Option<f64> {
        self.root().map(|root| -self.c / (self.b + root))
    }

    /// Where the slope passes zero downward, in a form that loses no digits where it rises first.
    fn highest(&self) -> Option<f64> {
        self.root().map(|root| self.c / (root - self.b))
    }

    /// The passage of zero between a value above (at `low`) and one that is not (at `high`):
    /// Newton's method, and a halving where it leaves what is known.
    fn zero(&self, mut low: f64, mut high: f64) -> f64 {
        let mut u = 0.5 * (low + high);
        for _ in 0..MOST_ROUNDS {
            let value = self.value(u);
            if value == 0.0 {
                return u;
            }
            if value > 0.0 {
                low = u
            } else {
                high = u
            }
            let newton = u - value / self.slope(u);
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - u).abs() <= f64::EPSILON * high {
                return next;
            }
            u = next;
        }
        u
    }
}

/// Where the cubic through values and slopes (times the step) at both ends of [0, 1] first passes
/// from above to below zero.
pub fn crossing(ends: [f64; 2], slopes: [f64; 2]) -> Option<f64> {
    let cubic = Cubic::through(ends, slopes);
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
        high = cubic.lowest()?.clamp(0.0, 1.0);
        // A dip of the size of rounding is none: a joint that comes free starts at such a rate.
        let size = ends[1].abs().max(slopes[0].abs()).max(slopes[1].abs());
        if cubic.value(high) >= -1e-12 * size {
            return None;
        }
    }
    // A rate that starts at zero (a turn just before) and falls below it turns at once.
    if ends[0] <= 0.0 && slopes[0] <= 0.0 {
        return Some(0.0);
    }
    if ends[0] <= 0.0 {
        // It rises first: the crossing lies after the highest point.
        low = cubic.highest().filter(|u| (0.0..high).contains(u)).unwrap_or(high);
        if cubic.value(low) <= 0.0 {
            return Some(low);
        }
    }
    Some(cubic.zero(low, high))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first passage on a fine grid, from above zero to below it.
    fn by_grid(ends: [f64; 2], slopes: [f64; 2]) -> Option<f64> {
        let n = 200_000;
        let at = |i: usize| {
            let u = i as f64 / n as f64;
            let (u2, u3) = (u * u, u * u * u);
            let from_ends = ends[0] * (1.0 - 3.0 * u2 + 2.0 * u3) + ends[1] * (3.0 * u2 - 2.0 * u3);
            from_ends + slopes[0] * (u - 2.0 * u2 + u3) + slopes[1] * (u3 - u2)
        };
        (0..n).find(|&i| at(i) > 0.0 && at(i + 1) <= 0.0).map(|i| i as f64 / n as f64)
    }

    #[test]
    fn the_first_passage_is_where_a_fine_grid_has_it() {
        let mut seen = [0; 2];
        for k in 0..400 {
            let of = |m: usize| ((k * m) % 401) as f64 / 200.5 - 1.0;
            let (ends, slopes) = ([of(37) + 0.2, of(91)], [4.0 * of(53), 4.0 * of(17)]);
            // Where it begins below zero it may have turned just before; twice in a step it is only
            // looked for where it falls first and rises last. The others are not asked here.
            if ends[0] <= 0.0 || (ends[1] >= 0.0 && !(slopes[0] < 0.0 && slopes[1] > 0.0)) {
                continue;
            }
            let (found, grid) = (crossing(ends, slopes), by_grid(ends, slopes));
            seen[usize::from(found.is_some())] += 1;
            match (found, grid) {
                (Some(a), Some(b)) => assert!((a - b).abs() < 1e-5, "{ends:?} {slopes:?}: {a} {b}"),
                (a, b) => assert_eq!(a, b, "{ends:?} {slopes:?}"),
            }
        }
        assert!(seen[0] > 5 && seen[1] > 50, "{seen:?}");
    }

    #[test]
    fn a_rate_of_zero_turns_behind_its_highest_point() {
        let found = crossing([0.0, -1.0], [1.0, -3.0]).unwrap();
        // u − u² … : d = 0, c = 1, b = −2, a = 0.
        assert!((found - 0.5).abs() < 1e-12, "{found}");
        assert_eq!(crossing([0.0, -1.0], [-1.0, -1.0]), Some(0.0));
        assert_eq!(crossing([1.0, 1.0], [-0.1, 0.1]), None);
    }
}

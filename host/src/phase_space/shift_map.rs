//! The left-shift map x(k+1) = 2 x(k) mod 1 (4.2), (4.3) in exact arithmetic: why a long stretch of
//! chaos is as good as a periodic orbit.
//!
//! A rational p/q with q odd is a periodic point: its period is the order of 2 modulo q. The points
//! with 2ⁿ x = x are p/(2ⁿ − 1). For any x there is one of them, y, with the same first n binary
//! digits, and |x(k) − y(k)| < 2^−(n−k) for all k ≤ n (4.4): the orbit of length n lies close to a
//! periodic one but for its last few points.
//!
//! Points are fractions of integers of 128 bits (n ≤ 60, q < 2⁶⁴): a double holds 53 digits, and
//! each step shifts one of them out, so that every orbit in floating point ends at 0 after 53
//! steps.

/// A point p/q of [0, 1), not necessarily in lowest terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Point {
    p: u128,
    q: u128,
}

impl Point {
    /// p/q mod 1; none for q = 0 or q ≥ 2⁶⁴.
    pub fn new(p: u64, q: u64) -> Option<Self> {
        (q > 0).then(|| Self { p: u128::from(p % q), q: u128::from(q) })
    }

    /// The next point, 2x mod 1.
    #[must_use]
    pub fn shifted(self) -> Self {
        Self { p: 2 * self.p % self.q, ..self }
    }

    /// As a double, for plotting.
    pub fn value(self) -> f64 {
        self.p as f64 / self.q as f64
    }

    /// The point of period n (or of a divisor of n) with the same first n binary digits, 1 ≤ n
    /// ≤ 60. Digits that are all 1 stand for (2ⁿ − 1)/(2ⁿ − 1) = 1, which is the fixed point 0 from
    /// the other side; it is kept as 1 so that (4.4) holds.
    pub fn shadow(self, n: u32) -> Option<Self> {
        (1..=60).contains(&n).then(|| Self { p: (self.p << n) / self.q, q: (1 << n) - 1 })
    }

    /// Whether |x − y| < 2^−m, exactly.
    pub fn within(self, other: Self, m: u32) -> bool {
        let (a, b) = (self.p * other.q, other.p * self.q);
        let difference = a.abs_diff(b);
        // difference · 2^m < q q′ without leaving 128 bits.
        difference <= (self.q * other.q - 1) >> m.min(127)
    }
}

/// The shadowing orbit of (4.4): y(k) = x's first n digits, cycled from place k on. Unlike
/// iterating the fraction it keeps 1 for digits that are all 1.
pub fn shadow_orbit(x: Point, n: u32) -> Option<Vec<Point>> {
    let first = x.shadow(n)?;
    let q = first.q;
    let turn = |p: u128| if p == q { p } else { 2 * p % q };
    Some(std::iter::successors(Some(first), |y| Some(Point { p: turn(y.p), q })).take(n as usize + 1).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_orbit_lies_near_a_periodic_one_by_4_4() {
        // Numerators and denominators without pattern; q even too: those are periodic only after a
        // while.
        for (p, q) in [(1, 3), (314_159, 1_000_003), (271_828, 1 << 20), (u64::MAX / 3, u64::MAX - 58), (0, 1)] {
            let x = Point::new(p, q).unwrap();
            for n in [1, 5, 20, 40, 59] {
                let y = shadow_orbit(x, n).unwrap();
                let mut xk = x;
                for k in 0..=n {
                    assert!(xk.within(y[k as usize], n - k), "{p}/{q}, n {n}, k {k}");
                    xk = xk.shifted();
                }
                assert_eq!(y[n as usize], y[0], "periodic");
                assert!(x.within(y[0], n));
            }
        }
        // The bound is not slack: with one digit more it fails for some orbit.
        let x = Point::new(2, 3).unwrap();
        assert!(!x.within(x.shadow(5).unwrap(), 8));
    }

    #[test]
    fn comparison_is_exact() {
        let (a, b) = (Point::new(1, 4).unwrap(), Point::new(1, 2).unwrap());
        assert!(a.within(b, 1) && !a.within(b, 2));
        let close = Point::new((1 << 62) + 1, 1 << 63).unwrap();
        assert!(close.within(b, 62) && !close.within(b, 63) && a.within(a, 127));
    }

    #[test]
    fn doubles_shift_themselves_to_zero() {
        let mut x = 1.0 / 3.0;
        for _ in 0..60 {
            x = 2.0 * x % 1.0;
        }
        assert_eq!(x, 0.0);
        let exact = (0..60).fold(Point::new(1, 3).unwrap(), |x, _| x.shifted());
        assert_eq!(exact, Point::new(1, 3).unwrap());
    }
}

//! A coordinate with dry friction that sticks: plants of tests.

/// What acts on it.
pub struct Law<'a> {
    /// Acceleration at a time, position and velocity while it moves in a sense.
    pub acceleration: &'a dyn Fn(f64, f64, f64, f64) -> f64,
    /// What pulls it at rest, at a time and position.
    pub pull: &'a dyn Fn(f64, f64) -> f64,
    /// The most of that that friction holds.
    pub holds: f64,
}

/// The coordinate: at rest while what pulls it stays within the friction, and in the sense of its
/// motion otherwise; a reversal ends a step, which has to be short.
#[derive(Default)]
pub struct Sticking {
    /// Position.
    pub x: f64,
    v: f64,
    /// Sense of the motion; 0 at rest.
    sign: f64,
}

impl Sticking {
    /// A step of Runge and Kutta of fourth order.
    pub fn step(&mut self, law: &Law<'_>, t: f64, h: f64) {
        if self.sign == 0.0 {
            let pull = (law.pull)(t, self.x);
            if pull.abs() <= law.holds {
                return;
            }
            self.sign = pull.signum();
        }
        let sign = self.sign;
        let rate = |t: f64, x: f64, v: f64| (v, (law.acceleration)(t, x, v, sign));
        let (a1, b1) = rate(t, self.x, self.v);
        let (a2, b2) = rate(t + 0.5 * h, self.x + 0.5 * h * a1, self.v + 0.5 * h * b1);
        let (a3, b3) = rate(t + 0.5 * h, self.x + 0.5 * h * a2, self.v + 0.5 * h * b2);
        let (a4, b4) = rate(t + h, self.x + h * a3, self.v + h * b3);
        let next = self.v + h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4);
        if next * sign < 0.0 {
            // To the instant of the reversal along a straight line, and on from rest there.
            let share = self.v / (self.v - next);
            self.x += 0.5 * share * h * self.v;
            (self.v, self.sign) = (0.0, 0.0);
            if share > 0.0 {
                self.step(law, t + share * h, (1.0 - share) * h);
            }
            return;
        }
        self.x += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        self.v = next;
    }
}

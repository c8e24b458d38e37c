//! Fixed points that would go to and fro: Aitken's Δ² for vectors (Irons and Tuck 1969).
//!
//! Strengths are found beside coefficients for the inertias that stood before, and the inertias
//! follow from the coefficients. Where a strength tells an inertia almost as well as its own
//! coefficient does, each round goes as far beyond the solution as the last one was before it. With
//! sₖ the step that round k would take, in standard errors (a parameter that is 0 but for noise has
//! no other size), what is taken is ωₖ sₖ, ωₖ = −ωₖ₋₁ sₖ₋₁·(sₖ − sₖ₋₁)/|sₖ − sₖ₋₁|².

/// Least share of a step that is taken (by hand); the greatest is all of it.
const LEAST: f64 = 0.1;

/// The last step and the share of it that was taken.
#[derive(Clone, Debug, Default)]
pub struct Relaxation {
    step: Vec<f64>,
    share: f64,
}

impl Relaxation {
    /// Values between those of the last round and those that would follow, in the place of these;
    /// how far the farthest would have gone, in standard errors. Those without an error are not
    /// counted.
    pub fn relax(&mut self, from: &[f64], to: &mut [f64], errors: &[f64]) -> f64 {
        let in_errors = |((a, b), error): ((&f64, &f64), &f64)| if *error > 0.0 { (b - a) / error } else { 0.0 };
        let step: Vec<f64> = from.iter().zip(&*to).zip(errors).map(in_errors).collect();
        let is_next = !step.is_empty() && self.step.len() == step.len();
        self.share = if is_next { self.next(&step) } else { 1.0 };
        to.iter_mut().zip(from).for_each(|(to, from)| *to = from + self.share * (*to - from));
        self.step = step;
        self.step.iter().fold(0.0, |most, s| most.max(s.abs()))
    }

    fn next(&self, step: &[f64]) -> f64 {
        let (along, square) = self.step.iter().zip(step).fold((0.0, 0.0), |(along, square), (last, now)| {
            let change = now - last;
            (along + last * change, square + change * change)
        });
        let share = -self.share * along / square;
        if share.is_finite() { share.clamp(LEAST, 1.0) } else { self.share }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x → 2 + λ (x − 2): at λ = −1 for ever to and fro, at −1.5 away. The third is noise about 0.
    #[test]
    fn what_goes_to_and_fro_comes_to_rest() {
        for slope in [-1.5, -1.0, -0.3, 0.0, 0.5] {
            let mut relaxation = Relaxation::default();
            let (mut x, mut farthest) = (vec![2.3, 5.0, 0.0], f64::NAN);
            for round in 0..30 {
                let noise = if round % 2 == 0 { 1e-9 } else { -1e-9 };
                let mut next = vec![2.0 + slope * (x[0] - 2.0), 5.0, noise];
                farthest = relaxation.relax(&x, &mut next, &[1e-3, 0.0, 1e-5]);
                x = next;
            }
            assert!((x[0] - 2.0).abs() < 1e-6 && x[1] == 5.0, "{slope}: {x:?}");
            assert!(farthest < 1e-2, "{slope}: {farthest} standard errors");
        }
    }
}

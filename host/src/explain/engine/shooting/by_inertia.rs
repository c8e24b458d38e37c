//! What strengths do while inertias follow from coefficients.
//!
//! A friction c between two masses decelerates each by c over its mass, and a mass follows from the
//! coefficients of the springs. A change of such a coefficient b changes what c does: ∂(c s(p))/∂b =
//! c ∂s/∂p · ∂p/∂b, which stands in b's own column. Without it an inertia would rest on springs
//! alone, however well a friction tells it, and another name would make up for the difference.

use nalgebra::DVector;

use super::super::setting::Setting;
use super::super::state::State;
use crate::model::model_file::expression::{Node, multiply, number, subtract};

/// Relative step of the parameters for the difference.
const STEP: f64 = 1e-4;

/// Coefficient of the model, equation and expression of everything that the strengths of what is
/// chosen, at coefficients `x`, add to the coefficients' own columns. Inertias that stay open are
/// held as they are: they are the unit of the strengths.
pub fn additions(setting: &Setting<'_>, state: &State, x: &[f64]) -> Vec<(usize, usize, Node)> {
    let physical = &state.physical;
    let mut out = Vec::new();
    for (j, slope) in physical.slopes.column_iter().enumerate() {
        let relative = |(p, d): (&f64, &f64)| if *p == 0.0 { 0.0 } else { (d / p).abs() };
        let size = physical.values.iter().zip(slope.iter()).map(relative).fold(0.0, f64::max);
        if !(size > 0.0 && size.is_finite()) {
            continue;
        }
        let step = STEP / size;
        let along = |by: f64| DVector::from_fn(physical.slopes.ncols(), |i, _| if i == j { by } else { 0.0 });
        let sides = [step, -step].map(|by| physical.moved(&along(by)));
        let mut at = setting.own.names.len();
        for k in &state.chosen {
            let [high, low] = [0, 1].map(|s| k.candidate.forces(setting, &sides[s]));
            for (i, (high, low)) in high.iter().zip(&low).enumerate() {
                let per = number(0.5 * x[at + i] / step);
                let both = high.iter().zip(low).filter(|(h, l)| h.1 != l.1);
                let closed = both.filter(|(h, _)| !physical.is_open(h.0));
                out.extend(
                    closed.map(|((e, h), (_, l))| (j, *e, multiply(per.clone(), subtract(h.clone(), l.clone())))),
                );
            }
            at += k.strengths.len();
        }
    }
    out
}

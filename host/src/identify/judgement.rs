//! Whether identified coefficients can be those of a rig, and whether the equations describe the
//! record.
//!
//! *Signs.* Dampings take energy away, moments of inertia are positive, and so is the kinetic
//! energy: B11 B21 = H²/(J_o1 J_o2) lies between 0 and 1. A coefficient on the wrong side of that
//! by `CLEAR` standard errors cannot be a rig's.
//!
//! *Ties.* A torque in joint 2 acts on both arms, and the drive on both alike: C12 B21 = C2 B11,
//! B13 B22 = B23 B12 and B14 B22 = B24 B12 (3.23), whatever is known of masses and lengths. With h
//! what the ties miss by and S its covariance from the jackknife over G blocks, hᵀ S⁻¹ h (G − d)/(d
//! (G − 1)) has Fisher's F distribution with d and G − d degrees of freedom (Hotelling 1931). Where
//! that is less likely than `CHANCE`, the equations miss something. Of a system from bodies the ties
//! are those of its mechanism, and hᵀ S⁻¹ h is the least distance of its coefficients from ones that
//! it can have ([`crate::system::ties`], in the metric S).
//!
//! *Noise.* Records that the identified model makes itself, from states of the record, with the
//! noise of sensors and measured inputs ([`super::chain_bias`]), tell what ε and which residual
//! power a record would have if the equations were right, and how much that scatters. Where an input
//! hides its noise ([`super::input_noise`]), what is left may be that, and the answer stands.
//!
//! Limits: inertias of the double and single pendulum; of systems from bodies the signs of nominal
//! frictions and of masses. Nothing tells which signs the coefficients of written equations must
//! have, or how they are tied.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

use super::{Identification, known_of_system, known_quantities};
use crate::effects::{catalogue, kinds};
use crate::rig::Rig;
use crate::system::mechanism::{Coefficient, Mechanism};
use crate::system::polynomial::Atom;
use crate::warning::Warning;
use crate::wording::format::{Z95, behind, plus_minus, significant};

/// Standard errors by which a sign must be wrong: by chance once in thirty thousand coefficients.
const CLEAR: f64 = 4.0;
/// Probability below which nothing is chance. The least found on 120 clean records (three rigs,
/// 1024 and 4096 counts, 20 to 120 s) was 0.009 for the ties and 10⁻⁴ for a known length; a hidden
/// drag of 2·10⁻⁶ N m s² gave 10⁻²⁰.
pub(super) const CHANCE: f64 = 1e-6;
/// Ratio of residual to noise power from which something besides noise is left, as in `explain`.
pub(super) const BESIDE_NOISE: f64 = 2.0;
/// The same of one equation alone, four times what the sensors explain of it, and the share of its
/// largest term from which that counts (by hand).
const OF_ONE: f64 = 16.0;
const NOTABLE: f64 = 0.01;
/// Ratio from which the answer does not stand: a residual of five times the sensors'. A second
/// harmonic of 2 % in the drive (ratio 71) moves B11 by 7.4 standard errors. It is no bound below
/// which nothing has moved: an eccentricity of 0.015 rad (ratio 12) moves B22 by 12 of them, and is
/// warned of.
pub(super) const MISLEADING: f64 = 25.0;

/// Coefficients with their covariance.
pub(super) struct Coefficients<'a> {
    pub(super) names: &'a [String],
    pub(super) values: DVector<f64>,
    pub(super) covariance: DMatrix<f64>,
    /// Blocks of the jackknife.
    pub(super) blocks: usize,
}

impl<'a> Coefficients<'a> {
    /// Of an identification.
    pub(super) fn of(result: &'a Identification) -> Self {
        let names = &result.correlation_names;
        let n = names.len();
        let (values, errors): (Vec<f64>, Vec<f64>) =
            names.iter().map(|n| result.parameter(n).map_or((0.0, 0.0), |p| (p.value, p.std_error))).unzip();
        let related = |i: usize, j: usize| result.correlation.get(i).and_then(|r| r.get(j)).copied().unwrap_or(0.0);
        let covariance = DMatrix::from_fn(n, n, |i, j| related(i, j) * errors[i] * errors[j]);
        Self { names, values: DVector::from_vec(values), covariance, blocks: result.details.jackknife_blocks }
    }

    /// Value and place of a coefficient.
    pub(super) fn at(&self, name: &str) -> Option<(f64, usize)> {
        self.names.iter().position(|n| n == name).map(|i| (self.values[i], i))
    }

    /// Variance of a function with this gradient.
    pub(super) fn variance(&self, gradient: &DVector<f64>) -> f64 {
        (gradient.transpose() * &self.covariance * gradient)[(0, 0)].max(0.0)
    }

    /// Standard error of a coefficient.
    fn error(&self, i: usize) -> f64 {
        self.covariance[(i, i)].max(0.0).sqrt()
    }
}

/// Adds a warning for everything that cannot be.
pub fn judge(result: &mut Identification, rig: &Rig) {
    // Of a record that is at fault itself nothing further is said.
    if result.warnings.iter().any(|w| w.invalidates) {
        return;
    }
    if rig.bound.is_none() {
        let c = Coefficients::of(result);
        let mut found = signs(&c);
        let ties = ties(&c);
        let spread = ties.as_ref().map_or(1.0, |t| (t.statistic / t.freedom as f64).sqrt().max(1.0));
        if let Some(t) = ties.filter(|t| t.chance < CHANCE) {
            found.extend(t.warnings());
        }
        found.extend(known_quantities::contradicted(&c, rig, spread));
        result.warnings.extend(found);
    }
    if let Some(mechanism) = rig.bound.as_ref().and_then(|b| b.model.mechanism.as_deref()) {
        let c = Coefficients::of(result);
        let mut found = dampings_of(mechanism, &c);
        let violated = known_of_system::ties(mechanism, &c).filter(|t| t.chance < CHANCE);
        found.extend(violated.iter().flat_map(Ties::warnings));
        found.extend(known_of_system::contradicted(mechanism, &c, rig));
        result.warnings.extend(found);
    }
    let negative = physical_signs(result, rig);
    result.warnings.extend(negative);
    result.warnings.extend(misfit(result));
}

/// That more is left than the sensors' noise. Where an input hides its noise, it may be that.
pub(super) fn misfit(result: &Identification) -> Option<Warning> {
    let details = &result.details;
    let by_chance = details.by_chance.max(1.0);
    let of_all = details.residual_over_noise.filter(|ratio| *ratio > BESIDE_NOISE * by_chance);
    // An equation that fits well hides one that does not.
    let each = result.identification_error.iter().zip(&details.expected_error);
    let of_one = each.filter(|(error, _)| **error > NOTABLE).map(|(error, expected)| (error / expected).powi(2));
    let of_one = of_one.fold(0.0, f64::max);
    let ratio = of_all.or(Some(of_one).filter(|r| r.is_finite() && *r > OF_ONE * by_chance))?;
    // What a model misses comes back wherever the motion does: it is no sign of a periodic record.
    let percent =
        |of: &[f64]| of.iter().map(|e| format!("{} %", significant(100.0 * e, 2))).collect::<Vec<_>>().join(", ");
    let hidden = details.hidden_noise.join(" and ");
    let advice = if hidden.is_empty() {
        "An effect is missing. Run `whirl explain`".to_owned()
    } else {
        format!(
            "An effect is missing, or it is the noise of {hidden}, which this record does not show. Run `whirl explain`"
        )
    };
    // What fails is said: the equations' errors, or, where these are near what the sensors explain,
    // the rows of the weak form.
    let mut errors = result.identification_error.iter().zip(&details.expected_error);
    let near = |(error, expected): (&f64, &f64)| (error / expected).powi(2) <= BESIDE_NOISE * by_chance;
    let text = if of_all.is_some() && errors.all(near) {
        format!(
            "These equations do not describe this record: over its windows they leave {} times the power of the sensors' noise, where up to {} would be noise",
            significant(ratio, 3),
            significant(BESIDE_NOISE * by_chance, 2)
        )
    } else {
        format!(
            "These equations do not describe this record: the identification error is {}, where its sensors explain {}",
            percent(&result.identification_error),
            percent(&details.expected_error)
        )
    };
    let warning = Warning::new("model-misses-something", text, advice).with("residual_over_noise", ratio);
    Some(if ratio > MISLEADING * by_chance && hidden.is_empty() { warning.invalidating() } else { warning })
}

/// Coefficients with a sign that no rig has.
fn signs(c: &Coefficients<'_>) -> Vec<Warning> {
    let mut out = Vec::new();
    for (i, name) in c.names.iter().enumerate() {
        let (value, error) = (c.values[i], c.error(i));
        if !(value < 0.0 && value < -CLEAR * error) {
            continue;
        }
        let negative = format!("{name} = {} is negative", plus_minus(value, Z95 * error));
        let damping = name.starts_with('C') || name == "c_r";
        let warning = if damping {
            Warning::new(
                "negative-damping",
                format!("{negative}: that friction would drive the motion instead of braking it"),
                "Does time run backwards, is a sign reversed or a channel late? If not, the equations miss something: run `whirl explain`",
            )
        } else if ["B11", "B21"].contains(&name.as_str()) {
            Warning::new(
                "negative-inertia",
                format!("{negative}: one of the arms would have a negative moment of inertia"),
                "Is a channel dead, exchanged with the other or reversed? See `whirl inspect`",
            )
        } else if ["B22", "q_sin"].contains(&name.as_str()) {
            Warning::new(
                "negative-gravity",
                format!("{negative}: gravity would pull the arm upward"),
                "Angles count from where the arm hangs at rest, all in the same sense: check the channels' zeros and signs",
            )
        } else {
            continue;
        };
        out.push(warning.invalidating().with("parameter", name.clone()).with("value", value).with("std_error", error));
    }
    if let (Some((b11, i)), Some((b21, j))) = (c.at("B11"), c.at("B21"))
        && b11 > 0.0
        && b21 > 0.0
    {
        let mut gradient = DVector::zeros(c.values.len());
        (gradient[i], gradient[j]) = (b21, b11);
        let (product, error) = (b11 * b21, c.variance(&gradient).sqrt());
        if product > 1.0 + CLEAR * error {
            let warning = Warning::new(
                "negative-inertia",
                format!(
                    "B11 B21 = {} exceeds 1: some motions would have a negative kinetic energy",
                    plus_minus(product, Z95 * error)
                ),
                "Is a channel dead, exchanged with the other, or of another number of counts a turn? See `whirl inspect`",
            );
            out.push(
                warning.invalidating().with("parameter", "B11 B21").with("value", product).with("std_error", error),
            );
        }
    }
    out
}

/// Coefficients of a system from bodies that are the strength of a friction over an inertia, with a
/// sign that no rig has.
fn dampings_of(mechanism: &Mechanism, c: &Coefficients<'_>) -> Vec<Warning> {
    let brakes = |name: &str| {
        let entry = name.split_once('@').and_then(|(id, _)| catalogue().iter().find(|e| e.id == id));
        entry.is_some_and(kinds::brakes)
    };
    let strength = |of: &Coefficient| {
        let of_one = |k: &usize| {
            let other = |a: &Atom| *a != Atom::Parameter(*k);
            of.numerator.any(&|a| *a == Atom::Parameter(*k)) && !of.numerator.any(&other)
        };
        (0..mechanism.parameters.len()).find(of_one).map(|k| mechanism.parameters[k].name.as_str())
    };
    let ones = vec![1.0; mechanism.parameters.len()];
    let mut out = Vec::new();
    for of in &mechanism.coefficients {
        let Some(friction) = strength(of).filter(|name| brakes(name)) else { continue };
        let Some((value, i)) = c.at(&of.name) else { continue };
        let turned = mechanism.value(&of.name, &ones).is_some_and(|x| x < 0.0);
        let brakes_by = if turned { -value } else { value };
        if brakes_by < -CLEAR * c.error(i) {
            out.push(
                Warning::new(
                    "negative-damping",
                    format!("{} = {}: {friction} would drive the motion instead of braking it", of.name, plus_minus(value, Z95 * c.error(i))),
                    "Does time run backwards, is a sign reversed or a channel late? If not, the equations miss something: run `whirl explain`",
                )
                .invalidating()
                .with("parameter", of.name.clone())
                .with("value", value)
                .with("std_error", c.error(i)),
            );
        }
    }
    out
}

/// Physical quantities that no rig has negative.
fn physical_signs(result: &Identification, rig: &Rig) -> Vec<Warning> {
    let mechanism = rig.bound.as_ref().and_then(|b| b.model.mechanism.clone());
    let built_in = |name: &str| ["J_o", "tau_c", "c_r", "m1", "m2"].iter().any(|start| name.starts_with(start));
    let positive = |name: &str| match &mechanism {
        Some(m) => m.parameters.iter().any(|p| p.positive && p.name == name),
        None => rig.bound.is_none() && built_in(name),
    };
    let of_fit = |name: &str| result.correlation_names.iter().any(|n| n == name);
    result
        .parameters
        .iter()
        .filter(|p| positive(&p.name) && !of_fit(&p.name) && p.value < -CLEAR * p.std_error)
        .map(|p| {
            Warning::new(
                "negative-quantity",
                format!("{} = {}{} is negative", p.name, plus_minus(p.value, Z95 * p.std_error), behind(&p.unit)),
                "No rig is so. Are the quantities under [known] right? If they are, the equations miss something: run `whirl explain`",
            )
            .invalidating()
            .with("parameter", p.name.clone())
            .with("value", p.value)
            .with("std_error", p.std_error)
        })
        .collect()
}

/// What the ties between coefficients miss by.
pub(super) struct Ties {
    /// hᵀ S⁻¹ h.
    statistic: f64,
    /// Number of ties.
    freedom: usize,
    /// Probability of so much by chance.
    pub(super) chance: f64,
    /// C12 and C2 with opposite signs, both clearly.
    opposed: Option<(f64, f64)>,
}

/// Products that are equal: first · second = third · fourth.
const TIES: [[&str; 4]; 4] = [
    ["C12", "B21", "C2", "B11"],
    ["C14", "B21", "C4", "B11"],
    ["B13", "B22", "B23", "B12"],
    ["B14", "B22", "B24", "B12"],
];

/// The test of the ties; none where there are none, or too few blocks to judge.
fn ties(c: &Coefficients<'_>) -> Option<Ties> {
    let mut missed = Vec::new();
    let mut gradients = Vec::new();
    for names in TIES {
        let found: Option<Vec<(f64, usize)>> = names.iter().map(|n| c.at(n)).collect();
        let Some([(a, i), (b, j), (d, k), (e, l)]) = found.as_deref().and_then(|f| f.first_chunk().copied()) else {
            continue;
        };
        let mut g = DVector::zeros(c.values.len());
        (g[i], g[j], g[k], g[l]) = (b, a, -e, -d);
        missed.push(a * b - d * e);
        gradients.push(g);
    }
    let freedom = missed.len();
    if freedom == 0 || c.blocks <= freedom + 1 {
        return None;
    }
    // Scaled to unit variances, since ties differ by orders of magnitude.
    let error: Vec<f64> = gradients.iter().map(|g| c.variance(g).sqrt()).collect();
    let spread = DMatrix::from_fn(freedom, freedom, |i, j| {
        (gradients[i].transpose() * &c.covariance * &gradients[j])[(0, 0)] / (error[i] * error[j])
    });
    let missed = DVector::from_fn(freedom, |i, _| missed[i] / error[i]);
    let statistic = missed.dot(&spread.cholesky()?.solve(&missed));
    let opposed = [("C12", "C2"), ("C14", "C4")].into_iter().find_map(|(first, second)| {
        let ((a, i), (b, j)) = (c.at(first)?, c.at(second)?);
        (a * b < 0.0 && a.abs() > CLEAR * c.error(i) && b.abs() > CLEAR * c.error(j)).then_some((a, b))
    });
    Some(Ties { opposed, ..Ties::of(statistic, freedom, c.blocks)? })
}

impl Ties {
    /// Of a distance from the ties in the metric of a covariance over so many blocks: Hotelling's
    /// T². None where the blocks are too few to judge.
    pub(super) fn of(statistic: f64, freedom: usize, blocks: usize) -> Option<Self> {
        let (d, g) = (freedom as f64, blocks as f64);
        if freedom == 0 || blocks <= freedom + 1 || !statistic.is_finite() {
            return None;
        }
        let f = FisherSnedecor::new(d, g - d).ok()?;
        let chance = f.sf(statistic * (g - d) / (d * (g - 1.0)));
        chance.is_finite().then_some(Self { statistic, freedom, chance, opposed: None })
    }

    fn warnings(&self) -> Vec<Warning> {
        let text = match self.opposed {
            Some((a, b)) => format!(
                "These coefficients contradict each other: friction in joint 2 would brake one arm and drive the other ({} and {}; χ² {}, expected {})",
                significant(a, 3),
                significant(b, 3),
                significant(self.statistic, 5),
                self.freedom
            ),
            None => format!(
                "These coefficients contradict each other (χ² {}, expected {}): the equations miss something",
                significant(self.statistic, 5),
                self.freedom
            ),
        };
        let warning = Warning::new("tie-violated", text, "Run `whirl explain`")
            .invalidating()
            .with("chi_squared", self.statistic)
            .with("expected", self.freedom as u64);
        vec![warning]
    }
}

#[cfg(test)]
#[path = "judgement_tests.rs"]
pub(super) mod tests;

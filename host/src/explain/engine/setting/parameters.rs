//! The equations' own coefficients over several records, and the parameters p of the system behind
//! them: b(p) = b for systems from bodies ([`crate::system::ties`]), D_e of every equation for
//! written ones ([`written`]). SI units.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::Setting;
use crate::effects::columns::{self, Part};
use crate::effects::written;
use crate::identify::Identification;
use crate::model::model_file::ModelFile;
use crate::rig::Rig;
use crate::system::mechanism::Mechanism;
use crate::system::openness::Openness;
use crate::system::ties::{self, Identified};

/// The equations' own coefficients over several records: each once, or once for each record.
#[derive(Clone, Debug)]
pub struct Own {
    /// Their names; a record's own are `name_1`, `name_2` …
    pub names: Vec<String>,
    /// For each record, the column of each of the model's coefficients.
    pub of_record: Vec<Vec<usize>>,
}

impl Own {
    pub(super) fn new(model: &ModelFile, records: usize) -> Self {
        let (mut names, mut of_record) = (Vec::new(), vec![Vec::new(); records.max(1)]);
        for c in model.coefficients() {
            let own = records > 1 && each_record(model, Some(c));
            for (r, columns) in of_record.iter_mut().enumerate() {
                if own || r == 0 {
                    names.push(if own { format!("{c}_{}", r + 1) } else { c.clone() });
                }
                columns.push(names.len() - 1);
            }
        }
        Self { names, of_record }
    }

    /// The columns of a coefficient of the model: one, or one for each record; none where the model
    /// does not have it.
    pub fn columns(&self, model: &ModelFile, name: &str) -> Vec<usize> {
        let number = model.coefficients().iter().position(|n| n == name);
        let mut all: Vec<usize> = number.map_or_else(Vec::new, |i| self.of_record.iter().map(|r| r[i]).collect());
        all.dedup();
        all
    }

    /// Coefficients of the model in one record from values of the columns.
    pub fn coefficients(&self, values: &[f64], record: usize) -> Vec<f64> {
        let columns = &self.of_record[record.min(self.of_record.len() - 1)];
        columns.iter().map(|&c| values.get(c).copied().unwrap_or(0.0)).collect()
    }
}

/// Whether a coefficient (or any) is one for each record.
fn each_record(model: &ModelFile, name: Option<&str>) -> bool {
    model.equations.iter().flat_map(|e| &e.terms).any(|t| t.each_record && name.is_none_or(|n| n == t.name))
}

/// Parameters of the system behind its coefficients.
#[derive(Clone, Debug)]
pub struct Physical {
    /// All parameters of the file, those that stay open among them.
    pub values: Vec<f64>,
    /// Whether the inertia of each equation stays open.
    pub open: Vec<bool>,
    /// Coefficients of written equations.
    pub written: Vec<f64>,
    /// What else of the parameters stays open.
    pub openness: Openness,
    /// ∂p/∂b of the parameters by the coefficients without dampings, 0 of those that these hardly
    /// tell ([`MOST_MOVED`]); of no column where they are not tied.
    pub slopes: DMatrix<f64>,
    /// Standard errors of the parameters by those of the coefficients without dampings.
    pub errors: Vec<f64>,
}

/// Largest relative change of a parameter that the slopes are trusted for: a mass stays one. One
/// whose standard error is more is held where it is while coefficients are fitted.
const MOST_MOVED: f64 = 0.5;
/// Relative step of a coefficient for a slope.
const SLOPE_STEP: f64 = 1e-5;

impl Physical {
    /// The same where the coefficients without dampings are by so much others, to first order and by
    /// [`MOST_MOVED`] at most; itself where they are not tied.
    pub fn moved(&self, by: &DVector<f64>) -> Self {
        if self.slopes.ncols() != by.len() {
            return self.clone();
        }
        let step = &self.slopes * by;
        let relative = |(p, d): (&f64, &f64)| if *p == 0.0 { 0.0 } else { (d / p).abs() };
        let most = self.values.iter().zip(step.iter()).map(relative).fold(0.0, f64::max);
        let share = if most > MOST_MOVED { MOST_MOVED / most } else { 1.0 };
        Self { values: self.values.iter().zip(step.iter()).map(|(p, d)| p + share * d).collect(), ..self.clone() }
    }

    /// The same of written equations where inertias follow from their coefficients, of that
    /// covariance.
    fn following(self, model: &ModelFile, rig: &Rig, covariance: &DMatrix<f64>) -> Self {
        let (omega, n, own) = (rig.omega(), model.equations.len(), &self.written);
        let mut slopes = DMatrix::zeros(self.values.len(), own.len());
        for j in 0..own.len() {
            let step = SLOPE_STEP * own[j].abs();
            let at = |by: f64| {
                let mut all = own.clone();
                all[j] += by;
                written::inertias(model, omega, &all).filter(|_| step > 0.0)
            };
            let (Some(high), Some(low)) = (at(step), at(-step)) else { continue };
            (0..n).for_each(|e| slopes[(e, j)] = (high.scales[e] - low.scales[e]) / (2.0 * step));
        }
        let mut open = self.open;
        for (e, open) in open.iter_mut().enumerate() {
            let row = slopes.row(e);
            let error = (row * covariance * row.transpose())[(0, 0)].max(0.0).sqrt();
            // The first of those that are coupled is the unit of what acts there.
            let follows = row.iter().any(|x| *x != 0.0) && error <= MOST_MOVED * self.values[e].abs();
            if !follows {
                slopes.row_mut(e).fill(0.0);
            }
            *open = !follows;
        }
        Self { slopes, open, ..self }
    }

    /// Whether the inertia of an equation stays open: it is the unit of what acts there, and is held
    /// as it is.
    pub fn is_open(&self, equation: usize) -> bool {
        self.open.get(equation).copied().unwrap_or(true)
    }

    /// Whether the parameters that parts of columns hold inside functions are fixed.
    pub fn fixes(&self, parts: &[Part], mechanism: &Mechanism) -> bool {
        columns::quotients(parts, mechanism).iter().all(|(n, d)| !self.openness.is_open(n, d))
    }
}

impl Setting<'_> {
    /// Parameters of the system from coefficients of the equations without dampings; while
    /// trajectories are followed near those that stood before, which the balance of forces may not
    /// have.
    pub fn physical(&self, values: &DVector<f64>, covariance: &DMatrix<f64>, near: &Physical) -> Option<Physical> {
        if self.is_written() {
            let own = self.own.coefficients(values.as_slice(), 0);
            let found = of_equations(self.model(), self.rig, &own)?;
            // Several records may have coefficients of their own.
            let is_one = own.len() == values.len();
            return Some(if is_one { found.following(self.model(), self.rig, covariance) } else { found });
        }
        let mechanism = self.mechanism()?;
        let names = self.model().coefficients();
        let identified = Identified { names, values, covariance, metric: covariance };
        physical(mechanism, &identified, &self.known, if self.shooting { &near.values } else { &[] })
    }
}

/// What effects rest on in written equations.
pub(super) fn of_equations(model: &ModelFile, rig: &Rig, values: &[f64]) -> Option<Physical> {
    let found = written::parameters(model, rig.direction(), rig.omega(), values)?;
    let open = vec![true; model.equations.len()];
    Some(Physical {
        values: found,
        open,
        written: values.to_vec(),
        openness: Openness::default(),
        slopes: DMatrix::zeros(0, 0),
        errors: Vec::new(),
    })
}

fn physical(
    mechanism: &Mechanism,
    b: &Identified<'_>,
    known: &BTreeMap<String, f64>,
    near: &[f64],
) -> Option<Physical> {
    let known: BTreeMap<&str, f64> = known.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    let fit = ties::fit_near(mechanism, b, &known, near)?;
    let own = mechanism.file.as_deref()?.parameters.len();
    let values = fit.parameters[..own].to_vec();
    let mut slopes = fit.slopes.rows(0, own).into_owned();
    let variance = |s: &DMatrix<f64>, k: usize| (s.row(k) * b.covariance * s.row(k).transpose())[(0, 0)];
    let errors: Vec<f64> = (0..own).map(|k| variance(&slopes, k).max(0.0).sqrt()).collect();
    for (k, (value, error)) in values.iter().zip(&errors).enumerate() {
        if *error > MOST_MOVED * value.abs() {
            slopes.row_mut(k).fill(0.0);
        }
    }
    Some(Physical { values, open: fit.open_scales, written: Vec::new(), openness: fit.openness, slopes, errors })
}

/// Parameters behind an identification's coefficients.
pub(super) fn of_identification(
    mechanism: &Mechanism,
    first: &Identification,
    known: &BTreeMap<String, f64>,
) -> Option<Physical> {
    let names = &first.correlation_names;
    let of = |n: &String| first.parameter(n);
    let values = DVector::from_iterator(names.len(), names.iter().map(|n| of(n).map_or(0.0, |p| p.value)));
    let errors: Vec<f64> = names.iter().map(|n| of(n).map_or(0.0, |p| p.std_error)).collect();
    let covariance = DMatrix::from_fn(names.len(), names.len(), |i, j| first.correlation[i][j] * errors[i] * errors[j]);
    let b = Identified { names, values: &values, covariance: &covariance, metric: &covariance };
    // These are coefficients of dampings as well; how parameters follow from the others alone is
    // known when these are fitted.
    physical(mechanism, &b, known, &[]).map(|found| Physical { slopes: DMatrix::zeros(0, 0), ..found })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::library;
    use crate::system::ties::tests::TRUTH;

    /// Parameters of a double pendulum from exact coefficients, each with a share of it as standard
    /// error; number of J_2.
    fn with_errors(share: f64) -> (Physical, usize) {
        let text = library::text("double-pendulum").unwrap();
        let model = library::read("double-pendulum", text).unwrap().model(None, 31.4).unwrap();
        let mechanism = model.mechanism.clone().unwrap();
        let of = |n: &str| TRUTH.iter().find(|t| t.0 == n).unwrap().1;
        let truth: Vec<f64> = mechanism.parameters.iter().map(|p| of(&p.name)).collect();
        let names: Vec<String> = mechanism.coefficients.iter().map(|c| c.name.clone()).collect();
        let values = DVector::from_iterator(names.len(), names.iter().map(|n| mechanism.value(n, &truth).unwrap()));
        let covariance = DMatrix::from_diagonal(&values.map(|v| (share * v).powi(2)));
        let known = ["m2", "e2", "l1", "g"].map(|n| (n.to_owned(), of(n))).into();
        let b = Identified { names: &names, values: &values, covariance: &covariance, metric: &covariance };
        let place = mechanism.parameters.iter().position(|p| p.name == "J_2").unwrap();
        (physical(&mechanism, &b, &known, &[]).unwrap(), place)
    }

    /// About a mass that the record hardly tells, what a coefficient does to it means nothing.
    #[test]
    fn what_coefficients_hardly_tell_is_held_while_they_are_fitted() {
        let by = |p: &Physical| DVector::from_element(p.slopes.ncols(), 0.01);
        let (told, k) = with_errors(1e-3);
        assert!(told.errors[k] > 0.0 && told.errors[k] < 1e-2 * told.values[k], "{:?}", told.errors);
        assert!((told.moved(&by(&told)).values[k] / told.values[k] - 1.0).abs() > 1e-3);
        let (vague, k) = with_errors(2.0);
        assert!(vague.errors[k] > vague.values[k], "{:?}", vague.errors);
        assert_eq!(vague.moved(&by(&vague)).values[k], vague.values[k]);
    }
}

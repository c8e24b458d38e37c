//! What stays the same while effects are added: the record, its sensors, the system without its dampings (written equations stand as they
//! are).

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::candidates::{Candidate, Column};
use crate::effects::columns::Span;
use crate::effects::entry::Entry;
use crate::effects::{self, places, written};
use crate::error::Result;
use crate::explain::model_file::told;
use crate::identify::general::noise::Sensors;
use crate::identify::general::stretches::Stretch;
use crate::identify::general::{self, Prepared};
use crate::identify::{Geometry, Identification, Settings as IdentifySettings};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::multiple;
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::Bound;
use crate::system::language::SystemFile;
use crate::system::mechanism::Mechanism;
use crate::system::ties::{self, Identified};
use crate::warning::Warning;

/// The record and the system.
pub struct Setting<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// The rig's system with its nominal dampings as coefficients.
    pub whole: &'a Bound,
    /// The same system without dampings, which are effects here.
    pub bound: Bound,
    /// Steady, unbroken stretches.
    pub raw: Vec<Stretch>,
    /// Noise of the sensors.
    pub sensors: Sensors,
    /// Windows and low-passes.
    pub geometry: Geometry,
    /// Whether each coordinate lies on a circle.
    pub circle: Vec<bool>,
    /// Beginning and length of the record.
    pub span: Span,
    /// The catalogue and the user's effects.
    pub entries: Vec<Arc<Entry>>,
    /// What is known of the rig.
    known: BTreeMap<String, f64>,
    /// Places of written equations.
    written: Option<Mechanism>,
}

/// A setting with what its identification gave.
pub struct Begun<'a> {
    /// The setting.
    pub setting: Setting<'a>,
    /// The identification with the nominal dampings.
    pub first: Identification,
    /// Parameters behind it.
    pub physical: Physical,
    /// Things noticed in the record.
    pub warnings: Vec<Warning>,
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
}

impl<'a> Setting<'a> {
    /// For records of a rig whose system was derived from bodies; none where its equations need their dampings to be any, or
    /// their ties cannot be solved.
    ///
    /// # Errors
    /// As [`crate::identify::identify`].
    pub fn begin(records: &[Record], rig: &'a Rig, whole: &'a Bound, most_windows: f64) -> Result<Option<Begun<'a>>> {
        let Some(base) = base(rig, whole, records.len()) else { return Ok(None) };
        let settings = IdentifySettings::default();
        let first = general::identify(records, rig, whole, &settings)?;
        let Prepared { stretches, sensors, geometry, warnings, .. } = general::prepare(records, rig, whole, &settings)?;
        let raw = shorten(stretches, geometry.windows.hop_s * most_windows);
        let (Some(start), Some(end)) = (raw.first(), raw.last()) else { return Ok(None) };
        let span =
            Span { start_s: start.start_s, length_s: (end.time(end.len()) - start.start_s).max(f64::MIN_POSITIVE) };
        let mechanism = whole.model.mechanism.as_deref();
        let known: BTreeMap<String, f64> = mechanism.map_or_else(BTreeMap::new, |m| {
            let known = m.known(&rig.known, rig.says_gravity());
            known.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
        });
        let circle = base.circle();
        let (written, physical) = if written::applies(&base) {
            let value = |n: &String| first.parameter(n).map_or(0.0, |p| p.value);
            let values: Vec<f64> = base.coefficients().iter().map(value).collect();
            let places = written::mechanism(&base, rig.direction(), rig.omega(), &values);
            (places, of_equations(&base, rig, &values))
        } else {
            (None, mechanism.and_then(|m| of_identification(m, &first, &known)))
        };
        let Some(physical) = physical else { return Ok(None) };
        let setting = Self {
            rig,
            whole,
            bound: Bound { model: Arc::new(base), ..whole.clone() },
            raw,
            sensors,
            geometry,
            circle,
            span,
            entries: effects::catalogue().iter().cloned().map(Arc::new).chain(rig.effects.iter().cloned()).collect(),
            known,
            written,
        };
        Ok(Some(Begun { setting, first, physical, warnings }))
    }

    /// The system without dampings.
    pub fn model(&self) -> &ModelFile {
        &self.bound.model
    }

    /// What its coefficients are made of.
    pub fn mechanism(&self) -> Option<&Mechanism> {
        self.written.as_ref().or(self.bound.model.mechanism.as_deref())
    }

    /// Whether the equations were written down, so that effects are told in their own units.
    pub fn is_written(&self) -> bool {
        self.written.is_some()
    }

    /// What it was derived from.
    pub fn file(&self) -> Option<&SystemFile> {
        self.mechanism().and_then(|m| m.file.as_deref())
    }

    /// Whether written equations have a column already: each of its parts is a multiple of one of the equation's own terms.
    pub fn holds(&self, column: &Column) -> bool {
        let model = self.model();
        column.iter().all(|(e, of)| {
            let mut own = model.equations[*e].terms.iter();
            own.any(|t| multiple(of, &model.in_seconds(&t.of, self.rig.omega())).is_some())
        })
    }

    /// Every candidate: each effect at each of its places in each of its forms.
    pub fn candidates(&self, physical: &Physical) -> Vec<Candidate> {
        let Some(file) = self.file() else { return Vec::new() };
        self.entries
            .iter()
            .flat_map(|entry| {
                places::of(entry, file, &self.bound).into_iter().flat_map(move |place| {
                    let forms = entry.forms().into_iter();
                    forms.filter_map(move |form| Candidate::new(self, entry, place, form, physical))
                })
            })
            .collect()
    }

    /// Parameters of the system from coefficients of the equations without dampings.
    pub fn physical(&self, values: &DVector<f64>, covariance: &DMatrix<f64>) -> Option<Physical> {
        if self.is_written() {
            return of_equations(self.model(), self.rig, values.as_slice());
        }
        let mechanism = self.mechanism()?;
        let names = self.model().coefficients();
        let identified = Identified { names: &names, values, covariance, metric: covariance };
        physical(mechanism, &identified, &self.known)
    }
}

/// The equations without nominal dampings; none where effects cannot be placed in them.
fn base(rig: &Rig, whole: &Bound, records: usize) -> Option<ModelFile> {
    let model = &*whole.model;
    if model.equations.len() != model.coordinates.len() {
        return None;
    }
    if written::applies(model) {
        // A coefficient of its own for each record, and what is neither length nor angle, is beyond this way.
        let own = records > 1 && model.equations.iter().flat_map(|e| &e.terms).any(|t| t.each_record);
        let open = rig.drive.is_some() && !own && told::moves(rig, whole).iter().all(|m| *m);
        return open.then(|| model.clone());
    }
    let file = model.mechanism.as_deref()?.file.clone()?;
    if file.written { None } else { file.model(Some(&[]), rig.omega()).ok() }
}

/// What effects rest on in written equations.
fn of_equations(model: &ModelFile, rig: &Rig, values: &[f64]) -> Option<Physical> {
    let found = written::parameters(model, rig.direction(), rig.omega(), values)?;
    Some(Physical { values: found, open: vec![true; model.equations.len()], written: values.to_vec() })
}

fn physical(mechanism: &Mechanism, b: &Identified<'_>, known: &BTreeMap<String, f64>) -> Option<Physical> {
    let known: BTreeMap<&str, f64> = known.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    let fit = ties::fit(mechanism, b, &known)?;
    let own = mechanism.file.as_deref()?.parameters.len();
    Some(Physical { values: fit.parameters[..own].to_vec(), open: fit.open_scales, written: Vec::new() })
}

/// Parameters behind an identification's coefficients.
fn of_identification(mechanism: &Mechanism, first: &Identification, known: &BTreeMap<String, f64>) -> Option<Physical> {
    let names = &first.correlation_names;
    let of = |n: &String| first.parameter(n);
    let values = DVector::from_iterator(names.len(), names.iter().map(|n| of(n).map_or(0.0, |p| p.value)));
    let errors: Vec<f64> = names.iter().map(|n| of(n).map_or(0.0, |p| p.std_error)).collect();
    let covariance = DMatrix::from_fn(names.len(), names.len(), |i, j| first.correlation[i][j] * errors[i] * errors[j]);
    physical(mechanism, &Identified { names, values: &values, covariance: &covariance, metric: &covariance }, known)
}

/// The first part of a long record: explanations need no more.
fn shorten(stretches: Vec<Stretch>, seconds: f64) -> Vec<Stretch> {
    let mut left = seconds;
    let mut out = Vec::new();
    for s in stretches {
        let n = ((left / s.step_s) as usize).min(s.len());
        if n == 0 {
            break;
        }
        left -= n as f64 * s.step_s;
        out.push(if n < s.len() { s.part(0, n) } else { s });
    }
    out
}

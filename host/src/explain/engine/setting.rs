//! What stays the same while effects are added: the record, its sensors, the system without its dampings.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::candidates::Candidate;
use crate::effects::columns::Span;
use crate::effects::entry::Entry;
use crate::effects::{self, places};
use crate::error::Result;
use crate::identify::general::noise::Sensors;
use crate::identify::general::stretches::Stretch;
use crate::identify::general::{self, Prepared};
use crate::identify::{Geometry, Identification, Settings as IdentifySettings};
use crate::model::model_file::ModelFile;
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
}

impl<'a> Setting<'a> {
    /// For records of a rig whose system was derived from bodies; none where its equations need their dampings to be any, or
    /// their ties cannot be solved.
    ///
    /// # Errors
    /// As [`crate::identify::identify`].
    pub fn begin(records: &[Record], rig: &'a Rig, whole: &'a Bound, most_windows: f64) -> Result<Option<Begun<'a>>> {
        let Some(mechanism) = whole.model.mechanism.as_deref() else { return Ok(None) };
        let Some(file) = mechanism.file.clone() else { return Ok(None) };
        if file.written || whole.model.equations.len() != whole.model.coordinates.len() {
            return Ok(None);
        }
        let Ok(base) = file.model(Some(&[]), rig.omega()) else { return Ok(None) };
        let settings = IdentifySettings::default();
        let first = general::identify(records, rig, whole, &settings)?;
        let Prepared { stretches, sensors, geometry, warnings, .. } = general::prepare(records, rig, whole, &settings)?;
        let raw = shorten(stretches, geometry.windows.hop_s * most_windows);
        let (Some(start), Some(end)) = (raw.first(), raw.last()) else { return Ok(None) };
        let span =
            Span { start_s: start.start_s, length_s: (end.time(end.len()) - start.start_s).max(f64::MIN_POSITIVE) };
        let known = mechanism.known(&rig.known, rig.says_gravity());
        let known: BTreeMap<String, f64> = known.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
        let Some(physical) = of_identification(mechanism, &first, &known) else { return Ok(None) };
        let circle = base.circle();
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
        };
        Ok(Some(Begun { setting, first, physical, warnings }))
    }

    /// The system without dampings.
    pub fn model(&self) -> &ModelFile {
        &self.bound.model
    }

    /// What its coefficients are made of.
    pub fn mechanism(&self) -> Option<&Mechanism> {
        self.bound.model.mechanism.as_deref()
    }

    /// What it was derived from.
    pub fn file(&self) -> Option<&SystemFile> {
        self.mechanism().and_then(|m| m.file.as_deref())
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
        let mechanism = self.mechanism()?;
        let names = self.model().coefficients();
        let identified = Identified { names: &names, values, covariance, metric: covariance };
        physical(mechanism, &identified, &self.known)
    }
}

fn physical(mechanism: &Mechanism, b: &Identified<'_>, known: &BTreeMap<String, f64>) -> Option<Physical> {
    let known: BTreeMap<&str, f64> = known.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    let fit = ties::fit(mechanism, b, &known)?;
    let own = mechanism.file.as_deref()?.parameters.len();
    Some(Physical { values: fit.parameters[..own].to_vec(), open: fit.open_scales })
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

//! What stays the same while effects are added: the record, its sensors, the system without its dampings (written equations stand as they
//! are).

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::candidates::{Candidate, Column};
use super::memory;
use super::shooting::signs;
use super::units;
use crate::effects::columns::{self, Part, Span};
use crate::effects::entry::{Entry, LENGTH, Verb};
use crate::effects::places::Place;
use crate::effects::{self, along_an_arm, places, written};
use crate::error::Result;
use crate::identify::history::{History, Laws};
use crate::identify::remeasured::Sensors;
use crate::identify::stretches::Stretch;
use crate::identify::{self, Prepared};
use crate::identify::{Geometry, Identification, Settings as IdentifySettings};
use crate::model::model_file::ModelFile;
use crate::model::model_file::equations_of_motion::wrapped;
use crate::model::model_file::expression::{Expression, Function, Node, Symbol, multiple};
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::measures::Bound;
use crate::system::language::SystemFile;
use crate::system::mechanism::Mechanism;
use crate::system::openness::Openness;
use crate::system::polynomial::Polynomial;
use crate::system::ties::{self, Identified};
use crate::warning::Warning;

/// Turn of the low-pass's highest frequency between two points, rad: columns are integrated to (0.4)²/12, 1 % of what is fastest. Most points to a sample.
const MOST_TURN: f64 = 0.4;
const MOST_POINTS: f64 = 16.0;
/// Samples of which shooting follows some: more of a record is not looked at.
const MOST_FOLLOWED: f64 = 120_000.0;

/// The equations' own coefficients over several records: each once, or once for each record.
#[derive(Clone, Debug)]
pub struct Own {
    /// Their names; a record's own are `name_1`, `name_2` …
    pub names: Vec<String>,
    /// For each record, the column of each of the model's coefficients.
    pub of_record: Vec<Vec<usize>>,
}

impl Own {
    fn new(model: &ModelFile, records: usize) -> Self {
        let (mut names, mut of_record) = (Vec::new(), vec![Vec::new(); records.max(1)]);
        for c in model.coefficients() {
            let own = records > 1 && each_record(model, Some(&c));
            for (r, columns) in of_record.iter_mut().enumerate() {
                if own || r == 0 {
                    names.push(if own { format!("{c}_{}", r + 1) } else { c.clone() });
                }
                columns.push(names.len() - 1);
            }
        }
        Self { names, of_record }
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
    /// Record of each.
    pub record_of: Vec<usize>,
    /// Columns of the equations' own coefficients.
    pub own: Own,
    /// Whether candidates are judged by shooting; rows of the weak form stand in where the model follows no window of the record.
    pub shooting: bool,
    /// Signs that own coefficients keep; 0 for either.
    pub signs: Vec<f64>,
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
    /// States of effects that remember.
    pub laws: Arc<Laws>,
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
    /// What else of the parameters stays open.
    pub openness: Openness,
}

impl Physical {
    /// Whether the parameters that parts of columns hold inside functions are fixed.
    pub fn fixes(&self, parts: &[Part], mechanism: &Mechanism) -> bool {
        columns::quotients(parts, mechanism).iter().all(|(n, d)| !self.openness.is_open(n, d))
    }
}

impl<'a> Setting<'a> {
    /// For records of a rig whose system was derived from bodies; none where its equations need their dampings to be any, or
    /// their ties cannot be solved.
    ///
    /// # Errors
    /// As [`crate::identify::identify`].
    pub fn begin(
        records: &[Record],
        rig: &'a Rig,
        whole: &'a Bound,
        (most_windows, settings): (f64, &IdentifySettings),
    ) -> Result<Option<Begun<'a>>> {
        let Some(base) = base(rig, whole) else { return Ok(None) };
        let first = identify::weak_form(records, rig, settings)?;
        let Prepared { stretches, record_of, sensors, geometry, warnings } =
            identify::prepare(records, rig, whole, settings)?;
        let own = Own::new(&base, records.len());
        let longest = MOST_FOLLOWED / rig.sample_rate_hz;
        let mut raw = shorten(stretches, longest.max(geometry.windows.hop_s * most_windows));
        let (Some(start), Some(end)) = (raw.first(), raw.last()) else { return Ok(None) };
        let span =
            Span { start_s: start.start_s, length_s: (end.time(end.len()) - start.start_s).max(f64::MIN_POSITIVE) };
        let mechanism = whole.model.mechanism.as_deref();
        let known: BTreeMap<String, f64> = mechanism.map_or_else(BTreeMap::new, |m| {
            let known = m.known(&rig.known, rig.says_gravity());
            known.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
        });
        let circle = base.circle();
        let laws = Arc::new(Laws::default());
        for s in &mut raw {
            let at = (s.start_s, s.step_s);
            s.history = Some(Arc::new(History::new(&s.coordinates, at, &geometry.kernels, &circle, &laws)));
        }
        let (written, physical) = if written::applies(&base) {
            let columns: Vec<f64> = own.names.iter().map(|n| first.parameter(n).map_or(0.0, |p| p.value)).collect();
            let values = own.coefficients(&columns, 0);
            let places = written::mechanism(&base, rig.direction(), rig.omega(), &values);
            (places, of_equations(&base, rig, &values))
        } else {
            (None, mechanism.and_then(|m| of_identification(m, &first, &known)))
        };
        let Some(physical) = physical else { return Ok(None) };
        let mut setting = Self {
            rig,
            whole,
            bound: Bound { model: Arc::new(base), ..whole.clone() },
            raw,
            record_of,
            own,
            shooting: true,
            signs: Vec::new(),
            sensors,
            geometry,
            circle,
            span,
            entries: effects::catalogue().iter().cloned().map(Arc::new).chain(rig.effects.iter().cloned()).collect(),
            known,
            written,
            laws,
        };
        setting.signs = signs::own(&setting, &physical, &first);
        Ok(Some(Begun { setting, first, physical, warnings }))
    }

    /// Points to a sample: so many that what the low-pass lets through turns by little between two.
    pub fn points(&self) -> usize {
        let spacing = self.raw.first().map_or(1.0, |s| s.step_s);
        let turn = core::f64::consts::TAU * self.geometry.kernels.full.pass_hz * spacing;
        (turn / MOST_TURN).ceil().clamp(1.0, MOST_POINTS) as usize
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

    /// Whether a candidate's form is looked for among the lines of what is left.
    pub fn looks_at_lines(&self) -> bool {
        self.entries.iter().any(|e| e.shapes.iter().any(|s| s.of_lines))
    }

    /// Every candidate: each effect at each of its places in each of its forms; `lines` are the frequencies, Hz, of lines in what is left.
    pub fn candidates(&self, physical: &Physical, lines: &[f64]) -> Vec<Candidate> {
        let Some(file) = self.file() else { return Vec::new() };
        let moves = units::moves(self.rig, self.whole);
        let mut out = Vec::new();
        for entry in &self.entries {
            for place in places::of(entry, file, &self.bound) {
                // What a record without a drive has no phase for.
                if self.rig.drive.is_none() && entry.names("tau") {
                    continue;
                }
                let Some(entry) = self.sized(entry, place, physical).map(|e| with_lines(e, lines)) else { continue };
                let all = entry.forms().into_iter().filter_map(|f| Candidate::new(self, &entry, place, f, physical));
                // What is neither a length nor an angle has no friction.
                out.extend(all.filter(|c| {
                    let rubs = || rubs(&c.plain(self, physical), &moves) || rubs(&memory::laws(self, c), &moves);
                    moves.iter().all(|m| *m) || !rubs()
                }));
            }
        }
        // What remembers is followed along the record, each form once.
        let good: Vec<bool> = out.par_iter().map(|c| memory::is_followed(self, c)).collect();
        let mut good = good.into_iter();
        out.retain(|_| good.next().unwrap_or(false));
        out
    }

    /// An entry with the grid of its shape parameter in the size of what is there: of the motion, or of the arm that it acts along; none where that is not known, and where a
    /// refinement is no other law than the simpler one, along an arm whose end rests.
    fn sized(&self, entry: &Arc<Entry>, place: Place, physical: &Physical) -> Option<Arc<Entry>> {
        let file = self.file()?;
        if let (Place::Arm(k), Verb::Drags) = (place, entry.verb) {
            if entry.refines.is_some() && !along_an_arm::end_moves(file, k) {
                return None;
            }
            let length = along_an_arm::length(file, k, &physical.values)?;
            let mut out = (**entry).clone();
            let grids = out.shapes.iter_mut().filter(|s| s.name == LENGTH).flat_map(|s| &mut s.grid);
            grids.for_each(|x| *x *= length);
            return Some(Arc::new(out));
        }
        Some(self.as_large_as_the_motion(entry, place, file))
    }

    /// An entry whose grid of a shape parameter holds the size of the motion: where it does not, as of a slow axis in metres, the grid is moved there.
    fn as_large_as_the_motion(&self, entry: &Arc<Entry>, place: Place, file: &SystemFile) -> Arc<Entry> {
        let (Place::Joint(k), [shape]) = (place, &entry.shapes[..]) else { return entry.clone() };
        if shape.within.is_none() || !self.shooting {
            return entry.clone();
        }
        let rate = shape.name.starts_with('v');
        // What a law of the velocity alone has beside it is no position: a power.
        if !rate && !entry.names("x") && entry.states.is_empty() {
            return entry.clone();
        }
        let size = self.size(&file.joints[k].moves.value, rate);
        let (low, high) = (shape.grid[0], shape.grid[shape.grid.len() - 1]);
        if !entry.states.is_empty() {
            // Distances of what remembers are far below the motion: those of the list are for a motion of about one. Times stay.
            let by = if shape.name.starts_with('T') || (0.1..10.0).contains(&size) { 1.0 } else { size };
            return if by > 0.0 && by.is_finite() { scaled(entry, by) } else { entry.clone() };
        }
        if !(size > 0.0 && size.is_finite()) || (2.0 * low..0.5 * high).contains(&size) {
            return entry.clone();
        }
        scaled(entry, size / (low * high).sqrt())
    }

    /// Rms of a joint's position (within a turn where it is an angle), or of its velocity by differences over five samples.
    fn size(&self, moves: &Polynomial, rate: bool) -> f64 {
        let node = moves.node();
        let turns = self.file().is_some_and(|f| places::is_angle(f, moves));
        let (mut sum, mut count) = (0.0, 0.0_f64);
        for s in &self.raw {
            let at = |i: usize| node.value(&|x| if let Symbol::Coordinate(k) = x { s.coordinates[k][i] } else { 0.0 });
            for i in (0..s.len().saturating_sub(5)).step_by(5) {
                let x = match (rate, turns) {
                    (true, _) => (at(i + 5) - at(i)) / (5.0 * s.step_s),
                    (false, true) => wrapped(at(i)),
                    (false, false) => at(i),
                };
                sum += x * x;
                count += 1.0;
            }
        }
        (sum / count.max(1.0)).sqrt()
    }

    /// Parameters of the system from coefficients of the equations without dampings.
    pub fn physical(&self, values: &DVector<f64>, covariance: &DMatrix<f64>) -> Option<Physical> {
        if self.is_written() {
            let values = self.own.coefficients(values.as_slice(), 0);
            return of_equations(self.model(), self.rig, &values);
        }
        let mechanism = self.mechanism()?;
        let names = self.model().coefficients();
        let identified = Identified { names: &names, values, covariance, metric: covariance };
        physical(mechanism, &identified, &self.known)
    }
}

/// The equations without nominal dampings; none where effects cannot be placed in them.
fn base(rig: &Rig, whole: &Bound) -> Option<ModelFile> {
    let model = &*whole.model;
    if model.equations.len() != model.coordinates.len() {
        return None;
    }
    if written::applies(model) {
        return Some(model.clone());
    }
    let file = model.mechanism.as_deref()?.file.clone()?;
    if file.written { None } else { file.model(Some(&[]), rig.omega()).ok() }
}

/// An entry with its first shape's values and bounds multiplied.
fn scaled(entry: &Arc<Entry>, by: f64) -> Arc<Entry> {
    let mut out = (**entry).clone();
    if let Some(shape) = out.shapes.first_mut() {
        shape.grid.iter_mut().for_each(|x| *x *= by);
        shape.within = shape.within.map(|w| w.map(|x| x * by));
    }
    Arc::new(out)
}

/// Whether a column holds the sign or size of the rate of something that does not move.
fn rubs(columns: &[Column], moves: &[bool]) -> bool {
    fn holds(n: &Node, still: &dyn Fn(Symbol) -> bool) -> bool {
        match &**n {
            Expression::Call(Function::Sign | Function::Abs, a) => a.any(still),
            Expression::Call(_, a) | Expression::PowerWhole(a, _) => holds(a, still),
            Expression::Add(a, b)
            | Expression::Subtract(a, b)
            | Expression::Multiply(a, b)
            | Expression::Divide(a, b)
            | Expression::Power(a, b) => holds(a, still) || holds(b, still),
            _ => false,
        }
    }
    let still = |s: Symbol| matches!(s, Symbol::Rate(k) if !moves[k]);
    columns.iter().flatten().any(|(_, of)| holds(of, &still))
}

/// What effects rest on in written equations.
fn of_equations(model: &ModelFile, rig: &Rig, values: &[f64]) -> Option<Physical> {
    let found = written::parameters(model, rig.direction(), rig.omega(), values)?;
    let open = vec![true; model.equations.len()];
    Some(Physical { values: found, open, written: values.to_vec(), openness: Openness::default() })
}

fn physical(mechanism: &Mechanism, b: &Identified<'_>, known: &BTreeMap<String, f64>) -> Option<Physical> {
    let known: BTreeMap<&str, f64> = known.iter().map(|(k, v)| (k.as_str(), *v)).collect();
    let fit = ties::fit(mechanism, b, &known)?;
    let own = mechanism.file.as_deref()?.parameters.len();
    let values = fit.parameters[..own].to_vec();
    Some(Physical { values, open: fit.open_scales, written: Vec::new(), openness: fit.openness })
}

/// An entry whose forms are those of some lines, where it takes them from there.
fn with_lines(entry: Arc<Entry>, lines: &[f64]) -> Arc<Entry> {
    if entry.shapes.iter().all(|s| !s.of_lines) {
        return entry;
    }
    let mut out = (*entry).clone();
    for s in out.shapes.iter_mut().filter(|s| s.of_lines) {
        let [low, high] = s.within.unwrap_or([0.0, f64::INFINITY]);
        s.grid = lines.iter().copied().filter(|f| (low..=high).contains(f)).collect();
    }
    Arc::new(out)
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

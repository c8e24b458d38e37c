//! What stays the same while effects are added: the record, its sensors, the system without its
//! dampings (written equations stand as they are).

mod open_parameter;
mod parameters;
mod sized;

use std::collections::BTreeMap;
use std::sync::Arc;

use rayon::prelude::*;

pub use self::parameters::{Own, Physical};
use self::parameters::{of_equations, of_identification};
pub use self::sized::{Lines, with_lines};
use super::candidates::{Candidate, Column};
use super::memory;
use super::shooting::{self, BLOCKS, MOST_SAMPLES, WHOLE, signs};
use super::units;
use crate::effects::columns::Span;
use crate::effects::entry::Entry;
use crate::effects::places::Place;
use crate::effects::{self, places, written};
use crate::error::Result;
use crate::identify::history::{History, Laws};
use crate::identify::prepared::{self, prepare_moving};
use crate::identify::remeasured::Sensors;
use crate::identify::stretches::Stretch;
use crate::identify::{self, Prepared};
use crate::identify::{Geometry, Identification, Settings as IdentifySettings};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::{Expression, Function, Node, Symbol, multiple};
use crate::record::Record;
use crate::rig::Rig;
use crate::rig::computed::share_a_column;
use crate::rig::measures::ObservedModel;
use crate::system::language::SystemFile;
use crate::system::mechanism::Mechanism;
use crate::warning::Warning;

/// Turn of the motion between two points, rad: forces are integrated to (0.4)⁴/720.
const MOST_TURN: f64 = 0.4;
/// Most points to a sample.
pub const MOST_POINTS: f64 = 16.0;

/// The record and the system.
pub struct Setting<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// The rig's system with its nominal dampings as coefficients.
    pub whole: &'a ObservedModel,
    /// The same system without dampings, which are effects here.
    pub bound: ObservedModel,
    /// Steady, unbroken stretches.
    pub raw: Vec<Stretch>,
    /// Record of each.
    pub record_of: Vec<usize>,
    /// Columns of the equations' own coefficients.
    pub own: Own,
    /// Whether candidates are judged by shooting; rows of the weak form stand in where the model
    /// follows no window of the record.
    pub shooting: bool,
    /// Windows of shooting that the record should give.
    pub blocks: f64,
    /// Fewest samples of a block where windows are cut into several.
    pub part: usize,
    /// Samples of a prediction, for which a block has room where there are enough.
    pub room: usize,
    /// Length of a window that was asked for, s: in its place no other is sought.
    pub window_s: Option<f64>,
    /// Signs that own coefficients keep; 0 for either.
    pub signs: Vec<f64>,
    /// Noise of the sensors.
    pub sensors: Sensors,
    /// Windows and low-passes.
    pub geometry: Geometry,
    /// Points to a sample at which forces are computed.
    pub points: usize,
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

impl<'a> Setting<'a> {
    /// For records of a rig whose system was derived from bodies; none where its equations need
    /// their dampings to be any, or their ties cannot be solved.
    ///
    /// # Errors
    /// As [`crate::identify::identify`].
    pub fn begin(
        records: &[Record],
        rig: &'a Rig,
        whole: &'a ObservedModel,
        most_windows: f64,
        settings: &IdentifySettings,
    ) -> Result<Option<Begun<'a>>> {
        let Some(base) = base(rig, whole) else { return Ok(None) };
        let first = identify::weak_form(records, rig, settings)?;
        let Prepared { stretches, record_of, sensors, geometry, warnings, .. } =
            prepare_moving(records, rig, whole, settings)?;
        let own = Own::new(&base, records.len());
        // More is not followed.
        let longest = MOST_SAMPLES as f64 / rig.sample_rate_hz;
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
            let (start_s, step_s) = (s.start_s, s.step_s);
            s.history =
                Some(Arc::new(History::new(&s.coordinates, start_s, step_s, &geometry.kernels, &circle, &laws)));
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
        let turn = if whole.inputs.is_empty() {
            raw.iter().filter_map(|s| Some(s.history.as_ref()?.turn_rad())).fold(0.0, f64::max)
        } else {
            // What is measured to act may be as fast as the low-pass lets through.
            core::f64::consts::TAU * geometry.kernels.full.pass_hz / rig.sample_rate_hz
        };
        let is_free = rig.drive.is_none() && whole.inputs.is_empty();
        let paths: Vec<usize> = raw.iter().map(|s| shooting::samples_of_path(s, &geometry.kernels)).collect();
        let is_short = is_free && shooting::is_short(&paths);
        let part = if is_short {
            let swing_s = prepared::swing_s(&raw, whole).unwrap_or(geometry.period_s);
            let half_swing = 0.5 * swing_s * rig.sample_rate_hz;
            shooting::fewest_of_part(2 * circle.len(), sensors.sigma.len(), half_swing)
        } else {
            shooting::LONG_PART
        };
        let mut setting = Self {
            rig,
            whole,
            bound: ObservedModel { model: Arc::new(base), ..whole.clone() },
            raw,
            record_of,
            own,
            shooting: true,
            blocks: if is_short && settings.window_s.is_none() { WHOLE } else { BLOCKS },
            part,
            room: 1,
            window_s: settings.window_s,
            signs: Vec::new(),
            sensors,
            geometry,
            points: (turn / MOST_TURN).ceil().clamp(1.0, MOST_POINTS) as usize,
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

    /// Whether written equations have a column already: each of its parts is a multiple of one of
    /// the equation's own terms.
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

    /// Whether a sensor comes of the same columns as the first.
    fn is_of_the_first(&self, sensor: usize) -> bool {
        let channel = |k: usize| &self.rig.channel[self.bound.sensors[k]];
        share_a_column(channel(0), channel(sensor))
    }

    /// Every candidate: each effect at each of its places in each of its forms; `lines` are the
    /// frequencies, Hz, of lines in what is left.
    pub fn candidates(&self, physical: &Physical, lines: &Lines) -> Vec<Candidate> {
        self.candidates_of(physical, lines, &|_| true)
    }

    /// Those of them that have some names, `ID@PLACE`: no other is followed along the record.
    pub fn candidates_of(&self, physical: &Physical, lines: &Lines, wanted: &dyn Fn(&str) -> bool) -> Vec<Candidate> {
        let Some(file) = self.file() else { return Vec::new() };
        let moves = units::moves(self.rig, self.whole);
        let mut out = Vec::new();
        for entry in &self.entries {
            for place in places::of(entry, file, &self.bound) {
                // What a record without a drive has no phase for.
                if self.rig.drive.is_none() && entry.names("tau") {
                    continue;
                }
                if matches!(place, Place::Between(i, j) if !units::alike(self.rig, self.whole, i, j)) {
                    continue;
                }
                // A delay is told against the first channel.
                if matches!(place, Place::Encoder(k) if entry.id == "channel-delay" && self.is_of_the_first(k)) {
                    continue;
                }
                if !wanted(&format!("{}@{}", entry.id, place.name(file))) {
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
}

/// The equations without nominal dampings; none where effects cannot be placed in them.
fn base(rig: &Rig, whole: &ObservedModel) -> Option<ModelFile> {
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

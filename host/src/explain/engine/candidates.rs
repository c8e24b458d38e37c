//! A candidate: an effect at a place in one form, and its columns.

use std::sync::Arc;

use super::memory;
use super::setting::{Physical, Setting};
use super::state::State;
use crate::effects::changes;
use crate::effects::columns::{self, Action};
use crate::effects::entry::{Entry, Form, Verb};
use crate::effects::places::{self, Place, SIZE};
use crate::effects::written;
use crate::model::model_file::by_parts::pieces_of_effect;
use crate::model::model_file::expression::{Expression, Node, Symbol, add, multiply, number, subtract, symbol};

/// Half the step, as a share of a shape parameter, over which a column's derivative by it is taken.
const SHAPE_STEP: f64 = 1e-3;
/// The same of a frequency, whose phase adds up over the record.
const LINE_STEP: f64 = 1e-7;

/// Share of its range by which a shape parameter of either sign moves in one step.
const ACROSS: f64 = 0.1;

/// Share of a shape parameter that is rounding.
const ROUNDING: f64 = 1e-9;

/// An effect at a place in one form.
#[derive(Clone)]
pub struct Candidate {
    /// The effect.
    pub entry: Arc<Entry>,
    /// Where.
    pub place: Place,
    /// Its shape parameters.
    pub form: Form,
    /// Whether these were moved between the grid's to what the model leaves.
    pub is_moved: bool,
    /// How it acts.
    action: Action,
    /// The same at a smaller and a greater value of each shape parameter that is refined, and half
    /// the step between them.
    beside: Vec<(f64, Box<[Action; 2]>)>,
}

/// Additions to the left-hand sides of one strength.
pub type Column = Vec<(usize, Node)>;

impl Candidate {
    /// None where the effect adds nothing there.
    pub fn new(
        setting: &Setting<'_>,
        entry: &Arc<Entry>,
        place: Place,
        form: Form,
        physical: &Physical,
    ) -> Option<Self> {
        let action = Self::action_of(setting, entry, place, &form, physical)?;
        // An input's rate would have to be known beside it.
        if let Action::Records { input, .. } = action
            && setting.model().equations.iter().any(|e| {
                let rate = |s: Symbol| s == Symbol::InputRate(input);
                e.balance.any(&rate) || e.terms.iter().any(|t| t.of.any(&rate))
            })
        {
            return None;
        }
        let candidate = Self { entry: entry.clone(), place, form, is_moved: false, action, beside: Vec::new() };
        if matches!(candidate.action, Action::Force(_) | Action::Changes(_)) {
            let all = candidate.plain(setting, physical);
            let holds =
                |of: &Node| setting.shooting || pieces_of_effect(of, setting.rig.omega(), &setting.circle).is_ok();
            // Nothing that the weak form cannot hold, nothing that is nothing.
            if all.iter().any(|c| c.is_empty() || !c.iter().all(|(_, of)| holds(of))) {
                return None;
            }
            if setting.is_written() && all.iter().any(|c| setting.holds(c)) {
                return None;
            }
        }
        Some(candidate)
    }

    /// Columns of an entry without shape parameters at a place, whatever the equations hold
    /// already.
    pub fn plain_columns(setting: &Setting<'_>, entry: &Arc<Entry>, place: Place, physical: &Physical) -> Vec<Column> {
        let action = Self::action_of(setting, entry, place, &Vec::new(), physical);
        action.map_or_else(Vec::new, |a| at_values(setting, &a, entry.strengths.len(), physical))
    }

    /// Its columns but those of a sensor or the phase, none of them refined, at values of what they
    /// rest on and of the equations' own coefficients.
    pub fn plain(&self, setting: &Setting<'_>, physical: &Physical) -> Vec<Column> {
        at_values(setting, &self.action, self.entry.strengths.len(), physical)
    }

    fn action_of(
        setting: &Setting<'_>,
        entry: &Entry,
        place: Place,
        form: &Form,
        physical: &Physical,
    ) -> Option<Action> {
        let mechanism = setting.mechanism()?;
        let (values, own) = setting.values_in(entry, place, form, physical)?;
        let (omega, span) = (setting.rig.omega(), setting.span);
        let action = columns::action(entry, form, place, mechanism, &values, omega, span).ok().flatten()?;
        match &action {
            Action::Force(parts) if own => Some(Action::Force(changes::at_values(parts, mechanism, &values))),
            Action::Force(parts) if !physical.fixes(parts, mechanism) => None,
            _ => memory::numbered(setting, action),
        }
    }

    /// Numbers of the states in its columns.
    pub fn remembered(&self) -> impl Iterator<Item = usize> {
        let sides = self.beside.iter().flat_map(|(_, sides)| sides.iter());
        std::iter::once(&self.action).chain(sides).flat_map(numbers)
    }

    /// The same in its own form alone.
    pub fn own_states(&self) -> impl Iterator<Item = usize> {
        numbers(&self.action)
    }

    /// `ID@PLACE`.
    pub fn name(&self, setting: &Setting<'_>) -> String {
        format!("{}@{}", self.entry.id, self.place_name(setting))
    }

    /// What stands behind the `@`.
    pub fn place_name(&self, setting: &Setting<'_>) -> String {
        setting.file().map_or_else(String::new, |f| self.place.name(f))
    }

    /// The shape parameters that are refined: those that have bounds, of what acts on the equations.
    pub fn refined_shapes(&self) -> Vec<usize> {
        if matches!(self.action, Action::Force(_) | Action::Changes(_)) {
            self.entry.bounded_shapes().collect()
        } else {
            Vec::new()
        }
    }

    /// How many of the strengths have columns by which shapes are refined: the first, or all of
    /// them where they are parts of one amplitude.
    pub fn leading(&self) -> usize {
        if self.entry.value.is_some() { self.entry.strengths.len() } else { 1 }
    }

    /// The Gauss–Newton steps of the refined shapes, from the strengths s_i and those of the
    /// columns s_i ∂/∂shape beside them: Σ s_i b_i / Σ s_i². Where a strength that keeps its sign
    /// is held at nothing beside them the shape is far off: without end in their direction.
    pub fn steps(&self, strengths: &[f64]) -> Vec<f64> {
        let (own, beside) = strengths.split_at(self.entry.strengths.len().min(strengths.len()));
        let leading = &own[..self.leading().min(own.len())];
        let square: f64 = leading.iter().map(|s| s * s).sum();
        let of = |b: &[f64]| leading.iter().zip(b).map(|(s, b)| s * b).sum::<f64>() / square;
        if square > 0.0 {
            return beside.chunks(leading.len()).map(of).collect();
        }
        let sign = self.entry.positive[0] && leading.len() == 1;
        if sign { beside.iter().map(|b| if *b == 0.0 { 0.0 } else { b * f64::INFINITY }).collect() } else { Vec::new() }
    }

    /// The same with further strengths, which multiply the first column's derivatives by the shape
    /// parameters that are refined.
    #[must_use]
    pub fn refined(mut self, setting: &Setting<'_>, physical: &Physical) -> Self {
        let sides = |k: usize| {
            let at = self.form[k].1;
            // What rings is refined like any shape: its phase begins anew with every push.
            let adds_up = self.entry.shapes[k].of_lines && self.entry.states.is_empty();
            let step = if adds_up { LINE_STEP } else { SHAPE_STEP } * at.abs();
            let side = |x: f64| {
                let mut form = self.form.clone();
                form[k].1 = x;
                Self::action_of(setting, &self.entry, self.place, &form, physical)
            };
            (step > 0.0).then_some((step, Box::new([side(at - step)?, side(at + step)?])))
        };
        let all: Option<Vec<_>> = self.refined_shapes().into_iter().map(sides).collect();
        self.beside = all.unwrap_or_default();
        self
    }

    /// Whether it has further strengths by which its shape is refined.
    pub fn is_refined(&self) -> bool {
        !self.beside.is_empty()
    }

    /// The candidate at refined shape parameters moved by steps, at most by half each (by a tenth of
    /// its range where it may have either sign) and within their bounds.
    #[must_use]
    pub fn moved(&self, setting: &Setting<'_>, steps: &[f64], physical: &Physical) -> Self {
        let shapes = self.refined_shapes();
        if shapes.is_empty() {
            return self.clone();
        }
        let mut form = self.form.clone();
        for (k, step) in shapes.into_iter().zip(steps) {
            let [low, high] = self.entry.shapes[k].within.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
            // What may have either sign crosses nothing on its way.
            let across = if low < 0.0 && high > 0.0 { ACROSS * (high - low) } else { 0.0 };
            let limit = (0.5 * form[k].1.abs()).max(across);
            form[k].1 = (form[k].1 + step.clamp(-limit, limit)).clamp(low, high);
        }
        let moved = Self::new(setting, &self.entry, self.place, form, physical)
            .map(|c| Self { is_moved: self.is_moved, ..c.refined(setting, physical) });
        // At the edge of what can be followed a shape has no derivative; columns that were counted
        // with one need it.
        let kept = moved.filter(|c| !self.is_refined() || c.strengths() == self.strengths());
        kept.unwrap_or_else(|| self.clone())
    }

    /// Whether its refined shape parameters moved, from another's, by less than steps.
    pub fn is_short_of(&self, from: &Self, steps: &[f64]) -> bool {
        self.refined_shapes().into_iter().zip(steps).any(|(k, step)| {
            let by = (self.form[k].1 - from.form[k].1).abs();
            by > 0.0 && step.abs() - by > ROUNDING * self.form[k].1.abs()
        })
    }

    /// The same as one whose form was moved to what is left.
    #[must_use]
    pub fn of_moved_form(self) -> Self {
        Self { is_moved: true, ..self }
    }

    /// The same where a strength may take away from another effect at its place.
    #[must_use]
    pub fn of_either_sign(self) -> Self {
        let mut entry = (*self.entry).clone();
        entry.positive.fill(false);
        Self { entry: Arc::new(entry), ..self }
    }

    /// The angle about which it is turned; none where it turns nothing.
    pub fn turned_by(&self) -> Option<f64> {
        (self.entry.verb == Verb::Turns).then(|| self.entry.about.first().copied().unwrap_or(0.0))
    }

    /// The same near its strengths, where they do not enter linearly.
    #[must_use]
    pub fn about(&self, setting: &Setting<'_>, strengths: &[f64], physical: &Physical) -> Self {
        let entry = Arc::new(self.entry.about_found(strengths));
        let Some(action) = Self::action_of(setting, &entry, self.place, &self.form, physical) else {
            return self.clone();
        };
        let near = Self { entry, action, ..self.clone() };
        if self.is_refined() { near.refined(setting, physical) } else { near }
    }

    /// The same in another form.
    pub fn at(&self, setting: &Setting<'_>, form: Form, physical: &Physical) -> Option<Self> {
        Self::new(setting, &self.entry, self.place, form, physical)
    }

    /// The drive's amplitude at some parameters of the system by that at others, where strengths
    /// are shares of it; none where they are not, or either is nothing.
    pub fn size_ratio(&self, setting: &Setting<'_>, over: &Physical, under: &Physical) -> Option<f64> {
        if setting.is_written() || !self.entry.names(SIZE) {
            return None;
        }
        let y = places::drive(setting.file()?)?.y;
        let ratio = places::size(&y, &over.values) / places::size(&y, &under.values);
        (ratio > 0.0 && ratio.is_finite()).then_some(ratio)
    }

    /// Number of strengths.
    pub fn strengths(&self) -> usize {
        self.entry.strengths.len() + self.leading() * self.beside.len()
    }

    /// Whether strengths are applied to the data and found as increments, since the columns hold to
    /// first order only.
    pub fn is_applied(&self) -> bool {
        !matches!(self.action, Action::Force(_) | Action::Changes(_))
    }

    /// What it adds to a sensor: which, and a law for each strength.
    pub fn reads(&self) -> Option<(usize, &[Node])> {
        match &self.action {
            Action::Reads { sensor, laws } => Some((*sensor, laws)),
            _ => None,
        }
    }

    /// What it adds to the record of an input: which, and a law for each strength.
    pub fn records(&self) -> Option<(usize, &[Node])> {
        match &self.action {
            Action::Records { input, laws } => Some((*input, laws)),
            _ => None,
        }
    }

    /// What it adds to the drive's phase: radians by time for each strength.
    pub fn advances(&self) -> Option<&[Node]> {
        match &self.action {
            Action::Advances(laws) => Some(laws),
            _ => None,
        }
    }

    /// Columns of its strengths at some parameters of a system from bodies; none where it is no
    /// force there.
    pub fn forces(&self, setting: &Setting<'_>, physical: &Physical) -> Vec<Column> {
        match &self.action {
            Action::Force(_) => at_values(setting, &self.action, self.entry.strengths.len(), physical),
            _ => Vec::new(),
        }
    }

    /// Columns of strengths on the left-hand sides at the state's parameters; empty ones for what
    /// acts on a sensor.
    pub fn columns(&self, setting: &Setting<'_>, state: &State) -> Vec<Column> {
        self.columns_at(setting, state, &state.physical)
    }

    /// The same at other parameters of the system.
    pub fn columns_at(&self, setting: &Setting<'_>, state: &State, physical: &Physical) -> Vec<Column> {
        let n = self.entry.strengths.len();
        let of = |action: &Action| match action {
            Action::Advances(laws) => laws.iter().map(|law| outside(setting, state, Symbol::Tau, law)).collect(),
            Action::Records { input, laws } => {
                laws.iter().map(|law| outside(setting, state, Symbol::Input(*input), &taken_off(law, *input))).collect()
            }
            other => at_values(setting, other, n, physical),
        };
        let mut out = of(&self.action);
        for (lead, (step, sides)) in self.beside.iter().flat_map(|b| (0..self.leading()).map(move |lead| (lead, b))) {
            let per = number(0.5 / step);
            let [low, high] = [of(&sides[0]), of(&sides[1])];
            out.push(
                high[lead]
                    .iter()
                    .zip(&low[lead])
                    .map(|((e, h), (_, l))| (*e, multiply(per.clone(), subtract(h.clone(), l.clone()))))
                    .collect(),
            );
        }
        out
    }
}

/// Numbers of the states of an action.
fn numbers(action: &Action) -> impl Iterator<Item = usize> {
    action.states().filter_map(|s| if let Expression::Symbol(Symbol::Memory(k)) = **s { Some(k) } else { None })
}

/// Columns of what acts on the left-hand sides; empty ones for what does not.
fn at_values(setting: &Setting<'_>, action: &Action, strengths: usize, physical: &Physical) -> Vec<Column> {
    let (model, rig) = (setting.model(), setting.rig);
    match (action, setting.mechanism()) {
        (Action::Force(parts), Some(mechanism)) => columns::columns(parts, strengths, mechanism, &physical.values),
        (Action::Changes(all), _) => written::columns(all, model, rig.direction(), rig.omega(), &physical.written),
        _ => vec![Vec::new(); strengths],
    }
}

/// What is taken off an input so that what an effect added to its record is gone.
fn taken_off(law: &Node, input: usize) -> Node {
    let of = law.replace(&|s| match s {
        Symbol::Coordinate(_) => symbol(Symbol::Input(input)),
        Symbol::Rate(_) => symbol(Symbol::InputRate(input)),
        other => symbol(other),
    });
    multiply(number(-1.0), of)
}

/// ∂(left-hand sides)/∂u of the model so far times what is added to u: the drive's phase or an
/// input.
fn outside(setting: &Setting<'_>, state: &State, u: Symbol, law: &Node) -> Column {
    let model = setting.model();
    let omega = setting.rig.omega();
    let places = model.term_places();
    let values = setting.own.coefficients(&state.values, 0);
    let mut out = Vec::new();
    for (e, equation) in model.equations.iter().enumerate() {
        let mut sum = number(0.0);
        for (term, &at) in equation.terms.iter().zip(&places[e]) {
            let value = values.get(at).copied().unwrap_or(0.0);
            if let Some(slope) = model.in_seconds(&term.of, omega).derivative(u) {
                sum = add(sum, multiply(number(value), slope));
            }
        }
        if let Some(slope) = model.in_seconds(&equation.balance, omega).derivative(u) {
            sum = subtract(sum, slope);
        }
        out.push((e, multiply(sum, law.clone())));
    }
    out
}

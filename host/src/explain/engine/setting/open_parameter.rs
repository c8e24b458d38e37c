//! Effects that rest on a parameter which neither the record nor `[known]` fixes, with that as a
//! shape: how a tilt acts beside an arm whose mass is open.

use std::borrow::Cow;
use std::sync::Arc;

use super::{Physical, Setting};
use crate::effects::changes;
use crate::effects::columns::{self, Action};
use crate::effects::entry::{Entry, Form, Verb};
use crate::effects::places::Place;
use crate::system::open_parameter;
use crate::system::polynomial::{Atom, Polynomial};
use crate::system::ties::TiesFit;

/// Values of the parameter that are tried.
const VALUES: usize = 6;
/// Powers of two up and down over which they reach where nothing bounds them (by hand).
const REACH: i32 = 8;
/// Halvings of the step to a bound.
const HALVINGS: usize = 6;

/// Whether an effect changes bodies or gravity, and so holds products of parameters.
fn is_change(entry: &Entry, place: Place) -> bool {
    entry.verb == Verb::Turns || (entry.verb == Verb::Moves && matches!(place, Place::Drive))
}

impl Setting<'_> {
    /// The parameters behind the equations' coefficients with one of them at a value.
    fn moved(&self, physical: &Physical, name: &str, value: f64) -> Option<TiesFit> {
        let names = self.model().coefficients();
        open_parameter::moved(self.mechanism()?, names, &physical.values, &self.known, (name, value))
    }

    /// Values of the parameters that an effect in a form rests on, and whether these are the form's:
    /// one of its shapes may be a parameter. None where no parameters have that value.
    pub fn values_in<'a>(
        &self,
        entry: &Entry,
        place: Place,
        form: &Form,
        physical: &'a Physical,
    ) -> Option<(Cow<'a, [f64]>, bool)> {
        let file = self.file()?;
        let own = form.iter().find(|s| file.parameters.iter().any(|p| p.name == s.0));
        let Some((name, value)) = own.filter(|_| is_change(entry, place) && !self.is_written()) else {
            return Some((Cow::Borrowed(&physical.values), false));
        };
        let mut found = self.moved(physical, name, *value)?.parameters;
        found.truncate(physical.values.len());
        Some((Cow::Owned(found), true))
    }

    /// An entry with the parameter that it rests on as a shape where that is open.
    pub(super) fn with_open(&self, entry: &Arc<Entry>, place: Place, physical: &Physical) -> Arc<Entry> {
        let found = is_change(entry, place) && !self.is_written();
        let with = found.then(|| self.open_in(entry, place, physical)).flatten();
        with.map_or_else(|| entry.clone(), |(name, grid, within)| Arc::new(entry.with_shape(&name, grid, Some(within))))
    }

    /// Name, values and bounds of a parameter that fixes how the terms of an effect go together.
    fn open_in(&self, entry: &Entry, place: Place, physical: &Physical) -> Option<(String, Vec<f64>, [f64; 2])> {
        let mechanism = self.mechanism()?;
        let form = entry.forms().into_iter().next()?;
        let (values, omega) = (&physical.values, self.rig.omega());
        let action = columns::action(entry, &form, place, mechanism, values, omega, self.span).ok().flatten()?;
        let Action::Force(parts) = action else { return None };
        let mut ratios = changes::ratios(&parts, mechanism);
        ratios.retain(|(n, d)| physical.openness.is_open(n, d));
        let takes_part = |k: usize| {
            let own = |p: &Polynomial| p.any(&|a| *a == Atom::Parameter(k));
            ratios.iter().any(|(n, d)| own(n) || own(d))
        };
        (0..values.len()).filter(|k| takes_part(*k) && values[*k] > 0.0).find_map(|k| {
            let name = &mechanism.parameters[k].name;
            let fit = self.moved(physical, name, values[k])?;
            if ratios.iter().any(|(n, d)| fit.openness.is_open(n, d)) {
                return None;
            }
            let [low, high] = [-1.0, 1.0].map(|sense| self.end(physical, name, values[k], sense));
            let value = |i: usize| low * (high / low).powf((i as f64 + 0.5) / VALUES as f64);
            (high > 1.01 * low).then(|| (name.clone(), (0..VALUES).map(value).collect(), [low, high]))
        })
    }

    /// How far a parameter can be moved while others have the same coefficients with it.
    fn end(&self, physical: &Physical, name: &str, from: f64, sense: f64) -> f64 {
        let (mut at, mut step) = (0.0, f64::from(REACH));
        for _ in 0..HALVINGS {
            let value = from * (sense * (at + step)).exp2();
            if self.moved(physical, name, value).is_some() {
                at += step;
                if at >= f64::from(REACH) {
                    break;
                }
            }
            step *= 0.5;
        }
        from * (sense * at).exp2()
    }
}

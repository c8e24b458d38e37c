//! Effects that may only stand in for what has no name.
//!
//! Where something stays that no name accounts for, an effect whose own part is the smaller of the
//! two is no finding: what stays is no noise, and a law that is a little like it takes a strength
//! from it that no standard error covers. A name stands in such an answer only where it takes away
//! more than what stays, of the power in the windows of shooting and, where predictions miss
//! clearly, of the square of what they miss by.

use super::evidence::{Outcome, refit};
use super::offered;
use super::run::Run;
use crate::error::Result;
use crate::explain::decidability::EXPLAINED_GAP;
use crate::explain::explanation::{Explanation, Found, Refused};

/// Why such an effect is not named.
const WHY: &str = "it takes away less than what stays without a name, for which it may only stand in";

/// Numbers of the effects that take away less than what stays beside them; `by_chance`: power of
/// what is left where nothing is missing, in units of the noise's.
pub(super) fn stand_ins(result: &Explanation, by_chance: f64) -> Vec<usize> {
    let steps = &result.gap.steps;
    let missed = steps.last().map(|s| s.value).filter(|gap| *gap > EXPLAINED_GAP);
    let by_gap = |f: &Found| {
        let at = steps.iter().position(|s| s.added.as_deref() == Some(&f.name()))?;
        let [before, after] = [steps.get(at.checked_sub(1)?)?.value, steps[at].value].map(|g| g * g);
        Some(before - after < missed?.powi(2) - 1.0)
    };
    let power = result.residual_power[1];
    // From the last one back: of what was left before it, an effect took the share of its gain.
    let mut after = power;
    let mut out = Vec::new();
    for (k, f) in result.effects.iter().enumerate().rev() {
        let before = after / (1.0 - f.held_out_gain).max(f64::EPSILON);
        if before - after < power - by_chance || by_gap(f) == Some(true) {
            out.push(k);
        }
        after = before;
    }
    out
}

impl Run<'_> {
    /// Takes effects out again that may stand in for what has no name; none where nothing is taken
    /// out, or the model without them cannot be fitted.
    ///
    /// # Errors
    /// As [`Run::push`].
    pub fn without_stand_ins(&mut self, gone: &[usize]) -> Result<Option<Outcome>> {
        if gone.is_empty() {
            return Ok(None);
        }
        let mut names = Vec::new();
        // From the last one on, as they are numbered.
        for &k in gone {
            names.push(self.told.result.effects.remove(k).name());
            let _ = self.told.state.chosen.remove(self.told.state.nominal + k);
        }
        self.told.state.stretches = self.told.state.taken_off(&self.setting, &self.setting.raw);
        let candidates = offered::candidates(&self.setting, &self.told.state);
        let Ok(outcome) = refit(&self.setting, &mut self.told.state, candidates) else { return Ok(None) };
        for name in &names {
            self.told.result.forget(name);
        }
        self.told.result.refuse(names.iter().map(|name| Refused::new(name, WHY.to_owned())));
        self.tell_last(&outcome)?;
        if self.told.result.effects.is_empty() {
            self.told.result.residual_power[0] = self.told.result.residual_power[1];
        }
        Ok(Some(outcome))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::gap::Step;

    fn answer(effects: &[(&str, f64, f64)], first: f64, power: f64) -> Explanation {
        let mut result = Explanation::new(0.2, Vec::new());
        result.gap.steps.push(Step { added: None, value: first });
        for (id, gain, gap) in effects {
            let found = Found { held_out_gain: *gain, ..Found::empty(id, "x", "N".to_owned()) };
            result.gap.steps.push(Step { added: Some(found.name()), value: *gap });
            result.effects.push(found);
        }
        result.residual_power = [power; 2];
        result
    }

    /// A large effect stays, small ones beside what has no name do not; where hardly anything is
    /// left small ones stay as well.
    #[test]
    fn a_name_takes_away_more_than_what_stays() {
        let bump = [("coulomb-friction", 0.82, 8.5), ("quadratic-drag", 0.084, 8.3), ("cubic", 0.15, 8.0)];
        assert_eq!(stand_ins(&answer(&bump, 15.6, 1481.0), 1.0), [2, 1]);
        // By its power the first would stay, predictions come hardly nearer with it.
        assert_eq!(stand_ins(&answer(&[("play", 0.6, 69.2)], 75.4, 13_000.0), 1.0), [0]);
        let tilt = [("frame-tilt", 0.645, 1.007), ("input-gain", 0.049, 1.006)];
        assert_eq!(stand_ins(&answer(&tilt, 1.212, 1.107), 1.0), [1]);
        assert!(stand_ins(&answer(&tilt, 1.212, 1.02), 1.0).is_empty());
        // Counts that stand leave as much in the model's own records.
        assert!(stand_ins(&answer(&tilt, 1.212, 1.107), 1.08).is_empty());
    }
}

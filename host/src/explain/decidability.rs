//! Whether a record can decide at all, and the verdict.

use super::engine::unknown::{self, Unknown};
use super::explanation::{AtHorizon, DecidedBy, Explanation, Verdict};
use super::reason::{Criterion, OwnRecords, Patch, Reason, Residual, Undecidable};
use crate::inspect::InspectSettings;
use crate::inspect::motion;
use crate::inspect::periodicity::{Kind, Periodicity, periodicity};
use crate::record::{Record, Segment};
use crate::rig::Rig;
use crate::warning::Warning;

/// Gap (in noise floors) up to which a model counts as explaining the record (by hand).
pub(super) const EXPLAINED_GAP: f64 = 1.3;
/// Ratio of residual to noise power in the rows of the weak form up to which nothing counts as left
/// (by hand).
const EXPLAINED_POWER: f64 = 2.0;
/// Standard errors by which the same of trajectories may exceed that of records which the model
/// itself makes: 3e-5 by chance.
const CLEAR: f64 = 4.0;
/// Ratio to theirs up to which it is nothing in any case: a sensor's noise is not known to 2 %.
const ALIKE: f64 = 1.05;
/// Amplitude of what is left, in units of the noise's, beyond which records that the model itself
/// makes excuse nothing: an effect as large as the noise would be taken for nothing then (by hand).
pub(super) const EXCUSED: f64 = 2.0;
/// Horizons of the gap that count for the verdict, in units of the shortest: chaos makes longer
/// ones show weaker effects (by hand).
const VERDICT_HORIZONS: f64 = 4.5;
/// Fewest whole windows for a decision: fewer leave the jackknife and the folds too little (by
/// hand).
pub(super) const FEWEST_BLOCKS: usize = 9;

/// What to do about the noise of an input beside which an effect stands.
const INPUT_NOISE: &str = "What was found stands far above that";

/// Share of a record that must repeat for its motion to count as locked (by hand).
const LOCKED_SHARE: f64 = 0.5;
/// Condition number of an equation's columns from which its coefficients are hardly separable (by
/// hand).
pub(super) const WORST_CONDITION: f64 = 100.0;

/// What records have of a motion, s: their length, and what is left of it without the low-pass's
/// reach at the ends, gaps and standstills.
#[derive(Clone, Copy, Debug)]
pub(super) struct Length {
    pub whole_s: f64,
    pub used_s: f64,
}

impl Length {
    pub(super) fn of(records: &[Record], used_s: f64) -> Self {
        let whole = |r: &Record| {
            let (first, last) = (r.segments.first()?, r.segments.last()?);
            Some(last.start_s + last.len() as f64 * last.step_s - first.start_s)
        };
        Self { whole_s: records.iter().filter_map(whole).sum::<f64>().max(used_s), used_s }
    }

    /// That of records with so many windows more, which lose as much of it.
    fn with(self, windows: usize, window_s: f64) -> f64 {
        let lost = if self.used_s > 0.0 { self.whole_s / self.used_s } else { 1.0 };
        self.whole_s + windows as f64 * window_s * lost
    }
}

/// A record of so many whole windows is too short; of no length where its motion is over.
pub(super) fn too_few(windows: usize, window_s: f64, of_forces: bool, length: Option<Length>) -> Undecidable {
    // One beyond the fewest: what is left over at the end is none.
    let least_s = length.map(|l| l.with((FEWEST_BLOCKS + 1).saturating_sub(windows), window_s));
    Undecidable::FewWindows { of_forces, windows, window_s, least_s }
}

/// What is told of equations in which no effect has a place.
pub(super) fn unplaced() -> Explanation {
    let mut result = Explanation::new(0.0, Vec::new());
    result.reason = Reason::Undecidable(Undecidable::Unplaced);
    result
}

/// How the longest stretch of a driven record repeats, and that stretch. It is the motion that is
/// looked at, not the residuals: those of a wrong model repeat wherever the motion comes back near
/// an earlier state.
fn repeats<'a>(record: &'a Record, rig: &Rig) -> Option<(Periodicity, &'a Segment)> {
    let drive = rig.drive?;
    let motions = motion::motions(record);
    let (index, segment) = record.segments.iter().enumerate().max_by_key(|(_, s)| s.len())?;
    let rate = record.sample_rate_hz;
    let tolerance = InspectSettings::default().period_tolerance;
    Some((periodicity(&motions, index, Some(rate / drive.frequency_hz), rate, tolerance), segment))
}

/// Whether most of a record repeats.
pub(super) fn locked(record: &Record, rig: &Rig) -> bool {
    let Some((found, segment)) = repeats(record, rig) else { return false };
    match found.kind {
        Kind::AtRest | Kind::Periodic => true,
        Kind::LocksLater => {
            let length = segment.len() as f64 / record.sample_rate_hz;
            found.locked_after_s.is_some_and(|after| after < (1.0 - LOCKED_SHARE) * length)
        }
        Kind::ChaoticOrTransient | Kind::Free => false,
    }
}

/// Time, s, from which a record repeats that had not before; none for any other.
pub(super) fn freely_until_s(record: &Record, rig: &Rig) -> Option<f64> {
    let (found, segment) = repeats(record, rig)?;
    let after_s = found.locked_after_s.filter(|_| found.kind == Kind::LocksLater)?;
    Some(segment.start_s + after_s)
}

/// Power up to which nothing counts as left beside records of the model's own with that mean power,
/// from which one differs by that standard error.
fn most_power(mean: f64, error: f64) -> f64 {
    (mean + CLEAR * error).max(ALIKE * mean)
}

/// The gap over a horizon of records that the model itself makes.
#[derive(Clone, Copy, Debug)]
pub(super) struct OwnGap {
    /// The horizon, s.
    pub horizon_s: f64,
    /// Its mean.
    pub mean: f64,
    /// What one more such record has at most, with a probability of 99.9 %; 0 where they do not
    /// scatter by more than the sensors' noise.
    pub most: f64,
}

/// What is left of the last model, beside its power and the gap.
#[derive(Default)]
pub(super) struct Left {
    /// Several effects that stand for one shape.
    pub patched: Option<Patch>,
    /// A shape without a name that predicts clearly better, and its gain in standard errors.
    pub shape: Option<(Unknown, f64)>,
    /// Power in records that the model itself makes, and the standard error of the difference; none
    /// for the weak form.
    pub remade: Option<(f64, f64)>,
    /// Windows that are not followed even there, whose power does not count.
    pub left_out: usize,
    /// Gaps in such records, where they were measured.
    pub gaps: Vec<OwnGap>,
    /// Measured inputs that are noisy, which such records have as well.
    pub noisy: Vec<String>,
    /// What one simulation of the whole record leaves, in units of the noise's power, and its
    /// values.
    pub whole: Option<(f64, usize)>,
}

impl Left {
    /// Power up to which nothing counts as left.
    pub(super) fn most_power(&self) -> f64 {
        self.remade.map_or(EXPLAINED_POWER, |(mean, error)| most_power(mean, error))
    }

    /// The same of one simulation of so many values: windows of the model's own records leave as
    /// much above the noise as it does (counts that stand), and their scatter is that of the noise.
    fn most_of_whole(&self, values: usize) -> f64 {
        let (mean, error) = self.remade.unwrap_or((1.0, 0.0));
        most_power(mean, error.max(mean * (2.0 / values.max(1) as f64).sqrt()))
    }

    /// Gap over a horizon up to which nothing counts as left: in units of what the model's own
    /// records leave, where that is more than the noise, and no less than any one of them may have.
    fn most_gap(&self, horizon_s: f64) -> f64 {
        let own = self.gaps.iter().find(|g| g.horizon_s == horizon_s).filter(|g| g.mean.is_finite());
        let (mean, most) = own.map_or((1.0, 0.0), |g| (g.mean.max(1.0), g.most));
        (EXPLAINED_GAP * mean).max(most)
    }

    /// What a power is held against, where that is told.
    fn beside(&self, power: f64) -> Option<OwnRecords> {
        let (most, left_out) = (self.most_power(), self.left_out);
        let (mean, _) = self.remade.filter(|_| power > most || left_out > 0)?;
        Some(OwnRecords { mean, most, left_out })
    }

    /// Why what lies within limits from the model's own records decides nothing: it is far more
    /// than noise, and these records leave as much.
    fn unfollowed(&self, power: f64, horizon_s: f64, gap: f64) -> Option<Undecidable> {
        let (criterion, value) = if power > EXCUSED * EXCUSED {
            (Criterion::Power, power)
        } else if gap > EXCUSED * EXPLAINED_GAP {
            (Criterion::Gap { horizon_s }, gap)
        } else {
            return None;
        };
        Some(Undecidable::OwnRecords { criterion, value, inputs: self.noisy.clone() })
    }
}

/// The verdict and its reason from everything that was measured.
pub(super) fn decide(result: &mut Explanation, undecidable: Option<Undecidable>, rest: Left) {
    let power = result.residual_power[1];
    let horizon_s = result.gap.horizon_s;
    let over_limit = |h: &AtHorizon| h.after / rest.most_gap(h.horizon_s);
    let far = result
        .gap
        .horizons
        .iter()
        .filter(|h| h.horizon_s <= VERDICT_HORIZONS * horizon_s && h.after > rest.most_gap(h.horizon_s))
        .max_by(|a, b| over_limit(a).total_cmp(&over_limit(b)))
        .copied();
    let diverged = result.settle();
    let gap = result.gap.steps.last().map_or(f64::NAN, |s| s.value);
    // Every comparison fails for what is not a number: it is left over then.
    let within = gap <= rest.most_gap(horizon_s) && far.is_none() && power <= rest.most_power();
    let whole = rest.whole.map(|(left, values)| (left, rest.most_of_whole(values))).filter(|(left, most)| left > most);
    let left = !within || whole.is_some();
    let undecidable = undecidable.or_else(|| diverged.then_some(Undecidable::Diverged));
    let unfollowed = if within && undecidable.is_none() { rest.unfollowed(power, horizon_s, gap) } else { None };
    // What stands as far above the noise of an input as that above the sensors' is told.
    let stands = !result.effects.is_empty() && result.residual_power[0] > EXCUSED * EXCUSED * power;
    let undecidable = match unfollowed {
        Some(why) if stands && !rest.noisy.is_empty() => {
            result.warnings.push(Warning::new("input-noise", why.to_string(), INPUT_NOISE));
            undecidable
        }
        other => undecidable.or(other),
    };
    if undecidable.is_none() {
        result.decided_by = decided_by(result, gap, (power, &rest));
    }
    let residual = Residual {
        power,
        own: rest.beside(power),
        horizon_s,
        gap: result.gap.miss(gap),
        // Where longer predictions decided, their number is told.
        longer: far.map(|h| (h.horizon_s, result.gap.miss(h.after))),
        whole: whole.filter(|_| within),
    };
    let by = |what: Criterion, value: f64, limit: f64| Some(DecidedBy { what, value, limit });
    let (shape, gain) = rest.shape.unzip();
    if undecidable.is_none() && !left {
        if let Some(gain) = gain {
            result.decided_by = by(Criterion::Shape, gain, unknown::CLEAR);
        } else if let (Some(patch), false) = (&rest.patched, result.effects.is_empty()) {
            result.decided_by = by(Criterion::Pieces, patch.effects.len() as f64, 1.0);
        }
    }
    (result.verdict, result.reason) = match (undecidable, left, result.effects.is_empty()) {
        (Some(why), ..) => {
            result.effects.clear();
            (Verdict::NotDecidable, Reason::Undecidable(why))
        }
        (None, true, _) => (Verdict::Unexplained, Reason::Excess { residual, shape, changed: None }),
        (None, false, _) if let Some(shape) = shape => (Verdict::Unexplained, Reason::Shape { residual, shape }),
        (None, false, true) => (Verdict::NothingMissing, Reason::Noise(residual)),
        (None, false, false) if let Some(patch) = rest.patched => {
            (Verdict::Unexplained, Reason::Patched { residual, patch })
        }
        (None, false, false) => (Verdict::Explained, Reason::Noise(residual)),
    };
    // Beside something that is left nothing is known of what would have been named.
    if !matches!(result.verdict, Verdict::Explained | Verdict::NothingMissing) {
        result.detection_limits.clear();
    }
}

/// The number that is largest beside its limit.
fn decided_by(result: &Explanation, gap: f64, (power, rest): (f64, &Left)) -> Option<DecidedBy> {
    let over = |horizon_s: f64, value: f64| DecidedBy {
        what: Criterion::Gap { horizon_s },
        value,
        limit: rest.most_gap(horizon_s),
    };
    let horizon_s = result.gap.horizon_s;
    let longer = result.gap.horizons.iter().filter(|h| h.horizon_s <= VERDICT_HORIZONS * horizon_s);
    let all = longer.map(|h| over(h.horizon_s, h.after));
    let power = DecidedBy { what: Criterion::Power, value: power, limit: rest.most_power() };
    let all = all.chain([over(horizon_s, gap), power]);
    let all = all.chain(rest.whole.map(|(value, values)| DecidedBy {
        what: Criterion::PowerOfWhole,
        value,
        limit: rest.most_of_whole(values),
    }));
    all.filter(|d| d.value.is_finite()).max_by(|a, b| (a.value / a.limit).total_cmp(&(b.value / b.limit)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::explanation::Found;
    use crate::explain::gap::Step;

    /// The verdict on a model without effects that leaves so much power and gap.
    fn verdict(power: f64, gap: f64, rest: Left) -> (Verdict, String) {
        let mut result = Explanation::new(0.2, Vec::new());
        result.residual_power = [power; 2];
        result.gap.steps.push(Step { added: None, value: gap });
        decide(&mut result, None, rest);
        (result.verdict, result.reason.to_string())
    }

    /// Whatever was found on the way to it, and whatever the residual says.
    #[test]
    fn a_fit_that_diverged_decides_nothing_and_tells_no_number() {
        for gap in [f64::NAN, f64::INFINITY, 1e46] {
            for power in [f64::NAN, 1.0, 1e9] {
                let mut result = Explanation::new(0.2, Vec::new());
                result.residual_power = [power; 2];
                result.gap.motion = Some(1000.0);
                result.gap.steps = vec![
                    Step { added: None, value: 5.0 },
                    Step { added: Some("quadratic-drag@arm2".to_owned()), value: gap },
                ];
                result.effects.push(Found::empty("quadratic-drag", "arm2", "N m s²".to_owned()));
                decide(&mut result, None, Left::default());
                // No smaller gap than none at all is told either.
                assert_eq!(
                    (result.verdict, &result.reason),
                    (Verdict::NotDecidable, &Reason::Undecidable(Undecidable::Diverged)),
                    "{gap} {power}"
                );
                assert!(result.effects.is_empty() && result.decided_by.is_none(), "{result:?}");
                let told = serde_json::to_string(&result.gap).unwrap();
                assert!(result.gap.steps.iter().all(|s| s.value == 5.0), "{told}");
            }
        }
    }

    #[test]
    fn a_record_that_is_too_short_is_asked_for_more_than_it_has() {
        let least = |windows: usize, whole_s: f64, used_s: f64| match too_few(
            windows,
            1.07,
            false,
            Some(Length { whole_s, used_s }),
        ) {
            Undecidable::FewWindows { least_s: Some(least_s), .. } => least_s,
            other => panic!("{other:?}"),
        };
        // Seven windows in 12 s: the ends take 4 s.
        assert!((least(7, 12.0, 8.0) - (12.0 + 3.0 * 1.07 * 1.5)).abs() < 1e-9);
        assert!((least(0, 1.0, 0.0) - 11.7).abs() < 1e-9);
        assert!((0..FEWEST_BLOCKS).all(|n| least(n, 12.0, 12.0) > 12.0 + 1.07));
    }

    /// Each window has an initial state of its own; the whole record has one.
    #[test]
    fn what_one_simulation_of_the_whole_record_leaves_counts() {
        let whole = |left: f64| Left { remade: Some((1.0, 0.02)), whole: Some((left, 2000)), ..Left::default() };
        assert_eq!(verdict(1.0, 1.0, whole(1.1)).0, Verdict::NothingMissing);
        let (found, why) = verdict(1.0, 1.0, whole(1.5));
        assert!(
            found == Verdict::Unexplained && why.contains("leaves 1.50 times the noise's power (up to 1.1"),
            "{why}"
        );
    }

    #[test]
    fn records_of_the_models_own_excuse_a_little_and_not_everything() {
        let own = |mean: f64, gap: f64| Left {
            remade: Some((mean, 0.02)),
            gaps: vec![OwnGap { horizon_s: 0.2, mean: gap, most: 0.0 }],
            ..Left::default()
        };
        assert_eq!(verdict(1.04, 1.1, own(1.0, 1.0)).0, Verdict::NothingMissing);
        assert_eq!(verdict(1.2, 1.1, own(1.0, 1.0)).0, Verdict::Unexplained);
        // Counts that stand.
        assert_eq!(verdict(1.5, 1.8, own(1.48, 1.7)).0, Verdict::NothingMissing);
        for (power, gap) in [(6000.0, 1.0), (1.0, 60.0)] {
            let (verdict, why) = verdict(power, gap, own(power, gap));
            assert_eq!(verdict, Verdict::NotDecidable);
            assert!(why.contains("records that the model itself makes are no better"), "{why}");
        }
        // Noise of an input is named.
        let (found, why) = verdict(11.0, 1.0, Left { noisy: vec!["current".to_owned()], ..own(11.0, 1.0) });
        assert!(found == Verdict::NotDecidable && why.contains("Measure current with less noise"), "{why}");
        // An effect that stands as far above it is told all the same.
        for (before, expected) in [(30.0, Verdict::NotDecidable), (5000.0, Verdict::Explained)] {
            let mut result = Explanation::new(0.2, Vec::new());
            result.residual_power = [before, 11.0];
            let steps = [(None, 20.0), (Some("cubic-stiffness@x".to_owned()), 1.0)];
            result.gap.steps.extend(steps.map(|(added, value)| Step { added, value }));
            result.effects.push(Found::empty("cubic-stiffness", "x", "N/m³".to_owned()));
            decide(&mut result, None, Left { noisy: vec!["current".to_owned()], ..own(11.0, 1.0) });
            assert_eq!(result.verdict, expected);
            let told = result.warnings.iter().any(|w| w.id == "input-noise" && w.text.contains("current"));
            assert_eq!(told, expected == Verdict::Explained);
        }
        let (_, why) = verdict(2.0, 1.0, Left { left_out: 2, ..own(1.0, 1.0) });
        assert!(why.contains("up to 1.08 would be chance; 2 windows that cannot be followed"), "{why}");
    }
}

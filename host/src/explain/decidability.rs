//! Whether a record can decide at all, and the verdict.

use super::explanation::{DecidedBy, Explanation, Verdict};
use crate::inspect::InspectSettings;
use crate::inspect::motion;
use crate::inspect::periodicity::{Kind, periodicity};
use crate::record::Record;
use crate::report::format::{rounded, shortest, significant};
use crate::rig::Rig;

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

/// Share of a record that must repeat for its motion to count as locked (by hand).
const LOCKED_SHARE: f64 = 0.5;
/// Condition number of an equation's columns from which its coefficients are hardly separable (by
/// hand).
pub(super) const WORST_CONDITION: f64 = 100.0;

/// Why a locked record cannot.
pub(super) const LOCKED: &str = "the motion repeats (locked to the drive): one orbit cannot tell effects apart. Change the drive until the motion is chaotic";

/// Why a fit that diverged cannot.
pub(super) const DIVERGED: &str = "the fit diverged: the model's predictions miss by more than the record itself moves, so that nothing follows from them. See `whirl inspect` for the channels, and check units and signs in the rig file";

/// Why a record whose motion is poor cannot.
pub(super) const POOR: &str =
    "the motion does not visit enough of the state space: the nominal coefficients themselves are hardly separable";

/// Why what cannot be followed cannot.
pub(super) const UNFOLLOWED: &str = "the model follows no part of the record, so that nothing can be predicted: see `whirl inspect` for the channels, and check units and signs in the rig file";

/// Why a record of so many whole windows cannot.
pub(super) fn too_few(blocks: usize, window_s: f64) -> String {
    let wanted = shortest(rounded(window_s * (FEWEST_BLOCKS + 1) as f64, 3));
    let window_s = shortest(rounded(window_s, 3));
    let few = if blocks == 1 { "window is" } else { "windows are" };
    format!("{blocks} whole {few} too few to hold some back ({window_s} s each): record at least {wanted} s")
}

/// What is told of equations in which no effect has a place.
pub(super) fn unplaced() -> Explanation {
    let mut result = Explanation::new(0.0, Vec::new());
    result.reason =
        "nothing can be predicted: that takes one equation for each coordinate, and an inertia in each".to_owned();
    result
}

/// Whether most of a record repeats. It is the motion that is looked at, not the residuals: those
/// of a wrong model repeat wherever the motion comes back near an earlier state.
pub(super) fn locked(record: &Record, rig: &Rig) -> bool {
    let Some(drive) = rig.drive else { return false };
    let motions = motion::motions(record);
    let longest = record.segments.iter().enumerate().max_by_key(|(_, s)| s.len());
    let Some((index, segment)) = longest else { return false };
    let rate = record.sample_rate_hz;
    let tolerance = InspectSettings::default().period_tolerance;
    let found = periodicity(&motions, index, Some(rate / drive.frequency_hz), rate, tolerance);
    match found.kind {
        Kind::AtRest | Kind::Periodic => true,
        Kind::LocksLater => {
            let length = segment.len() as f64 / rate;
            found.locked_after_s.is_some_and(|after| after < (1.0 - LOCKED_SHARE) * length)
        }
        Kind::ChaoticOrTransient | Kind::Free => false,
    }
}

/// Power up to which nothing counts as left beside records of the model's own with that mean power,
/// from which one differs by that standard error.
fn most_power(mean: f64, error: f64) -> f64 {
    (mean + CLEAR * error).max(ALIKE * mean)
}

/// What is left of the last model, beside its power and the gap.
#[derive(Default)]
pub(super) struct Left {
    /// A joint at which several effects stand for one shape, and their names.
    pub patched: Option<(String, String)>,
    /// A shape without a name that predicts clearly better, in words.
    pub shape: Option<String>,
    /// Power in records that the model itself makes, and the standard error of the difference; none
    /// for the weak form.
    pub remade: Option<(f64, f64)>,
    /// Windows that are not followed even there, whose power does not count.
    pub left_out: usize,
    /// Gaps in such records: horizon in s and mean, where they were measured.
    pub gaps: Vec<(f64, f64)>,
    /// Measured inputs that are noisy, which such records have as well.
    pub noisy: Vec<String>,
    /// What one simulation of the whole record leaves, in units of the noise's power, and its
    /// values.
    pub whole: Option<(f64, usize)>,
}

impl Left {
    /// Power up to which nothing counts as left.
    fn most_power(&self) -> f64 {
        self.remade.map_or(EXPLAINED_POWER, |(mean, error)| most_power(mean, error))
    }

    /// The same of one simulation of so many values: windows of the model's own records leave as
    /// much above the noise as it does (counts that stand), and their scatter is that of the noise.
    fn most_of_whole(&self, values: usize) -> f64 {
        let (mean, error) = self.remade.unwrap_or((1.0, 0.0));
        most_power(mean, error.max(mean * (2.0 / values.max(1) as f64).sqrt()))
    }

    /// Gap over a horizon up to which nothing counts as left: in units of what the model's own
    /// records leave, where that is more than the noise.
    fn most_gap(&self, horizon_s: f64) -> f64 {
        let own = self.gaps.iter().find(|g| g.0 == horizon_s).map_or(1.0, |g| g.1.max(1.0));
        EXPLAINED_GAP * if own.is_finite() { own } else { 1.0 }
    }

    /// What a power is held against, in words, where that is told.
    fn beside(&self, power: f64) -> String {
        let most = self.most_power();
        let Some((mean, _)) = self.remade.filter(|_| power > most || self.left_out > 0) else { return String::new() };
        let left_out = match self.left_out {
            0 => String::new(),
            1 => "; one window that cannot be followed even there is left out".to_owned(),
            n => format!("; {n} windows that cannot be followed even there are left out"),
        };
        format!(
            " (in records that the model itself makes it is {mean:.2}, and up to {most:.2} would be chance{left_out})"
        )
    }

    /// Why what lies within limits from the model's own records decides nothing: it is far more
    /// than noise, and these records leave as much.
    fn unfollowed(&self, power: f64, gap: f64) -> Option<String> {
        let why = |what: String| {
            if !self.noisy.is_empty() {
                let inputs = self.noisy.join(" and ");
                return format!(
                    "{what}, and the noise of the measured {inputs} leaves about as much in records that the model itself makes: what is fainter cannot be told. Measure {inputs} with less noise"
                );
            }
            format!(
                "{what}, and records that the model itself makes are no better: what is missing cannot be told from what the fit does not follow. Sample faster, or hold the model against a second record (`whirl validate`)"
            )
        };
        if power > EXCUSED * EXCUSED {
            return Some(why(format!(
                "what is left has {} times the power of the sensors' noise",
                significant(power, 3)
            )));
        }
        (gap > EXCUSED * EXPLAINED_GAP)
            .then(|| why(format!("predictions miss by {} noise floors", significant(gap, 3))))
    }
}

/// The verdict and its reason from everything that was measured.
pub(super) fn decide(result: &mut Explanation, undecidable: Option<String>, rest: Left) {
    let power = result.residual_power[1];
    let most_power = rest.most_power();
    let horizon_s = result.gap.horizon_s;
    let far = result
        .gap
        .horizons
        .iter()
        .filter(|h| h.0 <= VERDICT_HORIZONS * horizon_s && h.2 > rest.most_gap(h.0))
        .max_by(|a, b| (a.2 / rest.most_gap(a.0)).total_cmp(&(b.2 / rest.most_gap(b.0))))
        .copied();
    let diverged = result.settle();
    let gap = result.gap.steps.last().map_or(f64::NAN, |s| s.value);
    // Every comparison fails for what is not a number: it is left over then.
    let within = gap <= rest.most_gap(horizon_s) && far.is_none() && power <= most_power;
    let mut noise = format!(
        "what is left has {} times the power that the sensors' noise gives, and predictions over {horizon_s:.3} s miss by {}",
        if power < 1000.0 { format!("{power:.2}") } else { significant(power, 3) },
        result.gap.told(gap)
    );
    noise += &rest.beside(power);
    // Where longer predictions decided, their number is told.
    if let Some(h) = far {
        noise += &format!(", over {:.3} s by {}", h.0, result.gap.told(h.2));
    }
    let undecidable = undecidable.or_else(|| diverged.then(|| DIVERGED.to_owned()));
    let undecidable = undecidable.or_else(|| if within { rest.unfollowed(power, gap) } else { None });
    let whole = rest.whole.map(|(left, values)| (left, rest.most_of_whole(values))).filter(|(left, most)| left > most);
    let left = !within || whole.is_some();
    if let (Some((left, most)), true) = (whole, within) {
        noise += &format!(
            ", but one simulation of the whole record leaves {} times the noise's power (up to {most:.2} would be chance)",
            significant(left, 3)
        );
    }
    if undecidable.is_none() {
        result.decided_by = decided_by(result, gap, (power, &rest));
    }
    (result.verdict, result.reason) = match (undecidable, left, result.effects.is_empty()) {
        (Some(reason), ..) => {
            result.effects.clear();
            (Verdict::NotDecidable, reason)
        }
        (None, true, _) if let Some(shape) = rest.shape => {
            (Verdict::Unexplained, format!("{noise}; {shape}: no effect of the list accounts for it"))
        }
        (None, true, _) => (Verdict::Unexplained, format!("{noise}; no effect of the list accounts for it")),
        (None, false, _) if let Some(shape) = rest.shape => {
            (Verdict::Unexplained, format!("{noise}, but {shape}: no effect of the list accounts for it"))
        }
        (None, false, true) => (Verdict::NothingMissing, noise),
        (None, false, false) if let Some((joint, names)) = rest.patched => (
            Verdict::Unexplained,
            format!(
                "{noise}, but it took {names} to get there: one shape of {joint}'s angle that has no name in the list"
            ),
        ),
        (None, false, false) => (Verdict::Explained, noise),
    };
}

/// The number that is largest beside its limit.
fn decided_by(result: &Explanation, gap: f64, (power, rest): (f64, &Left)) -> Option<DecidedBy> {
    let over = |horizon_s: f64, value: f64| {
        let what = format!("gap over {} s, noise floors", significant(horizon_s, 4));
        DecidedBy { what, value, limit: rest.most_gap(horizon_s) }
    };
    let horizon_s = result.gap.horizon_s;
    let longer = result.gap.horizons.iter().filter(|h| h.0 <= VERDICT_HORIZONS * horizon_s);
    let what = "power of what is left over that of the sensors' noise".to_owned();
    let all = longer.map(|h| over(h.0, h.2));
    let all = all.chain([over(horizon_s, gap), DecidedBy { what, value: power, limit: rest.most_power() }]);
    let all = all.chain(rest.whole.map(|(value, values)| DecidedBy {
        what: "power of what one simulation of the whole record leaves over that of the sensors' noise".to_owned(),
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
        (result.verdict, result.reason)
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
                    (result.verdict, result.reason.as_str()),
                    (Verdict::NotDecidable, DIVERGED),
                    "{gap} {power}"
                );
                assert!(result.effects.is_empty() && result.decided_by.is_none(), "{result:?}");
                let told = serde_json::to_string(&result.gap).unwrap();
                assert!(result.gap.steps.iter().all(|s| s.value == 5.0), "{told}");
            }
        }
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
        let own = |mean: f64, gap: f64| Left { remade: Some((mean, 0.02)), gaps: vec![(0.2, gap)], ..Left::default() };
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
        let (_, why) = verdict(2.0, 1.0, Left { left_out: 2, ..own(1.0, 1.0) });
        assert!(why.contains("up to 1.08 would be chance; 2 windows that cannot be followed"), "{why}");
    }
}

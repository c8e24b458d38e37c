//! What changed in the middle of a record: whether what is left depends on its time, where.
//!
//! Two things tell it: what each window leaves of the one model is less before an instant than after
//! it, or the other way round; or coefficients of its own for each part leave less than one set for
//! both. Either is held against what other orders of the windows give (`order`). A wrong law as
//! well leaves more where the motion is larger, and a motion may grow or die along a record. So only
//! windows whose motion and inputs are alike are exchanged. Where a drive or inputs keep the motion
//! up, and coefficients of its own leave nothing but noise of each part, a motion that changed with
//! them is what they did: inputs alone have to be alike then.
//!
//! What drifts is cut best in its middle. Where coefficients that go evenly with time leave less than
//! those of two parts, that is told.

mod order;

use core::f64::consts::SQRT_2;

use nalgebra::DMatrix;

use self::order::{Measure, alike, left_by_drift, together};
use super::evidence::{Evidence, Outcome};
use super::prediction::Range;
use super::residual_map::Where;
use super::setting::Setting;
use super::shooting::blocks::Blocks;
use super::state::State;
use crate::explain::decidability::FEWEST_BLOCKS;
use crate::explain::explanation::{Explanation, Verdict};
use crate::explain::reason::Reason;
use crate::statistics::median;
use crate::warning::Warning;
use crate::wording::format::{percent, shortest, significant};

/// Ids of the warnings that the parameters are those of a part, or of neither part, and that
/// windows of one part are left out.
const DEPENDS: &str = "depends-on-time";
const LEFT_OUT: &str = "left-out-in-part";

/// Share of what one set of coefficients leaves that is far less (by hand).
const FAR_LESS: f64 = 0.5;
/// Weight of a part's windows, beside that of as many others, below which the coefficients are those
/// of the other part (by hand).
const HARDLY: f64 = 0.1;
/// Power over that of the noise from which the rms says more.
const FAR: f64 = 1e4;

/// A time to a hundredth of so many seconds and finer, whatever a clock began at.
fn time(s: f64, within_s: f64) -> String {
    let unit = 10f64.powf((0.01 * within_s).log10().floor());
    shortest((s / unit).round() * unit)
}

/// That what is left depends on time.
#[derive(Clone, Debug, PartialEq)]
pub struct Changed {
    /// When, by the record's own clock, s.
    pub at_s: f64,
    /// Where the window before begins and that after ends, s: in one of the two it was.
    pub within_s: [f64; 2],
    /// Whether it is a drift, of which that is the middle.
    pub drifts: bool,
    /// Median over the windows before and after of what is left, over the noise's power.
    pub powers: [f64; 2],
    /// The same with coefficients for each part, where that is far less.
    pub apart: Option<f64>,
    /// Power up to which nothing counts as left of all windows.
    pub most: f64,
}

impl Changed {
    fn time(&self, s: f64) -> String {
        time(s, self.within_s[1] - self.within_s[0])
    }

    /// The instant.
    fn instant(&self) -> String {
        self.time(self.at_s)
    }

    /// Options for the two parts, without the windows about the instant.
    fn options(&self) -> [String; 2] {
        let [before, after] = self.within_s.map(|s| self.time(s));
        [format!("--to {before}"), format!("--from {after}")]
    }

    /// Whether a part leaves nothing but noise: half the windows scatter more than all.
    fn is_noise(&self, power: f64) -> bool {
        power <= 1.0 + SQRT_2 * (self.most - 1.0)
    }

    /// What is left in words.
    fn left(&self, power: f64) -> String {
        if self.is_noise(power) {
            "nothing but noise".to_owned()
        } else if power > FAR {
            format!("{} times the sensors' noise (rms)", significant(power.sqrt(), 2))
        } else {
            format!("{} times the power of the sensors' noise", significant(power, 3))
        }
    }

    /// What is known of it, a sentence without its end.
    pub fn told(&self) -> String {
        let [before, after] = self.powers.map(|p| self.left(p));
        let apart = self.apart.map(|p| self.left(p));
        let at = self.instant();
        if self.drifts {
            let one = self.left(self.powers[0].max(self.powers[1]));
            let apart = apart.map_or_else(String::new, |p| format!(", one for each half {p}"));
            return format!("one set of parameters leaves {one}{apart}: something in the rig drifts along the record");
        }
        let parts = if self.is_noise(self.powers[1]) && !self.is_noise(self.powers[0]) {
            format!("after about t = {at} s the model leaves nothing but noise, before it {before}")
        } else {
            format!("before about t = {at} s the model leaves {before}, after it {after}")
        };
        let apart = apart.map_or_else(String::new, |p| format!(", and with parameters of its own for each part {p}"));
        format!("{parts}{apart}: something in the rig changed then")
    }

    /// What to do.
    pub fn advice(&self) -> String {
        let [to, from] = self.options();
        let look = if self.drifts {
            "what differs is what drifts. Look for what warms up, wears or runs down"
        } else {
            "what differs is what changed. Look up what happened at the rig then (a screw that came loose, a setting)"
        };
        format!("Explain the two parts apart, with `{to}` and with `{from}`, and compare their parameters: {look}.")
    }

    /// That parameters are those of one part, or of neither: what the windows before have of the
    /// weight, and of the windows; whether they are those of simulations, to which every part counts.
    fn warning(&self, [weight, count]: [f64; 2], simulated: bool) -> Warning {
        let at = self.instant();
        let [before, after] = [weight / count, (1.0 - weight) / (1.0 - count)];
        let of_part = |part: &str, other: &str, share: f64| {
            format!(
                "the parameters are those of the part {part} t = {at} s: windows {other} it miss by so much that they have {} of the weight",
                percent(share, 2)
            )
        };
        let text = if !simulated && after < HARDLY * before {
            of_part("before", "after", 1.0 - weight)
        } else if !simulated && before < HARDLY * after {
            of_part("after", "before", weight)
        } else {
            format!("the parameters are those of neither the part before t = {at} s nor that after it, but lie between")
        };
        let [to, from] = self.options();
        let advice = format!("Identify the two parts apart (`{to}`, `{from}`)");
        Warning::new(DEPENDS, text, advice)
            .with("time_s", self.at_s)
            .with("within_s", self.within_s.to_vec())
            .with("drifts", self.drifts)
            .with("power_before", self.powers[0])
            .with("power_after", self.powers[1])
            .with("weight_before", weight)
    }
}

/// Tells in a result where what is left depends on time, and where windows of one part of the record
/// are left out. `most`: power up to which nothing counts as left.
pub fn tell_in(result: &mut Explanation, setting: &Setting<'_>, state: &State, outcome: &Outcome, most: f64) {
    let Evidence::Shooting(blocks) = &outcome.evidence else { return };
    if result.verdict != Verdict::NotDecidable && setting.record_of.iter().all(|r| *r == 0) {
        result.warnings.extend(left_out(setting, state));
    }
    let Reason::Excess { changed, shape, .. } = &mut result.reason else { return };
    // What follows mostly from a position, a velocity or a phase needs no other reason.
    if shape.as_ref().is_some_and(|s| s.held_out_gain > 1.0 - FAR_LESS) {
        return;
    }
    let Some((found, at)) = find(setting, state, outcome, blocks, most) else { return };
    let weights = blocks.weights_of_blocks();
    let share = |all: &[f64]| all[..at].iter().sum::<f64>() / all.iter().sum::<f64>();
    let shares = [share(&weights), share(&vec![1.0; weights.len()])];
    result.warnings.push(found.warning(shares, result.details.simulated_s.is_some()));
    let times = |of: &Range| [of.begin, of.end].map(|i| state.stretches[of.stretch].time(i));
    let ends = blocks.places.first().map(times).zip(blocks.places.last().map(times));
    if let Some(([from, _], [_, to])) = ends {
        let stretch = match found.powers {
            _ if found.drifts => [from, to],
            [before, after] if before > after => [from, found.at_s],
            _ => [found.at_s, to],
        };
        put_first(&mut result.r#where, stretch);
    }
    *changed = Some(found);
}

/// Puts a stretch of time before all places, with the equation, value and band of the clearest of
/// those against time that lie in it, or of all.
fn put_first(places: &mut Vec<Where>, [from, to]: [f64; 2]) {
    let is_in = |w: &&Where| w.against == "time" && w.from < to && w.to > from;
    let Some(clearest) = places.iter().find(is_in).or(places.first()).cloned() else { return };
    let units = ("s".to_owned(), clearest.units.1.clone());
    places.insert(0, Where { against: "time".to_owned(), from, to, units, ..clearest });
}

/// Whether and where what is left depends on time, and the block from which on it is otherwise; of
/// one record alone, whose windows are in the order of time.
fn find(
    setting: &Setting<'_>,
    state: &State,
    outcome: &Outcome,
    blocks: &Blocks,
    most: f64,
) -> Option<(Changed, usize)> {
    let (places, n) = (&blocks.places, blocks.places.len());
    if n < FEWEST_BLOCKS || !setting.record_of.iter().all(|r| *r == 0) {
        return None;
    }
    let powers = blocks.powers_alone(&outcome.fit.all);
    let grams = blocks.grams_alone(&outcome.own);
    if powers.len() != n || !powers.iter().all(|p| p.is_finite()) {
        return None;
    }
    let logs: Vec<f64> = powers.iter().map(|p| p.max(f64::MIN_POSITIVE).ln()).collect();
    let middle = |of: &[f64]| median(&mut of.to_vec());
    let instant = |of: &Range, sample: usize| state.stretches[of.stretch].time(sample);
    let told = |at: usize| Changed {
        at_s: instant(&places[at], places[at].begin),
        within_s: [instant(&places[at - 1], places[at - 1].begin), instant(&places[at], places[at].end)],
        drifts: false,
        powers: [middle(&powers[..at]), middle(&powers[at..])],
        apart: None,
        most,
    };
    // What coefficients of its own leave of each part.
    let apart = |at: usize| -> Option<[f64; 2]> {
        let x = [&grams[..at], &grams[at..]].map(|part| blocks.solved_alone(&outcome.own, part));
        let [before, after] = x.map(|x| x.map(|x| blocks.powers_alone(&x)));
        Some([middle(&before?[..at]), middle(&after?[at..])])
    };
    let is_kept_up = setting.rig.drive.is_some() || !setting.bound.inputs.is_empty();
    let (of_inputs, of_motion) = groups(setting, state, places);
    let all = [of_inputs.clone(), of_motion].concat();
    let by_coefficients = Measure::Coefficients(&grams);
    let is_clean = |at: usize| apart(at).is_some_and(|p| p.iter().all(|p| told(at).is_noise(*p)));
    let found = Measure::Levels(&logs).in_time(&all).or_else(|| {
        // Of what follows from the change itself no part has alike windows.
        let (at, left) = by_coefficients.in_time(&of_inputs)?;
        if is_kept_up && is_clean(at) { Some((at, left)) } else { by_coefficients.in_time(&all) }
    });
    let (at, _) = found?;
    let mut found = told(at);
    let one = found.powers[0].max(found.powers[1]);
    found.apart = apart(at).map(|p| p[0].max(p[1])).filter(|p| *p < FAR_LESS * one);
    found.drifts = drifts(state, places, &grams, at);
    Some((found, at))
}

/// Whether coefficients that go evenly with time leave less than those of two parts, and far less
/// than one set of them.
fn drifts(state: &State, places: &[Range], grams: &[DMatrix<f64>], at: usize) -> bool {
    let middle = |p: &Range| 0.5 * (state.stretches[p.stretch].time(p.begin) + state.stretches[p.stretch].time(p.end));
    let times: Vec<f64> = places.iter().map(middle).collect();
    let part = |of: &[DMatrix<f64>]| {
        let first = of.first()?.clone();
        order::left(&of[1..].iter().fold(first, |sum, g| sum + g))
    };
    let of_two = || part(&grams[..at]).zip(part(&grams[at..])).map(|(a, b)| a + b);
    let least = of_two().zip(part(grams)).map(|(two, one)| two.min(FAR_LESS * one));
    left_by_drift(grams, &times).zip(least).is_some_and(|(drift, least)| drift < least)
}

/// Ways to sort the blocks into groups.
type Groups = Vec<Vec<Vec<usize>>>;

/// Ways to sort the blocks into groups that are alike: all together and by inputs, and by motion.
fn groups(setting: &Setting<'_>, state: &State, places: &[Range]) -> (Groups, Groups) {
    let mut of_inputs = vec![together(places.len())];
    for k in 0..setting.bound.inputs.len() {
        let of =
            |p: &Range| state.stretches[p.stretch].inputs.get(k).map_or((0.0, 0.0), |x| spread(&x[p.begin..p.end]));
        let both: Vec<(f64, f64)> = places.iter().map(of).collect();
        of_inputs.push(alike(&both.iter().map(|b| b.0).collect::<Vec<f64>>()));
        of_inputs.push(alike(&both.iter().map(|b| b.1).collect::<Vec<f64>>()));
    }
    let Some(settled) = state.followed.as_ref().and_then(|f| f.settled(setting)) else {
        return (of_inputs, Vec::new());
    };
    let n = setting.circle.len();
    let mut size = vec![0.0; places.len()];
    let mut of_motion = Vec::new();
    let states: Vec<Vec<Vec<f64>>> =
        places.iter().map(|p| (p.begin..p.end).filter_map(|i| settled.at(p.stretch, i)).collect()).collect();
    for k in 0..n {
        let along = |of: &dyn Fn(&Vec<f64>) -> f64| -> Vec<(f64, f64)> {
            states.iter().map(|s| spread(&s.iter().map(of).collect::<Vec<f64>>())).collect()
        };
        let (position, rate) = (along(&|s| s[k]), along(&|s| s[n + k]));
        let means = |of: &[(f64, f64)]| of.iter().map(|b| b.0).collect::<Vec<f64>>();
        let sizes = |of: &[(f64, f64)]| of.iter().map(|b| b.1).collect::<Vec<f64>>();
        let mut about = vec![sizes(&position), sizes(&rate)];
        if setting.circle[k] {
            // Where it hangs, however often it has turned, and how it turns.
            about.extend([means(&along(&|s| s[k].cos())), means(&along(&|s| s[k].sin())), means(&rate)]);
        } else {
            about.push(means(&position));
        }
        // How fast it goes to and fro.
        about.push(rate.iter().zip(&position).map(|(v, q)| v.1 / q.1.max(f64::MIN_POSITIVE)).collect());
        for all in [&position, &rate] {
            let whole = all.iter().map(|b| b.1 * b.1).sum::<f64>().max(f64::MIN_POSITIVE);
            size.iter_mut().zip(all).for_each(|(size, b)| *size += b.1 * b.1 / whole);
        }
        of_motion.extend(about.iter().map(|by| alike(by)));
    }
    of_motion.push(alike(&size));
    (of_inputs, of_motion)
}

/// Mean, and standard deviation about it.
fn spread(x: &[f64]) -> (f64, f64) {
    let n = x.len().max(1) as f64;
    let mean = x.iter().sum::<f64>() / n;
    (mean, (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// A warning where windows are left out in one part of the record more than chance has it.
fn left_out(setting: &Setting<'_>, state: &State) -> Option<Warning> {
    let windows = state.followed.as_ref()?.counted(setting, state);
    let out: Vec<f64> = windows.iter().map(|w| f64::from(!w.1)).collect();
    let (at, _) = Measure::Levels(&out).in_time(&[together(out.len())])?;
    let count = |part: &[f64]| (part.iter().sum::<f64>() as usize, part.len());
    let (before, after) = (count(&out[..at]), count(&out[at..]));
    let more_before = before.0 * after.1 > after.0 * before.1;
    let (side, (gone, of), (others, of_others)) =
        if more_before { ("before", before, after) } else { ("after", after, before) };
    let other = if more_before { "after" } else { "before" };
    let at_s = time(windows[at].0, windows[at].0 - windows[at - 1].0);
    let text = format!(
        "of the {of} windows {side} t = {at_s} s {gone} are left out, of the {of_others} {other} it {others}: the model is not followed there, and what it may lack then does not show"
    );
    let advice = format!("Explain that part by itself (`--{} {at_s}`)", if more_before { "to" } else { "from" });
    Some(Warning::new(LEFT_OUT, text, advice).with("time_s", windows[at].0).with("left_out", gone).with("windows", of))
}

#[cfg(test)]
#[path = "changed_tests.rs"]
mod tests;

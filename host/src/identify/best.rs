//! The default: multiple shooting wherever it comes to rest and leaves nothing but the sensors'
//! noise, and the weak form otherwise.
//!
//! Where the equations hold, shooting's standard errors are near the bound of Cramér and Rao, those
//! of the weak form 2 to 80 times as large. Where they miss something, what is missing adds up
//! along a piece, and the weak form, which weighs it where it acts, is the sounder start. A motion
//! that nothing drives can be followed over whole stretches: there the fit is taken whose standard
//! errors are smaller, both being those of what is left along the record, whatever that is. Under
//! measured inputs the weak form has the force itself to go by.

use std::borrow::Cow;

use indicatif::ProgressBar;

use super::shooting::run::MOST_LOST;
use super::shooting::zeros::ZeroOffset;
use super::{Identification, Settings, held_inputs, identify, shooting, slips, stopped};
use crate::error::Result;
use crate::record::Record;
use crate::rig::Rig;
use crate::warning::Warning;
use crate::wording::format::significant;

/// Most samples that are shot over by default: some seconds of work, beyond which the weak form's
/// errors are small as well.
pub(super) const MOST_SAMPLES: usize = 200_000;
/// Warning of the weak form that more is left than the sensors' noise.
pub(super) const MISSES_SOMETHING: &str = "model-misses-something";
/// The same of shooting.
pub(super) const MORE_THAN_NOISE: &str = "more-than-noise";
/// Warnings that its coefficients cannot be a rig's, which zeros that are off make as well.
pub(super) const CANNOT_BE: [&str; 5] =
    ["tie-violated", "negative-damping", "negative-gravity", "negative-inertia", "negative-quantity"];
/// Warnings of the weak form that shooting gives by itself, or that are about its windows.
const OF_WEAK: [&str; 3] = ["few-windows", "periodic-record", "undetermined"];

/// Identifies a system by shooting where that stands, otherwise by the weak form with the reason in
/// `not_by_shooting`; slips of single counts that shooting shows are taken back ([`slips`]).
///
/// # Errors
/// As [`identify`].
pub fn best(
    records: &[Record],
    rig: &Rig,
    weak: &Settings,
    choices: &shooting::Settings,
    progress: &ProgressBar,
) -> Result<Identification> {
    let of = |records: &[Record]| {
        let found = slips::without(records, |records| once(records, rig, weak, choices, progress));
        found.map(|(found, records)| (found, matches!(records, Cow::Owned(_))))
    };
    let mut found = of(records)?.0;
    if let Some((held, warning)) = held_inputs::taken_as_held(records, rig, &found.warnings) {
        let (again, slips) = of(&held)?;
        // Between samples a reversal of dry friction may lie elsewhere than what acts within the band has
        // it, which looks like slips.
        if again.not_by_shooting.is_none() && !slips {
            found = again;
            found.warnings.push(warning);
        }
    }
    // Shooting leaves the same standstills out.
    stopped::tell_in(&mut found.warnings, records, rig);
    Ok(found)
}

/// The same of records as they are.
pub(super) fn once(
    records: &[Record],
    rig: &Rig,
    weak: &Settings,
    choices: &shooting::Settings,
    progress: &ProgressBar,
) -> Result<Identification> {
    let mut first = identify(records, rig, weak)?;
    first.not_by_shooting = unsuited(&first);
    if first.not_by_shooting.is_some() {
        return Ok(first);
    }
    // Where the equations miss something that is no zero, short pieces show it soon.
    let most_left = missed(&first).map(|_| shooting::MISSES);
    let choices = shooting::Settings { most_left, ..choices.clone() };
    let shot = shooting::identify(records, rig, weak, &choices, progress);
    if let (Some(_), Ok(found)) = (missed(&first), &shot)
        && found.zeros.iter().any(ZeroOffset::is_off)
    {
        // Is it the zeros alone that it missed?
        let without = identify(records, rig, &Settings { zeros: found.zeros.clone(), ..weak.clone() })?;
        if missed(&without).is_none() {
            first = without;
        }
    }
    let (found, why) = match shot {
        Ok(found) => (Some(found), None),
        Err(error) => (None, Some(error.found)),
    };
    let why = missed(&first).or(why).or_else(|| found.as_ref().and_then(unsettled));
    match (found, why) {
        (Some(mut found), None) => {
            take_over(&mut found, first.warnings);
            Ok(found)
        }
        (found, why) => {
            let more_left = found.as_ref().filter(|_| missed(&first).is_none()).and_then(left_by_shooting);
            // Parameters that slips have spoiled show the wrong ones, or none.
            if found.is_some_and(|found| !found.slips.is_empty()) || may_slip(&first, rig) {
                first.slips = shooting::slips(records, rig, weak, &first, progress).unwrap_or_default();
            }
            first.warnings.extend(more_left);
            let whole = shooting::simulated(records, rig, weak, &first, progress).ok().flatten();
            if let Some(mut found) = whole.filter(|found| mean_error(found) < mean_error(&first)) {
                let further = first.warnings.into_iter().filter(|w| !says_missed(w));
                take_over(&mut found, further.collect());
                found.slips = first.slips;
                return Ok(found);
            }
            first.not_by_shooting = why;
            Ok(first)
        }
    }
}

/// Joins the weak form's warnings that hold of shooting as well.
fn take_over(found: &mut Identification, warnings: Vec<Warning>) {
    let known: Vec<&str> = found.warnings.iter().map(|w| w.id).collect();
    let further = warnings.into_iter().filter(|w| !known.contains(&w.id) && !OF_WEAK.contains(&w.id));
    let further: Vec<Warning> = further.collect();
    found.warnings.extend(further);
}

/// The mean logarithm of the standard errors of the equations' coefficients: both are measured by
/// how what is left scatters along the record, whatever it is.
fn mean_error(found: &Identification) -> f64 {
    let names = &found.correlation_names;
    let of = |n: &String| found.parameter(n).map_or(0.0, |p| p.std_error.max(f64::MIN_POSITIVE).ln());
    names.iter().map(of).sum::<f64>() / names.len().max(1) as f64
}

/// Whether a warning of the weak form says that the equations miss something.
fn says_missed(w: &Warning) -> bool {
    w.id == MISSES_SOMETHING || (w.invalidates && CANNOT_BE.contains(&w.id))
}

/// What the first of them says.
fn missed(first: &Identification) -> Option<String> {
    first.warnings.iter().find(|w| says_missed(w)).map(|w| w.text.clone())
}

/// Why shooting is not tried. It is tried where the equations miss something: that may be zeros or
/// slips of the sensors, which shooting shows.
fn unsuited(first: &Identification) -> Option<String> {
    if let Some(w) = first.warnings.iter().find(|w| w.invalidates && !says_missed(w)) {
        return Some(w.text.clone());
    }
    (first.record.samples > MOST_SAMPLES)
        .then(|| format!("{} samples are more than {MOST_SAMPLES}; --method shooting takes all", first.record.samples))
}

/// Whether what the equations leave may be slips of single counts.
fn may_slip(first: &Identification, rig: &Rig) -> bool {
    let other = |w: &Warning| w.invalidates && w.id != MISSES_SOMETHING;
    missed(first).is_some() && !first.warnings.iter().any(other) && rig.channel.iter().any(|c| c.unit == "count")
}

/// Shooting's warning that more is left than the sensors' noise: true of the weak form's
/// coefficients as well, whose windows may be too few to show it.
fn left_by_shooting(found: &Identification) -> Option<Warning> {
    let followed = |s: &shooting::Details| s.converged && s.lost as f64 <= MOST_LOST * (s.lost + s.pieces) as f64;
    let settled = found.shooting.as_ref().is_some_and(followed);
    found.warnings.iter().find(|w| settled && w.id == MORE_THAN_NOISE).cloned()
}

/// Why its result does not stand.
fn unsettled(found: &Identification) -> Option<String> {
    let s = found.shooting.as_ref()?;
    let worst = s.noise_ratio.iter().copied().fold(0.0, f64::max);
    if !s.converged {
        return Some(format!("{} rounds did not come to rest", s.rounds));
    }
    if s.lost as f64 > MOST_LOST * (s.lost + s.pieces) as f64 {
        return Some(format!("{} of {} pieces could not be followed", s.lost, s.lost + s.pieces));
    }
    (worst > shooting::MISSES).then(|| format!("its residuals are {} times the sensors' noise", significant(worst, 3)))
}

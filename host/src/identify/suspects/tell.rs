//! A suspect in words: what it is, why it is believed, what to change.

use core::f64::consts::TAU;

use super::find::Finding;
use super::hypotheses::channels;
use super::scene::{Misfit, Scene};
use super::undo::Undo;
use crate::identify::held_inputs::HALF;
use crate::rig::Channel;
use crate::warning::Warning;
use crate::wording::format::{Z95, plus_minus, shortest, significant};

/// Standard errors from which a lag is said to grow.
const GROWS: f64 = 5.0;
/// Distance within which a number of counts is a whole one.
const WHOLE: f64 = 0.05;
/// Percent up to which a scale that is off may be a play or a slip.
const MOST_SLIP: f64 = 20.0;
/// Share within which a number of counts that is sold is named beside the one found.
const NEAR_SOLD: f64 = 5e-3;

/// Whether with what a warning says mended the equations leave no more than the sensors' noise.
pub(in crate::identify) fn explains(warning: &Warning) -> bool {
    let after = warning.details.get("residual_after").and_then(serde_json::Value::as_f64);
    after.is_some_and(|ratio| ratio.ln() < super::CLEAN)
}

/// The warning for what was found.
pub(super) fn tell(scene: &Scene, before: &Misfit, found: &Finding) -> Warning {
    let channels = channels(scene);
    let name = |i: usize| channels.get(i).map_or("", |c| c.name.as_str());
    let why = format!(
        "the equations then leave {} times the power of the sensors' noise, as it stands {} times",
        times(found.after.log),
        times(before.log)
    );
    let error = |k: usize| Z95 * found.errors.get(k).copied().unwrap_or(f64::NAN);
    let warning = match &found.undo {
        Undo::Exchange(a, b, _) => Warning::new(
            "channels-exchanged",
            format!("{} and {} are exchanged: {why}", name(*a), name(*b)),
            "Exchange the two names in the rig file, or the two plugs",
        )
        .with("channels", vec![name(*a), name(*b)]),
        Undo::Reverse(i) => reversed(found, *i, &name, &why),
        Undo::Against(i, other, factor) => {
            let (is, not) = if *factor > 0.0 {
                ("against", "an angle of its own")
            } else {
                ("absolute, not against", "an angle between the two")
            };
            let text = if *factor > 0.0 {
                format!("{} measures {is} {}, not {not}: {why}", name(*i), name(*other))
            } else {
                format!("{} is {is} {}: {why}", name(*i), name(*other))
            };
            let advice = relative_advice(channels[*i], *factor > 0.0);
            Warning::new("relative-absolute", text, advice).with("channel", name(*i))
        }
        Undo::Unit(list, factor) => {
            let unit = match channels[list[0]].unit.as_str() {
                "rad" => "deg",
                "deg" => "rad",
                "m" => "mm",
                _ => "m",
            };
            let who = names(list, &name);
            Warning::new(
                "channel-unit",
                format!("{who} in {unit}, not in {}: {why}", channels[list[0]].unit),
                format!("Set unit = \"{unit}\" in the rig file"),
            )
            .with("channels", list.iter().map(|i| name(*i)).collect::<Vec<_>>())
            .with("unit", unit)
            .with("factor", *factor)
        }
        Undo::Scale(list, factor) => scaled(&channels, list, (*factor, error(0)), found, &why),
        Undo::Drive(rate) => drive(scene, *rate, error(0), &why),
        Undo::Lag { signal, delay_s, drift, .. } => {
            let step_s = scene.stretches.first().map_or(1.0, |s| s.step_s);
            let drift_error = found.errors.get(1).copied().unwrap_or(f64::INFINITY);
            let lag = Lag {
                delay_s: *delay_s,
                error_s: error(0),
                drift: *drift,
                drift_error,
                step_s,
                span_s: scene.span_s(),
            };
            lag.warning(channels[*signal], channels[0], &why)
        }
    };
    warning.with("residual_before", before.log.exp()).with("residual_after", found.after.log.exp()).invalidating()
}

fn times(log: f64) -> String {
    significant(log.exp(), 2)
}

/// "count1 is" or "count1 and count2 are".
fn names<'a>(list: &[usize], name: &dyn Fn(usize) -> &'a str) -> String {
    let all: Vec<&str> = list.iter().map(|i| name(*i)).collect();
    format!("{} {}", all.join(" and "), if all.len() == 1 { "is" } else { "are" })
}

fn reversed<'a>(found: &Finding, i: usize, name: &dyn Fn(usize) -> &'a str, why: &str) -> Warning {
    let mut all = vec![i];
    all.extend(found.also.iter().filter_map(|u| if let Undo::Reverse(k) = u { Some(*k) } else { None }));
    all.sort_unstable();
    let list: Vec<&str> = all.iter().map(|k| name(*k)).collect();
    let text = if list.len() == 1 {
        format!("{} counts in the wrong sense: with its sign reversed {why}", list[0])
    } else {
        format!("{} count in opposite senses: with one of their signs reversed {why}", list.join(" and "))
    };
    let advice = "All channels must count positive in the same sense: negate one column, or exchange lines A and B of that encoder";
    Warning::new("sign-reversed", text, advice).with("channels", list)
}

/// What to write for a channel that is relative (or absolute) after all.
fn relative_advice(channel: &Channel, relative: bool) -> String {
    match (channel.measures.as_str(), relative) {
        ("theta2", _) => "Set measures = \"phi2\" for it in the rig file".to_owned(),
        ("phi2", _) => "Set measures = \"theta2\" for it in the rig file".to_owned(),
        (_, true) => "Say so in its `measures` in the rig file (such as \"q2 - q1\")".to_owned(),
        (_, false) => "Name the coordinate alone in its `measures` in the rig file".to_owned(),
    }
}

/// Counts a turn as far as a record knows them, and what to do; with the equations `is_clean` where
/// they leave nothing but the sensors' noise.
fn counts(value: f64, uncertainty: f64, factor: f64, is_clean: bool) -> (String, String) {
    if is_clean && uncertainty < 0.5 && (value - value.round()).abs() < WHOLE.max(uncertainty) {
        return (format!("{value:.0}"), format!("Set counts_per_turn = {value:.0} in the rig file"));
    }
    let apart = |n: f64| (n / value).ln().abs();
    let sold = super::COUNTS.into_iter().map(f64::from).min_by(|a, b| apart(*a).total_cmp(&apart(*b)));
    let near = sold.filter(|n| apart(*n) < NEAR_SOLD && *n != value.round());
    let advice = if let Some(sold) = near {
        format!(
            "Set counts_per_turn to the encoder's own number in the rig file: this record says {value:.0}, and encoders of {sold} are sold"
        )
    } else {
        // What is off by a half or a double is another encoder.
        let percent = 100.0 * (factor - 1.0).abs();
        let slip =
            format!("; otherwise its scale is off by {} %, a play or slip of its drive", significant(percent, 3));
        let slip = if percent < MOST_SLIP { &slip } else { "" };
        format!("Set counts_per_turn = {value:.0} in the rig file if that is the encoder's number{slip}")
    };
    (plus_minus(value, uncertainty), advice)
}

fn scaled(channels: &[&Channel], list: &[usize], (factor, error): (f64, f64), found: &Finding, why: &str) -> Warning {
    let all: Vec<&str> = list.iter().map(|i| channels[*i].name.as_str()).collect();
    let who = all.join(" and ");
    let channel = channels[list[0]];
    let plural = all.len() > 1;
    let warning = match channel.counts_per_turn.filter(|_| channel.unit == "count") {
        Some(stated) => {
            let value = factor * f64::from(stated);
            let uncertainty = (error * f64::from(stated)).max(0.0);
            let is_clean = found.after.log < super::CLEAN;
            let (shown, advice) = counts(value, uncertainty, factor, is_clean);
            Warning::new(
                "counts-per-turn",
                format!("{who} {} {shown} counts a turn, not {stated}: {why}", if plural { "have" } else { "has" }),
                advice,
            )
            .with("stated", stated)
            .with("value", value)
        }
        None => Warning::new(
            "channel-scale",
            format!(
                "{who} {} {} times what {} should: {why}",
                if plural { "show" } else { "shows" },
                plus_minus(factor, error),
                if plural { "they" } else { "it" }
            ),
            "Check the sensor's calibration and the unit in the rig file",
        )
        .with("value", factor),
    };
    warning.with("channels", all).with("factor", factor).with("std_error", error / Z95)
}

fn drive(scene: &Scene, rate: f64, error: f64, why: &str) -> Warning {
    let stated = scene.rig.drive.map_or(0.0, |d| d.frequency_hz);
    let (value, error) = (stated + rate / TAU, error / TAU);
    let said = shortest(stated);
    let sampling = scene.rig.sample_rate_hz * stated / value;
    Warning::new(
        "drive-frequency",
        format!("the drive runs at {} Hz in the record's time, not at {said} Hz: {why}", plus_minus(value, error)),
        format!(
            "Set drive.frequency_hz = {} in the rig file; if the drive surely ran at {said} Hz, the times are wrong and the samples came at {} Hz",
            significant(value, 6),
            significant(sampling, 6)
        ),
    )
    .with("stated_hz", stated)
    .with("value_hz", value)
    .with("std_error_hz", error / Z95)
    .with("sample_rate_hz", sampling)
}

/// By how much a channel lags another.
struct Lag {
    /// At the record's beginning, s, and its 95 % bound.
    delay_s: f64,
    error_s: f64,
    /// What it grows by a second, and the standard error of that.
    drift: f64,
    drift_error: f64,
    /// Spacing of the samples and length of the record, s.
    step_s: f64,
    span_s: f64,
}

impl Lag {
    fn warning(&self, channel: &Channel, first: &Channel, why: &str) -> Warning {
        let Self { delay_s, error_s: error, drift, drift_error, step_s, span_s } = *self;
        // What the lag grows by over the record against what it begins with.
        let grows = drift.abs() > GROWS * drift_error && drift.abs() * span_s > delay_s.abs();
        let (name, first) = (&channel.name, &first.name);
        if grows {
            let sense = if drift > 0.0 { "slow" } else { "fast" };
            return Warning::new(
                "channel-clock",
                format!(
                    "the clock of {name} is {sense} by {} (against {first}), {} ms over {} s: {why}",
                    plus_minus(drift.abs(), Z95 * drift_error),
                    significant(1e3 * (drift * span_s).abs(), 3),
                    significant(span_s, 3)
                ),
                "Sample all channels by one clock, or correct the times of this one before the columns are joined",
            )
            .with("channel", name.as_str())
            .with("value", -drift)
            .with("std_error", drift_error)
            .with("delay_s", delay_s);
        }
        let (who, late) = (name, if delay_s > 0.0 { "late" } else { "early" });
        Warning::new(
        "channel-delay",
        format!(
            "{who} is {late} by {} ms ({} samples) against {first}: {why}",
            plus_minus(1e3 * delay_s.abs(), 1e3 * error),
            significant((delay_s / step_s).abs(), 3)
        ),
        if (delay_s / step_s + 0.5).abs() < HALF {
            "Half a sample early is an output that is held from each sample to the next: record what really acts (a current, a force), or sample faster"
        } else {
            "Sample both at the same instant, or shift that column by so much, and run again"
        },
    )
    .with("channel", name.as_str())
    .with("value_s", delay_s)
    .with("std_error_s", error / Z95)
    .with("samples", delay_s / step_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_of_counts_is_set_only_where_the_record_knows_it() {
        let told = |value: f64, uncertainty: f64, is_clean: bool| counts(value, uncertainty, value / 2048.0, is_clean);
        let (shown, advice) = told(4096.003, 0.02, true);
        assert_eq!((shown.as_str(), advice.as_str()), ("4096", "Set counts_per_turn = 4096 in the rig file"));
        // An effect that is missing moves it by more than its error.
        let (shown, advice) = told(4094.005, 0.08, false);
        let said = "this record says 4094, and encoders of 4096 are sold";
        assert!(shown.contains('±') && advice.contains(said), "{shown} {advice}");
        // Five counts of uncertainty make every number a whole one.
        assert!(told(4094.4, 5.0, true).0.contains('±'));
        let advice = told(3333.3, 0.1, true).1;
        assert_eq!(advice, "Set counts_per_turn = 3333 in the rig file if that is the encoder's number");
        assert!(told(2100.3, 0.1, true).1.contains("off by 2.55 %, a play or slip"), "{}", told(2100.3, 0.1, true).1);
    }
}

//! Where simulation and measurement disagree, which physical effect is missing, and the model with
//! it.
//!
//! 1. The nominal model (the equations and the rig's nominal dampings, with the ties that a torque
//!    in a joint obeys) is fitted.
//! 2. Every effect of the catalogue ([`crate::effects`]) at every place is added in turn,
//!    everything refitted, and judged on blocks of the record that were not fitted ([`ranking`]).
//!    Among those that are significant over the whole list (family-wise 1 %), the simplest within a
//!    standard error of the greatest held-out gain is added; others that held-out data cannot tell
//!    from it are named with it. This repeats until nothing more is supported.
//! 3. The gap before and after each step, on held-out blocks, in units of the sensors' noise.
//! 4. What is left is compared with what the sensors' noise alone leaves, located
//!    ([`engine::residual_map`]), and, where it has no name, drawn as a function of one coordinate
//!    ([`engine::unknown`]).
//!
//! Limits that are no probability and follow from nothing are marked "by hand": they were chosen.
//! What was counted with them, or with earlier values of some, is in
//! docs/explain/how-often-right.md.

mod asked;
pub mod card;
mod decidability;
mod decision;
pub mod double_pendulum;
pub mod engine;
mod explanation;
pub mod gap;
pub mod ledger;
mod locking;
mod outlying;
pub mod presentation;
pub mod ranking;
mod reason;
pub mod single_pendulum;
mod suspected;

use serde::Serialize;

use crate::error::{BadInput, Result};
use crate::identify;
use crate::model::identified::IdentifiedModel;
use crate::record::Record;
use crate::rig::Rig;
use crate::steps;
use crate::system::library::Pendulum;
use crate::warning::Warning;

pub use self::explanation::{DecidedBy, Details, Explanation, Forecast, Found, Gap, Ranked, Step, Verdict};
pub use self::reason::{Criterion, Reason, Undecidable};

/// Most effects that are added (by hand).
const MOST_EFFECTS: usize = 8;
/// Least share of the gap that an effect must take away while the gap is above [`EXPLAINED_GAP`]
/// (by hand).
const LEAST_PROGRESS: f64 = 0.03;
/// Longest part of a record that is used, windows.
const MOST_WINDOWS: f64 = 300.0;

/// Choices.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Horizon of the gap, s; by default one drive period, when free 0.2 s within an eighth and
    /// twenty of the motion's periods.
    pub horizon_s: Option<f64>,
    /// Horizons of the forecasts, s: the first 70 % of the record is fitted, the last 30 %
    /// predicted. By default 1 and 4 of the gap's, 1 and 40/3 (2.667 s) when free.
    pub forecast_s: Vec<f64>,
    /// Windows, test functions and low-pass of the weak form that everything starts from; shooting's
    /// windows follow from them, and are as long as a length that is given here.
    pub weak: identify::Settings,
    /// Most effects that are added; 8 by default.
    pub most_effects: Option<usize>,
    /// A model to start from, instead of the rig file's nominal one.
    pub model: Option<IdentifiedModel>,
}

/// Explains one or several records of the same rig; a mistake in the record or the rig file that
/// the equations show is told first.
///
/// # Errors
/// As [`identify::identify`]; a `model` that is not of this rig.
pub fn explain(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    let mut result = of_inputs(records, rig, settings)?;
    let longest_s = records.iter().map(Record::longest_segment_s).fold(0.0, f64::max);
    asked::tell_in(&mut result, settings, 1.0 / rig.sample_rate_hz, longest_s);
    Ok(result)
}

/// The same with inputs that are held between samples where they show to be.
fn of_inputs(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    steps::tell("looking for mistakes in record and rig file");
    let suspects = identify::suspects::examine(records, rig);
    if let Some((held, warning)) = identify::held_inputs::taken_as_held(records, rig, &suspects) {
        let mut result = suspecting(&held, rig, settings, identify::suspects::examine(&held, rig))?;
        // Between samples a reversal of dry friction may lie elsewhere than what acts within the band
        // has it.
        if matches!(result.verdict, Verdict::Explained | Verdict::NothingMissing) {
            result.warnings.push(warning);
            return Ok(result);
        }
    }
    suspecting(records, rig, settings, suspects)
}

/// The same with the mistakes that the equations show, and slips of counts taken back where that
/// says more with less.
fn suspecting(records: &[Record], rig: &Rig, settings: &Settings, suspects: Vec<Warning>) -> Result<Explanation> {
    let sound = !suspects.iter().any(suspected::grave);
    let as_read = judged(records, rig, settings, suspects.clone());
    let looked = as_read.as_ref().is_ok_and(|e| e.slips_show == Some(false));
    if sound && !looked {
        steps::tell("looking for slips of counts");
    }
    let slipped = if sound && !looked { identify::slips::taken_back(records, rig) } else { None };
    let Some(back) = slipped else { return as_read };
    let mended = judged(&back, rig, settings, suspects)?;
    match as_read {
        Ok(as_read) if mended.verdict != Verdict::NothingMissing && says_more(&as_read, &mended) => Ok(as_read),
        _ => Ok(mended),
    }
}

/// Whether a record as it was read is answered, and with fewer effects than with slips of counts
/// taken back, or where that has no answer: a slip that is none puts an offset into the record, which
/// has a name then.
fn says_more(as_read: &Explanation, mended: &Explanation) -> bool {
    let answers = |e: &Explanation| matches!(e.verdict, Verdict::Explained | Verdict::NothingMissing);
    answers(as_read) && (!answers(mended) || as_read.effects.len() < mended.effects.len())
}

/// The same of records as they stand.
fn judged(records: &[Record], rig: &Rig, settings: &Settings, suspects: Vec<Warning>) -> Result<Explanation> {
    let of_record: Vec<Warning> = records.iter().flat_map(|r| &r.warnings).filter(|w| w.invalidates).cloned().collect();
    let sound = of_record.is_empty() && !suspects.iter().any(suspected::grave);
    steps::tell("comparing with what is known");
    let mut known = if sound { suspected::known(records, rig) } else { Vec::new() };
    let misled = known.iter().any(|w| w.invalidates) && suspected::clean_without_known(records, rig, settings);
    let mut result = if !sound || misled {
        // No effect is looked for where one would be dressed up.
        let settings = Settings { most_effects: Some(0), ..settings.clone() };
        check_model(rig, settings.model.as_ref())?;
        match any_system(records, rig, &settings) {
            Err(e) if is_of_option(&e) => return Err(e),
            // The record's fault is told already.
            Err(_) => {
                let default_s = engine::units::default_horizon(rig, None);
                Explanation::new(settings.horizon_s.unwrap_or(default_s), Vec::new())
            }
            Ok(found) => found,
        }
    } else {
        steps::tell("preparing the record");
        locking::explain(records, rig, settings)?
    };
    // What is missing bends quantities as well: where effects explain the record, or nothing would
    // even if nothing were known, it is a remark.
    let bent = || match result.verdict {
        Verdict::Explained => !result.effects.is_empty(),
        Verdict::Unexplained => {
            known.iter().any(|w| w.invalidates) && !suspected::explained_without_known(records, rig, settings)
        }
        Verdict::NothingMissing | Verdict::NotDecidable => false,
    };
    if !misled && bent() {
        known.iter_mut().for_each(|w| w.invalidates = false);
    }
    if !of_record.is_empty() {
        // Nothing that was computed from it says anything.
        result.warnings.retain(|w| !of_record.contains(w));
        result.gap.attractor.clear();
        result.gap.forecasts.clear();
        result.prediction = None;
    }
    identify::stopped::tell_in(&mut result.warnings, records, rig);
    suspected::tell_in(&mut result, of_record.into_iter().chain(suspects).chain(known).collect());
    Ok(result)
}

/// Whether an option of the command line is wrong, which no fault of a record excuses.
fn is_of_option(e: &BadInput) -> bool {
    e.place.as_ref().is_some_and(|place| place.starts_with("--"))
}

/// Refuses a model of another rig before a record is looked at; that of a system of one's own is
/// compared with its equations later, by an error of the option.
fn check_model(rig: &Rig, model: Option<&IdentifiedModel>) -> Result<()> {
    let Some(model) = model.filter(|_| rig.bound.is_none()) else { return Ok(()) };
    match rig.pendulum() {
        Some(Pendulum::Single) => single_pendulum::own(model, rig).map(drop),
        _ => double_pendulum::own(model, rig).map(drop),
    }
}

/// Explains records of a system: what is built in as the file that it stands for.
fn any_system(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Explanation> {
    match (&rig.bound, rig.pendulum()) {
        (Some(bound), _) => {
            engine::explain(records, rig, bound, settings).map(|r| r.unwrap_or_else(decidability::unplaced))
        }
        (None, Some(Pendulum::Single)) => single_pendulum::explain(records, rig, settings),
        (None, _) => double_pendulum::explain(records, rig, settings),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::explain::explanation::Found;
    use crate::model::identified::System;
    use crate::record::{Column, Segment};

    #[test]
    fn slips_are_taken_back_where_that_says_no_more_with_more() {
        let with = |verdict, effects: &[&str]| {
            let mut out = Explanation::new(0.2, Vec::new());
            out.verdict = verdict;
            out.effects = effects.iter().map(|id| Found::empty(id, "joint", "N m".to_owned())).collect();
            out
        };
        let drag = with(Verdict::Explained, &["quadratic-drag"]);
        let offset = with(Verdict::Explained, &["constant-force", "quadratic-drag"]);
        let open = with(Verdict::Unexplained, &[]);
        assert!(says_more(&drag, &offset) && says_more(&drag, &open));
        assert!(!says_more(&drag, &drag) && !says_more(&offset, &drag) && !says_more(&open, &offset));
    }

    /// A record at fault excuses what it spoils, and no model of another rig.
    #[test]
    fn a_wrong_option_is_told_of_a_record_at_fault() {
        let rig = Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/seed.toml")).unwrap();
        let columns = vec![Column::Counts(vec![0; 100]); rig.channel.len()];
        let segment = Segment::new(0.0, 1.0 / rig.sample_rate_hz, columns);
        let warnings = vec![Warning::new("at-fault", "it is at fault", "Record again").invalidating()];
        let record = Record { warnings, ..Record::of("r.csv", &rig, vec![segment]) };
        let model = IdentifiedModel {
            name: "another".to_owned(),
            system: System::BuiltIn("single-pendulum".to_owned()),
            method: "shooting".to_owned(),
            drive_frequency_hz: Some(5.0),
            nominal: Vec::new(),
            parameters: Vec::new(),
            effects: Vec::new(),
            found_with: Default::default(),
        };
        let found = explain(std::slice::from_ref(&record), &rig, &Settings::default()).unwrap();
        assert_eq!(found.verdict, Verdict::NotDecidable);
        let settings = Settings { model: Some(model), ..Settings::default() };
        let e = explain(&[record], &rig, &settings).unwrap_err();
        assert!(e.found.contains("single-pendulum") && e.remedy.contains("Give a model"), "{e}");
        assert!(is_of_option(&BadInput::new("-1", "seconds").at("--horizon")));
        assert!(!is_of_option(&BadInput::new("3 s", "a longer record").in_file("r.csv").at("row 4")));
    }
}

//! `whirl capture --plan`: one planned record after the other, until what was asked is decided.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::Serialize;

use super::Answer;
use super::capture::{Arguments, end_on_signals, files, from_simulated, human, settings_of};
use super::output::print_warnings;
use super::progress;
use crate::capture::estimates::unfit;
use crate::capture::precision::Until;
use crate::capture::{CaptureOutcome, CaptureSettings, run as capture};
use crate::error::Result;
use crate::explain::{Found, Settings as ExplainSettings, Verdict, explain};
use crate::plan::presentation;
use crate::plan::written::{PlanFile, Run};
use crate::record::writer::check_ending;
use crate::record::{ReadOptions, Record};
use crate::rig::Rig;
use crate::warning::Warning;

/// A run that was made.
#[derive(Serialize)]
struct Made {
    record: PathBuf,
    planned: Run,
    capture: CaptureOutcome,
    /// Effects that the record shows, `ID@PLACE`; none where nothing was asked of effects.
    effects: Vec<String>,
    /// Whether that decides what was asked.
    decided: bool,
}

/// All of them.
#[derive(Serialize)]
struct Summary {
    runs: Vec<Made>,
    decided: bool,
}

/// The record of a run: REC-1.parquet, REC-2.parquet …; REC itself where there is one only.
fn path_of(output: &Path, index: usize, count: usize) -> PathBuf {
    if count == 1 {
        return output.to_path_buf();
    }
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let extension = output.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    output.with_file_name(format!("{stem}-{}{extension}", index + 1))
}

/// Effects that a record shows, and whether they tell those that were asked for: one of them is
/// found, and no other of them could stand in its place.
fn effects_shown(record: &Path, rig: &Rig, tell: &[String]) -> Result<(Vec<String>, bool)> {
    if tell.is_empty() {
        return Ok((Vec::new(), false));
    }
    let records = [Record::read(record, rig, &ReadOptions::default())?];
    let found = progress::during("looking for what was asked", || explain(&records, rig, &ExplainSettings::default()))?;
    let clear =
        |e: &Found| tell.contains(&e.name()) && !e.indistinguishable_from.iter().any(|other| tell.contains(other));
    let decided = found.verdict != Verdict::NotDecidable && found.effects.iter().any(clear);
    Ok((found.effects.iter().map(Found::name).collect(), decided))
}

/// What ends a run before its time: one parameter, and nothing beside it, that the device itself
/// identifies. Further goals take the planned time, which is reckoned for all of them.
fn until(plan: &PlanFile, device_knows: bool) -> Option<Until> {
    match (&plan.tell[..], &plan.precise[..]) {
        ([], [one]) if device_knows => one.parse().ok(),
        _ => None,
    }
}

/// Captures what was planned.
pub fn run(arguments: &Arguments, path: &Path) -> Result<Answer> {
    let rig = Rig::read(&arguments.rig)?;
    let plan = PlanFile::read(path)?;
    let until = until(&plan, unfit(&rig).is_none());
    let count = plan.run.len();
    // Everything that can be refused is refused before the rig moves.
    let mut steps = Vec::new();
    for (index, run) in plan.run.iter().enumerate() {
        let mut own = arguments.clone();
        own.output = path_of(&arguments.output, index, count);
        let rig = run.rig(&rig).map_err(|e| e.in_file(path))?;
        files(&own, &rig).reads([path]).check()?;
        check_ending(&own.output)?;
        steps.push((own, rig, run));
    }
    let stop = Arc::new(AtomicBool::new(false));
    end_on_signals(&stop)?;
    let mut summary = Summary { runs: Vec::new(), decided: false };
    for (own, rig, run) in steps {
        let settings = CaptureSettings {
            seconds: Some(run.seconds),
            amplitude_m: run.amplitude_m,
            until: until.clone(),
            ..settings_of(&own, stop.clone())
        };
        let setting = run.setting().on(&rig);
        let lasting = presentation::lasting(&setting, run.seconds);
        arguments.out.say(&format!("{}, {lasting}\n", presentation::setting(&setting)));
        let progress = &mut *progress::of_capture();
        let outcome = if own.effects.is_empty() {
            capture(&settings, &rig, progress)?
        } else {
            from_simulated(&settings, &rig, &own.effects, progress)?
        };
        print_warnings(&outcome.warnings);
        arguments.out.say(&human(&outcome));
        let (effects, clear) = effects_shown(&own.output, &rig, &plan.tell)?;
        // What was not measured on the way is not decided.
        let precise = plan.precise.is_empty() || outcome.until.as_ref().is_some_and(|u| u.reached);
        let decided = (plan.tell.is_empty() || clear) && precise && !(plan.tell.is_empty() && plan.precise.is_empty());
        if !plan.tell.is_empty() {
            let found = if effects.is_empty() { "no effect".to_owned() } else { effects.join(", ") };
            let what = if clear { "told apart" } else { "not told apart" };
            arguments.out.say(&format!("this record shows {found}; {}: {what}\n", plan.tell.join(", ")));
        }
        summary.runs.push(Made {
            record: own.output.clone(),
            planned: run.clone(),
            capture: outcome,
            effects,
            decided,
        });
        summary.decided = decided;
        if decided || stop.load(Ordering::Relaxed) {
            break;
        }
    }
    let warnings: Vec<Warning> = summary.runs.iter().flat_map(|r| r.capture.warnings.clone()).collect();
    arguments.out.write_json_with(&summary, &warnings)?;
    let asked = !plan.tell.is_empty() || !plan.precise.is_empty();
    if asked && !summary.decided {
        crate::error::tell("what was asked is not decided by these records");
    }
    Ok(if asked && !summary.decided { Answer::Negative } else { Answer::Positive })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_ends_early_for_the_only_goal() {
        let plan = |goals: &str| toml::from_str::<PlanFile>(&format!("format = 1\nrig = \"x\"\n{goals}")).unwrap();
        let one = plan("precise = [\"C2=1%\"]");
        assert!(until(&one, true).is_some() && until(&one, false).is_none());
        for goals in ["precise = [\"C2=1%\", \"C11=1%\"]", "precise = [\"C2=1%\"]\ntell = [\"play@joint1\"]"] {
            assert!(until(&plan(goals), true).is_none(), "{goals}");
        }
    }
}

//! `whirl validate`: whether an identified model moves as the measured system does.

use std::path::PathBuf;

use clap::Args;

use super::Judgement;
use super::single::{Analysed, Common, Named, Single};
use crate::batch::answers;
use crate::batch::row::Row;
use crate::error::Result;
use crate::model::identified::IdentifiedModel;
use crate::model::refused;
use crate::record::Record;
use crate::report::Results;
use crate::report::card::Card;
use crate::rig::Rig;
use crate::validate::card::card;
use crate::validate::{Settings, Supplements, Validation, Verdict, presentation, validate};
use crate::warning::Warning;

/// Arguments of `validate`.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    common: Common,
    /// Identified model, by `identify -o` or `explain -o`.
    #[arg(long, value_name = "MODEL.toml")]
    model: PathBuf,
    /// Free vibration of the same arms, for the natural frequencies.
    #[arg(long, value_name = "REC")]
    free: Option<PathBuf>,
    /// Angle by which a prediction may be off, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 30.0)]
    tolerance_deg: f64,
    /// Most starts of predictions.
    #[arg(long, value_name = "N", default_value_t = 60)]
    starts: usize,
    /// Seed of the noise in the model's own records.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Length of a window, s, as `identify` has it [default: 20 drive periods, or 10 of the motion when
    /// free].
    #[arg(long, value_name = "S")]
    window_s: Option<f64>,
    /// Bifurcation diagram over a factor on a parameter (drive: on all of the base's motion), such
    /// as drive=0.5:1.5.
    #[arg(long, value_name = "NAME=LOW:HIGH", value_parser = range)]
    bifurcation: Option<(String, f64, f64)>,
}

/// Greatest factor of a bifurcation diagram: a motion a hundred times as fast is still integrated
/// in its time.
const MOST_TIMES: f64 = 100.0;

/// NAME=LOW:HIGH.
fn range(text: &str) -> std::result::Result<(String, f64, f64), String> {
    let parse = || {
        let (name, ends) = text.split_once('=')?;
        let (low, high) = ends.split_once(':')?;
        Some((name.to_owned(), low.parse().ok()?, high.parse().ok()?))
    };
    let (name, low, high): (String, f64, f64) =
        parse().ok_or_else(|| format!("\"{text}\" is not NAME=LOW:HIGH, such as drive=0.5:1.5"))?;
    match [low, high].iter().find(|f| !(-MOST_TIMES..=MOST_TIMES).contains(*f)) {
        None => Ok((name, low, high)),
        Some(f) => Err(format!("{f:e} is not a factor from -{MOST_TIMES} to {MOST_TIMES}")),
    }
}

/// What a validation needs beside the records.
pub struct Ready {
    rig: Rig,
    model: IdentifiedModel,
    free: Option<Record>,
    settings: Settings,
}

impl AsRef<Rig> for Ready {
    fn as_ref(&self) -> &Rig {
        &self.rig
    }
}

impl Single for Arguments {
    const NAME: &'static str = "validate";
    const HEADING: &'static str = "Validation";
    type Ready = Ready;
    type Result = Validation;

    fn common(&self) -> &Common {
        &self.common
    }

    fn common_mut(&mut self) -> &mut Common {
        &mut self.common
    }

    fn reads(&self) -> Vec<Named<'_>> {
        let free = self.free.iter().map(|path| ("free vibration", path.as_path()));
        free.chain([("model file", self.model.as_path())]).collect()
    }

    fn seed(&self) -> Option<u64> {
        Some(self.seed)
    }

    fn prepare(&self, rig: Rig) -> Result<Ready> {
        let model = IdentifiedModel::read(&self.model)?;
        refused::other_system(&model, &self.model, &rig)?;
        let free_rig = Rig { drive: None, ..rig.clone() };
        let options = self.common.records.options();
        let free = self.free.as_ref().map(|path| Record::read(path, &free_rig, &options)).transpose()?;
        let settings = Settings {
            tolerance_deg: self.tolerance_deg,
            starts: self.starts,
            seed: self.seed,
            window_s: self.window_s,
            bifurcation: self.bifurcation.clone(),
        };
        Ok(Ready { rig, model, free, settings })
    }

    fn analyse(&self, ready: &Ready) -> Result<Analysed<Validation>> {
        let records = self.common.records.read_for(&ready.rig)?;
        let bar = super::progress::bar("validating", 0);
        let supplements = Supplements { free: ready.free.as_ref(), inspection: None, progress: Some(&bar) };
        let result = validate(&records, &ready.rig, &ready.model, supplements, &ready.settings).map_err(|e| {
            // What is wrong in the model has no file yet; records and rig name theirs.
            if e.place.as_deref().is_some_and(|p| p.starts_with("--")) { e } else { e.in_file(&self.model) }
        })?;
        bar.finish_and_clear();
        Ok(Analysed { records, result: Ok(result) })
    }

    fn warnings(result: &Validation) -> &[Warning] {
        &result.warnings
    }

    fn judge(&self, result: &Validation, lost: u64) -> Judgement {
        if result.verdict == Verdict::Failed {
            return Judgement::negative(Some("the model fails its validation".to_owned()));
        }
        self.stands(result, lost)
    }

    fn card(ready: &Ready, result: &Validation) -> Card {
        card(result, &ready.model, &ready.rig)
    }

    fn human(result: &Validation, card: &Card) -> String {
        format!("{}\nWhat it rests on\n{}", card.text(), presentation::human(result))
    }

    fn show(_ready: &Ready, _records: &[Record], result: &Validation, into: &mut Results) -> Result<()> {
        into.add(result.clone());
        Ok(())
    }

    fn cells(row: &mut Row, result: &Validation) {
        answers::validation(row, result);
    }
}

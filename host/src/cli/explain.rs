//! `whirl explain`: where simulation and measurement disagree, which effect is missing, the gap
//! before and after.

use std::path::PathBuf;

use clap::Args;

use super::identify::WeakForm;
use super::single::{Analysed, Common, Named, Single};
use super::{Judgement, progress};
use crate::batch::answers;
use crate::batch::row::Row;
use crate::error::{BadInput, Result};
use crate::explain::card::card;
use crate::explain::{Explanation, Settings, Verdict, explain, ledger, presentation};
use crate::files::write_file;
use crate::model::identified::IdentifiedModel;
use crate::model::refused;
use crate::record::Record;
use crate::report::Results;
use crate::report::card::Card;
use crate::rig::Rig;
use crate::warning::Warning;

/// Arguments of `explain`.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    common: Common,
    /// Horizon of the gap, s [default: one drive period; when free 0.2 s, within an eighth and twenty
    /// of the motion's periods].
    #[arg(long, value_name = "S")]
    horizon: Option<f64>,
    /// Horizons at which the last 30 % of the record is predicted after fitting the first 70 %, s
    /// [default: 1 and 4 of the gap's; 0.2 and 2.667 when free].
    #[arg(long, value_name = "S", value_delimiter = ',')]
    forecast: Vec<f64>,
    #[command(flatten)]
    weak: WeakForm,
    /// Most effects that are added [default: 8].
    #[arg(long, value_name = "N")]
    most_effects: Option<usize>,
    /// Start from this model, as `whirl identify -o` or an earlier `explain -o` wrote it, instead
    /// of the rig file's nominal one.
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    /// Look for the effects of this file too (docs/effects.md); may be given several times.
    #[arg(long, value_name = "FILE.toml")]
    effects: Vec<PathBuf>,
    /// Write the model with its effects here.
    #[arg(short, long, value_name = "MODEL.toml")]
    output: Option<PathBuf>,
    /// Write everything that is needed to audit and repeat the answer here, as JSON.
    #[arg(long, value_name = "FILE")]
    ledger: Option<PathBuf>,
}

/// What an explanation needs beside the records.
pub struct Ready {
    rig: Rig,
    settings: Settings,
}

impl AsRef<Rig> for Ready {
    fn as_ref(&self) -> &Rig {
        &self.rig
    }
}

impl Single for Arguments {
    const NAME: &'static str = "explain";
    const HEADING: &'static str = "Explanation";
    type Ready = Ready;
    type Result = Explanation;

    fn common(&self) -> &Common {
        &self.common
    }

    fn common_mut(&mut self) -> &mut Common {
        &mut self.common
    }

    fn writes(&self) -> Vec<Named<'_>> {
        let model = self.output.iter().map(|path| ("-o", path.as_path()));
        model.chain(self.ledger.iter().map(|path| ("--ledger", path.as_path()))).collect()
    }

    fn reads(&self) -> Vec<Named<'_>> {
        let model = self.model.iter().map(|path| ("model file", path.as_path()));
        model.chain(self.effects.iter().map(|path| ("effect file", path.as_path()))).collect()
    }

    fn prepare(&self, mut rig: Rig) -> Result<Ready> {
        for file in &self.effects {
            rig.add_effects(file)?;
        }
        for h in &self.forecast {
            if !(h.is_finite() && *h > 0.0 && *h <= 1e4) {
                return Err(BadInput::new(h.to_string(), "seconds above 0 (at most 10 000)").at("--forecast"));
            }
        }
        let model = self.model.as_ref().map(|p| IdentifiedModel::read(p)).transpose()?;
        if let (Some(model), Some(path)) = (&model, &self.model) {
            refused::other_system(model, path, &rig)?;
        }
        let settings = Settings {
            horizon_s: self.horizon,
            forecast_s: self.forecast.clone(),
            weak: self.weak.settings(),
            most_effects: self.most_effects,
            model,
        };
        Ok(Ready { rig, settings })
    }

    fn analyse(&self, ready: &Ready) -> Result<Analysed<Explanation>> {
        let records = self.common.records.read_for(&ready.rig)?;
        let work = || explain(&records, &ready.rig, &ready.settings);
        let result = progress::during("looking for the effect that is missing", work);
        Ok(Analysed { records, result })
    }

    fn warnings(result: &Explanation) -> &[Warning] {
        &result.warnings
    }

    fn judge(&self, result: &Explanation, lost: u64) -> Judgement {
        if result.verdict == Verdict::NotDecidable {
            // The answer itself says why.
            let model = self.output.as_ref().filter(|_| result.model.is_none());
            return Judgement::negative(
                model.map(|p| {
                    format!("{} was not written: as long as nothing is decided there is no model", p.display())
                }),
            );
        }
        self.stands(result, lost)
    }

    fn card(ready: &Ready, result: &Explanation) -> Card {
        card(result, &ready.rig)
    }

    fn human(result: &Explanation, card: &Card) -> String {
        presentation::human(result, card)
    }

    fn write(&self, ready: &Ready, records: &[Record], result: &Explanation) -> Result<()> {
        if let (Some(path), Some(model)) = (&self.output, &result.model) {
            model.write(path)?;
        }
        let Some(path) = &self.ledger else { return Ok(()) };
        let text = format!("{:#}\n", ledger::ledger(records, &ready.rig, &ready.settings, result));
        write_file(path, text.as_bytes())
    }

    fn show(_ready: &Ready, _records: &[Record], result: &Explanation, into: &mut Results) -> Result<()> {
        into.add(result.clone());
        Ok(())
    }

    fn cells(row: &mut Row, result: &Explanation) {
        answers::explanation(row, result);
    }
}

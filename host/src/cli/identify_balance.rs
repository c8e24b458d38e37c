//! Options of `whirl identify --method frequency|upo`.

use std::collections::BTreeMap;

use clap::{Args, ValueEnum};

use crate::error::{BadInput, Result};
use crate::identify::ERROR_BOUND;
use crate::identify::harmonic_balance::settings::{
    Basis, Differentiation, EnergyBalance, Optimisation, Orbits, Settings, Subharmonics,
};
use crate::rig::Rig;
use crate::system::library::Pendulum;

/// Differentiation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Derivatives {
    /// Fourier series of the angle without its rotation.
    #[default]
    Fourier,
    /// Fourier series of exp(iθ).
    Circle,
    /// Five-point differences.
    FivePoint,
}

/// Second step for the dampings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Energy {
    /// The harmonic balance's dampings stand.
    #[default]
    None,
    /// Each equation by itself.
    Equations,
    /// Both equations together, coupling cancelled.
    Coupled,
}

/// Choices of the harmonic balance.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Harmonic balance (--method frequency or upo)")]
pub struct BalanceArguments {
    /// Length of a piece, drive periods (frequency) [default: 100; 60 for the single pendulum; less
    /// where the record is short].
    #[arg(long, value_name = "N")]
    piece_periods: Option<usize>,
    /// How closely an orbit must close, as a share of the angle's range (upo) [default: 0.05].
    #[arg(long, value_name = "E")]
    tolerance: Option<f64>,
    /// Longest period of an orbit, drive periods (upo) [default: 16].
    #[arg(long, value_name = "K")]
    longest_period: Option<usize>,
    /// Delay of the embedding, samples (upo) [default: first clear minimum of the average mutual
    /// information].
    #[arg(long, value_name = "SAMPLES")]
    delay: Option<usize>,
    /// Velocities and accelerations [default: fourier].
    #[arg(long, value_enum)]
    differentiation: Option<Derivatives>,
    /// Cut-off of the low-pass before products are formed, share of the sampling rate, or none
    /// [default: 0.2].
    #[arg(long, value_name = "SHARE|none", allow_negative_numbers = true)]
    low_pass: Option<String>,
    /// Sub-harmonics: up-to:F (times the drive's frequency), largest:N (a drive period, in the
    /// acceleration's spectrum), harmonics:N (of the drive's frequency alone) [default: up-to:1].
    #[arg(long, value_name = "SET")]
    subharmonics: Option<String>,
    /// Leaves the mean (j = 0) out.
    #[arg(long)]
    no_mean_row: bool,
    /// Keeps all sub-harmonics: no optimisation by residuals.
    #[arg(long)]
    no_optimisation: bool,
    /// In each round, rows whose residual is above 1 − B times the largest are dropped
    /// [default: 0.05].
    #[arg(long, value_name = "B")]
    beta: Option<f64>,
    /// Residual over the largest term, rms, at which the optimisation stops [default: 0.1].
    #[arg(long, value_name = "E")]
    error_bound: Option<f64>,
    /// Most rounds of the optimisation [default: 200].
    #[arg(long, value_name = "N")]
    rounds: Option<usize>,
    /// Function series of the single pendulum: harmonic:K or interpolation:N [default: harmonic:1].
    #[arg(long, value_name = "BASIS")]
    basis: Option<String>,
    /// A coefficient that is known, such as C11=1.02e-3 (may be given several times).
    #[arg(long = "known-coefficient", value_name = "NAME=VALUE")]
    known: Vec<String>,
    /// Dampings by the energy balance (without a value: coupled) [default: none].
    #[arg(long, value_enum, num_args = 0..=1, require_equals = true, default_missing_value = "coupled")]
    energy_balance: Option<Energy>,
}

/// `word` or `word:number`.
fn choice<'a>(option: &str, text: &'a str, words: &[&str], expected: &str) -> Result<(&'a str, Option<f64>)> {
    let (word, number) = text.split_once(':').map_or((text, None), |(w, n)| (w, Some(n)));
    let bad = || BadInput::new(format!("\"{text}\""), expected.to_owned()).at(option.to_owned());
    if !words.contains(&word) {
        return Err(bad());
    }
    let number = number.map(|n| n.parse::<f64>().map_err(|_| bad())).transpose()?;
    match number {
        Some(n) if !(n > 0.0 && n < 1e6) => Err(bad()),
        n => Ok((word, n)),
    }
}

impl BalanceArguments {
    /// The options that were given, and whether each is of long pieces (`frequency`) and of orbits
    /// (`upo`).
    pub fn given(&self) -> Vec<(&'static str, [bool; 2])> {
        let (pieces, orbits, both) = ([true, false], [false, true], [true, true]);
        let all = [
            ("--piece-periods", pieces, self.piece_periods.is_some()),
            ("--tolerance", orbits, self.tolerance.is_some()),
            ("--longest-period", orbits, self.longest_period.is_some()),
            ("--delay", orbits, self.delay.is_some()),
            ("--differentiation", both, self.differentiation.is_some()),
            ("--low-pass", both, self.low_pass.is_some()),
            ("--subharmonics", both, self.subharmonics.is_some()),
            ("--no-mean-row", both, self.no_mean_row),
            ("--no-optimisation", both, self.no_optimisation),
            ("--beta", both, self.beta.is_some()),
            ("--error-bound", both, self.error_bound.is_some()),
            ("--rounds", both, self.rounds.is_some()),
            ("--basis", both, self.basis.is_some()),
            ("--known-coefficient", both, !self.known.is_empty()),
            ("--energy-balance", both, self.energy_balance.is_some()),
        ];
        all.into_iter().filter(|o| o.2).map(|(option, of, _)| (option, of)).collect()
    }

    /// The settings, for orbits that close (`unstable`) or pieces of a record of so many drive
    /// periods unbroken.
    pub fn settings(&self, rig: &Rig, unstable: bool, longest: f64) -> Result<Settings> {
        let usual = if rig.pendulum() == Some(Pendulum::Single) { 60 } else { 100 };
        let orbits = if unstable {
            Orbits::Unstable {
                tolerance: self.tolerance.unwrap_or(0.05),
                longest: self.longest_period.unwrap_or(16),
                delay: self.delay,
            }
        } else {
            // At least eight pieces, if they are then still ten periods long.
            let short = ((longest / 8.0) as usize).clamp(10, usual);
            Orbits::Pieces { periods: self.piece_periods.unwrap_or(short) }
        };
        let low_pass = match self.low_pass.as_deref().unwrap_or("0.2") {
            "none" => None,
            text => Some(text.parse::<f64>().map_err(|_| {
                BadInput::new(format!("\"{text}\""), "a share of the sampling rate, or none").at("--low-pass")
            })?),
        };
        let expected = "up-to:F, largest:N or harmonics:N";
        let words = ["up-to", "largest", "harmonics"];
        let subharmonics =
            match choice("--subharmonics", self.subharmonics.as_deref().unwrap_or("up-to:1"), &words, expected)? {
                ("largest", n) => Subharmonics::Largest(n.unwrap_or(1.0) as usize),
                ("harmonics", n) => Subharmonics::Harmonics(n.unwrap_or(3.0) as usize),
                (_, f) => Subharmonics::UpTo(f.unwrap_or(1.0)),
            };
        let expected = "harmonic:K or interpolation:N";
        let basis = match choice(
            "--basis",
            self.basis.as_deref().unwrap_or("harmonic:1"),
            &["harmonic", "interpolation"],
            expected,
        )? {
            ("interpolation", n) => Basis::Interpolation(n.unwrap_or(8.0) as usize),
            (_, k) => Basis::Harmonic(k.unwrap_or(1.0) as usize),
        };
        let mut known = BTreeMap::new();
        for text in &self.known {
            let pair = text.split_once('=').and_then(|(n, v)| Some((n.trim(), v.trim().parse::<f64>().ok()?)));
            let Some((name, value)) = pair else {
                return Err(BadInput::new(format!("\"{text}\""), "NAME=VALUE").at("--known-coefficient"));
            };
            known.insert(name.to_owned(), value);
        }
        let optimisation = Optimisation {
            beta: self.beta.unwrap_or(0.05),
            bound: self.error_bound.unwrap_or(ERROR_BOUND),
            rounds: self.rounds.unwrap_or(200),
        };
        Ok(Settings {
            orbits,
            differentiation: match self.differentiation.unwrap_or_default() {
                Derivatives::Fourier => Differentiation::Fourier,
                Derivatives::Circle => Differentiation::Circle,
                Derivatives::FivePoint => Differentiation::FivePoint,
            },
            low_pass,
            subharmonics,
            mean_row: !self.no_mean_row,
            optimisation: (!self.no_optimisation).then_some(optimisation),
            basis,
            known,
            energy_balance: match self.energy_balance.unwrap_or_default() {
                Energy::None => EnergyBalance::None,
                Energy::Equations => EnergyBalance::Equations,
                Energy::Coupled => EnergyBalance::Coupled,
            },
        })
    }
}

/// What the harmonic balance has to say beside the parameters, for people.
pub fn human(account: &crate::identify::harmonic_balance::account::Account) -> String {
    use std::fmt::Write;
    let mut text = String::new();
    let mut periods: Vec<usize> = account.orbits.iter().map(|o| o.periods).collect();
    periods.sort_unstable();
    let shown: Vec<String> = periods.iter().take(24).map(ToString::to_string).collect();
    let more = if periods.len() > shown.len() { ", …" } else { "" };
    let _ = match account.delay {
        Some(delay) => writeln!(
            text,
            "{} distinct orbits of {} recurrences (T_d {delay} samples), periods {}{more}",
            periods.len(),
            account.recurrences,
            shown.join(", ")
        ),
        None => writeln!(text, "{} pieces of {} drive periods", periods.len(), periods.first().unwrap_or(&0)),
    };
    for (i, e) in account.equations.iter().enumerate() {
        if let (Some(first), Some(last)) = (e.trail.rounds.first(), e.trail.rounds.last()) {
            let _ = write!(
                text,
                "equation {}: ε {:.1} % with {} rows, {:.1} % with {} after {} rounds{}",
                i + 1,
                100.0 * first.error,
                first.rows,
                100.0 * last.error,
                last.rows,
                e.trail.rounds.len() - 1,
                if e.trail.reached { "" } else { ": the bound is not reached" }
            );
            let _ = match &e.held_out {
                Some(h) => writeln!(
                    text,
                    "; on orbits left out {:.1} % from all rows, {:.1} % from those kept (rms residual {:.2} %, {:.2} %)",
                    100.0 * h.plain[0],
                    100.0 * h.optimised[0],
                    100.0 * h.plain[1],
                    100.0 * h.optimised[1]
                ),
                None => writeln!(text),
            };
        }
    }
    if !account.before_energy_balance.is_empty() {
        let list: Vec<String> = account
            .before_energy_balance
            .iter()
            .map(|(n, v)| format!("{n} {}", crate::wording::format::significant(*v, 4)))
            .collect();
        let _ = writeln!(text, "dampings are the energy balance's; the harmonic balance had {}", list.join(", "));
    }
    text
}

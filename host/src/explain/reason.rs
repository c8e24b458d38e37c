//! Why a verdict is what it is. Results hold it as data, which the rest of the program matches on;
//! its words are made here and nowhere else.

use core::fmt::{self, Display, Formatter};

use serde::{Serialize, Serializer};

use super::engine::changed::Changed;
use super::engine::unknown::Unknown;
use super::gap::Miss;
use crate::wording::format::{rounded, rounded_up, shortest, significant};

/// What is told of a shape that has no name.
const NAMELESS: &str = "no effect of the list accounts for it";

/// What is compared with a limit above which something is left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// The gap over a horizon, noise floors.
    Gap {
        /// Horizon, s.
        horizon_s: f64,
    },
    /// Power of what is left over that of the noise.
    Power,
    /// The same of one simulation of the whole record.
    PowerOfWhole,
    /// What a shape without a name gains where it was not fitted, standard errors.
    Shape,
    /// Effects that together are one shape.
    Pieces,
}

/// A horizon as every sentence tells it, and as `--horizon` takes it: `0.534`.
pub(super) fn seconds_of(horizon_s: f64) -> String {
    shortest(rounded(horizon_s, 4))
}

impl Display for Criterion {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gap { horizon_s } => write!(f, "gap over {} s, noise floors", significant(*horizon_s, 4)),
            Self::Power => f.write_str("power of what is left over that of the sensors' noise"),
            Self::PowerOfWhole => {
                f.write_str("power of what one simulation of the whole record leaves over that of the sensors' noise")
            }
            Self::Shape => f.write_str("gain of a shape without a name where it was not fitted, standard errors"),
            Self::Pieces => f.write_str("effects that together are one shape without a name"),
        }
    }
}

impl Serialize for Criterion {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

/// Why a verdict is what it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Reason {
    /// Nothing was judged yet.
    #[default]
    Unjudged,
    /// Nothing can be decided.
    Undecidable(Undecidable),
    /// Nothing but noise is left.
    Noise(Residual),
    /// More than noise is left.
    Excess {
        /// What is left.
        residual: Residual,
        /// Its shape, where one is clear.
        shape: Option<Unknown>,
        /// How it depends on time, where it does.
        changed: Option<Changed>,
    },
    /// What is left is within noise, but with a shape without a name the model predicts clearly
    /// better.
    Shape {
        /// What is left.
        residual: Residual,
        /// The shape.
        shape: Unknown,
    },
    /// Nothing but noise is left, but by effects that stand for one shape without a name.
    Patched {
        /// What is left.
        residual: Residual,
        /// The effects.
        patch: Patch,
    },
}

impl Display for Reason {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unjudged => Ok(()),
            Self::Undecidable(why) => why.fmt(f),
            Self::Noise(residual) => residual.fmt(f),
            Self::Excess { residual, changed: Some(changed), .. } => {
                write!(f, "{residual}; it depends on time: {}", changed.told())
            }
            Self::Excess { residual, shape: None, .. } => write!(f, "{residual}; {NAMELESS}"),
            Self::Excess { residual, shape: Some(shape), .. } => {
                write!(f, "{residual}; {}: {NAMELESS}", shape.told())
            }
            Self::Shape { residual, shape } => write!(f, "{residual}, but {}: {NAMELESS}", shape.told()),
            Self::Patched { residual, patch } => write!(f, "{residual}, but {patch}"),
        }
    }
}

impl Serialize for Reason {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

/// What a model leaves of a record, beside the sensors' noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// Power over that of the noise.
    pub power: f64,
    /// The same in records that the model itself makes, where it is held against theirs.
    pub own: Option<OwnRecords>,
    /// Horizon of the gap, s.
    pub horizon_s: f64,
    /// The gap.
    pub gap: Miss,
    /// A longer horizon, s, over which predictions miss by more than a right model's, and by how
    /// much.
    pub longer: Option<(f64, Miss)>,
    /// Power of what one simulation of the whole record leaves over that of the noise, and its
    /// limit, where this alone is above it.
    pub whole: Option<(f64, f64)>,
}

impl Display for Residual {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { power, horizon_s, gap, .. } = self;
        let power = if *power < 1000.0 { format!("{power:.2}") } else { significant(*power, 3) };
        write!(
            f,
            "what is left has {power} times the power that the sensors' noise gives, and predictions over {} s miss by {gap}",
            seconds_of(*horizon_s)
        )?;
        if let Some(own) = &self.own {
            own.fmt(f)?;
        }
        if let Some((horizon_s, miss)) = &self.longer {
            write!(f, ", over {} s by {miss}", seconds_of(*horizon_s))?;
        }
        if let Some((left, most)) = self.whole {
            let left = significant(left, 3);
            write!(
                f,
                ", but one simulation of the whole record leaves {left} times the noise's power (up to {most:.2} would be chance)"
            )?;
        }
        Ok(())
    }
}

/// Power of what is left in records that the model itself makes, over that of the noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnRecords {
    /// Its mean.
    pub mean: f64,
    /// How much would be chance.
    pub most: f64,
    /// Windows that cannot be followed even there, which are left out.
    pub left_out: usize,
}

impl Display for OwnRecords {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { mean, most, left_out } = self;
        write!(f, " (in records that the model itself makes it is {mean:.2}, and up to {most:.2} would be chance")?;
        match left_out {
            0 => {}
            1 => f.write_str("; one window that cannot be followed even there is left out")?,
            n => write!(f, "; {n} windows that cannot be followed even there are left out")?,
        }
        f.write_str(")")
    }
}

/// Several effects at a joint that stand for one shape of its position, or at a sensor for one bend
/// of its scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Joint or sensor.
    pub place: String,
    /// Effects.
    pub effects: Vec<String>,
    /// Whether it is a sensor's scale.
    pub is_bend: bool,
}

impl Display for Patch {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (place, effects) = (&self.place, self.effects.join(", "));
        if self.is_bend {
            return write!(
                f,
                "it took {effects} at {place} to get there, which nearly cancel: one bend of its scale that has no name \
                 in the list"
            );
        }
        write!(f, "it took {effects} to get there: one shape of {place}'s position that has no name in the list")
    }
}

/// Why nothing can be decided.
#[derive(Clone, Debug, PartialEq)]
pub enum Undecidable {
    /// The motion is locked to the drive.
    Locked,
    /// Predictions miss by more than the record itself moves.
    Diverged,
    /// The motion does not separate the nominal coefficients.
    Poor,
    /// No window of the record is followed.
    Unfollowed,
    /// There are too few windows to hold some back.
    FewWindows {
        /// Whether it is the balance of forces that they are too few for, as no trajectory of the
        /// record is followed.
        of_forces: bool,
        /// Whole windows.
        windows: usize,
        /// Length of each, s.
        window_s: f64,
        /// Least length of a record with enough of them, s; none where the motion is over.
        least_s: Option<f64>,
    },
    /// The equations have no place for an effect.
    Unplaced,
    /// What is left is far more than noise, and records that the model itself makes leave as much.
    OwnRecords {
        /// What is far above the noise.
        criterion: Criterion,
        /// Its value.
        value: f64,
        /// Measured inputs whose noise is why.
        inputs: Vec<String>,
    },
    /// The record or the rig file is at fault.
    Fault {
        /// What was noticed.
        text: String,
        /// What to do about it.
        advice: String,
    },
}

/// Why what cannot be followed decides nothing.
const UNFOLLOWED: &str = "the model follows no part of the record, so that nothing can be predicted: see `whirl inspect` for the channels, and check units and signs in the rig file";

/// What to do about a record of too few windows whose motion is over.
const OVER: &str = "the motion is over, and a longer record of it would tell no more. Record several releases, or with a higher sampling rate";

impl Display for Undecidable {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Locked => f.write_str(
                "the motion repeats (locked to the drive): one orbit cannot tell effects apart. Change the drive until the motion repeats no more, or record how it settles: `whirl plan` proposes settings",
            ),
            Self::Diverged => f.write_str(
                "the fit diverged: the model's predictions miss by more than the record itself moves, so that nothing follows from them. See `whirl inspect` for the channels, and check units and signs in the rig file",
            ),
            Self::Poor => f.write_str(
                "the motion does not visit enough of the state space: the nominal coefficients themselves are hardly separable",
            ),
            Self::Unfollowed => f.write_str(UNFOLLOWED),
            Self::FewWindows { of_forces, windows, window_s, least_s } => {
                if *of_forces {
                    write!(f, "{UNFOLLOWED}; for its forces ")?;
                }
                let few = if *windows == 1 { "window is" } else { "windows are" };
                let window_s = shortest(rounded(*window_s, 3));
                write!(f, "{windows} whole {few} too few to hold some back ({window_s} s each): ")?;
                match least_s {
                    Some(least_s) => write!(f, "record at least {} s", shortest(rounded_up(*least_s, 3))),
                    None => f.write_str(OVER),
                }
            }
            Self::Unplaced => f.write_str(
                "nothing can be predicted: that takes one equation for each coordinate, and an inertia in each",
            ),
            Self::OwnRecords { criterion, value, inputs } => {
                let value = significant(*value, 3);
                match criterion {
                    Criterion::Gap { .. } => write!(f, "predictions miss by {value} noise floors")?,
                    _ => {
                        write!(f, "what is left has {value} times the power of the sensors' noise")?;
                    }
                }
                if inputs.is_empty() {
                    return f.write_str(
                        ", and records that the model itself makes are no better: what is missing cannot be told from what the fit does not follow. Sample faster, or hold the model against a second record (`whirl validate`)",
                    );
                }
                let inputs = inputs.join(" and ");
                write!(
                    f,
                    ", and the noise of the measured {inputs} leaves about as much in records that the model itself makes: what is fainter cannot be told. Measure {inputs} with less noise"
                )
            }
            Self::Fault { text, advice } => write!(f, "{text}. {advice}"),
        }
    }
}

#[cfg(test)]
#[path = "reason_tests.rs"]
mod tests;

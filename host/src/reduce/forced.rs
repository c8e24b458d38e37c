//! The forced, damped response as `whirl reduce --force` tells it: [`super::forced_response`] with
//! its backbone and stability.
//!
//! M ẍ + c M ẋ + ∂V/∂x = F b cos Ωt. M: the system's where its equations are known, otherwise the
//! masses given (1 where none are). b: as given, otherwise the first proper orthogonal mode, of
//! unit length. c: as given, otherwise from the decays ([`super::damping`]). Along the curve from
//! the branch below the backbone to the one above, motion is stable where Ω rises: there the
//! determinant of the averaged equations is positive (their trace is −c); it changes its sign at
//! the folds.

use serde::Serialize;
use std::f64::consts::TAU;

use super::damping::{self, Damping};
use super::forced_response::{self, Forcing};
use super::polar::Polar;
use super::releases::Entry;
use super::systems::Mechanical;
use crate::error::{BadInput, Result};
use crate::warning::Warning;

/// Points of the backbone.
const BACKBONE: usize = 60;
/// Rms scatter of ln I from which damping is not of the form that is assumed.
const SCATTER: f64 = 0.02;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    /// F, in the unit of mass × coordinate/s².
    pub amplitude: f64,
    /// b, one number a channel.
    pub shape: Option<Vec<f64>>,
    /// c, 1/s.
    pub damping: Option<f64>,
}

/// A point of the response.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ResponsePoint {
    /// Frequency of the force, Hz.
    pub frequency_hz: f64,
    /// First harmonic of the major coordinate.
    pub amplitude: f64,
    /// Lag of the motion behind the force, rad.
    pub lag: f64,
    /// Whether the motion is stable (false at a fold itself).
    pub stable: bool,
}

/// The response.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Forced {
    /// F.
    pub amplitude: f64,
    /// b.
    pub shape: Vec<f64>,
    /// c, 1/s.
    pub damping: f64,
    /// What the decays say of it, where it comes from them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping_found: Option<Damping>,
    /// From the branch below the backbone over the greatest amplitude to the one above.
    pub curve: Vec<ResponsePoint>,
    /// Where the frequency turns.
    pub folds: Vec<ResponsePoint>,
    /// The point of greatest amplitude; none where it lies beyond the model's range.
    pub peak: Option<ResponsePoint>,
    /// Free motion, [frequency in Hz, amplitude].
    pub backbone: Vec<[f64; 2]>,
}

/// The response of a polar model; `mode` is the first proper orthogonal one.
///
/// # Errors
/// A force or a damping out of range, no damping known, a force that does not move the mode or is
/// too weak for any amplitude of the range.
pub fn make(
    force: &Force,
    polar: &Polar,
    mode: &[f64],
    entries: &[Entry],
    system: Option<&dyn Mechanical>,
    masses: Option<&[f64]>,
    warnings: &mut Vec<Warning>,
) -> Result<Forced> {
    let shape = force.shape.clone().unwrap_or_else(|| mode.to_vec());
    let found = if force.damping.is_none() { damping::of_decays(polar, entries, system, masses) } else { None };
    let Some(damping) = force.damping.or(found.map(|d| d.value).filter(|c| *c > 0.0)) else {
        return Err(BadInput::new(
            "no decay to take the damping from",
            "a damping, or records of decays of 12 periods or more",
        )
        .at("--damping")
        .remedy("Give --damping C in 1/s (twice the damping ratio times the angular frequency)"));
    };
    if let Some(d) = found.filter(|d| d.scatter > SCATTER) {
        warnings.push(Warning::new(
            "damping-form",
            format!(
                "the decays depart by {:.1} % (rms) from damping in proportion to velocity and mass",
                100.0 * d.scatter
            ),
            "Amplitudes near the peak are uncertain by as much; give --damping for the amplitudes that matter",
        ));
    }
    let forcing = Forcing { amplitude: force.amplitude, shape: shape.clone(), damping };
    let response = forced_response::response(polar, system, masses, &forcing);
    if response.curve.len() < 3 {
        return Err(BadInput::new(
            format!("a force of {} that holds no amplitude of the model's range", force.amplitude),
            "a force that moves the mode",
        )
        .at("--force")
        .remedy("Raise the force, lower the damping, or let the force act where the mode moves (--force-shape)"));
    }
    let omega = |i: usize| response.curve[i].omega;
    let last = response.curve.len() - 1;
    let point = |p: &forced_response::Point, stable| ResponsePoint {
        frequency_hz: p.omega / TAU,
        amplitude: p.amplitude,
        lag: p.lag,
        stable,
    };
    // Below and above the backbone apart: where the range ends before the peak, they do not meet.
    let side = |i: usize| response.curve[i].lag < 0.5 * std::f64::consts::PI;
    let curve: Vec<ResponsePoint> = (0..=last)
        .map(|i| {
            let from = if i > 0 && side(i - 1) == side(i) { i - 1 } else { i };
            let to = if i < last && (from == i || side(i + 1) == side(i)) { i + 1 } else { i };
            point(&response.curve[i], omega(to) > omega(from))
        })
        .collect();
    let greatest = curve.iter().max_by(|a, b| a.amplitude.total_cmp(&b.amplitude)).copied();
    let peak = greatest.filter(|p| p.amplitude < polar.range[1] * (1.0 - 1e-9));
    if peak.is_none() {
        warnings.push(Warning::new(
            "forced-beyond-range",
            format!(
                "the response goes on beyond the amplitude {:.4}, up to which the model may be used",
                polar.range[1]
            ),
            "Record releases of greater amplitude, or lower the force",
        ));
    }
    let high = greatest.map_or(polar.range[1], |p| p.amplitude);
    let low = curve.iter().map(|p| p.amplitude).fold(high, f64::min);
    let backbone = (0..=BACKBONE)
        .filter_map(|i| {
            let a = low + (high - low) * i as f64 / BACKBONE as f64;
            Some([polar.averages(system, masses, a)?.omega_squared.sqrt() / TAU, a])
        })
        .collect();
    let folds = response.folds.iter().map(|p| point(p, false)).collect();
    let amplitude = force.amplitude;
    Ok(Forced { amplitude, shape, damping, damping_found: found, curve, folds, peak, backbone })
}

/// Checks what was asked for.
///
/// # Errors
/// A force or damping that is not above 0, a shape of the wrong length or of zeros.
pub fn check(force: &Force, channels: usize) -> Result<()> {
    let above = |value: f64, name: &str| -> Result<()> {
        if value.is_finite() && value > 0.0 {
            return Ok(());
        }
        Err(BadInput::new(value.to_string(), "a number above 0").at(name))
    };
    above(force.amplitude, "--force")?;
    force.damping.map_or(Ok(()), |c| above(c, "--damping"))?;
    if let Some(shape) = &force.shape {
        if shape.len() != channels {
            let found = format!("{} numbers", shape.len());
            return Err(
                BadInput::new(found, format!("{channels}, one for each channel of the rig file")).at("--force-shape")
            );
        }
        if !shape.iter().all(|b| b.is_finite()) || shape.iter().all(|b| *b == 0.0) {
            return Err(BadInput::new(format!("{shape:?}"), "finite numbers, one of them not 0").at("--force-shape"));
        }
    }
    Ok(())
}

//! A drive's frequency from the motion alone: a line that stands over the whole record.
//!
//! What is locked to a drive makes a line as narrow as the record is long, whose phase goes on from
//! its beginning to its end, and which does not die away; a free motion's lines wander with its
//! amplitude. The equations of motion decide which of them is one ([`super::settle`]). Looked at
//! are the squares of the angles' velocities, which keep the line of a vertical drive in chaos (see
//! [`crate::inspect::drive_check`]), and the velocities themselves. Neither needs the angles'
//! scale.

use super::columns::{Kind, Seen};
use super::raw::{Raw, nice};
use super::{DraftDrive, Statement};
use crate::error::{BadInput, Result};
use crate::inspect::motion;
use crate::inspect::standing_line::{Line, dies_away, lines};
use crate::rig::{Direction, MOST_A_PERIOD, RATES};
use crate::wording::format::{shortest, significant};

/// Of those, how many may stand for a vertical drive, and for a horizontal one.
const MOST_EVEN: usize = 4;
const MOST_ODD: usize = 2;

/// What may drive a record.
#[derive(Debug, Default)]
pub(super) struct Drives {
    /// The drive whose phase the device recorded.
    pub known: Option<DraftDrive>,
    /// Drives that would make the lines of the motion's spectrum, the clearest lines first: the
    /// equations of motion decide.
    pub possible: Vec<DraftDrive>,
    /// Whether there may be one without a line.
    pub may_hide: bool,
}

/// The drive that a person names.
///
/// # Errors
/// A frequency that a record of this rate cannot have.
pub(super) fn told(hz: f64, rate_hz: f64) -> Result<Drives> {
    // What a rig file may have: see `rig::checks::drive`.
    let (least, most) = (RATES.start().max(rate_hz / MOST_A_PERIOD), rate_hz / 10.0);
    if hz != 0.0 && !(least..=most).contains(&hz) {
        let [least, most, rate] = [least, most, rate_hz].map(shortest);
        let expected = format!("0 (no drive), or {least} to {most} Hz, a tenth of the record's {rate} Hz");
        return Err(BadInput::new(format!("{hz}"), expected)
            .at("--drive-hz")
            .remedy("Say the frequency in Hz; a faster drive needs a record of a higher rate"));
    }
    let why = vec![
        Statement::new("drive", format!("{hz} Hz"), "--drive-hz says so"),
        Statement::new("drive", "vertical", "most drives of pendulums are").unsure(),
    ];
    let known = DraftDrive { direction: Direction::Vertical, frequency_hz: hz, why };
    Ok(Drives { known: (hz > 0.0).then_some(known), ..Drives::default() })
}

/// Looks for the drive of a record.
pub(super) fn find(raw: &Raw, seen: &[Seen]) -> Drives {
    if let Some(hz) = crate::inspect::drive_check::phase_frequency(&raw.record).filter(|f| *f > 0.0) {
        let why = Statement::new("drive", format!("{} Hz", nice(hz, 1e-7)), "the device recorded the drive's phase");
        let known = DraftDrive { direction: Direction::Vertical, frequency_hz: nice(hz, 1e-7), why: vec![why] };
        return Drives { known: Some(known), ..Drives::default() };
    }
    let Some(stretch) = (0..raw.record.segments.len()).max_by_key(|s| raw.record.segments[*s].len()) else {
        return Drives::default();
    };
    let rate = 1.0 / raw.record.segments[stretch].step_s;
    let angles = seen.iter().filter(|s| s.kind == Kind::Angle);
    let angles: Vec<Vec<f64>> = angles.filter_map(|s| Some(unwrapped(raw.values(s.index).get(stretch)?, s))).collect();
    // A free decay's own line is narrow enough, and a drive at it hides what the equations miss.
    if !angles.is_empty() && angles.iter().all(|x| dies_away(x)) {
        return Drives::default();
    }
    let velocities: Vec<Vec<f64>> = angles.iter().map(|x| x.windows(2).map(|w| w[1] - w[0]).collect()).collect();
    let squares: Vec<Vec<f64>> = velocities.iter().map(|v| v.iter().map(|v| v * v).collect()).collect();
    let even = lines(&squares, rate).into_iter().take(MOST_EVEN);
    let odd = lines(&velocities, rate).into_iter().take(MOST_ODD);
    let even = even.map(|l| of_line(&l, Direction::Vertical, "the square of the velocity has it"));
    // Under a horizontal drive the velocity has the drive's line.
    let odd = odd.map(|l| of_line(&l, Direction::Horizontal, "the velocity has it"));
    Drives { known: None, possible: even.chain(odd).collect(), may_hide: !angles.is_empty() }
}

/// The drive that a line would stand for.
fn of_line(line: &Line, direction: Direction, why: &str) -> DraftDrive {
    let f = nice(line.hz, 0.05 * line.resolution / line.hz);
    let phase = if line.stands { " stands over the whole record in one phase" } else { "" };
    let text = format!(
        "a line at {} Hz{phase} ({why}; {} standard deviations above its surroundings)",
        significant(line.hz, 6),
        significant(line.score, 2)
    );
    let (name, direction_why) = match direction {
        Direction::Horizontal => (
            "horizontal",
            "a motion that goes once to and fro in a drive period; a vertical drive of twice the frequency may do the same",
        ),
        Direction::Vertical => ("vertical", "a line in the square of the velocity is what a vertical drive leaves"),
    };
    let why =
        vec![Statement::new("drive", format!("{f} Hz"), text), Statement::new("drive", name, direction_why).unsure()];
    DraftDrive { direction, frequency_hz: f, why }
}

/// An angle with its turns undone: in rad where the column's turn is known, as it stands otherwise.
fn unwrapped(values: &[f64], seen: &Seen) -> Vec<f64> {
    let turn = match (seen.unit, seen.counts) {
        ("rad", _) => core::f64::consts::TAU,
        ("deg", _) => 360.0,
        (_, Some(n)) => f64::from(n),
        _ => f64::INFINITY,
    } / seen.factor.abs();
    if !turn.is_finite() {
        return values.to_vec();
    }
    let mut all = [values.iter().map(|x| x * core::f64::consts::TAU / turn).collect::<Vec<f64>>()];
    motion::unwrap_all(&mut all);
    let [x] = all;
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drive_that_is_told_is_one_that_a_rig_file_may_have() {
        for (hz, is_driven) in [(0.0, false), (20.0, true), (0.01, true)] {
            assert_eq!(told(hz, 200.0).unwrap().known.is_some(), is_driven, "{hz}");
        }
        for hz in [50.0, 150.0, -5.0, f64::NAN, 1e-5] {
            let e = told(hz, 200.0).err().unwrap().to_string();
            assert!(
                e.starts_with("--drive-hz: ") && e.contains("0.0002 to 20 Hz, a tenth of the record's 200 Hz"),
                "{e}"
            );
        }
    }
}

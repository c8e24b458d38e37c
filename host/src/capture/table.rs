//! `--table FILE`: one period of the base's displacement, made a spline for the device
//! ([`whirl_shared::excitation::Table`]).
//!
//! The spline goes through the points p_j: (c_{j−1} + 4 c_j + c_{j+1})/6 = p_j around the period, for
//! the control points c_j. The device's amplitude is that of the control points, so that none is
//! beyond it; it is r = max|c|/max|p| times the points' own, from 1 to 3, and less than 1.01 from
//! some 26 points a period of a sine on. Control points are rounded to 2⁻¹⁵ of that amplitude.

use std::path::Path;

use whirl_shared::excitation::{Excitation, POINTS, Table};

use crate::error::{BadInput, Result, plain};

/// Greatest displacement, m.
const GREATEST: f64 = 2.0;
/// Longest file, bytes.
const LONGEST: u64 = 1 << 16;
/// Each passage through the equations divides the error by two or more.
const PASSES: usize = 64;

/// A table that was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Read {
    pub(super) table: Table,
    /// Greatest displacement of the points, m.
    pub(super) peak_m: f64,
    /// Amplitude of the control points over that of the points.
    reach: f64,
}

impl Read {
    /// Reads a file of displacements, one a line, m; lines that begin with `#` and empty ones do not
    /// count.
    ///
    /// # Errors
    /// Names the line, what was found and what is expected.
    pub(super) fn of_file(path: &Path) -> Result<Self> {
        let file = std::fs::metadata(path).map_err(|e| BadInput::io(path, &e))?;
        let remedy = "Give the file one displacement a line, in metres: one period, equally spaced";
        if !file.is_file() || file.len() > LONGEST {
            let found = if file.is_file() { format!("{} bytes", file.len()) } else { "no regular file".to_owned() };
            let expected = format!("a text of {} to {} displacements", POINTS[0], POINTS[1]);
            return Err(BadInput::new(found, expected).in_file(path).at("--table").remedy(remedy));
        }
        let text = std::fs::read_to_string(path).map_err(|e| BadInput::io(path, &e).remedy(remedy))?;
        Self::of_text(&text).map_err(|e| e.in_file(path).remedy(remedy))
    }

    fn of_text(text: &str) -> Result<Self> {
        let mut points = Vec::new();
        for (line, n) in text.trim_start_matches('\u{feff}').lines().zip(1..) {
            let word = line.trim();
            if word.is_empty() || word.starts_with('#') {
                continue;
            }
            let value = word.parse::<f64>().ok().filter(|y| y.abs() <= GREATEST);
            let expected = format!("one displacement in metres, −{GREATEST} to {GREATEST}; headings begin with #");
            points.push(value.ok_or_else(|| BadInput::new(plain(word), expected).at(format!("line {n}")))?);
        }
        let last = text.lines().count();
        let [fewest, most] = POINTS;
        if !(fewest..=most).contains(&points.len()) {
            let found = format!("{} displacements", points.len());
            return Err(BadInput::new(found, format!("{fewest} to {most}")).at(format!("line {last}, the last one")));
        }
        Self::of(&points).ok_or_else(|| {
            BadInput::new("displacements that are all 0", "one that is not").at(format!("line {last}, the last one"))
        })
    }

    /// A table through points; none where all are 0.
    fn of(points: &[f64]) -> Option<Self> {
        let greatest = |values: &[f64]| values.iter().map(|y| y.abs()).fold(0.0, f64::max);
        let peak_m = greatest(points);
        let control = control_points(points);
        let most = greatest(&control);
        // The wire has micrometres.
        if peak_m < 1e-9 {
            return None;
        }
        // Within 16 bits: at most 32 767.
        let shares: Vec<i16> = control.iter().map(|c| (c / most * f64::from(i16::MAX)).round() as i16).collect();
        let reach = most / peak_m * 32_768.0 / 32_767.0;
        Table::of(&shares).map(|table| Self { table, peak_m, reach })
    }

    /// Moves the base by it: amplitudes were those of its points.
    pub(super) fn put_into(&self, excitation: &mut Excitation) {
        excitation.table = self.table.known().name;
        for micrometre in &mut excitation.amplitudes_micrometre {
            // At most 6 m.
            *micrometre = (f64::from(*micrometre) * self.reach).round() as u32;
        }
    }
}

/// The control points of the periodic cubic spline through points, by Gauss and Seidel.
fn control_points(points: &[f64]) -> Vec<f64> {
    let n = points.len();
    let mut control = points.to_vec();
    for _ in 0..PASSES {
        for j in 0..n {
            control[j] = (6.0 * points[j] - control[(j + n - 1) % n] - control[(j + 1) % n]) / 4.0;
        }
    }
    control
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(points: &[f64], amplitude_m: f64) -> f64 {
        let read = Read::of(points).unwrap();
        let mut excitation = Excitation::sine((amplitude_m * 1e6).round() as u32, 2_000);
        read.put_into(&mut excitation);
        let amplitude = excitation.amplitudes_micrometre[0] * 1_000;
        let away = points.iter().enumerate().map(|(j, p)| {
            let phase = ((j as u64) << 32).div_ceil(points.len() as u64) as u32;
            let y = f64::from(read.table.displacement(amplitude, phase)) * 1e-9;
            (y - p / read.peak_m * amplitude_m).abs()
        });
        away.fold(0.0, f64::max)
    }

    #[test]
    fn the_motion_goes_through_the_points() {
        let sine: Vec<f64> = (0..32).map(|j| 0.003 * (core::f64::consts::TAU * f64::from(j) / 32.0).sin()).collect();
        let square: Vec<f64> = (0..41).map(|j| if j < 20 { 1.0 } else { -0.4 }).collect();
        let hard: Vec<f64> = (0..8).map(|j| f64::from(1 - 2 * (j % 2))).collect();
        for points in [&sine[..], &square, &hard] {
            for amplitude in [0.001, 0.012] {
                // A micrometre of the amplitude and 2⁻¹⁶ of it, three times at most.
                let away = through(points, amplitude);
                assert!(away < 1.5e-6 + 5e-5 * amplitude, "{away}");
            }
        }
        let reach = |points: &[f64]| Read::of(points).unwrap().reach;
        assert!((1.0..1.01).contains(&reach(&sine)) && (2.99..3.01).contains(&reach(&hard)));
        assert_eq!(Read::of(&sine).unwrap().peak_m, 0.003);
    }

    #[test]
    fn a_file_is_read_or_refused_with_its_line() {
        let good = "\u{feff}# y, m\n0.001\n\n-2e-3\r\n0\n0\n0\n0\n0\n1e-3\n";
        assert_eq!(Read::of_text(good).unwrap().peak_m, 0.002);
        let zeros = "0\n".repeat(9);
        for (text, parts) in [
            ("", &["0 displacements", "8 to 256", "line 0"][..]),
            ("# only\n", &["0 displacements"]),
            ("0.1\n0.2\n", &["2 displacements", "line 2"]),
            ("0.1\n0.2\nnan\n", &["line 3", "nan", "in metres"]),
            ("inf\n", &["line 1", "inf"]),
            ("0.1\n\n3.5\n", &["line 3", "3.5", "−2 to 2"]),
            ("y_m\n0.1\n", &["line 1", "y_m", "begin with #"]),
            ("0.1,0.2\n", &["line 1", "0.1,0.2"]),
            (&zeros, &["all 0", "line 9"]),
            (&"0.1\n".repeat(257), &["257 displacements", "8 to 256", "line 257"]),
        ] {
            let error = Read::of_text(text).unwrap_err().to_string();
            assert!(parts.iter().all(|part| error.contains(part)), "{error} for {parts:?}");
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        for bytes in [&[0xff, 0xfe, 0x00][..], &[b'0'; 1 << 17], b"x\n"] {
            std::fs::write(&path, bytes).unwrap();
            let error = Read::of_file(&path).unwrap_err().to_string();
            assert!(error.contains("t.csv") && error.contains("one displacement a line"), "{error}");
        }
        let error = Read::of_file(dir.path()).unwrap_err().to_string();
        assert!(error.contains("no regular file"), "{error}");
        assert!(Read::of_file(&dir.path().join("none")).is_err());
    }
}

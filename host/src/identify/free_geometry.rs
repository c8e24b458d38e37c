//! Windows, test functions and low-pass of a free system, from where its motion lies in the
//! spectrum ([`crate::signal::band`]).
//!
//! With f_d the dominant frequency, f_99 below which lie 99 % of the acceleration's power, f_10 and
//! f_2 where the motion is ten times and twice the noise: windows of 10/f_d, shorter until there
//! are fourteen of them, not below 3/f_d; test functions up to max(f_99, min(√(f_99 f_10), 3.5
//! f_d), 1.5 f_d, 3/L); the low-pass up to max(1.15 min(f_2, 1.6 f_10), 1.5 of that), its reach a
//! tenth of the longest stretch at most. Measured inputs may excite a system far above its own
//! frequency: test functions then go up to where 99 % of the acceleration's power lie over the
//! white top of the band, f_10 at most, in windows of 30 of its periods (20/f_d and a fifth of the
//! record at most): on a measured positioning drive that gives mass, friction and offset within 0.4
//! % of the published ones. So nothing rests on seconds: a clock that runs a thousand times slower
//! gives the same windows in samples. The rule was set on 12 measured records and 12 simulated
//! systems in a prototype whose windows start every quarter; here they start every half, and are
//! therefore twice as many.

use super::geometry::{FEWEST_SAMPLES, PASS_OVER_END, PASS_OVER_TOP};
use crate::signal::band::{self, Band};

/// Periods of the dominant frequency in a window, as wished and at least.
const PERIODS: f64 = 10.0;
const FEWEST_PERIODS: f64 = 3.0;
/// Fewest frequencies of the test functions.
pub(super) const FEWEST_FREQUENCIES: f64 = 3.0;
/// Windows that a record should hold: half of them overlapping, they give the jackknife and the
/// folds of an explanation some 27 blocks.
const WINDOWS: f64 = 14.0;
/// Length of a window under measured inputs in periods of the highest test frequency.
const TRANSIENT: f64 = 30.0;
/// Fewest of them.
const FEWEST_TRANSIENTS: f64 = 5.0;
/// Reach of the low-pass times the width of its transition, and the share of the longest stretch
/// that it may take on either side.
const REACH: f64 = 4.0;
const MOST_REACH: f64 = 0.1;

/// Fewest whole windows in a record that gaps cut before shorter ones are taken: fewer decide
/// nothing.
const FEWEST_WINDOWS: f64 = 6.0;
/// Step by which they shorten.
pub(super) const SHORTEN: f64 = 0.95;

/// The window of a record that gaps cut: as wished where its stretches hold [`FEWEST_WINDOWS`], else
/// the longest of which they hold [`WINDOWS`], beside the low-pass's reach; as wished where there is
/// none.
pub(super) fn within_gaps(wished_s: f64, stretches_s: &[f64], rate: f64) -> f64 {
    let least_s = FEWEST_SAMPLES / rate;
    let reach_s = MOST_REACH * stretches_s.iter().fold(0.0, |a: f64, b| a.max(*b));
    let of = |stretch: &f64, length: f64| ((stretch - 2.0 * reach_s - length) / (0.5 * length)).floor() + 1.0;
    let held = |length: f64| stretches_s.iter().map(|s| of(s, length).max(0.0)).sum::<f64>();
    if stretches_s.len() < 2 || held(wished_s) >= FEWEST_WINDOWS {
        return wished_s;
    }
    let shorter = std::iter::successors(Some(wished_s), |l| Some(l * SHORTEN)).take_while(|l| *l >= least_s);
    shorter.into_iter().find(|l| held(*l) >= WINDOWS).unwrap_or(wished_s)
}

/// Samples of a short record: nine windows of [`FEWEST_SAMPLES`] have no room in less.
const SHORT: usize = 9 * FEWEST_SAMPLES as usize;

/// What is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choice {
    /// Length of a window, s.
    pub(super) length_s: f64,
    /// Highest test frequency, Hz.
    pub(super) top_hz: f64,
    /// Pass band, Hz.
    pub(super) pass_hz: f64,
}

/// What acts on the system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// Nothing.
    Free,
    /// Measured inputs, which may excite what lies far above the motion's own frequency: where 99 %
    /// of the acceleration's power lie over the white top of the band, Hz.
    WithInputs(f64),
}

impl Kind {
    /// Shares of the sampling rate that test functions and the pass band may take.
    pub(super) fn most(self) -> [f64; 2] {
        match self {
            Self::Free => [0.12, 0.3],
            Self::WithInputs(_) => [0.2, 0.4],
        }
    }
}

/// Chooses for a motion; `stretches_s` are the lengths of the unbroken stretches, `length_s` a
/// window that was asked for.
pub(super) fn choose(band: &Band, stretches_s: &[f64], rate: f64, length_s: Option<f64>, kind: Kind) -> Choice {
    let fd = band.dominant_hz;
    let whole: f64 = stretches_s.iter().sum();
    let [most_top, most_pass] = kind.most().map(|share| share * rate);
    // Not beyond where the motion stands clear of noise that falls with frequency.
    let excited = |white: f64| white.min(band.clear_end_hz).max(1.5 * fd).min(most_top);
    let wished = match kind {
        Kind::Free => (PERIODS / fd).min(whole / WINDOWS).max(FEWEST_PERIODS / fd),
        // Transients: short windows take all parts of them alike.
        Kind::WithInputs(white) => (TRANSIENT / excited(white)).min(2.0 * PERIODS / fd).min(whole / FEWEST_TRANSIENTS),
    };
    let length_s = length_s.unwrap_or_else(|| within_gaps(wished.max(FEWEST_SAMPLES / rate), stretches_s, rate));
    let f99 = band.acceleration_99_hz;
    let top_hz = match kind {
        Kind::Free => f99.max((f99 * band.clear_end_hz).sqrt().min(3.5 * fd)).max(1.5 * fd),
        Kind::WithInputs(white) => excited(white),
    };
    let top_hz = top_hz.max(FEWEST_FREQUENCIES / length_s).min(most_top);
    let pass_hz = (PASS_OVER_END * band.end_hz.min(1.6 * band.clear_end_hz)).max(PASS_OVER_TOP * top_hz).min(most_pass);
    Choice { length_s, top_hz, pass_hz }
}

/// Least width of the low-pass's transition, Hz: it reaches over a tenth of the longest stretch at
/// most.
pub(super) fn narrowest_hz(stretches_s: &[f64]) -> f64 {
    let longest = stretches_s.iter().fold(0.0_f64, |a, b| a.max(*b));
    REACH / (MOST_REACH * longest)
}

/// The band of several sensors: what holds all of them; each is an iterator over its stretches. Of
/// short records and slow motions from as many pieces as show one.
pub(super) fn band<'a, I: Iterator<Item = &'a [f64]> + Clone>(
    sensors: impl Iterator<Item = I> + Clone,
    step_s: f64,
) -> Option<Band> {
    let of = |averages| sensors.clone().filter_map(|s| band::of(s, step_s, averages)).reduce(Band::and);
    let any = || band::AVERAGES.into_iter().find_map(of);
    // An eighth of it holds few samples, and hardly ever three periods.
    let is_short = sensors.clone().next().is_some_and(|s| s.map(<[f64]>::len).sum::<usize>() < SHORT);
    let resolved = || sensors.clone().filter_map(|s| band::resolved(s, step_s)).reduce(Band::and);
    if is_short { resolved().or_else(any) } else { any() }
}

/// Period of the slowest of several sensors' motions, s.
pub(super) fn swing_s<'a, I: Iterator<Item = &'a [f64]> + Clone>(
    sensors: impl Iterator<Item = I>,
    step_s: f64,
) -> Option<f64> {
    sensors.filter_map(|s| band::resolved(s, step_s)).map(|b| 1.0 / b.dominant_hz).reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::METHODS;
    use crate::identify::geometry::DRIVE_PERIODS;

    #[test]
    fn what_is_listed_is_what_is_chosen() {
        let weak = METHODS.iter().find(|m| m.0 == "weak").unwrap().1;
        let told = format!("windows over {DRIVE_PERIODS} drive periods ({PERIODS} of the motion when free)");
        assert!(weak.contains(&told), "{weak}");
    }

    #[test]
    fn the_choice_scales_with_the_clock() {
        let band = Band { dominant_hz: 1.22, acceleration_99_hz: 1.71, clear_end_hz: 13.2, end_hz: 37.0 };
        let kind = Kind::Free;
        let one = choose(&band, &[36.7], 1000.0, None, kind);
        assert!((one.length_s - 36.7 / 14.0).abs() < 1e-12 && (one.top_hz - 4.27).abs() < 1e-9, "{one:?}");
        let slow = Band { dominant_hz: 1.22e-3, acceleration_99_hz: 1.71e-3, clear_end_hz: 13.2e-3, end_hz: 37.0e-3 };
        let other = choose(&slow, &[36.7e3], 1.0, None, kind);
        assert!((other.length_s / one.length_s / 1e3 - 1.0).abs() < 1e-12);
        assert!((other.top_hz / one.top_hz * 1e3 - 1.0).abs() < 1e-12);
        assert!((other.pass_hz / one.pass_hz * 1e3 - 1.0).abs() < 1e-12);
        // Three periods at least, whatever that leaves.
        assert!((choose(&band, &[5.0], 1000.0, None, kind).length_s - 3.0 / 1.22).abs() < 1e-12);
    }

    /// Five seconds of a camera: in an eighth of 160 samples a swing of 1.2 Hz looks like one of 2.8.
    #[test]
    fn a_short_record_has_the_band_of_its_motion() {
        let swing = |samples: usize| -> Vec<f64> {
            (0..samples).map(|i| i as f64 / 30.0).map(|t| (-0.3 * t).exp() * (7.5 * t).sin()).collect()
        };
        let (short, step_s) = (swing(160), 1.0 / 30.0);
        let of = |x: &[f64], averages| band::of(core::iter::once(x), step_s, averages).unwrap().dominant_hz;
        assert!(of(&short, 8) > 2.0);
        let found = band(core::iter::once(core::iter::once(&short[..])), step_s).unwrap();
        assert!((0.9..1.5).contains(&found.dominant_hz), "{found:?}");
        // A long one keeps its mean over eight pieces.
        let long = swing(400);
        let found = band(core::iter::once(core::iter::once(&long[..])), step_s).unwrap();
        assert_eq!(found.dominant_hz, of(&long, 8));
    }

    /// A camera that drops a frame in a hundred leaves stretches of less than a second.
    #[test]
    fn gaps_shorten_windows_only_where_hardly_any_would_be_whole() {
        let dropped: Vec<f64> = (0..24).map(|k| 0.4 + 0.1 * f64::from(k % 9)).collect();
        let length = within_gaps(2.13, &dropped, 120.0);
        assert!(length > 0.3 && length < 0.8, "{length}");
        for stretches in [&[20.0][..], &[12.0, 8.0], &[5.0]] {
            assert_eq!(within_gaps(2.13, stretches, 120.0), 2.13, "{stretches:?}");
        }
        // Too short for any: what is asked for stands, and is told.
        assert_eq!(within_gaps(2.13, &[0.2; 30], 120.0), 2.13);
    }
}

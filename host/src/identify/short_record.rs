//! Windows and low-pass of a free motion whose record is too short for what the motion asks for.
//!
//! The low-pass reaches over both ends of a stretch, the window takes what is left. So the low-pass
//! gives first: its pass band ends lower, down to 1.5 times the highest test frequency, as far as
//! its reach is a tenth of the longest stretch. Then the window shortens until one fits, to 32
//! samples at least; then test functions end lower, with three frequencies at least, as everywhere.
//! What does not fit even so takes some 64 samples. A window that is asked for stays as it is.

use super::Settings;
use super::free_geometry::{FEWEST_FREQUENCIES, SHORTEN, narrowest_hz};
use super::geometry::{Chosen, FEWEST_SAMPLES, LATEST_STOP, PASS_OVER_TOP};
use super::prepared::Geometry;
use super::windows::samples_needed;

/// What fits the longest of some stretches, the first of what comes nearest to the choice; the least
/// of all where nothing does.
pub(super) fn fitted(wished: &Chosen, settings: &Settings, stretches_s: &[f64]) -> Geometry {
    let whole = wished.geometry();
    let longest_s = stretches_s.iter().fold(0.0_f64, |a, b| a.max(*b));
    let samples = (longest_s / wished.step_s).round();
    let fits = |g: &Geometry| samples_needed(&g.windows, &g.kernels, wished.step_s) as f64 <= samples;
    if stretches_s.is_empty() || fits(&whole) {
        return whole;
    }
    let narrowest = narrowest_hz(stretches_s);
    let of = |length_s: f64, top_hz: f64| {
        let top_hz = settings.max_frequency_hz.unwrap_or_else(|| top_hz.max(FEWEST_FREQUENCIES / length_s));
        let least_hz = PASS_OVER_TOP * top_hz;
        let short_reach_hz = LATEST_STOP / wished.step_s - narrowest;
        let pass_hz = settings.pass_hz.unwrap_or_else(|| short_reach_hz.min(wished.pass_hz).max(least_hz));
        let narrowest_hz = wished.narrowest_hz.max(narrowest);
        Chosen { length_s, top_hz, pass_hz, narrowest_hz, ..*wished }.geometry()
    };
    let least_s = settings.window_s.unwrap_or(FEWEST_SAMPLES * wished.step_s);
    let longest = wished.length_s.min(longest_s).max(least_s);
    let lengths =
        || std::iter::successors(Some(longest), move |l: &f64| (*l > least_s).then(|| (SHORTEN * *l).max(least_s)));
    let all = [wished.top_hz, 0.0].into_iter().flat_map(|top_hz| lengths().map(move |l| (l, top_hz)));
    let mut last = whole;
    for (length_s, top_hz) in all {
        last = of(length_s, top_hz);
        if fits(&last) {
            break;
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 1.0 / 30.0;

    fn chosen() -> Chosen {
        // A camera's swing of 0.7 Hz as a band of one piece gives it.
        Chosen {
            step_s: STEP_S,
            length_s: 4.3,
            top_hz: 1.15,
            pass_hz: 2.6,
            clear_end_hz: 1.4,
            least_pass_hz: 4.5,
            narrowest_hz: 0.0,
            period_s: 1.4,
        }
    }

    fn needed(g: &Geometry) -> usize {
        samples_needed(&g.windows, &g.kernels, STEP_S)
    }

    #[test]
    fn a_window_is_as_long_as_a_short_record_allows() {
        let of = |samples: f64| fitted(&chosen(), &Settings::default(), &[samples * STEP_S]);
        assert_eq!(of(900.0).windows, chosen().geometry().windows);
        for samples in [70, 90, 130, 157] {
            let g = of(f64::from(samples));
            assert!(needed(&g) <= samples as usize, "{samples}: {}", needed(&g));
            // At least half of the record, but for what two reaches of the shortest take.
            let least = f64::from(samples - 38).max(0.5 * f64::from(samples));
            assert!(g.windows.length_s / STEP_S > 0.9 * least, "{samples}: {:?}", g.windows);
            assert!(g.windows.frequencies >= 3, "{samples}: {:?}", g.windows);
        }
        // Nothing fits: what is told is the least.
        let least = of(40.0);
        assert!((60..68).contains(&needed(&least)), "{}", needed(&least));
        assert!((least.windows.length_s / STEP_S - FEWEST_SAMPLES).abs() < 1e-9);
    }

    #[test]
    fn what_is_asked_for_stays() {
        let settings = Settings { window_s: Some(2.0), ..Settings::default() };
        let wide = Chosen { length_s: 2.0, top_hz: 3.0, pass_hz: 9.0, ..chosen() };
        let g = fitted(&wide, &settings, &[3.5]);
        assert!(g.windows.length_s == 2.0 && needed(&g) <= 105, "{}", needed(&g));
        assert!(needed(&wide.geometry()) > 105, "{}", needed(&wide.geometry()));
        let none = fitted(&wide, &settings, &[1.5]);
        assert!(none.windows.length_s == 2.0 && needed(&none) > 45);
    }
}

//! Axes: quantity and unit, scale, range, ticks.

use std::f64::consts::PI;

use crate::wording::format;

/// How values are laid along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By powers of ten; values of 0 or less are not drawn.
    Log,
    /// An angle wrapped to [−π, π], ticks at fractions of π.
    Angle,
}

/// An axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity and unit, `φ_{1} / rad`.
    pub label: String,
    /// Scale.
    pub scale: Scale,
    /// Range shown; from the data where there is none.
    pub range: Option<(f64, f64)>,
    /// Ticks of one's own: position and text.
    pub ticks: Option<Vec<(f64, String)>>,
}

/// An axis with its range fixed, in the coordinates that are drawn (logarithms on a log axis).
#[derive(Clone, Debug, PartialEq)]
pub struct Fixed {
    /// Scale.
    pub scale: Scale,
    /// From.
    pub low: f64,
    /// To, above `low`.
    pub high: f64,
    /// Ticks: drawn coordinate and text.
    pub ticks: Vec<(f64, String)>,
    /// Power of ten taken out of the tick texts, 0 for none.
    pub power: i32,
}

impl Axis {
    /// An axis of this scale that takes its range from the data.
    fn new(label: impl Into<String>, scale: Scale) -> Self {
        Self { label: label.into(), scale, range: None, ticks: None }
    }

    /// A linear axis.
    pub fn linear(label: impl Into<String>) -> Self {
        Self::new(label, Scale::Linear)
    }

    /// A logarithmic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Self::new(label, Scale::Log)
    }

    /// An axis for a wrapped angle.
    pub fn angle(label: impl Into<String>) -> Self {
        Self { range: Some((-PI, PI)), ..Self::new(label, Scale::Angle) }
    }

    /// The same with a range. On a log axis both ends must be above 0, otherwise the range is taken
    /// from the data.
    pub fn range(mut self, low: f64, high: f64) -> Self {
        let possible = low < high && (high - low).is_finite() && (self.scale != Scale::Log || low > 0.0);
        self.range = possible.then_some((low, high));
        self
    }

    /// Fixes range and ticks for the values that are to be drawn along `pixels`; `dense`: pixels a
    /// tick needs at least.
    pub fn fix<'a>(&self, values: impl Iterator<Item = &'a f64>, pixels: f64, dense: f64) -> Fixed {
        let drawn = |x: f64| if self.scale == Scale::Log { x.log10() } else { x };
        let (mut low, mut high) = match self.range {
            Some((low, high)) => (drawn(low), drawn(high)),
            None => {
                let (low, high) = values
                    .map(|&x| drawn(x))
                    .filter(|x| x.is_finite())
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
                if low > high { (0.0, 1.0) } else { (low, high) }
            }
        };
        // Sums of the ends must stay finite.
        (low, high) = (low.clamp(-1e300, 1e300), high.clamp(-1e300, 1e300));
        // All values alike (or nearly, so that ticks could not be told apart): a range about them.
        let size = low.abs().max(high.abs());
        if high - low <= 1e-9 * size || high <= low {
            let half = if size > 0.0 && self.scale != Scale::Log { 0.5 * size } else { 0.5 };
            (low, high) = (low - half, high + half);
        } else if self.range.is_none() {
            let margin = 0.04 * (high - low);
            (low, high) = (low - margin, high + margin);
        }
        let most = (pixels / dense).max(2.0);
        let (ticks, power) = match (&self.ticks, self.scale) {
            (Some(own), _) => (own.iter().map(|(x, t)| (drawn(*x), t.clone())).collect(), 0),
            (None, Scale::Linear) => linear_ticks(low, high, most),
            (None, Scale::Log) => (log_ticks(low, high, most), 0),
            (None, Scale::Angle) => (angle_ticks(low, high, most), 0),
        };
        // A record that starts at 1e-17 s has its tick at 0 all the same.
        let slack = 1e-6 * (high - low);
        let ticks = ticks.into_iter().filter(|(x, _)| (low - slack..=high + slack).contains(x));
        let ticks = ticks.map(|(x, text)| (x.clamp(low, high), text)).collect();
        Fixed { scale: self.scale, low, high, ticks, power }
    }
}

impl Fixed {
    /// The coordinate that is drawn; NaN for what cannot be or lies outside.
    pub fn place(&self, x: f64) -> f64 {
        let x = if self.scale == Scale::Log { x.log10() } else { x };
        let slack = 1e-9 * (self.high - self.low);
        if x >= self.low - slack && x <= self.high + slack { x } else { f64::NAN }
    }
}

/// Ticks at 1, 2 or 5 times a power of ten, at most about `most` (three where these fit in), and
/// the power of ten taken out.
fn linear_ticks(low: f64, high: f64, most: f64) -> (Vec<(f64, String)>, i32) {
    let steps = |rough: f64| {
        let e = 10f64.powf(rough.log10().floor());
        [1.0, 2.0, 5.0, 10.0].map(|m| m * e).into_iter().find(|s| *s >= 0.999 * rough).unwrap_or(rough)
    };
    let mut step = steps((high - low) / most);
    if (high / step).floor() - (low / step).ceil() < 2.0 {
        step = steps((high - low) / (1.6 * most));
    }
    let size = low.abs().max(high.abs());
    let power = if !(2e-3..1e5).contains(&size) { size.log10().floor() as i32 } else { 0 };
    let scale = 10f64.powi(power);
    let decimals = (-((step / scale).log10() + 1e-9).floor()).clamp(0.0, 12.0) as usize;
    // Ends that miss a tick by rounding alone still have it.
    let (first, last) = ((low / step - 1e-6).ceil(), (high / step + 1e-6).floor());
    let count = (last - first).clamp(0.0, 100.0) as usize;
    let ticks = (0..=count)
        .map(|i| {
            let x = (first + i as f64) * step;
            (x, format::fixed(x / scale, decimals))
        })
        .collect();
    (ticks, power)
}

/// Ticks at powers of ten (every one, or every second, third, …); within one decade at 1, 2, 5
/// times such.
fn log_ticks(low: f64, high: f64, most: f64) -> Vec<(f64, String)> {
    let text = |x: f64| {
        let e = x.log10().round() as i32;
        let power = (x / 10f64.powi(e) - 1.0).abs() < 1e-9;
        if power && !(-2..=3).contains(&e) { format::power_of_ten(e) } else { format::shortest(x) }
    };
    let decades = high - low;
    if decades < 1.5 {
        let (from, to) = (low.floor() as i32, high.ceil() as i32);
        let mantissas: &[f64] =
            if decades < 0.35 { &[1.0, 1.2, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0] } else { &[1.0, 2.0, 5.0] };
        return (from..=to)
            .flat_map(|e| mantissas.iter().map(move |m| m * 10f64.powi(e)))
            .map(|x| (x.log10(), text(x)))
            .collect();
    }
    let every = (decades / most).ceil().max(1.0) as i32;
    let (from, to) = (low.ceil() as i32, high.floor() as i32);
    // One way of writing for all of an axis.
    let plain = from >= -2 && to <= 3;
    let decade = |e: i32| if plain { text(10f64.powi(e)) } else { format::power_of_ten(e) };
    (from..=to).filter(|e| e.rem_euclid(every) == 0).map(|e| (f64::from(e), decade(e))).collect()
}

/// Ticks at multiples of π/4, π/2, π, … .
fn angle_ticks(low: f64, high: f64, most: f64) -> Vec<(f64, String)> {
    let quarters = [2.0, 4.0, 8.0, 16.0].into_iter().find(|q| (high - low) / (q * PI / 4.0) <= most).unwrap_or(32.0);
    let step = quarters * PI / 4.0;
    let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
    (first..=last.min(first + 50))
        .map(|k| {
            let halves = k * (quarters as i64) / 2;
            let sign = if halves < 0 { "−" } else { "" };
            let text = match halves.abs() {
                0 => "0".to_owned(),
                1 => format!("{sign}π/2"),
                2 => format!("{sign}π"),
                h if h % 2 == 0 => format!("{sign}{}π", h / 2),
                h => format!("{sign}{h}π/2"),
            };
            (k as f64 * step, text)
        })
        .map(|(x, t)| (x.clamp(low, high), t))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &Axis, values: &[f64], pixels: f64) -> Vec<String> {
        axis.fix(values.iter(), pixels, 70.0).ticks.into_iter().map(|t| t.1).collect()
    }

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(texts(&Axis::linear("t / s"), &[0.0, 120.0], 700.0), ["0", "20", "40", "60", "80", "100", "120"]);
        assert_eq!(texts(&Axis::linear("x"), &[-0.31, 0.29], 300.0), ["−0.2", "0.0", "0.2"]);
        assert_eq!(texts(&Axis::angle("θ"), &[], 300.0), ["−π", "−π/2", "0", "π/2", "π"]);
        assert_eq!(texts(&Axis::log("P"), &[1e-6, 100.0], 400.0), ["10⁻⁶", "10⁻⁴", "10⁻²", "10⁰", "10²"]);
        assert_eq!(texts(&Axis::linear("t / s").range(1e-16, 54.0), &[], 400.0)[0], "0");
        let fixed = Axis::linear("r").fix([-3e-5, 4e-5].iter(), 300.0, 70.0);
        assert_eq!(fixed.power, -5);
        assert!(fixed.ticks.iter().any(|t| t.1 == "2"), "{fixed:?}");
    }

    #[test]
    fn no_values_or_equal_ones_still_make_an_axis() {
        for values in [vec![], vec![f64::NAN], vec![3.0, 3.0], vec![0.0], vec![1e308, -1e308]] {
            for axis in [Axis::linear("x"), Axis::log("x"), Axis::angle("x"), Axis::linear("x").range(1.0, 1.0)] {
                let fixed = axis.fix(values.iter(), 400.0, 70.0);
                assert!(fixed.high > fixed.low && fixed.low.is_finite() && fixed.high.is_finite(), "{fixed:?}");
                assert!(fixed.ticks.len() < 200);
            }
        }
        assert!(Axis::log("x").fix([1.0, 100.0].iter(), 400.0, 70.0).place(-1.0).is_nan());
    }
}

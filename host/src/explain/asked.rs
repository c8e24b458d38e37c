//! What is told where a horizon that was asked for could not be had: an answer over another one, or
//! none, must not pass for the one that was asked for.

use super::{Explanation, Settings};
use crate::warning::Warning;
use crate::wording::format::{rounded, shortest};
use crate::wording::limits;

/// Share of a record that forecasts predict.
const PREDICTED: f64 = 0.3;

/// Adds the warnings. `step_s`: between samples; `longest_s`: the longest unbroken stretch.
pub fn tell_in(result: &mut Explanation, settings: &Settings, step_s: f64, longest_s: f64) {
    let seconds = |s: f64| shortest(rounded(s, 4));
    let (told, window_s) = (result.gap.horizon_s, result.details.window_s);
    let mut warnings = Vec::new();
    if let Some(asked) = settings.horizon_s.filter(|h| limits::within(*h, 0.0, told).is_none()) {
        let text = format!(
            "--horizon {asked}: the gap is told over {} s, the length of the windows in which predictions are made",
            seconds(told)
        );
        let advice = format!(
            "Say --window-s {asked} as well, where the record has several such windows; or ask for at most {} s",
            seconds(window_s.min(told))
        );
        let warning = Warning::new("horizon-shortened", text, advice);
        warnings.push(warning.with("asked_s", asked).with("value_s", told));
    }
    let forecasts = &result.gap.forecasts;
    let is_told = |h: f64| forecasts.iter().any(|f| f.horizon_s == h && !f.steps.is_empty());
    let predicted_s = PREDICTED * result.details.samples as f64 * step_s;
    let unbroken_s = predicted_s.min(longest_s);
    for asked in settings.forecast_s.iter().copied().filter(|h| !is_told(*h)) {
        let (why, advice) = if forecasts.is_empty() {
            ("nothing of the record could be decided", "See the verdict and the other warnings".to_owned())
        } else if asked > unbroken_s {
            (
                "it is longer than the last 30 % of the record, which are predicted",
                format!("Ask for less than {} s, or record longer", seconds(unbroken_s)),
            )
        } else {
            (
                "no prediction of the last 30 % of the record reached so far from a model of its first 70 %",
                "Ask for less, or record longer".to_owned(),
            )
        };
        let text = format!("--forecast {asked}: there is no forecast over {asked} s: {why}");
        warnings.push(Warning::new("no-forecast", text, advice).with("asked_s", asked));
    }
    result.warnings.extend(warnings);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::{Forecast, Step};

    fn told(horizon_s: Option<f64>, forecast_s: &[f64]) -> Vec<Warning> {
        let mut result = Explanation::new(1.405, Vec::new());
        (result.details.window_s, result.details.samples) = (1.405, 3000);
        let forecast = |horizon_s: f64, steps: Vec<Step>| Forecast { horizon_s, unit: "deg".to_owned(), steps };
        let step = || Step { added: None, value: 1.0 };
        result.gap.forecasts = vec![forecast(1.0, vec![step()]), forecast(4.0, vec![]), forecast(10.0, vec![])];
        let settings = Settings { horizon_s, forecast_s: forecast_s.to_vec(), ..Settings::default() };
        tell_in(&mut result, &settings, 0.01, 30.0);
        result.warnings
    }

    #[test]
    fn a_horizon_that_was_not_had_is_told() {
        assert_eq!((told(None, &[]), told(Some(1.405), &[1.0])), (Vec::new(), Vec::new()));
        // As it is printed.
        assert_eq!(told(Some(1.41), &[1.0]), Vec::new());
        let shortened = &told(Some(5.0), &[])[0];
        assert!(shortened.text.contains("--horizon 5: the gap is told over 1.405 s"), "{shortened:?}");
        assert!(shortened.advice.contains("--window-s 5"), "{shortened:?}");
        let none = told(None, &[1.0, 4.0, 10.0]);
        assert_eq!(none.len(), 2);
        assert!(none[0].text.contains("over 4 s: no prediction"), "{none:?}");
        assert!(none[1].text.contains("over 10 s: it is longer than the last 30 %"), "{none:?}");
        assert!(none[1].advice.contains("less than 9 s"), "{none:?}");
    }
}

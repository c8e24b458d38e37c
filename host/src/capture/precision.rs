//! A capture that goes on until a parameter is known well enough: `--until C2=1%`.
//!
//! The device tells a parameter's value and standard error every second window, over windows that
//! it forgets by λ. A standard error σ over a weight W = (1 − λⁿ)/(1 − λ) of n windows says that
//! each window gives the information 1/(σ² W). With the mean of that over the estimates, the N
//! windows of the record determine the parameter to
//!
//! σ_rec = 1/√(N · mean(1/(σ² W))), which falls as 1/√N: what is still to be recorded is T
//! (σ_rec/σ_wanted)² − T.
//!
//! The precision asked for is that of the 95 % interval, 1.96 σ over the value's size. It is what
//! the device's own method would give; `whirl identify` on the record does better.

use serde::Serialize;
use whirl_shared::regressor::NAMES;

use super::estimates::DeviceEstimate;
use crate::error::{BadInput, Result};
use crate::warning::Warning;
use crate::wording::format::{Z95, duration, significant};

/// Precision above which nothing is said of the time left, as a share: the value is hardly told
/// from 0.
const HARDLY_KNOWN: f64 = 1.0;

/// A parameter, and the half-width of its 95 % interval at which a capture ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Until {
    name: String,
    /// Half-width over the value's size.
    share: f64,
}

impl std::str::FromStr for Until {
    type Err = String;

    /// `NAME=X%`.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let form = || format!("\"{text}\" is not NAME=X%, such as C2=1%");
        let (name, percent) = text.split_once('=').ok_or_else(form)?;
        let percent: f64 = percent.trim().strip_suffix('%').and_then(|p| p.trim().parse().ok()).ok_or_else(form)?;
        if !(percent.is_finite() && percent > 0.0 && percent < 100.0) {
            return Err(format!("{percent} % is not a precision: above 0 and below 100 %"));
        }
        let name = name.trim();
        if !NAMES.contains(&name) {
            return Err(format!("the device does not estimate \"{name}\": it has {}", NAMES.join(", ")));
        }
        Ok(Self { name: name.to_owned(), share: percent / 100.0 })
    }
}

impl core::fmt::Display for Until {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}={}%", self.name, crate::wording::format::shortest(100.0 * self.share))
    }
}

impl Until {
    /// Checks that the device can say something of this rig.
    ///
    /// # Errors
    /// A rig that the device does not identify.
    pub(super) fn check(&self, rig: &crate::rig::Rig) -> Result<()> {
        match super::estimates::unfit(rig) {
            None => Ok(()),
            Some(e) => Err(BadInput { remedy: "Leave --until out, and say --seconds".to_owned(), ..e }),
        }
    }
}

/// How well the parameter is known, and how long it takes still.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Precision {
    /// Parameter.
    pub name: String,
    /// Half-width of the 95 % interval asked for, % of the value.
    pub asked_percent: f64,
    /// As the record until now would give it, by the device's method, %; none where the device has
    /// no estimate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub percent: Option<f64>,
    /// Device time still to be recorded, s; none where that cannot be said yet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_s: Option<f64>,
    /// Whether it is reached.
    pub reached: bool,
}

impl Precision {
    /// The warning of a capture that ended before it.
    pub(super) fn missed(&self) -> Option<Warning> {
        (!self.reached).then(|| {
            Warning::new(
                "precision-not-reached",
                format!("the capture ended before {}", self.words()),
                "Record longer; several records can be identified together",
            )
        })
    }

    /// In a few words: `C2 to ±1 % (95 %): now ±2.3 %, about 3 min 20 s still`.
    pub fn words(&self) -> String {
        let asked = format!("±{} % (95 %)", significant(self.asked_percent, 2));
        let Some(percent) = self.percent else {
            return format!("{} to {asked}: no estimate of the device yet", self.name);
        };
        let now = format!("{} to {asked}: now ±{} %", self.name, significant(percent, 2));
        match self.left_s {
            _ if self.reached => format!("{now}, reached"),
            Some(left) => format!("{now}, about {} still", about(left)),
            None => format!("{now}, too early to say how long still"),
        }
    }
}

/// A length of time that is no better known than to some per cent.
fn about(seconds: f64) -> String {
    match seconds {
        s if s > 48.0 * 3600.0 => format!("{} days", significant(s / 86_400.0, 2)),
        s if s >= 600.0 => duration((s / 60.0).round() * 60.0).replace(" 0 s", ""),
        s if s >= 60.0 => format!("{} min {} s", (s / 60.0).floor(), (s % 60.0 / 10.0).floor() * 10.0),
        s => format!("{} s", s.ceil()),
    }
}

/// Collects what the device tells of one parameter.
#[derive(Clone, Debug)]
pub(super) struct Progression {
    until: Until,
    /// Sum of 1/(σ² W), and the estimates in it.
    information: f64,
    estimates: f64,
    value: f64,
    window_s: f64,
}

impl Progression {
    pub(super) fn new(until: Until) -> Self {
        Self { until, information: 0.0, estimates: 0.0, value: 0.0, window_s: 0.0 }
    }

    /// Takes an estimate; one without parameters says nothing.
    pub(super) fn take(&mut self, estimate: &DeviceEstimate) {
        let Some(p) = estimate.parameters.iter().find(|p| p.name == self.until.name) else { return };
        let (n, forgetting) = (f64::from(estimate.windows), estimate.forgetting);
        let weight = if forgetting < 1.0 { (1.0 - forgetting.powf(n)) / (1.0 - forgetting) } else { n };
        let information = 1.0 / (p.std_error * p.std_error * weight);
        if information.is_finite() && information > 0.0 && estimate.window_s > 0.0 {
            self.information += information;
            self.estimates += 1.0;
            self.value = p.value;
            self.window_s = estimate.window_s;
        }
    }

    /// What a record of so many seconds of samples gives. Windows overlap by half.
    pub(super) fn now(&self, recorded_s: f64) -> Precision {
        let windows = (2.0 * recorded_s / self.window_s - 1.0).max(1.0);
        let sigma = (windows * self.information / self.estimates).sqrt().recip();
        let share = (Z95 * sigma / self.value).abs();
        let known = self.estimates > 0.0 && share.is_finite();
        let reached = known && share <= self.until.share;
        let ratio = share / self.until.share;
        let left = recorded_s * (ratio * ratio - 1.0);
        Precision {
            name: self.until.name.clone(),
            asked_percent: 100.0 * self.until.share,
            percent: known.then_some(100.0 * share),
            left_s: (known && share < HARDLY_KNOWN).then_some(left.max(0.0)),
            reached,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::estimates::Status;
    use crate::model::parameter::Parameter;

    fn estimate(windows: u32, forgetting: f64, std_error: f64) -> DeviceEstimate {
        let c2 = Parameter { name: "C2".to_owned(), value: 0.05, std_error, unit: "1".to_owned() };
        DeviceEstimate {
            tick: 0,
            t: 0.0,
            window_s: 4.0,
            windows,
            forgetting,
            drive_frequency_hz: 5.0,
            amplitude_m: 0.0155,
            status: Status::Known,
            reason: None,
            parameters: vec![c2],
            condition: Vec::new(),
            residual_rms: Vec::new(),
        }
    }

    #[test]
    fn the_option_is_read_or_refused_with_its_form() {
        let until: Until = "C2 = 1.5 %".parse().unwrap();
        assert_eq!(until, Until { name: "C2".to_owned(), share: 0.015 });
        assert_eq!(until.to_string(), "C2=1.5%");
        for (text, part) in [
            ("C2", "NAME=X%"),
            ("C2=1", "NAME=X%"),
            ("C2=0%", "above 0"),
            ("C2=nan%", "above 0"),
            ("mass=1%", "B11, B12"),
        ] {
            let e = text.parse::<Until>().unwrap_err();
            assert!(e.contains(part), "{text}: {e}");
        }
    }

    #[test]
    fn a_parameter_of_zero_is_not_known_to_any_share() {
        let mut progression = Progression::new("C2=2%".parse().unwrap());
        let mut zero = estimate(40, 1.0, 0.01);
        zero.parameters[0].value = 0.0;
        progression.take(&zero);
        let now = progression.now(800.0);
        assert_eq!((now.percent, now.left_s, now.reached), (None, None, false));
    }

    #[test]
    fn precision_grows_with_the_root_of_the_time_whatever_the_device_forgets() {
        // Of one information a window: weights 10 and 40.
        for (forgetting, windows, std_error) in [(0.9, 1_000, 0.01 / 10_f64.sqrt()), (1.0, 40, 0.01 / 40_f64.sqrt())] {
            let mut progression = Progression::new("C2=2%".parse().unwrap());
            assert_eq!((progression.now(10.0).percent, progression.now(10.0).left_s), (None, None));
            progression.take(&estimate(windows, forgetting, std_error));
            // 399 windows: 1.96 · 0.01/√399 of 0.05.
            let now = progression.now(800.0);
            let expected = 100.0 * 1.96 * 0.01 / 399_f64.sqrt() / 0.05;
            assert!((now.percent.unwrap() / expected - 1.0).abs() < 1e-9, "{now:?}");
            assert!(now.reached && now.left_s.unwrap() == 0.0 && now.words().ends_with("reached"), "{now:?}");
            let early = progression.now(200.0);
            let left = early.left_s.unwrap();
            assert!(!early.reached && left > 0.0);
            // After that long it is reached, up to the half window at the beginning.
            let then = progression.now(200.0 + left).percent.unwrap();
            assert!((then / 2.0 - 1.0).abs() < 0.01, "{then}");
        }
    }

    #[test]
    fn nothing_is_foretold_of_what_is_hardly_known() {
        let mut progression = Progression::new("C2=1%".parse().unwrap());
        progression.take(&estimate(10, 0.9, 1.0));
        let now = progression.now(20.0);
        assert!(now.left_s.is_none() && !now.reached && now.words().contains("too early"), "{}", now.words());
        progression.take(&estimate(10, 0.9, f64::NAN));
        assert_eq!(progression.now(20.0), now);
        assert_eq!(
            (about(42.2), about(200.0), about(4_000.0)),
            ("43 s".into(), "3 min 20 s".into(), "1 h 7 min".into())
        );
    }
}

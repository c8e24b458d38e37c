//! How far a capture is.

use std::io::{IsTerminal, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// State of a capture, told several times a second.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// What is being done.
    pub state: &'static str,
    /// Samples that came.
    pub samples: u64,
    /// Samples missing.
    pub lost: u64,
    /// Device time recorded, s.
    pub device_s: f64,
    /// Device time asked for, s.
    pub target_s: Option<f64>,
    /// The device's newest estimate, in a few words.
    pub estimate: Option<String>,
    /// What is to be told at once, a line each; each is handed over once.
    pub notices: Vec<String>,
}

/// What is to be told at once, on standard error. One that takes nothing more does not end a
/// capture.
pub fn tell(progress: &Progress) {
    let mut err = std::io::stderr().lock();
    for notice in &progress.notices {
        let _ = writeln!(err, "whirl: {notice}");
    }
}

/// A progress bar on standard error where that is a terminal; otherwise only what is to be told at
/// once.
pub fn on_terminal() -> Box<dyn FnMut(&Progress)> {
    if !std::io::stderr().is_terminal() {
        return Box::new(tell);
    }
    let bar = ProgressBar::new(0);
    let template = |text| ProgressStyle::with_template(text).unwrap_or_else(|_| ProgressStyle::default_bar());
    let (bounded, endless) =
        (template("{bar:20} {pos}/{len} s  {wide_msg}"), template("{spinner} {pos} s  {wide_msg}"));
    bar.set_style(endless);
    bar.enable_steady_tick(Duration::from_millis(200));
    let mut has_length = false;
    Box::new(move |p| {
        if !p.notices.is_empty() {
            bar.suspend(|| tell(p));
        }
        if let (Some(target), false) = (p.target_s, has_length) {
            bar.set_style(bounded.clone());
            // Settings bound it to 1e8 s.
            bar.set_length(target.ceil() as u64);
            has_length = true;
        }
        bar.set_position(p.device_s as u64);
        let estimate = p.estimate.as_ref().map_or_else(String::new, |e| format!("; {e}"));
        bar.set_message(format!("{}: {} samples, {} lost{estimate}", p.state, p.samples, p.lost));
    })
}

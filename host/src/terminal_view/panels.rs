//! What is told in numbers: samples, drive, the device's estimate.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Wrap};
use whirl_shared::frame::{ShakerState, Status, StopCause};

use super::draw::strong;
use super::scene::Scene;
use crate::capture::estimates::Status as Known;
use crate::error::plain;
use crate::model::parameter::Parameter;
use crate::wording::format::{Z95, count, fixed, plus_minus, shortest, significant};

/// Says why no motion is shown, where there is none.
pub(super) fn no_samples(frame: &mut Frame<'_>, area: Rect, scene: &Scene) -> bool {
    if scene.newest().is_some() {
        return false;
    }
    let text = "no samples yet (a capture with --rows has none to show)";
    frame.render_widget(Paragraph::new(text).wrap(Wrap { trim: true }), area);
    true
}

/// `1 gap`, `2 gaps`.
fn plural(n: u64, one: &str, many: &str) -> String {
    format!("{} {}", count(n), if n == 1 { one } else { many })
}

/// A line whose first word is what it is of.
fn line(name: &'static str, text: impl Into<String>) -> Line<'static> {
    Line::from(vec![Span::styled(format!("{name:<8} "), strong()), Span::raw(text.into())])
}

/// Samples in two lines.
pub(super) fn samples(scene: &Scene) -> Vec<Line<'static>> {
    let Some(s) = &scene.standing else { return vec![line("samples", "none yet")] };
    let l = &s.losses;
    vec![
        line("samples", format!("{}, {} missing", count(s.progress.samples), count(s.progress.lost))),
        line(
            "link",
            format!(
                "{}, lost {}",
                plural(l.gaps, "gap", "gaps"),
                if s.reconnections == 1 { "once".to_owned() } else { format!("{} times", s.reconnections) }
            ),
        ),
    ]
}

/// Samples, each cause on its own.
pub(super) fn samples_at_length(scene: &Scene) -> Vec<Line<'static>> {
    let Some(s) = &scene.standing else { return vec![line("samples", "none yet")] };
    let l = &s.losses;
    vec![
        line("recorded", count(s.progress.samples)),
        line("missing", format!("{} in {}", count(s.progress.lost), plural(l.gaps, "gap", "gaps"))),
        line("of these", format!("{} on the link, {} damaged", count(l.lost_on_link), count(l.damaged))),
        line("", format!("{} overruns, {} dropped", count(l.overruns), count(l.dropped_by_device))),
        line(
            "besides",
            format!(
                "{} restored, {} repeated, {} too late",
                count(l.restored),
                count(l.duplicates),
                count(l.dropped_late)
            ),
        ),
        line(
            "link",
            format!(
                "lost {}, {}",
                if s.reconnections == 1 { "once".to_owned() } else { format!("{} times", s.reconnections) },
                plural(l.restarts, "restart", "restarts")
            ),
        ),
        line("rate", format!("{} Hz", shortest(scene.rate_hz))),
    ]
}

/// The shaker's state, in words.
fn state(status: &Status) -> &'static str {
    match status.shaker {
        ShakerState::Disarmed => "off: disarmed",
        ShakerState::Armed => "enabled, at rest",
        ShakerState::Ramping => "enabled, ramping",
        ShakerState::Running => "enabled, running",
        ShakerState::Stopping => "enabled, stopping",
        ShakerState::Faulted => "off: FAULT",
    }
}

/// Why it stopped last.
fn stopped(status: &Status) -> &'static str {
    match status.stop_cause {
        StopCause::None => "not stopped since boot",
        StopCause::Command => "last stop: by command",
        StopCause::HostSilent => "last stop: host silent",
        StopCause::Limit => "last stop: a limit",
        StopCause::Fault => "last stop: a fault",
        StopCause::EmergencyStop => "last stop: EMERGENCY",
    }
}

fn millimetres(metres: f64) -> String {
    fixed(metres * 1e3, 3)
}

/// The amplitude that was asked for, and what the device gives now.
fn amplitude(scene: &Scene) -> String {
    // At most 4.3 m.
    let now = scene.newest().map(|s| f64::from(s.amplitude_nm) * 1e-9);
    let now = now.or(scene.status.as_ref().map(|s| f64::from(s.amplitude_nanometre) * 1e-9));
    let now = now.map_or_else(|| "–".to_owned(), millimetres);
    match scene.standing.as_ref().and_then(|s| s.asked) {
        Some((asked, _)) => format!("{now} mm of {} asked", millimetres(asked)),
        None => format!("{now} mm, none asked"),
    }
}

/// Frequency and phase that the device gives now.
fn phase(scene: &Scene) -> String {
    match scene.newest() {
        Some(s) if s.phase_increment > 0 => {
            let turn = 4_294_967_296.0;
            let (hz, deg) = (f64::from(s.phase_increment) / turn * scene.rate_hz, 360.0 * f64::from(s.phase) / turn);
            format!("{} Hz, {:>3}°", fixed(hz, 3), fixed(deg, 0))
        }
        _ => "at rest".to_owned(),
    }
}

/// Limits of the device.
fn limits(scene: &Scene) -> String {
    let Some(l) = scene.hello.as_ref().map(|h| h.limits) else { return "–".to_owned() };
    format!(
        "{} mm, {} Hz, {} m/s²",
        shortest(f64::from(l.amplitude_micrometre) * 1e-3),
        shortest(f64::from(l.frequency_millihertz) * 1e-3),
        shortest(f64::from(l.acceleration_millimetre_per_s2) * 1e-3)
    )
}

/// The drive in five lines.
pub(super) fn drive(scene: &Scene) -> Vec<Line<'static>> {
    let shaker = scene.status.as_ref().map_or("–", state);
    vec![
        line("shaker", shaker),
        line("ampl.", amplitude(scene)),
        line("phase", phase(scene)),
        line("limits", limits(scene)),
        line("", scene.status.as_ref().map_or("", stopped)),
    ]
}

/// The drive, and what the device says of itself.
pub(super) fn drive_at_length(scene: &Scene) -> Vec<Line<'static>> {
    let mut lines = drive(scene);
    if let Some(status) = &scene.status {
        lines.push(line("device", format!("{} bad frames, {} overruns", status.bad_frames, status.overruns)));
    }
    if let Some(hello) = &scene.hello {
        lines.push(line("board", format!("{}, {}", plain(&hello.board), plain(&hello.firmware))));
    }
    lines
}

/// A parameter: `C2  0.0485 ± 0.0012  2.5 %`.
fn parameter(p: &Parameter) -> String {
    let percent = (100.0 * Z95 * p.std_error / p.value).abs();
    let share = if percent < 100.0 { format!("{:>5} %", significant(percent, 2)) } else { "> 100 %".to_owned() };
    format!("{:<4}{:<21}{share:>7}", p.name, plus_minus(p.value, Z95 * p.std_error))
}

/// The device's own estimate, in two columns where there is room.
pub(super) fn estimate(scene: &Scene, width: u16) -> Vec<Line<'static>> {
    let Some(standing) = &scene.standing else { return Vec::new() };
    let Some(e) = &standing.estimate else {
        return vec![Line::from(
            "none yet: it comes after some windows of 20 drive periods (double pendulum, vertical drive only)",
        )];
    };
    if let Some(reason) = &e.reason {
        let what = if e.status == Known::TooFewWindows { "none yet" } else { "not identifiable" };
        return vec![Line::styled(what, strong()), Line::from(reason.clone())];
    }
    let columns = if width >= 70 { 2 } else { 1 };
    if columns == 1 {
        return short(&e.parameters);
    }
    let rows = e.parameters.len().div_ceil(columns);
    let mut lines: Vec<Line<'static>> = (0..rows)
        .map(|i| {
            let cells =
                (0..columns).filter_map(|c| e.parameters.get(i + c * rows)).map(|p| format!("{:<35}", parameter(p)));
            Line::from(cells.collect::<String>())
        })
        .collect();
    lines.push(Line::from(format!(
        "{} windows of {} s; ± is 95 %, then its share of the value",
        e.windows,
        significant(e.window_s, 3)
    )));
    lines
}

/// Two parameters a line.
fn short(parameters: &[Parameter]) -> Vec<Line<'static>> {
    let rows = parameters.len().div_ceil(2);
    let number = |p: &Parameter| plus_minus(p.value, Z95 * p.std_error).replace(" ± ", "±");
    let cell = |p: &Parameter| format!("{:<4}{:<18}", p.name, number(p));
    (0..rows)
        .map(|i| {
            let cells = [i, i + rows].into_iter().filter_map(|k| parameters.get(k)).map(cell);
            Line::from(cells.collect::<String>())
        })
        .collect()
}

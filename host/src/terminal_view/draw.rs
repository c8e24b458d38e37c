//! The screen: a head line, the page, what is to be told, the keys.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Wrap};

use super::scene::{Page, Scene};
use super::{light_page, motion_page};
use crate::wording::format::{duration, fixed};

/// Smallest terminal in which the view is drawn.
pub(super) const SMALLEST: (u16, u16) = (80, 24);
/// From this width on there is room for both arms.
pub(super) const WIDE: u16 = 140;

/// From this height on there is room for several lines that were told.
const TALL: u16 = 40;

/// Bold.
pub(super) fn strong() -> Style {
    Style::new().add_modifier(Modifier::BOLD)
}

/// A box with a title.
pub(super) fn titled(title: impl Into<Line<'static>>) -> Block<'static> {
    Block::bordered().title(title)
}

/// Draws everything.
pub(super) fn draw(frame: &mut Frame<'_>, scene: &Scene) {
    let area = frame.area();
    if area.width < SMALLEST.0 || area.height < SMALLEST.1 {
        return too_small(frame, area);
    }
    let told = told_lines(scene, if area.height < TALL { 1 } else { 4 });
    let rows = Layout::vertical([
        Constraint::Length(1),
        Constraint::Fill(1),
        // A handful.
        Constraint::Length(told.len() as u16),
        Constraint::Length(1),
    ]);
    let [head, page, below, keys] = rows.areas(area);
    frame.render_widget(Paragraph::new(head_line(scene, head.width)), head);
    match scene.page {
        Page::Motion => motion_page::draw(frame, page, scene),
        Page::FirstLight => light_page::draw(frame, page, scene),
    }
    frame.render_widget(Paragraph::new(told), below);
    frame.render_widget(Paragraph::new(keys_line(scene)), keys);
}

fn too_small(frame: &mut Frame<'_>, area: Rect) {
    let text = format!(
        "The terminal has {} × {} characters; the view needs {} × {}. The capture goes on; q ends it.",
        area.width, area.height, SMALLEST.0, SMALLEST.1
    );
    frame.render_widget(Paragraph::new(text).wrap(Wrap { trim: true }), area);
}

/// A bar of so many characters, filled to a share.
fn bar(share: f64, width: usize) -> String {
    let full = (share.clamp(0.0, 1.0) * width as f64).floor() as usize;
    format!("[{}{}]", "█".repeat(full), "·".repeat(width.saturating_sub(full)))
}

/// What is being done, into which record, how far.
fn head_line(scene: &Scene, width: u16) -> Line<'static> {
    let Some(standing) = &scene.standing else {
        return Line::from(vec![Span::styled(" whirl ", strong().reversed()), " waiting for the device".into()]);
    };
    let p = &standing.progress;
    let state = if scene.ending { "ending in order" } else { p.state };
    let time = match p.target_s {
        Some(target) => {
            let share = p.device_s / target;
            format!(
                "{} of {} {} {} %",
                clock(p.device_s),
                clock(target),
                bar(share, 12),
                fixed(100.0 * share.min(1.0), 0)
            )
        }
        None => format!("{} recorded, until q", clock(p.device_s)),
    };
    let state = format!("  {state}  ");
    let room = usize::from(width).saturating_sub(7 + state.chars().count() + time.chars().count() + 2);
    let title: String = match scene.title.chars().count() {
        n if n > room => format!("…{}", scene.title.chars().skip(n + 1 - room.max(1)).collect::<String>()),
        _ => scene.title.clone(),
    };
    Line::from(vec![
        Span::styled(" whirl ", strong().reversed()),
        Span::styled(state, strong()),
        time.into(),
        format!("  {title}").into(),
    ])
}

/// Minutes and seconds.
fn clock(seconds: f64) -> String {
    if seconds < 600.0 {
        format!("{} s", fixed(seconds, if seconds < 100.0 { 1 } else { 0 }))
    } else {
        duration(seconds)
    }
}

/// The end that is waited for, and the newest lines that were told.
fn told_lines(scene: &Scene, most: usize) -> Vec<Line<'static>> {
    let precision = scene.standing.as_ref().and_then(|s| s.precision.as_ref());
    let mut lines: Vec<_> =
        precision.map(|p| Line::styled(format!(" until {}", p.words()), strong())).into_iter().collect();
    if scene.lines.is_empty() {
        lines.push(Line::from(" told: nothing yet, by the device or the link"));
    }
    let newest = scene.lines.iter().skip(scene.lines.len().saturating_sub(most));
    lines.extend(newest.map(|line| Line::from(format!(" told: {line}"))));
    lines
}

fn keys_line(scene: &Scene) -> Line<'static> {
    let mut keys = vec![("Tab", "page")];
    match scene.page {
        Page::Motion => {
            keys.push(("+ −", "time shown"));
            if scene.arms.len() > 1 {
                keys.push(("a", "other arm"));
            }
        }
        Page::FirstLight => keys.push(("r", "count from here")),
    }
    if scene.standing.as_ref().is_some_and(|s| s.simulated) {
        keys.push(("f", if scene.hurry { "real time" } else { "fast" }));
    }
    keys.push(("q", "end in order"));
    let mut spans = Vec::new();
    for (key, what) in keys {
        spans.push(Span::styled(format!(" {key} "), Style::new().reversed()));
        spans.push(Span::raw(format!(" {what}  ")));
    }
    Line::from(spans)
}

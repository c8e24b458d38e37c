//! First light: turn each arm by hand and see that its encoder counts, which way, and how far a
//! turn is.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Wrap};

use super::draw::{strong, titled};
use super::first_light::judged;
use super::scene::{Arm, Scene, degrees};
use crate::record::device_boot::zero_word;
use crate::wording::format::fixed;

/// Draws the page.
pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    let [how, encoders] = Layout::vertical([Constraint::Length(8), Constraint::Fill(1)]).areas(area);
    frame.render_widget(
        Paragraph::new(instructions(scene)).wrap(Wrap { trim: false }).block(titled(" first light ")),
        how,
    );
    let columns = Layout::horizontal(vec![Constraint::Fill(1); scene.arms.len().max(1)]).split(encoders);
    for (i, arm) in scene.arms.iter().enumerate() {
        let text = Paragraph::new(encoder(scene, arm, i)).wrap(Wrap { trim: false });
        frame.render_widget(text.block(titled(format!(" encoder {}: {} ", i + 1, arm.symbol))), columns[i]);
    }
}

fn instructions(scene: &Scene) -> Vec<Line<'static>> {
    if scene.newest().is_some_and(|s| s.phase_increment > 0 || s.amplitude_nm > 0) {
        return vec![
            Line::styled("THE SHAKER IS ON: keep your hands off the arms.", strong()),
            Line::from("End this capture with q, and begin one for first light with --no-drive."),
        ];
    }
    [
        "1  Let both arms hang: θ reads 0° there, or `whirl device zero` sets it.",
        "2  Turn one arm by one whole turn and let it hang again: see `check`.",
        "   An encoder 2 that is relative counts arm 1's turns too: hold arm 1 still.",
        "3  Turn both the same way: both must count the same way. Where one does not,",
        "   `whirl device set reversed1=true` (or reversed2) turns its sign.",
        "r  counts anew from here.",
    ]
    .map(Line::from)
    .to_vec()
}

/// What one encoder does.
fn encoder(scene: &Scene, arm: &Arm, i: usize) -> Vec<Line<'static>> {
    let named = |name: &'static str, text: String| {
        Line::from(vec![Span::styled(format!("{name:<10}"), strong()), Span::raw(text)])
    };
    let turn = f64::from(arm.counts_per_turn);
    let Some(count) = scene.newest().map(|s| s.counts[i]) else {
        return vec![Line::from("no samples yet")];
    };
    let turns = |counts: i64| format!("{} turns", fixed(counts as f64 / turn, 3));
    let (least, greatest) = arm.turning.reach();
    let mut lines = vec![
        named("measures", arm.measures.to_owned()),
        named("now", arm.turning.direction().to_owned()),
        named("count", format!("{}, {}°", fixed(f64::from(count), 0), fixed(degrees(f64::from(count) + 0.5, turn), 1))),
        named("from here", format!("{} counts, {}", signed(arm.turning.since_mark()), turns(arm.turning.since_mark()))),
        named("reached", format!("{} … {} turns", fixed(least as f64 / turn, 2), fixed(greatest as f64 / turn, 2))),
        named("check", judged(arm.turning.between_rests, arm.counts_per_turn)),
    ];
    if let Some(hello) = &scene.hello
        && let (Some(reversed), Some(zero)) = (hello.reversed.get(i), hello.zeros.get(i))
    {
        let sign = if *reversed { "reversed on the device" } else { "as wired" };
        let index = zero.index.map_or_else(|| "no index mark seen".to_owned(), |at| format!("index at {at}"));
        lines.push(named("sign", sign.to_owned()));
        lines.push(named("zero", format!("{}, id {:08x}; {index}", zero_word(zero), zero.id)));
    }
    lines
}

fn signed(counts: i64) -> String {
    if counts > 0 { format!("+{counts}") } else { counts.to_string().replace('-', "−") }
}

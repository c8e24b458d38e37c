//! The page of a capture that runs: angles, phase portrait, Poincaré section; samples, drive,
//! estimate.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::{Axis, Chart, Dataset, GraphType, Paragraph, Wrap};

use super::draw::{WIDE, titled};
use super::panels;
use super::scene::{Arm, Scene};
use crate::wording::format::{count, shortest};

/// An arm that goes beyond this, degrees, is shown on the whole turn.
const WHOLE_FROM: f64 = 50.0;

/// Draws the page.
pub(super) fn draw(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    if area.width >= WIDE { wide(frame, area, scene) } else { narrow(frame, area, scene) }
}

/// Angles, one arm's portrait and section in a row; below the numbers.
fn narrow(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    let [plots, numbers] = Layout::vertical([Constraint::Fill(1), Constraint::Length(9)]).areas(area);
    let thirds = [Constraint::Fill(6), Constraint::Fill(5), Constraint::Fill(5)];
    let [first, second, third] = Layout::horizontal(thirds).areas(plots);
    angles(frame, first, scene);
    let arm = scene.arm.min(scene.arms.len().saturating_sub(1));
    portrait(frame, second, scene, arm);
    section(frame, third, scene, arm);
    let [left, right] = Layout::horizontal([Constraint::Length(36), Constraint::Fill(1)]).areas(numbers);
    let mut lines = panels::samples(scene);
    lines.extend(panels::drive(scene));
    frame.render_widget(Paragraph::new(lines).block(titled(" samples and drive ")), left);
    estimate(frame, right, scene);
}

/// Angles above; portrait and section of every arm; the numbers.
fn wide(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    let rows = [Constraint::Fill(2), Constraint::Fill(3), Constraint::Length(9)];
    let [top, middle, bottom] = Layout::vertical(rows).areas(area);
    angles(frame, top, scene);
    let n = scene.arms.len();
    let columns = Layout::horizontal(vec![Constraint::Fill(1); 2 * n]).split(middle);
    for arm in 0..n {
        portrait(frame, columns[2 * arm], scene, arm);
        section(frame, columns[2 * arm + 1], scene, arm);
    }
    let thirds = [Constraint::Length(40), Constraint::Length(48), Constraint::Fill(1)];
    let [left, centre, right] = Layout::horizontal(thirds).areas(bottom);
    frame.render_widget(Paragraph::new(panels::samples_at_length(scene)).block(titled(" samples ")), left);
    frame.render_widget(Paragraph::new(panels::drive_at_length(scene)).block(titled(" drive ")), centre);
    estimate(frame, right, scene);
}

fn estimate(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    let lines = panels::estimate(scene, area.width.saturating_sub(2));
    let text = Paragraph::new(lines).block(titled(" device's own estimate, ± is 95 % "));
    // Tables are cut, sentences go on.
    let told = scene.standing.as_ref().and_then(|s| s.estimate.as_ref()).is_some_and(|e| e.reason.is_none());
    frame.render_widget(if told { text } else { text.wrap(Wrap { trim: true }) }, area);
}

/// An axis with its ends, and 0, told.
fn axis(ends: [f64; 2], labels: Vec<String>) -> Axis<'static> {
    Axis::default().bounds(ends).labels(labels)
}

/// An angle's axis, degrees: as far as the arm has gone, or the whole turn.
fn angle(arm: &Arm) -> Axis<'static> {
    let end = if arm.widest > WHOLE_FROM { 180.0 } else { nice(arm.widest) };
    let word = shortest(end);
    axis([-end, end], vec![format!("−{word}"), "0".to_owned(), word])
}

/// A rate's axis: so far as arms have gone, rounded up.
fn rates(fastest: f64) -> Axis<'static> {
    let top = nice(fastest);
    let word = shortest(top);
    axis([-top, top], vec![format!("−{word}"), "0".to_owned(), word])
}

/// The next of 1, 2, 5 times a power of ten.
fn nice(x: f64) -> f64 {
    if !(x.is_finite() && x > 0.0) {
        return 1.0;
    }
    let power = 10_f64.powf(x.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|m| *m >= x).unwrap_or(10.0 * power)
}

fn chart<'a>(points: &'a [(f64, f64)], x: Axis<'a>, y: Axis<'a>) -> Chart<'a> {
    let dots = Dataset::default().marker(Marker::Braille).graph_type(GraphType::Scatter).data(points);
    Chart::new(vec![dots]).x_axis(x).y_axis(y).legend_position(None)
}

/// The last seconds of each arm, one below the other.
fn angles(frame: &mut Frame<'_>, area: Rect, scene: &Scene) {
    let names: Vec<&str> = scene.arms.iter().map(|arm| arm.symbol.as_str()).collect();
    let block = titled(format!(" {} in °, last {} s ", names.join(", "), scene.span_s()));
    let inside = block.inner(area);
    frame.render_widget(block, area);
    if panels::no_samples(frame, inside, scene) {
        return;
    }
    let n = scene.arms.len().max(1);
    // The time's axis, below the last one, takes two rows.
    let rows: Vec<Constraint> = (0..n)
        .map(|i| if i + 1 == n { Constraint::Length((inside.height + 2) / n as u16) } else { Constraint::Fill(1) })
        .collect();
    let places = Layout::vertical(rows).split(inside);
    for (i, place) in places.iter().enumerate().take(scene.arms.len()) {
        let points = scene.angles(i);
        let span = scene.span_s();
        let labels = if i + 1 == n { vec![format!("−{span} s"), "now".to_owned()] } else { Vec::new() };
        let y = angle(&scene.arms[i]).title(Line::from(scene.arms[i].symbol.clone()));
        frame.render_widget(chart(&points, axis([-span, 0.0], labels), y), *place);
    }
}

/// Rate against angle.
fn portrait(frame: &mut Frame<'_>, area: Rect, scene: &Scene, arm: usize) {
    let Some(of) = scene.arms.get(arm) else { return };
    let title =
        if area.width < 30 { format!(" phase {} ", of.symbol) } else { format!(" phase portrait of {} ", of.symbol) };
    let block = titled(title).title_bottom(format!(" last {} s ", scene.span_s()));
    if scene.newest().is_none() {
        return frame.render_widget(block, area);
    }
    let points = scene.portrait(arm);
    let (x, y) = (angle(of).title(format!("{} °", of.symbol)), rates(of.fastest).title(format!("{}′ °/s", of.symbol)));
    frame.render_widget(chart(&points, x, y).block(block), area);
}

/// Angle and rate each time the drive's phase passes 0.
fn section(frame: &mut Frame<'_>, area: Rect, scene: &Scene, arm: usize) {
    let Some(of) = scene.arms.get(arm) else { return };
    let points: Vec<(f64, f64)> = of.section.iter().copied().collect();
    let title = if area.width < 30 {
        format!(" section {} ", of.symbol)
    } else {
        format!(" Poincaré section of {} ", of.symbol)
    };
    let word = if points.len() == 1 { "point" } else { "points" };
    let block = titled(title).title_bottom(format!(" phase 0: {} {word} ", count(points.len() as u64)));
    if points.is_empty() {
        let why = if scene.newest().is_some_and(|s| s.phase_increment > 0) {
            "begins with the recording"
        } else {
            "the drive rests: a point comes each time its phase passes 0"
        };
        let text = Paragraph::new(why).wrap(Wrap { trim: true }).block(block);
        return frame.render_widget(text, area);
    }
    let (x, y) = (angle(of).title(format!("{} °", of.symbol)), rates(of.fastest).title(format!("{}′ °/s", of.symbol)));
    frame.render_widget(chart(&points, x, y).block(block), area);
}

#[cfg(test)]
mod tests {
    use super::nice;

    #[test]
    fn axes_end_at_round_numbers_that_hold_everything() {
        for (x, top) in [
            (0.0, 1.0),
            (f64::NAN, 1.0),
            (0.7, 1.0),
            (1.0, 1.0),
            (1234.0, 2000.0),
            (4999.0, 5000.0),
            (5001.0, 10_000.0),
        ] {
            assert_eq!(nice(x), top, "{x}");
        }
    }
}

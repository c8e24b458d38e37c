//! Every sample that is missing, by cause, and every gap.

use crate::inspect::Inspection;
use crate::report::html::{Align, Html};
use crate::report::{Results, SectionKind};
use crate::wording::format::{count, duration, instant, significant};

/// Most gaps listed.
const MOST: usize = 20;

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "losses", title: "Losses", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    for inspection in results.all::<Inspection>() {
        let r = &inspection.record;
        let l = &r.losses;
        let total = l.received + l.lost();
        if l.lost() == 0 && l.gaps == 0 && r.segments <= 1 && l.bad_frames == 0 && l.duplicates == 0 && l.restarts == 0
        {
            body.paragraph(&format!(
                "{}: nothing is missing, {} of {} samples.",
                r.file,
                count(r.samples),
                count(total.max(r.samples))
            ));
            continue;
        }
        body.heading(&r.file);
        let rows: Vec<Vec<Html>> = [
            ("received", l.received),
            ("lost on the link, or of unknown cause", l.lost_on_link),
            ("arrived damaged and were refused", l.damaged),
            ("never taken by the device (overruns)", l.overruns),
            ("dropped by the device (queue full)", l.dropped_by_device),
            ("rows with NaN", l.nan_rows),
        ]
        .iter()
        .filter(|(_, n)| *n > 0)
        .map(|(what, n)| {
            let share = if total > 0 { 100.0 * *n as f64 / total as f64 } else { 0.0 };
            vec![Html::text(what), Html::text(&count(*n)), Html::text(&format!("{} %", significant(share, 3)))]
        })
        .collect();
        let head = |t: &str, a| (Html::text(t), a);
        body.table(&[head("samples", Align::Left), head("number", Align::Right), head("share", Align::Right)], &rows);
        let others: Vec<(&str, String)> = [
            ("gaps", l.gaps),
            ("duplicates, kept once", l.duplicates),
            ("frames refused", l.bad_frames),
            ("device restarts", l.restarts),
        ]
        .iter()
        .filter(|(_, n)| *n > 0)
        .map(|(what, n)| (*what, count(*n)))
        .collect();
        if !others.is_empty() {
            body.facts(&others);
        }
        if !r.gaps.is_empty() {
            let rows: Vec<Vec<Html>> = r
                .gaps
                .iter()
                .take(MOST)
                .map(|g| {
                    let after = format!("{} s", instant(g.after_s, 1.0 / r.sample_rate_hz));
                    [after, duration(g.length_s), g.samples.to_string()].iter().map(|t| Html::text(t)).collect()
                })
                .collect();
            let right = Align::Right;
            body.table(&[head("gap after", right), head("length", right), head("samples missing", right)], &rows);
            if r.gaps.len() > MOST {
                body.paragraph(&format!("The first {MOST} of {} gaps.", count(r.gaps.len() as u64)));
            }
        }
    }
    (body != Html::new()).then_some(body)
}

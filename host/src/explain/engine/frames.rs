//! Frequencies at which the frame may give way. What rings shows a peak in what is left
//! ([`super::residual::lines`]), as under a drive, whose motion has all frequencies; a frame that is
//! pushed more slowly than it would ring follows the push, and below its resonance what is left of a
//! free swing has the lines of the motion alone. A grid of frequencies is tried there, of which the
//! best is moved like any other form.

use std::sync::Arc;

use rayon::prelude::*;

use super::candidates::Candidate;
use super::memory;
use super::setting::{Lines, Setting, with_lines};
use super::state::State;
use crate::effects::entry::{At, Entry, Form};
use crate::effects::places::Place;

/// Spacing of the grid in units of one over a window: a form in the middle is off by an eighth of a
/// turn at either end of it.
const SPACING: f64 = 0.5;
/// Most frequencies.
const MOST: f64 = 80.0;

/// Whether the form of a candidate is a frequency at which the frame gives way.
pub fn gives_way(c: &Candidate) -> bool {
    c.entry.at == At::Frame && c.entry.shapes.iter().any(|s| s.of_lines)
}

/// Frequencies, Hz, for windows of some length.
fn grid(highest_hz: f64, window_s: f64) -> Vec<f64> {
    let count = (highest_hz * window_s / SPACING).floor().clamp(1.0, MOST);
    // Few, and whole.
    (1..=count as usize).map(|k| k as f64 / count * highest_hz).collect()
}

/// A law over the grid of frequencies.
pub struct Scan {
    entry: Arc<Entry>,
    /// The law with every strength but the first at nothing: what the frame did when the record
    /// began is left out.
    alone: Arc<Entry>,
    place: Place,
    /// Forms of that.
    pub forms: Vec<Form>,
}

/// Those of the candidates' laws whose frame gives way, and that are neither in the model nor were
/// moved in vain; where nothing drives the motion.
pub fn scans(setting: &Setting<'_>, state: &State, among: &[Candidate]) -> Vec<Scan> {
    let Some(followed) = state.followed.as_ref().filter(|_| setting.rig.drive.is_none()) else { return Vec::new() };
    let (_, window_s) = followed.windows(setting);
    let of_frame = grid(setting.geometry.kernels.full.pass_hz, window_s);
    let frequencies = Lines { of_frame, ..Lines::default() };
    let found: Vec<String> = state.chosen.iter().map(|k| k.candidate.name(setting)).collect();
    let is_open = |c: &Candidate| {
        let name = c.name(setting);
        gives_way(c) && !found.contains(&name) && !state.moved_in_vain.contains(&name)
    };
    let mut out: Vec<Scan> = Vec::new();
    for c in among.iter().filter(|c| is_open(c)) {
        if out.iter().any(|s| s.entry.id == c.entry.id) {
            continue;
        }
        let entry = with_lines(c.entry.clone(), &frequencies);
        let alone = Arc::new(first_alone(&entry));
        out.push(Scan { entry, forms: alone.forms(), alone, place: c.place });
    }
    out
}

/// The same law with every strength but the first at nothing.
fn first_alone(entry: &Entry) -> Entry {
    let mut out = entry.clone();
    out.positive.truncate(1);
    let others = out.strengths.split_off(1);
    others.iter().fold(out, |e, name| e.with_shape(name, vec![0.0], None))
}

impl Scan {
    /// Some of its forms.
    pub fn candidates(&self, setting: &Setting<'_>, state: &State, forms: &[Form]) -> Vec<Candidate> {
        let of = |form: &Form| Candidate::new(setting, &self.alone, self.place, form.clone(), &state.physical);
        let all: Vec<Candidate> = forms.iter().filter_map(of).collect();
        all.into_par_iter().filter(|c| memory::is_followed(setting, c)).collect()
    }

    /// One of them with all strengths.
    pub fn whole(&self, setting: &Setting<'_>, state: &State, of: &Candidate) -> Option<Candidate> {
        let form = of.form[..self.entry.shapes.len()].to_vec();
        Candidate::new(setting, &self.entry, self.place, form, &state.physical)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_ends_at_what_the_low_pass_lets_through() {
        let all = grid(12.0, 2.0);
        assert_eq!((all.len(), all[0], all[47]), (48, 0.25, 12.0));
        assert_eq!(grid(12.0, 20.0).len(), 80);
        assert_eq!(grid(12.0, 0.01), [12.0]);
    }
}

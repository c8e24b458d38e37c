//! Two effects that only together are supported.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::{Evidence, Field, OF_A_FAMILY, Score};
use crate::explain::ranking;

/// Two candidates beside the model.
struct Pair<'a> {
    first: &'a Score,
    second: &'a Score,
    /// The larger of their probabilities by chance, each beside the other.
    p: f64,
    gain: f64,
    held_out: Vec<f64>,
}

impl Field<'_> {
    /// Two that only together are supported: each hides the other's trace while it is missing (a
    /// pendulum that Coulomb friction stops and whose damping grows with the swing looks viscous).
    /// Each must be significant beside the other, over all pairs; the one that takes away more by
    /// itself (of one and what refines it the simpler) comes first, with its probability.
    pub(super) fn pair<'b>(&'b self, order: &[&'b Score], together: &dyn Evidence) -> Option<(&'b Score, f64)> {
        let refines = |a: &Score, b: &Score| self.offers[a.index].refines.as_deref() == Some(self.name(b));
        // A refinement stands only beside what it refines, where that is on the list.
        let bears = |a: &Score, b: &Score| refines(a, b) || !order.iter().any(|o| refines(a, o));
        let all: Vec<(&Score, &Score)> = order
            .iter()
            .enumerate()
            .flat_map(|(k, a)| order[k + 1..].iter().map(move |b| (*a, *b)))
            .filter(|(a, b)| bears(a, b) && bears(b, a))
            .collect();
        let tests = all.len() as f64;
        // Columns where candidates are together: in this order behind the own ones.
        let mut at = self.own.len();
        let mut ranges: BTreeMap<usize, core::ops::Range<usize>> = BTreeMap::new();
        for s in order {
            let d = self.places[s.index].1;
            ranges.insert(s.index, at..at + d);
            at += d;
        }
        let range = |s: &Score| ranges.get(&s.index).cloned().unwrap_or_default();
        let fit = |first: &Score, last: &Score| -> Option<(f64, f64, Vec<f64>)> {
            let columns: Vec<usize> = self.own.iter().copied().chain(range(first)).chain(range(last)).collect();
            let d = self.places[last.index].1;
            if together.least_p(&columns, d)? * tests >= OF_A_FAMILY {
                return None;
            }
            let fit = together.fit(&columns)?;
            // One that would have to feed the motion is held at nothing.
            let first_at = fit.all.len() - d - self.places[first.index].1;
            if self.offers[first.index].positive && fit.all[first_at] <= 0.0 {
                return None;
            }
            let (gain, _) = ranking::gain(&self.plain.held_out, &fit.held_out);
            Some((ranking::p_value(&fit, d), gain, fit.held_out))
        };
        let scored: Vec<Pair<'_>> = all
            .par_iter()
            .filter_map(|&(a, b)| {
                let ((p, gain, held_out), (q, ..)) = (fit(a, b)?, fit(b, a)?);
                Some(Pair { first: a, second: b, p: p.max(q), gain, held_out })
            })
            .collect();
        let supported: Vec<&Pair<'_>> = scored
            .iter()
            .filter(|x| {
                let single = x.first.gain.max(x.second.gain).max(0.0);
                let (_, error) = ranking::gain(&self.plain.held_out, &x.held_out);
                let more = x.gain - single;
                let clear = more > self.evidence.least_deviations() * error;
                x.p * tests < OF_A_FAMILY && clear && self.is_something(more)
            })
            .collect();
        let best = supported.iter().max_by(|x, y| x.gain.total_cmp(&y.gain))?;
        // Of those within a standard error the simplest, then those that stand first in the
        // catalogue: its laws are in the order of how common they are.
        let within = supported.iter().filter(|x| {
            let (mean, error) = ranking::gain(&x.held_out, &best.held_out);
            mean <= error
        });
        let size = |s: &Score| self.offers[s.index].strengths + self.offers[s.index].shapes;
        let Pair { first: a, second: b, p, .. } =
            within.min_by_key(|x| (size(x.first) + size(x.second), x.first.index.max(x.second.index)))?;
        Some((if refines(a, b) { b } else { a }, *p))
    }
}

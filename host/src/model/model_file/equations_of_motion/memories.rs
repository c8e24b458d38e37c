//! States of effects with a memory among an equation's terms: those that are followed with the
//! motion, as rates behind those of the coordinates, and those that were followed along a record.

use std::sync::Arc;

use crate::model::model_file::by_parts::gather;
use crate::model::model_file::expression::{Node, Symbol, symbol};
use crate::model::model_file::memory::Memory;

/// Every state of the memories in some terms.
pub(super) fn hidden(extra: &[(usize, String, Node)]) -> Vec<(Arc<Memory>, usize)> {
    let mut found = Vec::new();
    extra.iter().for_each(|(_, _, of)| of.memories(&mut found));
    let mut out: Vec<(Arc<Memory>, usize)> = Vec::new();
    for (memory, _) in found {
        if !out.iter().any(|(m, _)| *m == memory) {
            out.extend((0..memory.len()).map(|k| (memory.clone(), k)));
        }
    }
    out
}

/// The rate that stands for a state behind `n` coordinates.
pub(super) fn state_rate(hidden: &[(Arc<Memory>, usize)], memory: &Arc<Memory>, state: usize, n: usize) -> Node {
    let place = hidden.iter().position(|(m, k)| m == memory && *k == state);
    place.map_or_else(|| symbol(Symbol::State(state)), |k| symbol(Symbol::Rate(n + k)))
}

/// A term with its states as rates.
pub(super) fn with_rates(of: &Node, hidden: &[(Arc<Memory>, usize)], n: usize) -> Node {
    of.with_memories(&|m, k| state_rate(hidden, m, k, n))
}

/// Numbers of followed states in some terms, sorted.
pub(super) fn remembered(extra: &[(usize, String, Node)]) -> Vec<usize> {
    let mut symbols = Vec::new();
    extra.iter().for_each(|(_, _, of)| gather(of, &mut symbols));
    let numbers = symbols.into_iter().filter_map(|s| if let Symbol::Memory(k) = s { Some(k) } else { None });
    let mut out: Vec<usize> = numbers.collect();
    out.sort_unstable();
    out.dedup();
    out
}

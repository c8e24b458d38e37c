//! How vectors are shared among the leaves of the tree: every node's are halved at the median of
//! its widest component, the first half the smaller one.

use super::FAR;
use crate::phase_space::embedding::Embedding;

/// Vectors of a leaf: from, to. The tree halves n again and again, the first half the smaller one.
pub(super) fn bounds(leaf: usize, count: usize, n: usize) -> (usize, usize) {
    let (mut from, mut to, mut half, mut rest) = (0, n, count / 2, leaf);
    while half > 0 {
        let middle = from + (to - from) / 2;
        if rest >= half {
            from = middle;
            rest -= half;
        } else {
            to = middle;
        }
        half /= 2;
    }
    (from, to)
}

/// Middle and half width of an arc; a little wider, so that rounding never cuts a vector off.
pub(super) fn arc(low: f32, high: f32) -> (f32, f32) {
    if low > high { (FAR, 0.0) } else { (0.5 * (low + high), 0.5 * (high - low) + 2.5e-7) }
}

/// Orders the keys so that every node's vectors lie together: halves at the median of the widest
/// component.
pub(super) fn split(e: &Embedding<'_>, d: usize, keys: &mut [u64], leaves: usize) {
    if leaves <= 1 || keys.len() < 2 {
        return;
    }
    let mut widest = (0, -1.0f32);
    for j in 0..d {
        // A sample of the node's vectors tells its widest component well enough.
        let step = keys.len().div_ceil(96);
        let (low, high) = keys.iter().step_by(step).fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), k| {
            let v = e.at(e.starts[*k as u32 as usize], j);
            (l.min(v), h.max(v))
        });
        if high - low > widest.1 {
            widest = (j, high - low);
        }
    }
    for k in keys.iter_mut() {
        let index = *k as u32;
        *k = u64::from(e.at(e.starts[index as usize], widest.0).to_bits()) << 32 | u64::from(index);
    }
    let middle = keys.len() / 2;
    keys.select_nth_unstable(middle);
    let (left, right) = keys.split_at_mut(middle);
    if right.len() > 4096 {
        rayon::join(|| split(e, d, left, leaves / 2), || split(e, d, right, leaves / 2));
    } else {
        split(e, d, left, leaves / 2);
        split(e, d, right, leaves / 2);
    }
}

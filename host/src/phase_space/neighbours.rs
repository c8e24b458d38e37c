//! Exact nearest neighbours of every delay vector, on the circle, outside a Theiler window (Theiler
//! 1986): vectors that are closer in time than w samples are no neighbours, for their nearness says
//! nothing of the attractor.
//!
//! A k-d tree (Bentley 1975) with up to 16 vectors a leaf and a tight box at each node; a box is an
//! arc in each angle. The queries of a leaf go down the tree together: what the box of all of them
//! cannot reach is looked at once. A search starts from a bound: the neighbour in the dimension
//! before, where there is one, and the neighbours of the leaf's other vectors.
//!
//! Leaves are compared with pulp's choice of vector instructions (it is faer's too): found at run
//! time, without unsafe code.
//!
//! Distances: squares of Euclidean ones of [`super::observable::distance`], in single precision.
//! Results do not depend on the number of threads: each query's answer is its own (of two equally
//! near vectors the first met). Cost about n log n; memory about (8 d + 24) bytes a vector.

mod partition;

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use self::partition::{arc, bounds, split};
use super::embedding::Embedding;
use super::observable::distance;

/// Vectors a leaf at most.
const LEAF: usize = 16;
/// Coordinate of the places of a leaf that hold no vector: farther than anything, and its square is
/// still finite.
const FAR: f32 = 1e9;
/// A distance that no two vectors have.
const NONE: f32 = 1e17;
/// No neighbour.
pub const NOBODY: u32 = u32::MAX;

/// The nearest neighbour of each vector.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbours {
    /// Start (time) of the nearest vector, [`NOBODY`] where the window leaves none; in the order of
    /// the embedding's starts.
    pub start: Vec<u32>,
    /// Square of its distance.
    pub distance2: Vec<f32>,
}

/// Tree over the first `dimension` components of an embedding.
pub struct Tree<'a> {
    embedding: &'a Embedding<'a>,
    dimension: usize,
    periods: Vec<f32>,
    /// Index of each vector among the embedding's starts, leaf by leaf, 16 places each; [`NOBODY`]
    /// for none.
    places: Vec<u32>,
    /// Start of each vector, likewise.
    times: Vec<u32>,
    /// Coordinates, leaf by leaf, dimension by dimension, 16 places each.
    leaves: Vec<f32>,
    /// Middle and half width of the nodes' boxes, node by node (heap order), dimension by
    /// dimension.
    boxes: Vec<(f32, f32)>,
    /// Number of leaves, a power of two.
    leaf_count: usize,
}

impl<'a> Tree<'a> {
    /// Builds the tree.
    pub fn new(embedding: &'a Embedding<'a>, dimension: usize) -> Self {
        let dimension = dimension.min(embedding.components.len());
        let n = embedding.len();
        let leaf_count = n.div_ceil(LEAF).next_power_of_two();
        let periods: Vec<f32> = embedding.components[..dimension].iter().map(|c| c.of.period).collect();
        // Coordinate's bits above, index below: coordinates are not negative, so the bits sort as
        // they do.
        let mut keys: Vec<u64> = (0..n as u64).collect();
        if dimension > 0 {
            split(embedding, dimension, &mut keys, leaf_count);
        }
        let mut tree = Self {
            embedding,
            dimension,
            periods,
            places: vec![NOBODY; leaf_count * LEAF],
            times: vec![NOBODY; leaf_count * LEAF],
            leaves: vec![FAR; leaf_count * LEAF * dimension],
            boxes: vec![(0.0, 0.0); 2 * leaf_count * dimension],
            leaf_count,
        };
        tree.fill(&keys);
        tree
    }

    fn fill(&mut self, keys: &[u64]) {
        let (d, n, e) = (self.dimension, keys.len(), self.embedding);
        if d == 0 {
            return;
        }
        let count = self.leaf_count;
        let (_, leaf_boxes) = self.boxes.split_at_mut(count * d);
        self.places
            .par_chunks_mut(LEAF)
            .zip(self.times.par_chunks_mut(LEAF))
            .zip(self.leaves.par_chunks_mut(LEAF * d))
            .zip(leaf_boxes.par_chunks_mut(d))
            .enumerate()
            .with_min_len(256)
            .for_each(|(leaf, (((places, times), x), boxes))| {
                let (from, to) = bounds(leaf, count, n);
                let mut low_high = vec![(f32::INFINITY, f32::NEG_INFINITY); d];
                for (place, key) in keys[from..to].iter().enumerate() {
                    let index = *key as u32;
                    let time = e.starts[index as usize];
                    (places[place], times[place]) = (index, time);
                    for j in 0..d {
                        let v = e.at(time, j);
                        x[j * LEAF + place] = v;
                        low_high[j] = (low_high[j].0.min(v), low_high[j].1.max(v));
                    }
                }
                for (b, (low, high)) in boxes.iter_mut().zip(low_high) {
                    *b = arc(low, high);
                }
            });
        // Upper boxes from the lower ones; an empty leaf's is far from all.
        for node in (1..count).rev() {
            for j in 0..d {
                let (a, b) = (self.boxes[2 * node * d + j], self.boxes[(2 * node + 1) * d + j]);
                self.boxes[node * d + j] = match (a.0 >= FAR, b.0 >= FAR) {
                    (true, _) => b,
                    (_, true) => a,
                    _ => arc((a.0 - a.1).min(b.0 - b.1), (a.0 + a.1).max(b.0 + b.1)),
                };
            }
        }
    }

    /// Square of a lower bound of the distances between two boxes.
    #[inline(always)]
    fn apart(&self, a: &[(f32, f32)], node: usize) -> f32 {
        let b = &self.boxes[node * self.dimension..(node + 1) * self.dimension];
        let mut sum = 0.0;
        for ((a, b), period) in a.iter().zip(b).zip(&self.periods) {
            let gap = distance(a.0, b.0, *period) - a.1 - b.1;
            let gap = if gap > 0.0 { gap } else { 0.0 };
            sum += gap * gap;
        }
        sum
    }

    /// The nearest neighbour of every vector, farther than `theiler` samples in time. `hints`:
    /// lists of starts that may be near, one for each vector (say of the dimension before) or
    /// [`NOBODY`]; all of them are outside its window.
    pub fn nearest(&self, theiler: u32, hints: &[Vec<u32>]) -> Neighbours {
        let n = self.embedding.len();
        let mut out = Neighbours { start: vec![NOBODY; n], distance2: vec![f32::INFINITY; n] };
        if self.dimension == 0 {
            return out;
        }
        let arch = Arch::new();
        let found: Vec<[(f32, u32); LEAF]> = (0..self.leaf_count)
            .into_par_iter()
            .with_min_len(64)
            .map_init(Vec::new, |stack, leaf| arch.dispatch(Search { tree: self, leaf, theiler, hints, stack }))
            .collect();
        for (leaf, best) in found.iter().enumerate() {
            for (place, (distance2, start)) in best.iter().enumerate() {
                let index = self.places[leaf * LEAF + place];
                if index != NOBODY && *start != NOBODY {
                    out.start[index as usize] = *start;
                    out.distance2[index as usize] = *distance2;
                }
            }
        }
        out
    }

    /// The `k` nearest vectors to the one that starts at `start`, farther than `theiler` samples in
    /// time, nearest first: squares of the distances and starts, into `best` (fewer where there are
    /// no more). `stack` is scratch.
    pub fn near(&self, start: u32, theiler: u32, k: usize, best: &mut Vec<(f32, u32)>, stack: &mut Vec<(f32, usize)>) {
        best.clear();
        stack.clear();
        let d = self.dimension;
        if d == 0 || k == 0 {
            return;
        }
        let query: Vec<(f32, f32)> = (0..d).map(|j| (self.embedding.at(start, j), 0.0)).collect();
        stack.push((0.0, 1));
        let mut reach = NONE;
        while let Some((gap, node)) = stack.pop() {
            if gap >= reach {
                continue;
            }
            if node < self.leaf_count {
                let (left, right) = (self.apart(&query, 2 * node), self.apart(&query, 2 * node + 1));
                let pair = [(left, 2 * node), (right, 2 * node + 1)];
                let order = if left <= right { [pair[1], pair[0]] } else { pair };
                stack.extend(order.iter().filter(|c| c.0 < reach));
                continue;
            }
            let leaf = node - self.leaf_count;
            let mut sums = [0.0f32; LEAF];
            for (j, row) in self.leaves[leaf * LEAF * d..(leaf + 1) * LEAF * d].chunks_exact(LEAF).enumerate() {
                for (s, p) in sums.iter_mut().zip(row) {
                    let a = distance(query[j].0, *p, self.periods[j]);
                    *s += a * a;
                }
            }
            for (s, t) in sums.iter().zip(&self.times[leaf * LEAF..]) {
                if *s < reach && *t != NOBODY && t.abs_diff(start) > theiler {
                    let place = best.partition_point(|b| b.0 <= *s);
                    best.insert(place, (*s, *t));
                    best.truncate(k);
                    if best.len() == k {
                        reach = best[k - 1].0;
                    }
                }
            }
        }
    }

    /// Nearest neighbours of one leaf's vectors: square of the distance and start.
    #[inline(always)]
    fn search(
        &self,
        leaf: usize,
        theiler: u32,
        hints: &[Vec<u32>],
        stack: &mut Vec<(f32, usize)>,
    ) -> [(f32, u32); LEAF] {
        let d = self.dimension;
        let mut best = [(NONE, NOBODY); LEAF];
        let here = leaf * LEAF;
        let used = self.places[here..here + LEAF].iter().take_while(|p| **p != NOBODY).count();
        if used == 0 {
            return best;
        }
        let coordinates = &self.leaves[here * d..(here + LEAF) * d];
        for place in 0..used {
            let (index, time) = (self.places[here + place] as usize, self.times[here + place]);
            for hint in hints.iter().map(|h| h[index]).filter(|h| *h != NOBODY) {
                let distance2 = self.embedding.distance2(time, hint, d);
                if distance2 < best[place].0 {
                    best[place] = (distance2, hint);
                }
            }
        }
        // What is near to one of a leaf is near to the others.
        for place in 1..used {
            let (time, near) = (self.times[here + place], best[place - 1].1);
            if near != NOBODY && near.abs_diff(time) > theiler {
                let distance2 = self.embedding.distance2(time, near, d);
                if distance2 < best[place].0 {
                    best[place] = (distance2, near);
                }
            }
        }
        self.scan(leaf, coordinates, here, used, theiler, &mut best);
        let own = &self.boxes[(self.leaf_count + leaf) * d..(self.leaf_count + leaf + 1) * d];
        let widest = |best: &[(f32, u32); LEAF]| best[..used].iter().fold(0.0f32, |w, b| w.max(b.0));
        let mut reach = widest(&best);
        stack.clear();
        stack.push((0.0, 1));
        while let Some((gap, node)) = stack.pop() {
            if gap >= reach {
                continue;
            }
            if node >= self.leaf_count {
                if node - self.leaf_count != leaf {
                    self.scan(node - self.leaf_count, coordinates, here, used, theiler, &mut best);
                    reach = widest(&best);
                }
                continue;
            }
            let (left, right) = (self.apart(own, 2 * node), self.apart(own, 2 * node + 1));
            let (near, far) = if left <= right {
                ((left, 2 * node), (right, 2 * node + 1))
            } else {
                ((right, 2 * node + 1), (left, 2 * node))
            };
            if far.0 < reach {
                stack.push(far);
            }
            if near.0 < reach {
                stack.push(near);
            }
        }
        best
    }

    /// Compares `used` queries (coordinates as in a leaf, starting at place `here`) with the
    /// vectors of a leaf.
    #[inline(always)]
    fn scan(
        &self,
        leaf: usize,
        queries: &[f32],
        here: usize,
        used: usize,
        theiler: u32,
        best: &mut [(f32, u32); LEAF],
    ) {
        let d = self.dimension;
        let points = &self.leaves[leaf * LEAF * d..(leaf + 1) * LEAF * d];
        let times = &self.times[leaf * LEAF..(leaf + 1) * LEAF];
        let bounding = &self.boxes[(self.leaf_count + leaf) * d..(self.leaf_count + leaf + 1) * d];
        // How far each query is from the leaf's box, all of them at once.
        let mut gaps = [0.0f32; LEAF];
        for ((row, bound), period) in queries.chunks_exact(LEAF).zip(bounding).zip(&self.periods) {
            for (g, x) in gaps.iter_mut().zip(row) {
                let gap = distance(*x, bound.0, *period) - bound.1;
                let gap = if gap > 0.0 { gap } else { 0.0 };
                *g += gap * gap;
            }
        }
        for q in 0..used {
            if gaps[q] >= best[q].0 {
                continue;
            }
            let mut sums = [0.0f32; LEAF];
            let mut near = 0.0;
            for (group, rows) in points.chunks(4 * LEAF).enumerate() {
                for (j, row) in rows.chunks_exact(LEAF).enumerate() {
                    let (x, period) = (queries[(4 * group + j) * LEAF + q], self.periods[4 * group + j]);
                    for (s, p) in sums.iter_mut().zip(row) {
                        let a = distance(x, *p, period);
                        *s += a * a;
                    }
                }
                // Most leaves are out of reach after four components.
                near = least(&sums);
                if near >= best[q].0 {
                    break;
                }
            }
            if near >= best[q].0 {
                continue;
            }
            let time = self.times[here + q];
            for (s, t) in sums.iter().zip(times) {
                if *s < best[q].0 && t.abs_diff(time) > theiler && *t != NOBODY {
                    best[q] = (*s, *t);
                }
            }
        }
    }
}

/// The least of 16 numbers, by halves: as wide as the processor compares them.
#[inline(always)]
fn least(x: &[f32; LEAF]) -> f32 {
    let less = |a: f32, b: f32| if a < b { a } else { b };
    let eight: [f32; 8] = core::array::from_fn(|i| less(x[i], x[i + 8]));
    let four: [f32; 4] = core::array::from_fn(|i| less(eight[i], eight[i + 4]));
    less(less(four[0], four[2]), less(four[1], four[3]))
}

/// A leaf's search, compiled for each width of vectors that processors have; the same operations in
/// the same order, and so the same results.
struct Search<'a, 'b> {
    tree: &'a Tree<'a>,
    leaf: usize,
    theiler: u32,
    hints: &'a [Vec<u32>],
    stack: &'b mut Vec<(f32, usize)>,
}

impl NullaryFnOnce for Search<'_, '_> {
    type Output = [(f32, u32); LEAF];

    #[inline(always)]
    fn call(self) -> Self::Output {
        self.tree.search(self.leaf, self.theiler, self.hints, self.stack)
    }
}

#[cfg(test)]
#[path = "neighbours_tests.rs"]
mod tests;

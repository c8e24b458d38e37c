//! A window's normal equations, its initial state eliminated.
//!
//! Products are summed segment by segment, each by the state with which it begins, and these follow
//! from the window's initial state s. In chaos that state and all columns grow along one direction, and
//! what is left without it is the small difference of large numbers. Where digits are lost so, s is
//! taken as P s' + Q c + r: r and Q what the first elimination gives for the target and the columns c,
//! P what makes the products of the state with itself 1. The columns then show what the state does not
//! take up, in numbers of their own size, and hardly anything is left to be eliminated (iterative
//! refinement; twice by Cholesky's factor: Fukaya, Nakatsukasa, Yanagisawa and Yamamoto 2014).

use core::ops::{AddAssign, Range};
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::cut::{Block, Cut};
use super::gram::{Gram, Layout, Sums};
use super::linear::{Linear, Measured};

/// Most times that the state is taken anew.
const MOST_TIMES: usize = 3;

/// Normal equations of a window or a part of one.
#[derive(Clone)]
pub struct Normal {
    /// Sums of products of the initial state s', the columns and the target, all rows in units of the
    /// noise.
    sums: Sums,
    /// [P | Q | −r] of the initial state s.
    begin: DMatrix<f64>,
    /// Rows.
    pub rows: usize,
    /// How many of the initial state's last entries are at nothing.
    pinned: usize,
}

/// Samples one after the other, so few of a window that little grows between them.
pub struct Segment {
    /// By the state with which they begin.
    pub normal: Normal,
    /// [P | Q | −r] of the state with which they end.
    pub map: DMatrix<f64>,
}

/// A state behind another: of s'' = [P | Q | −r] (s', c, 1) what s' = [P' | Q' | −r'] (s, c, 1) makes.
fn behind(map: &DMatrix<f64>, before: &DMatrix<f64>) -> DMatrix<f64> {
    let (d, width) = map.shape();
    let mut out = map.columns(0, d) * before;
    out.columns_mut(d, width - d).add_assign(&map.columns(d, width - d));
    out
}

/// Sums over segments one after the other, with which the first begins where `begin` says; what they
/// make of it is left there.
fn joined<'a>(segments: impl Iterator<Item = (&'a Sums, &'a DMatrix<f64>)>, begin: &mut DMatrix<f64>, to: &mut Sums) {
    for (sums, map) in segments {
        sums.carried(begin, to);
        *begin = behind(map, begin);
    }
}

impl Normal {
    /// Of sums by the initial state itself.
    pub fn new(sums: Sums, rows: usize, pinned: usize) -> Self {
        let begin = sums.as_they_begin();
        Self { sums, begin, rows, pinned }
    }

    /// Of blocks, each a list of segments, and what each block adds to it. `first` are their sums by
    /// the initial state itself.
    fn over(first: Vec<Sums>, blocks: &[&[Segment]], rows: usize, pinned: usize) -> Option<(Self, Vec<Sums>)> {
        let whole = |parts: &[Sums]| {
            let (first, rest) = parts.split_first()?;
            let mut sum = first.clone();
            rest.iter().for_each(|p| sum.add(p));
            Some(sum)
        };
        let mut parts = first;
        let mut normal = Self::new(whole(&parts)?, rows, pinned);
        for _ in 0..MOST_TIMES {
            let Some(better) = normal.sums.better(pinned) else { break };
            normal.begin = behind(&normal.begin, &better);
            let mut at = normal.begin.clone();
            let of = |block: &&[Segment]| {
                let mut sums = normal.sums.none();
                joined(block.iter().map(|s| (&s.normal.sums, &s.map)), &mut at, &mut sums);
                sums
            };
            parts = blocks.iter().map(of).collect();
            normal.sums = whole(&parts)?;
        }
        Some((normal, parts))
    }

    /// The Gram matrix with the initial state eliminated; none where the record does not determine
    /// it.
    pub fn reduced(&self) -> Option<Gram> {
        self.sums.reduced(self.pinned)
    }

    /// The initial state s' for every column and the target; none where the record does not determine
    /// it.
    pub fn solved(&self) -> Option<DMatrix<f64>> {
        self.sums.solved(self.pinned)
    }

    /// The initial step that goes with a step of the first columns.
    pub fn start(&self, step: &DVector<f64>) -> Option<DVector<f64>> {
        let (square, coupling) = self.sums.of_first(self.pinned);
        let last = coupling.ncols() - 1;
        let right = coupling.column(last) - coupling.columns(0, step.len()) * step;
        let d = square.nrows();
        let own = square.cholesky()?.solve(&right);
        let begin = &self.begin;
        Some(begin.columns(0, d) * own + begin.columns(d, step.len()) * step - begin.column(d + last))
    }
}

impl Linear {
    /// The normal equations of a window over columns whose accelerations from one point to another
    /// `alpha` gives (see [`super::forcing::Driven::between`]), and those of its blocks. None where
    /// `alpha` has none.
    pub fn normal(
        &self,
        states: &[f64],
        mut alpha: impl FnMut(Range<usize>, &mut Vec<f64>) -> Option<()>,
        layout: &Arc<Layout>,
        measured: &Measured<'_>,
        cut: Cut,
    ) -> Option<(Normal, Vec<Block>)> {
        let m = 2 * measured.shown.first().map_or(0, Vec::len);
        let (count, pinned) = (states.len() / m, self.size - m);
        let mut accelerations = Vec::new();
        let mut segments: Vec<Vec<Segment>> = Vec::with_capacity(cut.blocks);
        for own in cut.ranges(count) {
            let mut all = Vec::new();
            for first in own.clone().step_by(cut.segment) {
                let end = (first + cut.segment).min(own.end);
                alpha(first * self.each..end.min(count - 1) * self.each + 1, &mut accelerations)?;
                all.push(self.segment(states, &accelerations, layout, measured, first..end));
            }
            segments.push(all);
        }
        let none = Sums::zeros(layout, self.size);
        // Blocks by themselves, and what each makes of the state with which it begins.
        let (mut alone, mut first, mut at) = (Vec::new(), Vec::new(), none.as_they_begin());
        for block in &segments {
            let (mut sums, mut map) = (none.clone(), none.as_they_begin());
            joined(block.iter().map(|s| (&s.normal.sums, &s.map)), &mut map, &mut sums);
            if segments.len() > 1 {
                let mut of_window = none.clone();
                joined(std::iter::once((&sums, &map)), &mut at, &mut of_window);
                first.push(of_window);
            }
            let rows = block.iter().map(|s| s.normal.rows).sum();
            alone.push(Normal::over(vec![sums], &[block], rows, pinned)?.0);
        }
        let rows = alone.iter().map(|a| a.rows).sum();
        let all: Vec<&[Segment]> = segments.iter().map(Vec::as_slice).collect();
        let (whole, parts) = match &alone[..] {
            [one] => (one.clone(), vec![one.sums.clone()]),
            _ => Normal::over(first, &all, rows, pinned)?,
        };
        let full = cut.segment * measured.shown.len();
        let blocks = parts.into_iter().zip(alone).zip(segments).map(|((of_window, alone), all)| {
            let segments = all.into_iter().map(|s| s.normal).filter(|s| s.rows == full).collect();
            Block { of_window, alone, segments }
        });
        Some((whole, blocks.collect()))
    }
}

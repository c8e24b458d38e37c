//! Columns that are carried along a window together: with their rows they stay in the cache, where
//! those of hundreds of candidates do not.

use std::ops::Range;

use nalgebra::{DMatrix, DMatrixView};

use super::linear::{Linear, Measured};
use crate::model::vectors::{add_scaled, combine};

/// Rows whose products are summed at once.
const CHUNK: usize = 256;
/// Columns of a strip, groups whole.
pub(super) const STRIP: usize = 64;

/// Multiples that are summed.
type Terms<'a> = Vec<(f64, &'a [f64])>;

/// A range of samples of a window that ends at `last`, and what is fitted to it.
pub(super) struct Along<'a> {
    pub alpha: &'a [f64],
    /// Of the layout.
    pub columns: usize,
    pub measured: &'a Measured<'a>,
    pub samples: Range<usize>,
    pub last: usize,
}

/// Columns that are carried along together: the first state's, some of the layout, and what defects
/// add up to.
pub(super) struct Strip {
    pub lead: usize,
    pub columns: Range<usize>,
    pub trail: usize,
}

impl Strip {
    pub fn width(&self) -> usize {
        self.lead + self.columns.len() + self.trail
    }

    /// Puts rows of the strip's columns into rows of all, of which the first state's are the first.
    pub fn place(&self, rows: &[f64], all: &mut [f64], width: usize) {
        let d = rows.len() / self.width();
        for (from, to) in rows.chunks_exact(self.width()).zip(all.chunks_exact_mut(width)) {
            let (lead, rest) = from.split_at(self.lead);
            let (middle, trail) = rest.split_at(self.columns.len());
            to[..self.lead].copy_from_slice(lead);
            to[d + self.columns.start..d + self.columns.end].copy_from_slice(middle);
            to[width - self.trail..].copy_from_slice(trail);
        }
    }
}

impl Linear {
    /// What the columns of a strip make of the state at the end of a range of samples, row after
    /// row, having shown what sensors see of them to `full`, [`CHUNK`] rows at most at a time, each a
    /// column.
    pub(super) fn carried(
        &self,
        strip: &Strip,
        along: &Along<'_>,
        mut full: impl FnMut(usize, &DMatrixView<'_, f64>),
    ) -> Vec<f64> {
        let Along { alpha, columns, measured, samples, last } = along;
        let sensors = measured.shown.len();
        let n = measured.shown.first().map_or(0, Vec::len);
        let (d, width) = (self.size, strip.width());
        let middle = strip.lead..strip.lead + strip.columns.len();
        let mut z = vec![0.0; d * width];
        (0..strip.lead).for_each(|i| z[i * width + i] = 1.0);
        let mut next = z.clone();
        let accelerations = |k: usize, point: usize, i: usize| {
            &alpha[((k * self.each + point - samples.start * self.each) * n + i) * columns..][strip.columns.clone()]
        };
        let half = 0.5 * self.spacing;
        let mut chunk = DMatrix::zeros(width, CHUNK.min(samples.len() * sensors));
        let (mut filled, mut done) = (0, 0);
        for k in samples.clone() {
            let mut terms: Terms<'_> = Vec::with_capacity(d);
            for s in 0..sensors {
                let row = &mut chunk.as_mut_slice()[filled * width..(filled + 1) * width];
                let scale = 1.0 / measured.sigma[s];
                terms.clear();
                let weights = measured.shown[s].iter().zip(z.chunks_exact(width)).filter(|w| *w.0 != 0.0);
                terms.extend(weights.map(|(w, z)| (w * scale, z)));
                combine(row, &terms);
                for (i, w) in measured.shown[s].iter().enumerate().filter(|w| *w.1 != 0.0) {
                    let ahead = w * scale * self.spacing * self.spacing / 12.0;
                    add_scaled(&mut row[middle.clone()], ahead, accelerations(k, 0, i));
                }
                for (c, _, law) in measured.laws.iter().filter(|l| l.1 == s && strip.columns.contains(&l.0)) {
                    row[strip.lead + c - strip.columns.start] += scale * law[k];
                }
                filled += 1;
                if filled == chunk.ncols() {
                    full(done, &chunk.as_view());
                    (done, filled) = (done + filled, 0);
                }
            }
            if k == *last {
                break;
            }
            for point in 0..self.each {
                let a = &self.slopes[d * d * (k * self.each + point)..];
                for i in 0..n {
                    let from = (n + i) * width;
                    add_scaled(&mut z[from + middle.start..from + middle.end], half, accelerations(k, point, i));
                }
                let mut terms: Terms<'_> = Vec::with_capacity(d);
                for (i, to) in next.chunks_exact_mut(width).enumerate() {
                    let by = z.chunks_exact(width).zip(&a[i * d..(i + 1) * d]).filter(|(_, f)| **f != 0.0);
                    terms.clear();
                    terms.extend(by.map(|(z, f)| (*f, z)));
                    combine(to, &terms);
                    if (n..2 * n).contains(&i) {
                        add_scaled(&mut to[middle.clone()], half, accelerations(k, point + 1, i - n));
                    }
                }
                core::mem::swap(&mut z, &mut next);
            }
            if strip.trail > 0 {
                (0..d).for_each(|i| z[(i + 1) * width - 1] += self.defects[d * k + i]);
            }
        }
        if filled > 0 {
            full(done, &chunk.columns(0, filled));
        }
        z
    }
}

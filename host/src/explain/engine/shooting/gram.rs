//! Gram matrices of the model's own columns with everything, and of candidates with themselves: two
//! candidates that are never fitted together need no product, which is most of the work where there
//! are hundreds.

use core::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, DMatrixView};

/// Which columns are fitted together: the own ones, which come first, with all; those of a group
/// with one another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Own columns.
    pub own: usize,
    /// All columns.
    pub columns: usize,
    /// First column of each group and their number.
    groups: Vec<(usize, usize)>,
    /// Group of each column behind the own ones.
    group_of: Vec<usize>,
}

impl Layout {
    /// Groups of some sizes behind own columns.
    pub fn new(own: usize, sizes: &[usize]) -> Arc<Self> {
        let mut at = own;
        let (mut groups, mut group_of) = (Vec::with_capacity(sizes.len()), Vec::new());
        for (k, size) in sizes.iter().enumerate() {
            groups.push((at, *size));
            group_of.resize(group_of.len() + size, k);
            at += size;
        }
        Arc::new(Self { own, columns: at, groups, group_of })
    }

    /// The columns behind the own ones in strips of whole groups, about `width` columns each.
    pub fn strips(&self, width: usize) -> Vec<Range<usize>> {
        let mut out: Vec<Range<usize>> = Vec::new();
        for &(at, size) in self.groups.iter().filter(|g| g.1 > 0) {
            match out.last_mut() {
                Some(last) if last.len() + size <= width => last.end = at + size,
                _ => out.push(at..at + size),
            }
        }
        out
    }

    /// The same with the groups of another of the same own columns behind its own.
    pub fn joined(&self, other: &Self) -> Arc<Self> {
        let sizes: Vec<usize> = self.groups.iter().chain(&other.groups).map(|g| g.1).collect();
        Self::new(self.own, &sizes)
    }
}

/// Share of a column's square below which what is left of it without the first columns has lost
/// digits: of sixteen seven are left.
const LOST: f64 = 1e-9;
/// What is added to products of the first columns, as a share, where rounding makes them indefinite.
const SHIFT: f64 = 1e-13;

/// Sums of products over rows that begin with `first` columns more than the layout has (an initial
/// state), which go with all.
#[derive(Clone, Debug)]
pub struct Sums {
    layout: Arc<Layout>,
    first: usize,
    /// The first, the own columns and the target with all columns and the target.
    head: DMatrix<f64>,
    groups: Vec<DMatrix<f64>>,
}

/// The same of the layout's columns and the target alone.
#[derive(Clone, Debug)]
pub struct Gram(Sums);

impl Sums {
    /// Nothing yet.
    pub fn zeros(layout: &Arc<Layout>, first: usize) -> Self {
        Self {
            head: DMatrix::zeros(first + layout.own + 1, first + layout.columns + 1),
            groups: layout.groups.iter().map(|g| DMatrix::zeros(g.1, g.1)).collect(),
            layout: layout.clone(),
            first,
        }
    }

    /// Adds products of the first, the own columns and the target with one another: rows of these,
    /// each a column.
    pub fn push_head(&mut self, head: &DMatrix<f64>) {
        let (own, turned) = (self.first + self.layout.own, head.transpose());
        let product = head * turned;
        let target = self.head.ncols() - 1;
        for i in 0..=own {
            (0..own).for_each(|j| self.head[(i, j)] += product[(i, j)]);
            self.head[(i, target)] += product[(i, own)];
        }
    }

    /// Adds products of columns behind the own ones, whole groups from column `from` on, with the
    /// head's and with one another: rows of both, each a column.
    pub fn push(&mut self, head: &DMatrixView<'_, f64>, from: usize, rows: &DMatrixView<'_, f64>) {
        let turned = rows.transpose();
        self.head.columns_mut(self.first + from, rows.nrows()).gemm(1.0, head, &turned, 1.0);
        let within = |g: &&(usize, usize)| g.0 >= from && g.0 + g.1 <= from + rows.nrows();
        let begin = self.layout.groups.partition_point(|g| g.0 < from);
        let groups = self.layout.groups[begin..].iter().take_while(within);
        for (&(at, size), group) in groups.zip(&mut self.groups[begin..]) {
            let of = |i: usize| turned.column(at - from + i);
            for i in 0..size {
                for j in 0..=i {
                    group[(i, j)] += of(i).dot(&of(j));
                }
            }
        }
    }

    /// Adds these sums with the first columns, s, replaced: s = P s' + Q c + r for the first
    /// columns s' and the others c of `to`; `map` is [P | Q | −r], the last for the target, which
    /// loses what r shows. With H the products of s with all, W = [Q | −r] and Y = H + ½ H_s W
    /// products of others gain WᵀY + YᵀW.
    pub fn carried(&self, map: &DMatrix<f64>, to: &mut Self) {
        let (m, own, columns) = (self.first, self.layout.own, self.layout.columns);
        let (square, mut half) = self.of_first(0);
        let (p, w) = (map.columns(0, m), map.columns(m, columns + 1));
        half.gemm(0.5, &square, &w, 1.0);
        let mut whole = half.clone();
        whole.gemm(0.5, &square, &w, 1.0);
        to.head.view_mut((0, 0), (m, m)).gemm(1.0, &p.transpose(), &(&square * p), 1.0);
        to.head.view_mut((0, m), (m, columns + 1)).gemm(1.0, &p.transpose(), &whole, 1.0);
        let both = |i: usize, j: usize| w.column(i).dot(&half.column(j)) + half.column(i).dot(&w.column(j));
        for j in 0..=columns {
            for i in 0..=own {
                let of = if i < own { i } else { columns };
                to.head[(m + i, m + j)] += self.head[(m + i, m + j)] + both(of, j);
            }
        }
        for ((to, from), &(at, size)) in to.groups.iter_mut().zip(&self.groups).zip(&self.layout.groups) {
            for i in 0..size {
                for j in 0..=i {
                    to[(i, j)] += from[(i, j)] + both(at + i, at + j);
                }
            }
        }
    }

    /// Adds sums of other rows.
    pub fn add(&mut self, other: &Self) {
        self.head += &other.head;
        self.groups.iter_mut().zip(&other.groups).for_each(|(a, b)| *a += b);
    }

    /// What the first are for each column and the target, of which the last `pinned` are nothing;
    /// none where the rows do not determine them.
    pub fn solved(&self, pinned: usize) -> Option<DMatrix<f64>> {
        let (square, coupling) = self.of_first(pinned);
        Some(square.cholesky()?.solve(&coupling))
    }

    /// The same layout without rows.
    pub fn none(&self) -> Self {
        Self::zeros(&self.layout, self.first)
    }

    /// The first columns as they are: [1 | 0 | 0] as [`Self::carried`] has it.
    pub fn as_they_begin(&self) -> DMatrix<f64> {
        DMatrix::identity(self.first, self.first + self.layout.columns + 1)
    }

    /// First columns by which fewer digits are lost, as [`Self::carried`] has them: their products
    /// with one another are 1, and the others hardly go along with them. None where none are lost, or
    /// nothing is known of the first.
    pub fn better(&self, pinned: usize) -> Option<DMatrix<f64>> {
        let (m, columns) = (self.first, self.layout.columns);
        let (square, coupling) = self.of_first(pinned);
        let (factor, is_definite) = match square.clone().cholesky() {
            Some(factor) => (factor, true),
            None => {
                let shift = SHIFT * square.diagonal().amax();
                ((square + DMatrix::from_diagonal_element(m, m, shift)).cholesky()?, false)
            }
        };
        let solved = factor.solve(&coupling);
        let is_lost = |j: usize| {
            let whole = self.square(j);
            whole - coupling.column(j).dot(&solved.column(j)) < LOST * whole
        };
        if is_definite && !(0..=columns).any(is_lost) {
            return None;
        }
        let mut out = -solved.insert_columns(0, m, 0.0);
        out.columns_mut(0, m).copy_from(&factor.l().tr_solve_lower_triangular(&DMatrix::identity(m, m))?);
        out.iter().all(|x| x.is_finite()).then_some(out)
    }

    /// The square of one of the columns behind the first, or of the target, whose number is that of
    /// the columns.
    fn square(&self, column: usize) -> f64 {
        let (m, Layout { own, columns, groups, group_of }) = (self.first, &*self.layout);
        if column == *columns {
            return self.head[(m + own, m + columns)];
        }
        let Some(group) = column.checked_sub(*own).map(|k| group_of[k]) else {
            return self.head[(m + column, m + column)];
        };
        let within = column - groups[group].0;
        self.groups[group][(within, within)]
    }

    /// What is left of these rows with the first as `solved` of more rows than these: such parts add
    /// up to what is left of all.
    pub fn left_by(&self, solved: &DMatrix<f64>) -> Option<Gram> {
        let (m, own, columns) = (self.first, self.layout.own, self.layout.columns);
        let map = DMatrix::from_fn(m, m + columns + 1, |i, j| if j < m { 0.0 } else { -solved[(i, j - m)] });
        let (mut whole, mut out) = (Self::zeros(&self.layout, m), Self::zeros(&self.layout, 0));
        self.carried(&map, &mut whole);
        out.head.copy_from(&whole.head.view((m, m), (own + 1, columns + 1)));
        out.groups = whole.groups;
        out.finite()
    }

    fn finite(self) -> Option<Gram> {
        let finite = self.head.iter().chain(self.groups.iter().flatten()).all(|x| x.is_finite());
        finite.then_some(Gram(self))
    }

    /// Products of the first with one another, with the columns, and with the target, the last
    /// `pinned` of the first being nothing.
    pub fn of_first(&self, pinned: usize) -> (DMatrix<f64>, DMatrix<f64>) {
        let (m, rest) = (self.first, self.layout.columns + 1);
        let mut square = self.head.view((0, 0), (m, m)).into_owned();
        let mut coupling = self.head.view((0, m), (m, rest)).into_owned();
        for i in m - pinned..m {
            square.row_mut(i).fill(0.0);
            square.column_mut(i).fill(0.0);
            square[(i, i)] = 1.0;
            coupling.row_mut(i).fill(0.0);
        }
        (square, coupling)
    }

    /// The same with the first eliminated, of which the last `pinned` are nothing; none where the
    /// rows do not determine them.
    pub fn reduced(&self, pinned: usize) -> Option<Gram> {
        let (m, own, columns) = (self.first, self.layout.own, self.layout.columns);
        let (coupling, solved) = (self.of_first(pinned).1, self.solved(pinned)?);
        let mut out = Self::zeros(&self.layout, 0);
        let column = |i: usize| if i < own { i } else { columns };
        for i in 0..=own {
            for j in 0..=columns {
                let taken = coupling.column(column(i)).dot(&solved.column(j));
                out.head[(i, j)] = self.head[(m + i, m + j)] - taken;
            }
        }
        for ((to, from), &(at, size)) in out.groups.iter_mut().zip(&self.groups).zip(&self.layout.groups) {
            for i in 0..size {
                for j in 0..=i {
                    to[(i, j)] = from[(i, j)] - coupling.column(at + i).dot(&solved.column(at + j));
                }
            }
        }
        out.finite()
    }
}

impl Gram {
    /// Of own columns alone, from the matrix of all products with the target last.
    #[cfg(test)]
    pub fn of_own(whole: DMatrix<f64>) -> Self {
        let layout = Layout::new(whole.nrows() - 1, &[]);
        Self(Sums { head: whole, groups: Vec::new(), layout, first: 0 })
    }

    /// The product of two columns, or of one and the target, whose number is that of the columns;
    /// no number for two that are never fitted together.
    fn at(&self, i: usize, j: usize) -> f64 {
        let Sums { layout, head, groups, .. } = &self.0;
        let (own, target) = (layout.own, layout.columns);
        let (low, high) = (i.min(j), i.max(j));
        if low < own {
            return head[(low, high)];
        }
        if high == target {
            return head[(own, low)];
        }
        let group = layout.group_of[low - own];
        if group != layout.group_of[high - own] {
            return f64::NAN;
        }
        let from = layout.groups[group].0;
        groups[group][(high - from, low - from)]
    }

    /// The square of a column.
    pub fn square(&self, column: usize) -> f64 {
        self.0.square(column)
    }

    /// The matrix of some columns and the target.
    pub fn chosen(&self, columns: &[usize]) -> DMatrix<f64> {
        let p = columns.len();
        let place = |i: usize| if i < p { columns[i] } else { self.0.layout.columns };
        let mut out = DMatrix::zeros(p + 1, p + 1);
        for i in 0..=p {
            for j in 0..=i {
                let x = self.at(place(i), place(j));
                (out[(i, j)], out[(j, i)]) = (x, x);
            }
        }
        out
    }

    /// Adds a multiple of one of the own columns to the target.
    pub fn retarget(&mut self, column: usize, by: f64) {
        let Layout { own, columns, .. } = *self.0.layout;
        let of: Vec<f64> = (0..columns).map(|j| self.at(column, j)).collect();
        let (with_target, square) = (self.at(column, columns), of[column]);
        let head = &mut self.0.head;
        for (j, x) in of.iter().enumerate() {
            head[(own, j)] += by * x;
            if j < own {
                head[(j, columns)] += by * x;
            }
        }
        head[(own, columns)] += by * (2.0 * with_target + by * square);
    }

    /// The same with the groups of another of the same own columns behind its own.
    pub fn joined(&self, other: &Self, layout: &Arc<Layout>) -> Self {
        let (Sums { head, groups, layout: first, .. }, more) = (&self.0, &other.0);
        let (own, behind) = (first.own, more.layout.columns - more.layout.own);
        let mut whole = DMatrix::zeros(own + 1, layout.columns + 1);
        whole.columns_mut(0, first.columns).copy_from(&head.columns(0, first.columns));
        whole.columns_mut(first.columns, behind + 1).copy_from(&more.head.columns(own, behind + 1));
        let groups = groups.iter().chain(&more.groups).cloned().collect();
        Self(Sums { head: whole, groups, layout: layout.clone(), first: 0 })
    }

    /// Its layout.
    pub fn layout(&self) -> &Arc<Layout> {
        &self.0.layout
    }

    /// Adds another of the same layout.
    pub fn add(&mut self, other: &Self) {
        self.0.add(&other.0);
    }
}

#[cfg(test)]
#[path = "gram_tests.rs"]
mod tests;

//! The model from its nodes: scales and degrees by leaving out one node at a time, then least
//! squares.

use nalgebra::{DMatrix, DVector};

use super::{Node, Polar, horner, s_of};

/// Highest degree in s.
const MOST_DEGREE: usize = 6;

/// Coefficients of polynomials of one degree through all quantities of the nodes (columns of
/// `values`), by least squares: exact interpolation where there are as many nodes as powers.
fn polynomials(s: &[f64], weight: &[f64], values: &DMatrix<f64>, degree: usize) -> Option<Vec<DVector<f64>>> {
    if s.len() <= degree {
        return None;
    }
    let a = DMatrix::from_fn(s.len(), degree + 1, |i, j| weight[i] * s[i].powi(j as i32));
    let b = DMatrix::from_fn(s.len(), values.ncols(), |i, q| weight[i] * values[(i, q)]);
    let qr = a.qr();
    let x = qr.r().solve_upper_triangular(&(qr.q().transpose() * b))?;
    x.iter().all(|v| v.is_finite()).then(|| x.column_iter().map(|c| c.into_owned()).collect())
}

/// A scale and a degree, with their error at nodes left out: by which they were chosen, and the
/// greatest.
struct Choice {
    value: f64,
    worst: f64,
    a0: f64,
    degree: usize,
}

/// The nodes of positive amplitude in rising order, the linear mode first where it is known, and ω²
/// and the shapes, one row a node.
struct Table {
    nodes: Vec<Node>,
    /// ω², then X_k/a by k and channel.
    values: DMatrix<f64>,
    weight: Vec<f64>,
    harmonics: usize,
}

impl Table {
    /// The shapes' columns of the harmonics from … to − 1.
    fn harmonics(&self, from: usize, to: usize, channels: usize) -> DMatrix<f64> {
        self.values.columns(1 + from * channels, (to - from) * channels).into_owned()
    }

    /// What served best without one node goes up by one degree with it, where every node then is
    /// met.
    fn full(&self, degree: usize) -> usize {
        let n = self.nodes.len();
        if degree + 2 == n { degree + 1 } else { degree }.min(n - 1)
    }

    /// Coefficients of the columns of `part` in powers of s, fitted to the nodes `rows`.
    fn fitted(&self, part: &DMatrix<f64>, a0: f64, degree: usize, rows: &[usize]) -> Option<Vec<Vec<f64>>> {
        let s: Vec<f64> = rows.iter().map(|i| s_of(self.nodes[*i].amplitude, a0)).collect();
        let p = polynomials(&s, &picked(&self.weight, rows), &part.select_rows(rows), degree)?;
        Some(p.iter().map(|c| c.iter().copied().collect()).collect())
    }

    /// The nodes to which harmonic k is fitted: all of them; of an even one the linear mode and
    /// those that have any. Nodes from the equations of a symmetric system have none, and what a
    /// release has beside such a mode is not to be averaged with that.
    fn rows_of(&self, k: usize, channels: usize) -> Vec<usize> {
        let all = 0..self.nodes.len();
        let has = |i: usize| {
            let mut even =
                (0..self.harmonics).step_by(2).flat_map(|k| (0..channels).map(move |c| 1 + k * channels + c));
            even.any(|q| self.values[(i, q)] != 0.0)
        };
        let having: Vec<usize> = all.clone().filter(|&i| has(i)).collect();
        if k % 2 == 1 || having.len() < 2 {
            return all.collect();
        }
        all.filter(|&i| has(i) || self.nodes[i].amplitude == 0.0).collect()
    }
}

fn table(
    nodes: &[Node],
    major: &[f64],
    linear: Option<(f64, Vec<f64>)>,
    symmetric: Option<bool>,
) -> Option<(Table, bool)> {
    let channels = major.len();
    let mut nodes: Vec<Node> = nodes.iter().filter(|n| n.amplitude > 0.0 && n.amplitude.is_finite()).cloned().collect();
    nodes.sort_by(|a, b| a.amplitude.total_cmp(&b.amplitude));
    // Even harmonics stay out of a symmetric mode: 1 % of the odd ones is what noise and mixing
    // leave.
    let even: f64 = nodes.iter().flat_map(|n| n.shape.iter().step_by(2).flatten().map(|x| x * x)).sum();
    let odd: f64 = nodes.iter().flat_map(|n| n.shape.iter().skip(1).step_by(2).flatten().map(|x| x * x)).sum();
    let symmetric = symmetric.unwrap_or(even < 1e-4 * odd);
    let harmonics = nodes.iter().map(|n| n.shape.len()).max()?;
    if let Some((omega, shape)) = linear {
        let a: f64 = shape.iter().zip(major).map(|(x, p)| x * p).sum();
        let mut of = vec![vec![0.0; channels]; 2];
        of[1] = shape.iter().map(|x| x / a).collect();
        nodes.insert(0, Node { amplitude: 0.0, omega, error: 0.0, shape: of, spread: vec![0.0; channels] });
    }
    let values = DMatrix::from_fn(nodes.len(), 1 + harmonics * channels, |i, q| {
        if q == 0 {
            return nodes[i].omega * nodes[i].omega;
        }
        let (k, c) = ((q - 1) / channels, (q - 1) % channels);
        if symmetric && k % 2 == 0 { 0.0 } else { nodes[i].shape.get(k).map_or(0.0, |x| x[c]) }
    });
    // Nodes that are known equally well weigh alike; one ten times worse than the median weighs a
    // tenth.
    let mut errors: Vec<f64> = nodes.iter().map(|n| n.error).collect();
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2].max(1e-9);
    let weight = nodes.iter().map(|n| (median / n.error.max(median)).max(0.01)).collect();
    Some((Table { nodes, values, weight, harmonics }, symmetric))
}

/// The same model of other nodes: scales, degrees and harmonics as they were chosen, range and
/// error as they were.
pub fn again(of: &Polar, nodes: &[Node], linear: Option<(f64, Vec<f64>)>) -> Option<Polar> {
    let channels = of.major.len();
    let (t, _) = table(nodes, &of.major, linear, Some(of.symmetric))?;
    let all: Vec<usize> = (0..t.nodes.len()).collect();
    let degree = of.omega_squared.len().checked_sub(1)?;
    let omega_squared = t.fitted(&t.values.columns(0, 1).into_owned(), of.a0, degree, &all)?.swap_remove(0);
    let mut shape = Vec::with_capacity(of.shape.len());
    for (k, was) in of.shape.iter().enumerate() {
        // A harmonic of zeros alone was left out, by its parity or because other modes ring in it.
        let left_out = was.iter().flatten().all(|c| *c == 0.0) || k >= t.harmonics;
        let degree = was.first()?.len().checked_sub(1)?;
        let rows = t.rows_of(k, channels);
        shape.push(if left_out {
            was.clone()
        } else {
            t.fitted(&t.harmonics(k, k + 1, channels), of.shape_a0, degree, &rows)?
        });
    }
    Some(Polar { omega_squared, shape, ..of.clone() })
}

/// Makes the model of nodes (at least two of different amplitude), with the linear mode (ω, X_1/a)
/// where it is known.
pub fn model(nodes: &[Node], major: &[f64], linear: Option<(f64, Vec<f64>)>) -> Option<Polar> {
    model_of(nodes, major, linear, MOST_DEGREE, None)
}

/// The same with degrees up to `most`; `symmetric`: whether there are no even harmonics, where that
/// is known.
pub(super) fn model_of(
    nodes: &[Node],
    major: &[f64],
    linear: Option<(f64, Vec<f64>)>,
    most: usize,
    symmetric: Option<bool>,
) -> Option<Polar> {
    let channels = major.len();
    let (table, symmetric) = table(nodes, major, linear, symmetric)?;
    let nodes = &table.nodes;
    let first = nodes.iter().map(|n| n.amplitude).find(|a| *a > 0.0)?;
    let last = nodes.last()?.amplitude;
    let middle = (first * last).sqrt();
    let scales: Vec<f64> = (-20..=20).map(|n| middle * 10.0_f64.powf(f64::from(n) * 0.075)).collect();
    let selection = Selection::new(&table, channels, most);
    let every: Vec<usize> = (0..nodes.len()).collect();
    // ω and the shapes each with their own scale and degree, by their errors at releases left out.
    let omega_values = table.values.columns(0, 1).into_owned();
    let by_omega = selection.choose(&omega_values, &scales);
    let (a0, degree) = by_omega.as_ref().map_or((middle, table.full(1)), |b| (b.a0, table.full(b.degree)));
    let omega_squared = table.fitted(&omega_values, a0, degree, &every)?.swap_remove(0);
    let by_shape = selection.choose(&selection.shapes, &scales);
    let (shape_a0, degree) = by_shape.as_ref().map_or((middle, table.full(1)), |b| (b.a0, table.full(b.degree)));
    let mut shape = Vec::with_capacity(table.harmonics);
    for k in 0..table.harmonics {
        let part = table.harmonics(k, k + 1, channels);
        let rows = table.rows_of(k, channels);
        shape.push(match selection.degree_of_harmonic(&part, &rows, shape_a0, degree) {
            Some(d) => table.fitted(&part, shape_a0, d, &rows)?,
            None => vec![vec![0.0]; channels],
        });
    }
    let low = if nodes[0].amplitude == 0.0 { 0.0 } else { first };
    Some(Polar {
        major: major.to_vec(),
        a0,
        omega_squared,
        omega_squared_std_error: Vec::new(),
        shape_a0,
        shape,
        range: [low, last],
        left_out: by_omega.map(|b| b.worst),
        symmetric,
        beside: !symmetric && table.rows_of(0, channels).len() < nodes.len(),
    })
}

/// The choice of scales and degrees by nodes left out one at a time.
///
/// Few releases are interpolated, by the worst, ω with the shapes' error beside its own: of two or
/// three errors of one quantity the worst may be small by luck at a scale that serves nothing else.
/// Many (the windows of decays) are smoothed, by the mean.
struct Selection<'a> {
    table: &'a Table,
    /// All shapes, which share a degree.
    shapes: DMatrix<f64>,
    /// Whether the releases are few.
    few: bool,
    /// Highest degree.
    most: usize,
}

impl<'a> Selection<'a> {
    fn new(table: &'a Table, channels: usize, most: usize) -> Self {
        let few = table.nodes.len() <= MOST_DEGREE + 2;
        Self { table, shapes: table.harmonics(0, table.harmonics, channels), few, most }
    }

    /// The nodes `rows` left out one at a time, the ends excepted (they would have to be
    /// extrapolated): rms (by the nodes' weights) and greatest relative error.
    fn score(&self, part: &DMatrix<f64>, a0: f64, degree: usize, rows: &[usize]) -> Option<(f64, f64)> {
        let Table { nodes, weight, .. } = self.table;
        let s: Vec<f64> = nodes.iter().map(|n| s_of(n.amplitude, a0)).collect();
        let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
        for &out in rows.get(1..rows.len().saturating_sub(1)).unwrap_or_default() {
            let keep: Vec<usize> = rows.iter().copied().filter(|i| *i != out).collect();
            let p = polynomials(&picked(&s, &keep), &picked(weight, &keep), &part.select_rows(&keep), degree)?;
            let (mut error, mut size) = (0.0, 0.0);
            for (q, p) in p.iter().enumerate() {
                error += (horner(p.as_slice(), s[out]).0 - part[(out, q)]).powi(2);
                size += part[(out, q)].powi(2);
            }
            // Shapes are of size 1, ω² is not.
            let relative = if part.ncols() == 1 { 0.5 * (error / size).sqrt() } else { error.sqrt() };
            let weight = if self.few { 1.0 } else { weight[out] };
            sum += (weight * relative).powi(2);
            count += weight * weight;
            worst = worst.max(relative);
        }
        Some(((sum / count).sqrt(), worst)).filter(|e| e.0.is_finite())
    }

    /// The scale and the degree that serve best; none for two nodes.
    fn choose(&self, part: &DMatrix<f64>, scales: &[f64]) -> Option<Choice> {
        let n = self.table.nodes.len();
        let every: Vec<usize> = (0..n).collect();
        let mut best: Option<Choice> = None;
        for degree in 1..=self.most.min(n.saturating_sub(2)) {
            for &a0 in scales {
                let Some((rms, worst)) = self.score(part, a0, degree, &every) else { continue };
                let value = match part.ncols() {
                    _ if !self.few => rms,
                    1 => worst.max(self.score(&self.shapes, a0, degree, &every).map_or(f64::INFINITY, |s| s.1)),
                    _ => worst,
                };
                if best.as_ref().is_none_or(|b| value < b.value) {
                    best = Some(Choice { value, worst, a0, degree });
                }
            }
        }
        best.filter(|_| n > 2)
    }

    /// The degree of one harmonic, fitted to the nodes `rows`; `degree`: that of all shapes. None
    /// for one that is not the mode's.
    fn degree_of_harmonic(&self, part: &DMatrix<f64>, rows: &[usize], a0: f64, degree: usize) -> Option<usize> {
        let Table { nodes, weight, .. } = self.table;
        if rows.len() < nodes.len() {
            // Few releases: interpolated, by the worst at one left out.
            let worst = |d: usize| self.score(part, a0, d, rows).map_or(f64::INFINITY, |s| s.1);
            let best = (1..rows.len().saturating_sub(1)).min_by(|a, b| worst(*a).total_cmp(&worst(*b)));
            let full = best.map_or(1, |d| if d + 2 == rows.len() { d + 1 } else { d });
            return Some(full.min(rows.len() - 1).min(MOST_DEGREE));
        }
        if self.few {
            return Some(degree);
        }
        // Every harmonic with the degree that serves it, so that one that other modes disturb does
        // not coarsen the others; one that is predicted no better than by nothing at all is not the
        // mode's: other modes ring there.
        let rms = (0..nodes.len()).map(|i| (weight[i] * part.row(i).norm()).powi(2)).sum::<f64>().sqrt()
            / weight.iter().map(|w| w * w).sum::<f64>().sqrt();
        self.choose(part, &[a0]).filter(|b| b.value < 0.5 * rms).map(|b| self.table.full(b.degree))
    }
}

fn picked(values: &[f64], rows: &[usize]) -> Vec<f64> {
    rows.iter().map(|i| values[*i]).collect()
}

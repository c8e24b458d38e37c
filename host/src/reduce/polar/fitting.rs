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
    let fitted = |a0: f64, from: usize, count: usize, degree: usize, rows: &[usize]| -> Option<Vec<Vec<f64>>> {
        let s: Vec<f64> = rows.iter().map(|i| s_of(t.nodes[*i].amplitude, a0)).collect();
        let weight: Vec<f64> = rows.iter().map(|i| t.weight[*i]).collect();
        let p = polynomials(&s, &weight, &t.values.columns(from, count).select_rows(rows), degree)?;
        Some(p.iter().map(|c| c.iter().copied().collect()).collect())
    };
    let all: Vec<usize> = (0..t.nodes.len()).collect();
    let omega_squared = fitted(of.a0, 0, 1, of.omega_squared.len().checked_sub(1)?, &all)?.swap_remove(0);
    let mut shape = Vec::with_capacity(of.shape.len());
    for (k, was) in of.shape.iter().enumerate() {
        // A harmonic of zeros alone was left out, by its parity or because other modes ring in it.
        let left_out = was.iter().flatten().all(|c| *c == 0.0) || k >= t.harmonics;
        let degree = was.first()?.len().checked_sub(1)?;
        let rows = t.rows_of(k, channels);
        shape.push(if left_out {
            was.clone()
        } else {
            fitted(of.shape_a0, 1 + k * channels, channels, degree, &rows)?
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
    let Table { nodes, values, weight, harmonics } = &table;
    let harmonics = *harmonics;
    let first = nodes.iter().map(|n| n.amplitude).find(|a| *a > 0.0)?;
    let last = nodes.last()?.amplitude;
    let few = nodes.len() <= MOST_DEGREE + 2;
    // Quantities that share a degree: ω² alone, or the shapes (all harmonics from..to).
    let of_harmonics =
        |from: usize, to: usize| values.columns(1 + from * channels, (to - from) * channels).into_owned();
    let omega_values = values.columns(0, 1).into_owned();
    // Left out one at a time, the ends excepted (they would have to be extrapolated): rms (by the
    // nodes' weights) and greatest relative error.
    let score_of = |part: &DMatrix<f64>, a0: f64, degree: usize, rows: &[usize]| -> Option<(f64, f64)> {
        let s: Vec<f64> = nodes.iter().map(|n| s_of(n.amplitude, a0)).collect();
        let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
        for &out in rows.get(1..rows.len().saturating_sub(1)).unwrap_or_default() {
            let keep: Vec<usize> = rows.iter().copied().filter(|i| *i != out).collect();
            let pick = |v: &[f64]| keep.iter().map(|i| v[*i]).collect::<Vec<f64>>();
            let p = polynomials(&pick(&s), &pick(weight), &part.select_rows(&keep), degree)?;
            let (mut error, mut size) = (0.0, 0.0);
            for (q, p) in p.iter().enumerate() {
                error += (horner(p.as_slice(), s[out]).0 - part[(out, q)]).powi(2);
                size += part[(out, q)].powi(2);
            }
            // Shapes are of size 1, ω² is not.
            let relative = if part.ncols() == 1 { 0.5 * (error / size).sqrt() } else { error.sqrt() };
            let weight = if few { 1.0 } else { weight[out] };
            sum += (weight * relative).powi(2);
            count += weight * weight;
            worst = worst.max(relative);
        }
        Some(((sum / count).sqrt(), worst)).filter(|e| e.0.is_finite())
    };
    let every: Vec<usize> = (0..nodes.len()).collect();
    let score = |part: &DMatrix<f64>, a0: f64, degree: usize| score_of(part, a0, degree, &every);
    let middle = (first * last).sqrt();
    let scales: Vec<f64> = (-20..=20).map(|n| middle * 10.0_f64.powf(f64::from(n) * 0.075)).collect();
    let degrees = 1..=most.min(nodes.len().saturating_sub(2));
    // ω and the shapes each with their own scale and degree, by their errors at releases left out.
    // Few releases are interpolated, by the worst, ω with the shapes' error beside its own: of two
    // or three errors of one quantity the worst may be small by luck at a scale that serves nothing
    // else. Many (the windows of decays) are smoothed, by the mean.
    let all = of_harmonics(0, harmonics);
    let choose = |part: &DMatrix<f64>, scales: &[f64]| -> Option<Choice> {
        let mut best: Option<Choice> = None;
        for degree in degrees.clone() {
            for &a0 in scales {
                let Some((rms, worst)) = score(part, a0, degree) else { continue };
                let value = match part.ncols() {
                    _ if !few => rms,
                    1 => worst.max(score(&all, a0, degree).map_or(f64::INFINITY, |s| s.1)),
                    _ => worst,
                };
                if best.as_ref().is_none_or(|b| value < b.value) {
                    best = Some(Choice { value, worst, a0, degree });
                }
            }
        }
        best.filter(|_| nodes.len() > 2)
    };
    // What served best without one node goes up by one degree with it, where every node then is
    // met.
    let full = |d: usize| if d + 2 == nodes.len() { d + 1 } else { d }.min(nodes.len() - 1);
    let of = |a0: f64| -> Vec<f64> { nodes.iter().map(|n| s_of(n.amplitude, a0)).collect() };
    let coefficients =
        |p: Vec<DVector<f64>>| -> Vec<Vec<f64>> { p.iter().map(|c| c.iter().copied().collect()).collect() };
    let by_omega = choose(&omega_values, &scales);
    let (a0, degree) = by_omega.as_ref().map_or((middle, full(1)), |b| (b.a0, full(b.degree)));
    let omega_squared = coefficients(polynomials(&of(a0), weight, &omega_values, degree)?).swap_remove(0);
    let by_shape = choose(&all, &scales);
    let (shape_a0, shape_degree) = by_shape.as_ref().map_or((middle, full(1)), |b| (b.a0, full(b.degree)));
    let s = of(shape_a0);
    let mut shape = Vec::with_capacity(harmonics);
    for k in 0..harmonics {
        let part = of_harmonics(k, k + 1);
        let rows = table.rows_of(k, channels);
        let degree = if rows.len() < nodes.len() {
            // Few releases: interpolated, by the worst at one left out.
            let worst = |d: usize| score_of(&part, shape_a0, d, &rows).map_or(f64::INFINITY, |s| s.1);
            let best = (1..rows.len().saturating_sub(1)).min_by(|a, b| worst(*a).total_cmp(&worst(*b)));
            Some(best.map_or(1, |d| if d + 2 == rows.len() { d + 1 } else { d }).min(rows.len() - 1).min(MOST_DEGREE))
        } else if few {
            Some(shape_degree)
        } else {
            // Every harmonic with the degree that serves it, so that one that other modes disturb
            // does not coarsen the others; one that is predicted no better than by nothing at all
            // is not the mode's: other modes ring there.
            let rms = (0..nodes.len()).map(|i| (weight[i] * part.row(i).norm()).powi(2)).sum::<f64>().sqrt()
                / weight.iter().map(|w| w * w).sum::<f64>().sqrt();
            choose(&part, &[shape_a0]).filter(|b| b.value < 0.5 * rms).map(|b| full(b.degree))
        };
        shape.push(match degree {
            Some(d) => {
                let pick = |v: &[f64]| rows.iter().map(|i| v[*i]).collect::<Vec<f64>>();
                coefficients(polynomials(&pick(&s), &pick(weight), &part.select_rows(&rows), d)?)
            }
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

//! By how much each written equation differs from Lagrange's: D_e, from the symmetry of mechanics.
//!
//! D_i ∂F_i/∂q̈_j = D_j ∂F_j/∂q̈_i, or, for coordinates that share no inertia, D_i ∂F_i/∂q_j = D_j
//! ∂F_j/∂q_i at rest, both by least squares over states spread over all angles; the first
//! coordinate of those that are coupled has D = ±1, the sign of its inertia.

use super::left_hand_sides::{STATES, at_rest, sides, value};
use crate::model::model_file::ModelFile;
use crate::model::model_file::expression::{Node, Symbol, number};

/// Share by which coupled equations may break the symmetry of mechanics: coefficients are
/// identified, with errors.
const ASYMMETRY: f64 = 0.1;
/// Size of an entry beside the diagonal, as a share of it, below which equations are not coupled.
const UNCOUPLED: f64 = 1e-9;
/// Share of a slope by which it differs from place to place where it is one and the same: rounding.
const EVEN: f64 = 1e-9;

/// What written equations tell of inertias.
pub struct Inertias {
    /// D_e of every equation.
    pub scales: Vec<f64>,
    /// Pairs of coordinates that are coupled.
    pub coupled: Vec<(usize, usize)>,
    /// Those of them between which there is a linear spring.
    pub springs: Vec<(usize, usize)>,
}

/// D_e of every equation, and what is coupled; none where a coordinate has no inertia in its
/// equation.
pub fn inertias(model: &ModelFile, omega: f64, values: &[f64]) -> Option<Inertias> {
    let n = model.coordinates.len();
    let all = sides(model, omega, values);
    let rest: Vec<Node> = at_rest(model, omega, values).into_iter().map(|[still, _]| still).collect();
    let matrix = |of: &[Node], by: fn(usize) -> Symbol| -> Vec<Vec<Vec<f64>>> {
        of.iter()
            .map(|f| {
                (0..n)
                    .map(|j| {
                        let slope = f.derivative_between_jumps(by(j)).unwrap_or_else(|| number(f64::NAN));
                        (0..STATES).map(|s| value(&slope, s, 0.0)).collect()
                    })
                    .collect()
            })
            .collect()
    };
    let (inertia, stiffness) = (matrix(&all, Symbol::Acceleration), matrix(&rest, Symbol::Coordinate));
    let own = |k: usize| inertia[k][k].iter().sum::<f64>();
    let mut scales: Vec<Option<f64>> = vec![None; n];
    let mut coupled = Vec::new();
    for root in 0..n {
        if scales[root].is_some() {
            continue;
        }
        scales[root] = Some(sign_of(own(root))?);
        let mut open = vec![root];
        while let Some(i) = open.pop() {
            for j in (0..n).filter(|&j| j != i) {
                let ratio = ratio(&inertia, i, j).or_else(|| ratio(&stiffness, i, j));
                let (Some(ratio), Some(at)) = (ratio, scales[i]) else { continue };
                if !coupled.contains(&(i.min(j), i.max(j))) {
                    coupled.push((i.min(j), i.max(j)));
                }
                if scales[j].is_none() {
                    scales[j] = Some(at * ratio);
                    open.push(j);
                }
            }
        }
    }
    let scales = scales.into_iter().collect::<Option<Vec<f64>>>()?;
    coupled.sort_unstable();
    let is_linear = |&(i, j): &(usize, usize)| is_constant(&stiffness[i][j]) && is_constant(&stiffness[j][i]);
    let springs = coupled.iter().copied().filter(is_linear).collect();
    Some(Inertias { scales, coupled, springs })
}

/// Pairs of `n` coordinates that nothing couples, not by way of others either: the ratio of their
/// inertias stays open.
pub(super) fn apart(n: usize, coupled: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let mut group: Vec<usize> = (0..n).collect();
    for &(i, j) in coupled {
        let (to, from) = (group[i], group[j]);
        group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
    }
    let all = (0..n).flat_map(|j| (0..j).map(move |i| (i, j)));
    all.filter(|&(i, j)| group[i] != group[j]).collect()
}

/// Whether a slope is the same wherever it is taken, and not none.
fn is_constant(slope: &[f64]) -> bool {
    let size = slope[0].abs();
    size > 0.0 && slope.iter().all(|x| (x - slope[0]).abs() < EVEN * size)
}

fn sign_of(x: f64) -> Option<f64> {
    if x > 0.0 {
        Some(1.0)
    } else if x < 0.0 {
        Some(-1.0)
    } else {
        None
    }
}

/// D_j/D_i from D_i m_ij = D_j m_ji; none where the two are not coupled or not symmetric for any
/// ratio.
fn ratio(m: &[Vec<Vec<f64>>], i: usize, j: usize) -> Option<f64> {
    let (a, b) = (&m[i][j], &m[j][i]);
    let square = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>();
    let product: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
    let ratio = product / square(b);
    let misfit: f64 = a.iter().zip(b).map(|(x, y)| (x - ratio * y).powi(2)).sum();
    let coupled = square(a) > UNCOUPLED * square(&m[i][i]) && square(b) > UNCOUPLED * square(&m[j][j]);
    (coupled && ratio.is_finite() && misfit < ASYMMETRY * ASYMMETRY * square(a)).then_some(ratio)
}

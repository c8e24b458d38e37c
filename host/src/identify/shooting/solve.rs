//! Levenberg–Marquardt over parameters and initial states, the states eliminated.
//!
//! With a piece's normal matrix [[H_xx H_xp], [H_px H_pp]] and gradient (g_x, g_p), the step of the
//! parameters solves Σ_s (H_pp − H_px H_xx⁻¹ H_xp) δp = −Σ_s (g_p − H_px H_xx⁻¹ g_x), and each
//! piece's own step is δx = −H_xx⁻¹ (g_x + H_xp δp) (Schur complement): the cost of a step grows
//! linearly with the number of pieces. Damping multiplies the diagonals by 1 + μ. Bounds: a
//! parameter that stands at its bound and would leave it is held there.
//!
//! A piece that begins while a joint sticks may never come to rest: an initial rate v is lost within
//! v²/2|a|, so that the derivatives by it vanish as it does, its step grows beyond all bounds, and
//! every joint step is refused for that piece alone. Where rounds are used up the parameters are
//! looked at without such pieces (`stuck`).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::problem::{Piece, Problem, Share};
use crate::model::dynamics::Dynamics;

/// Increase of a piece's cost, in mean square residuals, from which its state is fitted anew.
const WORSE: f64 = 1.0;

/// Share of the pieces whose states need not have come to rest (by hand): near a solution that
/// nearly stops or turns over a state creeps on (30 rounds were seen), while the parameters stand.
const CREEPING: f64 = 0.02;
/// Damping of a step that is as good as none.
const UNDAMPED: f64 = 1e-9;
/// Share of the pieces whose states may still promise something where rounds are used up: as many
/// as may be lost ([`super::run::MOST_LOST`]).
const MOST_STUCK: f64 = super::run::MOST_LOST;
/// Promise of a state, in squared standard errors, from which its piece is astray: five of them.
const ASTRAY: f64 = 25.0;

/// Where the minimisation stands.
#[derive(Clone, Debug)]
pub struct ShootingFit {
    /// Parameters.
    pub parameters: Vec<f64>,
    /// Initial state of each piece.
    pub states: Vec<Vec<f64>>,
    /// Each piece's share of the normal equations there.
    pub shares: Vec<Share>,
    /// Rounds taken.
    pub rounds: usize,
    /// Whether the last step was small enough, or only pieces that tell no more of the parameters
    /// were still moving.
    pub converged: bool,
    /// Parameters held at a bound.
    pub held: Vec<bool>,
    /// Pieces whose states are far from where they would rest; none where it converged.
    pub astray: Vec<usize>,
}

/// Lowest and highest value of each parameter.
pub type Bounds = Vec<[f64; 2]>;

/// A piece's normal equations with its state eliminated.
pub struct Reduced {
    /// H_pp − H_px H_xx⁻¹ H_xp.
    pub normal: DMatrix<f64>,
    /// g_p − H_px H_xx⁻¹ g_x.
    pub gradient: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    coupling: DMatrix<f64>,
    own: DVector<f64>,
}

/// Eliminates the first `x` unknowns of a piece. None where its own state is not determined.
pub fn reduce(share: &Share, x: usize, damping: f64) -> Option<Reduced> {
    let p = share.gradient.len() - x;
    let mut own_block = share.normal.view((0, 0), (x, x)).into_owned();
    // What no sensor feels stays where it is.
    (0..x).for_each(|i| own_block[(i, i)] = damped(own_block[(i, i)], damping));
    let factor = own_block.cholesky()?;
    let coupling = share.normal.view((0, x), (x, p)).into_owned();
    let own = share.gradient.rows(0, x).into_owned();
    let solved = factor.solve(&coupling);
    let normal = share.normal.view((x, x), (p, p)) - coupling.transpose() * &solved;
    let gradient = share.gradient.rows(x, p) - solved.transpose() * &own;
    Some(Reduced { normal, gradient, factor, coupling, own })
}

impl Reduced {
    /// The piece's own step for a step of the parameters.
    pub fn own_step(&self, step: &DVector<f64>) -> DVector<f64> {
        -self.factor.solve(&(&self.own + &self.coupling * step))
    }
}

/// A diagonal element with damping; 1 where nothing depends on the unknown.
pub fn damped(diagonal: f64, damping: f64) -> f64 {
    if diagonal == 0.0 { 1.0 } else { diagonal * (1.0 + damping) }
}

/// Solves a symmetric system scaled to unit diagonal, the unknowns in `held` left at zero. None
/// where it is singular.
pub fn solve_scaled(normal: &DMatrix<f64>, right: &DVector<f64>, damping: f64, held: &[bool]) -> Option<DVector<f64>> {
    let n = right.len();
    let scale = DVector::from_fn(n, |i, _| if normal[(i, i)] > 0.0 { normal[(i, i)].sqrt().recip() } else { 0.0 });
    let matrix = DMatrix::from_fn(n, n, |i, j| {
        let fixed = held[i] || held[j] || scale[i] == 0.0 || scale[j] == 0.0;
        if i == j {
            if fixed { 1.0 } else { 1.0 + damping }
        } else if fixed {
            0.0
        } else {
            normal[(i, j)] * scale[i] * scale[j]
        }
    });
    let scaled = DVector::from_fn(n, |i, _| if held[i] { 0.0 } else { right[i] * scale[i] });
    Some(matrix.cholesky()?.solve(&scaled).component_mul(&scale))
}

/// All shares, if every piece has one.
fn complete(shares: Vec<Option<Share>>) -> Option<Vec<Share>> {
    shares.into_iter().collect()
}

/// Shares at trial parameters and `moved` states, `before` those at `states`. A piece that the step
/// made worse than its scatter explains (a joint's velocity that grazes zero there bends the cost)
/// gets its state fitted anew, from where it was and from where the step put it; of one piece alone
/// the step is too long.
fn follow<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[Piece],
    states: &[Vec<f64>],
    before: &[Share],
    mut moved: Vec<Vec<f64>>,
    trial: &[f64],
    unit: f64,
) -> Option<(Vec<Vec<f64>>, Vec<Share>)> {
    let mut shares = problem.shares(pieces, &moved, trial);
    let worse: Vec<usize> = (0..pieces.len())
        .filter(|_| pieces.len() > 1)
        .filter(|i| shares[*i].as_ref().is_none_or(|s| s.cost() > before[*i].cost() + WORSE * unit))
        .collect();
    let again: Vec<Option<(Vec<f64>, Share)>> = worse
        .par_iter()
        .map_init(
            || (problem.room(false), problem.room(true)),
            |(small, large), i| {
                let length = [before[*i].samples];
                [&moved[*i], &states[*i]]
                    .into_iter()
                    .filter_map(|start| problem.fit_state(&pieces[*i], start, trial, &length, small))
                    .min_by(|a, b| a.1.total_cmp(&b.1))
                    .and_then(|(state, _)| {
                        let share = problem.share(&pieces[*i], &state, trial, large)?;
                        Some((state, share))
                    })
            },
        )
        .collect();
    for (i, found) in worse.into_iter().zip(again) {
        if let Some((state, share)) = found
            && shares[i].as_ref().is_none_or(|s| share.cost() < s.cost())
        {
            moved[i] = state;
            shares[i] = Some(share);
        }
    }
    Some((moved, complete(shares)?))
}

/// Pieces that keep a fit from its rest.
struct Stuck {
    /// Whether the parameters rest all the same: their step promises nothing, and without these few
    /// pieces they would stay within a standard error each.
    harmless: bool,
    /// Those whose states are far from where they would rest.
    astray: Vec<usize>,
}

/// What still promises something where rounds are used up, of pieces with `x` unknowns each. None
/// where the normal equations are singular.
fn stuck(shares: &[Share], x: usize, held: &[bool], tolerance: f64) -> Option<Stuck> {
    let p = held.len();
    let values: f64 = shares.iter().map(|s| (s.samples * s.squares.len()) as f64 - x as f64).sum();
    let unit = shares.iter().map(Share::cost).sum::<f64>() / values.max(1.0);
    let reduced: Vec<Reduced> = shares.iter().map(|s| reduce(s, x, UNDAMPED)).collect::<Option<_>>()?;
    let of = |kept: &dyn Fn(usize) -> bool| {
        let none: (DMatrix<f64>, DVector<f64>) = (DMatrix::zeros(p, p), DVector::zeros(p));
        let all = reduced.iter().enumerate().filter(|r| kept(r.0));
        all.fold(none, |(normal, gradient), (_, r)| (normal + &r.normal, gradient + &r.gradient))
    };
    let promised = |(normal, gradient): &(DMatrix<f64>, DVector<f64>)| {
        let step = solve_scaled(normal, &-gradient, UNDAMPED, held)?;
        Some((-step.dot(gradient) / unit, step))
    };
    let (promise, step) = promised(&of(&|_: usize| true))?;
    let own: Vec<f64> = reduced.iter().map(|r| -r.own_step(&step).dot(&r.own) / unit).collect();
    // What is no number is no rest either.
    let from = |least: f64| -> Vec<usize> { (0..own.len()).filter(|k| own[*k].is_nan() || own[*k] >= least).collect() };
    let (moving, astray) = (from(tolerance), from(ASTRAY));
    let few = moving.len() as f64 <= MOST_STUCK * own.len() as f64;
    let free = held.iter().filter(|h| !**h).count() as f64;
    let harmless = promise < tolerance && few && promised(&of(&|k: usize| !moving.contains(&k)))?.0 <= free;
    Some(Stuck { harmless, astray })
}

/// Where a search begins.
pub struct Start<'a> {
    /// Parameters.
    pub parameters: &'a [f64],
    /// The initial state of each piece.
    pub states: Vec<Vec<f64>>,
}

/// Minimises from parameters and states until the promised gain of a step falls below `tolerance`
/// (in units of the residuals' mean square: a step of one standard error in one parameter promises
/// 1), for at most `most` rounds. `tick` is told of each round. None where the start has no
/// solution.
pub fn minimise<D: Dynamics + ?Sized>(
    problem: &Problem<'_, D>,
    pieces: &[Piece],
    start: Start<'_>,
    bounds: &Bounds,
    tolerance: f64,
    most: usize,
    tick: &mut dyn FnMut(),
) -> Option<ShootingFit> {
    let x = problem.states();
    let clip = |p: &[f64]| -> Vec<f64> { p.iter().zip(bounds).map(|(v, [low, high])| v.clamp(*low, *high)).collect() };
    let mut parameters = clip(start.parameters);
    let mut states = start.states;
    let mut shares = complete(problem.shares(pieces, &states, &parameters))?;
    let (mut damping, mut rounds, mut converged) = (UNDAMPED, 0, false);
    let mut held = vec![false; parameters.len()];
    while rounds < most && !converged {
        let cost: f64 = shares.iter().map(Share::cost).sum();
        let freedom = shares.iter().map(|s| s.samples * problem.sensors.len() - x).sum::<usize>().max(1) as f64;
        let reduced: Vec<Reduced> = shares.iter().map(|s| reduce(s, x, damping)).collect::<Option<_>>()?;
        let p = parameters.len();
        let normal = reduced.iter().fold(DMatrix::zeros(p, p), |sum, r| sum + &r.normal);
        let gradient = reduced.iter().fold(DVector::zeros(p), |sum, r| sum + &r.gradient);
        for (i, h) in held.iter_mut().enumerate() {
            let [low, high] = bounds[i];
            *h = (parameters[i] <= low && gradient[i] > 0.0) || (parameters[i] >= high && gradient[i] < 0.0);
        }
        let Some(step) = solve_scaled(&normal, &-&gradient, damping, &held) else {
            damping = (damping * 10.0).max(1e-6);
            rounds += 1;
            continue;
        };
        let unit = cost / freedom;
        let trial = clip(&parameters.iter().zip(step.iter()).map(|(a, b)| a + b).collect::<Vec<_>>());
        let taken = DVector::from_iterator(p, trial.iter().zip(&parameters).map(|(a, b)| a - b));
        let own: Vec<DVector<f64>> = reduced.iter().map(|r| r.own_step(&taken)).collect();
        // What the parameters' step promises, and the pieces' own steps, whose states may be far
        // off while the parameters stand.
        let promise = -step.dot(&gradient) / unit;
        let mut own_promises: Vec<f64> = own.iter().zip(&reduced).map(|(d, r)| -d.dot(&r.own) / unit).collect();
        own_promises.sort_by(f64::total_cmp);
        own_promises.truncate(pieces.len() - (CREEPING * pieces.len() as f64) as usize);
        let own_promise: f64 = own_promises.iter().sum();
        let small = damping <= 1e-6 && promise < tolerance && own_promise < tolerance * (1.0 + pieces.len() as f64);
        let moved: Vec<Vec<f64>> = states
            .iter()
            .zip(&own)
            .map(|(state, d)| state.iter().zip(d.iter()).map(|(a, b)| a + b).collect())
            .collect();
        rounds += 1;
        tick();
        let tried = follow(problem, pieces, &states, &shares, moved, &trial, unit);
        match tried {
            Some((new_states, new)) if new.iter().map(Share::cost).sum::<f64>() <= cost => {
                (parameters, states, shares) = (trial, new_states, new);
                converged = small;
                damping = if damping > UNDAMPED { (damping * 0.01).max(UNDAMPED) } else { damping };
            }
            // At the minimum, to what kinks and rounding leave, no step lowers the cost.
            _ if small => converged = true,
            _ if damping < 1e8 => damping = (damping * 10.0).max(1e-4),
            _ => break,
        }
    }
    let left = if converged { None } else { stuck(&shares, x, &held, tolerance) };
    let converged = converged || left.as_ref().is_some_and(|s| s.harmless);
    let astray = left.filter(|_| !converged).map_or_else(Vec::new, |s| s.astray);
    Some(ShootingFit { parameters, states, shares, rounds, converged, held, astray })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A piece of a hundred samples that knows one parameter and one state, with the gradients of
    /// both.
    fn piece(by_state: f64, by_parameter: f64) -> Share {
        Share {
            normal: DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 9.0]),
            gradient: DVector::from_column_slice(&[by_state, by_parameter]),
            squares: vec![99.0],
            samples: 100,
        }
    }

    fn of(shares: &[Share]) -> Stuck {
        stuck(shares, 1, &[false], 1e-2).unwrap()
    }

    /// A state's gradient g leaves g/4 of itself in that of the parameter: with a quarter of it there,
    /// a piece says nothing of the parameter.
    #[test]
    fn a_state_at_a_kink_keeps_no_fit_from_its_rest() {
        let rest = |_| piece(0.0, 0.0);
        let mut shares: Vec<Share> = (0..20).map(rest).collect();
        assert!(of(&shares).harmless && of(&shares).astray.is_empty());
        shares[7] = piece(30.0, 7.5);
        let found = of(&shares);
        assert!(found.harmless && found.astray == [7], "{:?}", found.astray);
        // Too many of them, one that is all, and parameters that would still move.
        (0..3).for_each(|k| shares[k] = piece(3.0, 0.75));
        assert!(!of(&shares).harmless && of(&shares).astray == [7]);
        assert!(!of(&[piece(3.0, 0.75)]).harmless);
        let mut shares: Vec<Share> = (0..20).map(rest).collect();
        shares[3] = piece(0.0, 20.0);
        assert!(!of(&shares).harmless);
        // At rest with a piece whose gradient the others hold against: without it they would go far.
        let against = 40.0 / 19.0;
        let mut shares: Vec<Share> = (0..20).map(|_| piece(0.0, -against)).collect();
        shares[7] = piece(30.0, 7.5 + 40.0);
        assert!(!of(&shares).harmless);
    }
}

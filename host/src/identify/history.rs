//! What effects that remember have seen of a stretch: their states, each followed once along the
//! smoothed motion.

use std::collections::BTreeSet;
use std::sync::{Arc, OnceLock, RwLock};

use super::windows::Kernels;
use crate::model::model_file::equations_of_motion::wrapped;
use crate::model::model_file::expression::{Node, Symbol};
use crate::model::model_file::memory::{Course, Memory};

/// Share of what a state was in the beginning, of which nothing is seen any more (by hand).
const FORGOTTEN: f64 = 1e-3;

/// Laws of states by number: [`crate::model::model_file::expression::Symbol::Memory`].
#[derive(Debug, Default)]
pub struct Laws(RwLock<Vec<(Arc<Memory>, usize)>>);

impl Laws {
    /// The number of a state, a new one for one that is not known yet.
    pub fn number(&self, memory: &Arc<Memory>, state: usize) -> usize {
        let is_it = |(m, k): &(Arc<Memory>, usize)| *k == state && (Arc::ptr_eq(m, memory) || m == memory);
        let seen = {
            let all = self.0.read().unwrap_or_else(std::sync::PoisonError::into_inner);
            if let Some(known) = all.iter().position(is_it) {
                return known;
            }
            all.len()
        };
        let mut all = self.0.write().unwrap_or_else(std::sync::PoisonError::into_inner);
        // Between the two locks another thread may have numbered it.
        all[seen..].iter().position(is_it).map(|k| seen + k).unwrap_or_else(|| {
            all.push((memory.clone(), state));
            all.len() - 1
        })
    }

    /// The law of a number.
    pub fn law(&self, number: usize) -> Option<(Arc<Memory>, usize)> {
        self.0.read().unwrap_or_else(std::sync::PoisonError::into_inner).get(number).cloned()
    }
}

/// A state's values at the samples, once they were asked for; none where it leaves the finite
/// numbers.
type Values = Arc<OnceLock<Option<Vec<f64>>>>;

/// What is known of a state, once it was asked for.
#[derive(Clone, Debug, Default)]
struct Series {
    values: Values,
    /// None where a state of its law leaves the finite numbers.
    settling: Arc<OnceLock<Option<Settling>>>,
}

/// How the states of a law settle along the motion.
#[derive(Clone, Copy, Debug)]
struct Settling {
    /// Greatest |∂r_j/∂z_j| times the samples' spacing; no number where one is none.
    fastest: f64,
    /// See [`History::forgets`].
    forgets: usize,
}

/// The smoothed motion of a stretch with the states that were followed along it.
#[derive(Debug)]
pub struct History {
    start_s: f64,
    motion: Course,
    laws: Arc<Laws>,
    series: RwLock<Vec<Series>>,
}

/// A signal with its mirror images through its end points, `reach` samples on either side: what a
/// low-pass that keeps the motion's direction needs there.
fn extended(x: &[f64], reach: usize) -> Vec<f64> {
    let (Some(first), Some(last)) = (x.first(), x.last()) else { return Vec::new() };
    let at = |i: usize| x[i.min(x.len() - 1)];
    let before = (1..=reach).rev().map(|i| 2.0 * first - at(i));
    let after = (1..=reach).map(|i| 2.0 * last - x[(x.len() - 1).saturating_sub(i)]);
    before.chain(x.iter().copied()).chain(after).collect()
}

/// A followed state between samples 1 and 2 of four, at a share of the way: the parabola of the
/// harmonic mean of the second differences there, and a line where they differ in sign. What swings
/// loses (ωh)²/12 of its size on lines alone; where a law has a corner one of the two is small.
pub fn between_samples(x: [f64; 4], share: f64) -> f64 {
    let [before, after] = [x[0] - 2.0 * x[1] + x[2], x[1] - 2.0 * x[2] + x[3]];
    let bend = if before * after > 0.0 { 2.0 * before * after / (before + after) } else { 0.0 };
    x[1] + share * (x[2] - x[1]) - 0.5 * share * (1.0 - share) * bend
}

impl History {
    /// Of a stretch of `coordinates` that begins at `start_s` with samples `step_s` apart.
    pub fn new(
        coordinates: &[Vec<f64>],
        start_s: f64,
        step_s: f64,
        kernels: &Kernels,
        circle: &[bool],
        laws: &Arc<Laws>,
    ) -> Self {
        let smoothed = coordinates.iter().map(|x| {
            let (mut smooth, mut slope) = (Vec::new(), Vec::new());
            kernels.full.apply(&extended(x, kernels.full.reach()), &mut smooth, &mut slope);
            (smooth, slope)
        });
        let (coordinates, rates) = smoothed.unzip();
        let motion = Course::new(coordinates, rates, step_s, circle.to_vec());
        Self { start_s, motion, laws: laws.clone(), series: RwLock::default() }
    }

    /// The same where the motion is known better: parts of `states`, coordinates and then rates at
    /// every sample, each behind the sample at which it begins. Only the states of some numbers are
    /// followed anew.
    #[must_use]
    pub fn moved<'a>(&self, parts: impl Iterator<Item = (usize, &'a [f64])>, numbers: &[usize]) -> Self {
        let n = self.motion.coordinates().len();
        let (mut coordinates, mut rates) = (self.motion.coordinates().to_vec(), self.motion.rates().to_vec());
        for (first, states) in parts {
            for (i, state) in states.chunks_exact(2 * n).enumerate() {
                coordinates.iter_mut().zip(&state[..n]).for_each(|(x, q)| x[first + i] = *q);
                rates.iter_mut().zip(&state[n..]).for_each(|(x, v)| x[first + i] = *v);
            }
        }
        let known = self.series.read().unwrap_or_else(std::sync::PoisonError::into_inner);
        // How a state settles depends on the motion, whether its values are kept or not.
        let kept = known.iter().enumerate().map(|(k, s)| {
            let values = if numbers.contains(&k) { Values::default() } else { s.values.clone() };
            Series { values, ..Series::default() }
        });
        let series = RwLock::new(kept.collect());
        let motion = Course::new(coordinates, rates, self.motion.step_s(), self.motion.circle().to_vec());
        Self { start_s: self.start_s, motion, laws: self.laws.clone(), series }
    }

    /// Turn of the motion between two samples, rad: √(rms of the velocities' second differences over
    /// theirs), ω h at one frequency; the greatest of all coordinates.
    pub fn turn_rad(&self) -> f64 {
        let of = |rates: &Vec<f64>| {
            let all: f64 = rates.iter().map(|v| v * v).sum();
            let bends: f64 = rates.windows(3).map(|v| (v[0] - 2.0 * v[1] + v[2]).powi(2)).sum();
            if all > 0.0 { (bends / all).powf(0.25) } else { 0.0 }
        };
        self.motion.rates().iter().map(of).fold(0.0, f64::max)
    }

    fn series(&self, number: usize) -> Series {
        if let Some(known) = self.series.read().unwrap_or_else(std::sync::PoisonError::into_inner).get(number) {
            return known.clone();
        }
        let mut all = self.series.write().unwrap_or_else(std::sync::PoisonError::into_inner);
        while all.len() <= number {
            all.push(Series::default());
        }
        all[number].clone()
    }

    /// Lets go of what is not `used`: each form that is tried has states of its own, as long as the
    /// stretch.
    pub fn keep(&self, used: &BTreeSet<usize>) {
        let mut all = self.series.write().unwrap_or_else(std::sync::PoisonError::into_inner);
        let gone = all.iter_mut().enumerate().filter(|(k, _)| !used.contains(k));
        gone.for_each(|(_, series)| *series = Series::default());
    }

    /// A state's values, followed where they were not yet.
    fn values(&self, number: usize) -> Values {
        let values = self.series(number).values;
        let _ = values.get_or_init(|| {
            let (memory, state) = self.laws.law(number)?;
            let mut all = memory.follow(&self.motion)?;
            (state < all.len()).then(|| all.swap_remove(state))
        });
        values
    }

    fn followed<T>(&self, number: usize, then: impl FnOnce(&[f64]) -> T) -> Option<T> {
        self.values(number).get()?.as_deref().map(then)
    }

    /// Whether a state stays within the finite numbers.
    pub fn is_finite(&self, number: usize) -> bool {
        self.followed(number, |_| ()).is_some()
    }

    /// How the states of the law that a number belongs to settle; none where one leaves the finite
    /// numbers.
    fn settling(&self, number: usize) -> Option<Settling> {
        *self.series(number).settling.get_or_init(|| {
            let slopes = self.slopes(number)?;
            let fastest = slopes
                .iter()
                .flatten()
                .fold(0.0, |most: f64, x| if x.is_nan() || most.is_nan() { f64::NAN } else { most.max(x.abs()) });
            // What swings counts as known: how it rang in the beginning is a strength of its effect.
            let [settling] = &slopes[..] else { return Some(Settling { fastest, forgets: 0 }) };
            let mut sum = 0.0;
            let forgotten = |x: &f64| {
                sum += x;
                sum < FORGOTTEN.ln()
            };
            let forgets = settling.iter().position(forgotten).unwrap_or(settling.len());
            Some(Settling { fastest, forgets })
        })
    }

    /// ∂r_j/∂z_j times the samples' spacing along the motion, for every state j of the law that a
    /// number belongs to; none where it leaves the finite numbers.
    fn slopes(&self, number: usize) -> Option<Vec<Vec<f64>>> {
        let (memory, _) = self.laws.law(number)?;
        let values: Vec<Values> = (0..memory.len()).map(|j| self.values(self.laws.number(&memory, j))).collect();
        let values: Vec<&[f64]> = values.iter().map(|v| v.get()?.as_deref()).collect::<Option<_>>()?;
        let (motion, count) = (&self.motion, self.motion.len());
        let of = |(j, rate): (usize, &Node)| {
            let slope = rate.derivative_between_jumps(Symbol::State(j))?;
            let at = |i: usize| {
                slope.value(&|s| match s {
                    Symbol::Coordinate(k) if motion.circle()[k] => wrapped(motion.coordinates()[k][i]),
                    Symbol::Coordinate(k) => motion.coordinates()[k][i],
                    Symbol::Rate(k) => motion.rates()[k][i],
                    Symbol::State(k) => values[k][i],
                    _ => f64::NAN,
                })
            };
            Some((0..count).map(|i| at(i) * motion.step_s()).collect())
        };
        memory.rates().iter().enumerate().map(of).collect()
    }

    /// Whether a state, and those of its law beside it, settle so slowly along the motion that a
    /// step of a sample follows them: |∂r_k/∂z_k| times the sample's spacing at most `most`.
    pub fn is_slow(&self, number: usize, most: f64) -> bool {
        // What jumps with a state settles at once.
        let jumps = |(memory, _): (Arc<Memory>, usize)| {
            memory.rates().iter().any(|r| r.jumps_with(&|s| matches!(s, Symbol::State(_))))
        };
        !self.laws.law(number).is_some_and(jumps) && self.settling(number).is_some_and(|s| s.fastest <= most)
    }

    /// The sample from which a state hardly depends on what it was when the stretch began, which is
    /// not known: exp ∫∂r/∂z dt < 10⁻³. The stretch's length where it never is; 0 for
    /// states that swing, how they rang in the beginning being strengths of their effect.
    pub fn forgets(&self, number: usize) -> usize {
        self.settling(number).map_or(0, |s| s.forgets)
    }

    /// A state at `count` samples from a time on; beyond the stretch as at its ends, NaN where it
    /// leaves the finite numbers.
    pub fn since(&self, number: usize, start_s: f64, count: usize) -> Vec<f64> {
        let first = ((start_s - self.start_s) / self.motion.step_s()).round();
        // Rounded; the cast cuts nothing but what lies before the stretch.
        let first = first.max(0.0) as usize;
        let found = self.followed(number, |all| {
            let last = all.len().saturating_sub(1);
            (first..first + count).map(|i| all.get(i.min(last)).copied().unwrap_or(f64::NAN)).collect()
        });
        found.unwrap_or_else(|| vec![f64::NAN; count])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::model_file::expression::{Function, call, divide, multiply, number, subtract, symbol};

    /// Dahl's state along an even motion of 0.1 a sample and a distance of 1: exp(−0.1 i) is below a
    /// thousandth after 70 samples. One that swings counts as known.
    #[test]
    fn a_state_forgets_how_it_was_when_the_stretch_began() {
        let (v, z) = (symbol(Symbol::Rate(0)), symbol(Symbol::State(0)));
        let dahl = subtract(v.clone(), multiply(call(Function::Abs, v), z.clone()));
        let swings = vec![symbol(Symbol::State(1)), subtract(number(0.0), divide(z, number(4.0)))];
        let laws = Arc::new(Laws::default());
        let history = History {
            start_s: 0.0,
            motion: Course::new(
                vec![(0..200).map(|i| 0.1 * f64::from(i)).collect()],
                vec![vec![10.0; 200]],
                0.01,
                vec![false],
            ),
            laws: laws.clone(),
            series: RwLock::default(),
        };
        let number_of = |rates: Vec<Node>| laws.number(&Arc::new(Memory::new(rates)), 0);
        assert_eq!(history.forgets(number_of(vec![dahl.clone()])), 69);
        // 0.1 a sample; one that follows by jumps is never slow.
        let follows = multiply(
            number(10.0),
            call(Function::Sign, subtract(symbol(Symbol::Coordinate(0)), symbol(Symbol::State(0)))),
        );
        let [slow, jumps] = [vec![dahl.clone()], vec![follows]].map(&number_of);
        assert!(history.is_slow(slow, 0.11) && !history.is_slow(slow, 0.09) && !history.is_slow(jumps, 2.0));
        assert_eq!(history.forgets(number_of(vec![multiply(number(0.1), dahl)])), 200);
        assert_eq!(history.forgets(number_of(swings)), 0);
        // What is let go is followed again when it is asked for.
        let values = |k: usize| history.series.read().unwrap()[k].values.get().is_some();
        let settling = |k: usize| history.series.read().unwrap()[k].settling.get().is_some();
        history.keep(&BTreeSet::from([slow]));
        assert!(values(slow) && settling(slow));
        history.keep(&BTreeSet::from([jumps]));
        assert!(!values(slow) && !settling(slow) && history.is_finite(slow) && values(slow));
        // Along another motion it settles otherwise, though its values are kept: 0.2 a sample.
        assert!(history.is_slow(slow, 0.11) && settling(slow));
        let faster: Vec<f64> = (0..200).flat_map(|i| [0.1 * f64::from(i), 20.0]).collect();
        let moved = history.moved([(0, &faster[..])].into_iter(), &[]);
        assert!(moved.series.read().unwrap()[slow].values.get().is_some());
        assert!(moved.is_slow(slow, 0.21) && !moved.is_slow(slow, 0.19));
    }

    /// Whether it comes as one law or as another of the same rates, and from whichever thread.
    #[test]
    fn a_law_is_numbered_once() {
        use rayon::prelude::*;
        let law = |k: usize| Arc::new(Memory::new(vec![symbol(Symbol::Rate(0)), number((k % 7) as f64)]));
        let laws = Laws::default();
        let found: Vec<[usize; 2]> = (0..700)
            .into_par_iter()
            .map(|k| {
                let of = law(k);
                assert_eq!(laws.number(&of, 0), laws.number(&law(k), 0));
                [0, 1].map(|state| laws.number(&of, state))
            })
            .collect();
        assert_eq!(BTreeSet::from_iter(found.iter().flatten()), BTreeSet::from_iter(&(0..14).collect::<Vec<_>>()));
        for (k, numbers) in found.iter().enumerate() {
            assert_eq!(*numbers, found[k % 7]);
            let (of, state) = laws.law(numbers[1]).unwrap();
            assert!(of == law(k) && state == 1 && laws.law(14).is_none());
        }
    }

    /// 11 Hz at 2 ms: (ωh)²/12 of the size would be lost on lines, 1.6 thousandths on the average.
    #[test]
    fn what_swings_keeps_its_size_between_samples_and_a_corner_stays_one() {
        let wave = |i: f64| (0.138 * i).cos();
        let (mut product, mut square) = (0.0, 0.0);
        for i in 0..4000 {
            let at = f64::from(i) / 10.0;
            let four = [-1.0, 0.0, 1.0, 2.0].map(|k| wave(at.floor() + k));
            let x = between_samples(four, at - at.floor());
            product += x * wave(at);
            square += wave(at) * wave(at);
        }
        assert!((product / square - 1.0).abs() < 1e-4, "{}", product / square);
        for share in [0.0, 0.3, 1.0] {
            assert!((between_samples([0.0, 0.0, 1.0, 2.0], share) - share).abs() < 1e-15);
            assert!((between_samples([1.0, 0.0, 0.0, -0.5], share)).abs() < 1e-15);
        }
    }
}

//! Multiple shooting, linearised about the measured motion: residuals of trajectories for
//! everything that a model may be missing.
//!
//! Each window of the record has an initial state of its own, which is eliminated; what is lacking
//! is weighed as predictions miss it: a force that acts against the motion adds up over a window,
//! where in the balance of forces it is a small share beside those that do not. No solution is
//! searched for: the model is linearised about the smoothed record, solved, and linearised again
//! about its own motion until that stands still ([`linear`]). Windows grow to their length in three
//! stages; those in which the model has no solution are left out, and a path is not moved farther
//! than a linearisation can mean.
//!
//! Each window is predicted over two horizons, its own length and a twelfth of it, with a weight
//! for either: what adds up slowly shows in the long one, what is fast in the short one, where
//! little of what else is lacking has added up.
//!
//! Windows are as long as leaves [`BLOCKS`] of them, and ten periods of the motion at most (under
//! measured inputs, whose windows of the weak form are those of transients, twenty of these). What
//! a drive keeps moving may be chaotic: there windows double from one period of the drive to eight,
//! as long as they can be followed, and those of the last length that do not stand still are left
//! out, by convergence and never by misfit (a reversal that only just happens). Other windows grow
//! while what is left of them is small beside the motion, and on with the model that gets better.
//! Where a length is asked for they are as long as that, if the model follows them. A free motion
//! too short for windows to decide is followed in whole stretches from the beginning ([`cut`]).
//!
//! | file | what |
//! |---|---|
//! | [`path`] | the motion that is linearised about, windows |
//! | [`course`] | the record while columns are fitted to it |
//! | [`forcing`] | accelerations by every column |
//! | [`by_inertia`](mod@by_inertia) | what strengths do while inertias follow from coefficients |
//! | [`linear`] | the model's flow about a window's path |
//! | [`normal`](mod@normal) | a window's normal equations |
//! | [`strips`](mod@strips) | columns carried along a window together |
//! | [`gram`] | sums of products of the columns that are fitted together |
//! | [`adjoint`] | how what is left of a window pulls on the force at every instant |
//! | [`cut`] | blocks of windows |
//! | [`blocks`] | least squares over blocks |
//! | [`left_out`](mod@left_out) | windows that do not count |
//! | [`coloured`](mod@coloured) | the sensors' noise where the record was smoothed |
//! | [`quieter`](mod@quieter) | the sensors' noise where it was taken for too much |
//! | [`remade`](mod@remade) | what is left of records that the model itself makes |
//! | [`astray`](mod@astray) | windows that were led to another solution |
//! | [`stage`](mod@stage) | windows of one length until they stand still |
//! | [`steps`] | steps of integration that do not show |
//! | [`finer`] | what is left of an effect in finer ones |
//! | [`signs`] | coefficients that keep their sign |
//! | [`window_inputs`] | time, phase, inputs along a window |

pub mod adjoint;
mod astray;
pub mod blocks;
mod by_inertia;
mod coloured;
mod course;
mod cut;
mod finer;
mod forcing;
mod gram;
mod left_out;
mod linear;
mod normal;
mod path;
mod quieter;
mod remade;
pub mod signs;
mod slipped;
mod stage;
mod steps;
mod strips;
mod window_inputs;

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use self::blocks::Blocks;
pub use self::coloured::{Coloured, coloured};
use self::course::{Course, List};
pub use self::cut::{LONG_PART, fewest_of_part, is_short, most_blocks};
pub use self::finer::outlasts_finer_steps;
use self::linear::Linear;
pub use self::path::samples_of_path;
use self::path::{FEWEST_SAMPLES, Path, Window, windows};
pub use self::quieter::quieter;
pub use self::remade::{RECORDS, record as remade_record, remade};
pub use self::slipped::shows_slips;
use self::stage::{is_applied, stage};
pub use self::steps::Steps;
use super::candidates::{Candidate, Column};
use super::setting::Setting;
use super::state::State;

/// Windows that a record should give (by hand).
pub const BLOCKS: f64 = 20.0;
/// The same where windows are whole stretches.
pub const WHOLE: f64 = 1.0;
/// Longest window under measured inputs, and of a free motion that is followed on, in windows of the
/// weak form.
const TRANSIENTS: f64 = 20.0;
/// Most samples that are followed.
pub const MOST_SAMPLES: usize = 300_000;
/// Parts of the full length in which windows grow, and most linearisations at each.
const STAGES: [f64; 3] = [0.25, 0.5, 1.0];
const PASSES: [usize; 3] = [2, 2, 5];
/// Longest window under a drive, in its periods (by hand).
const MOST_PERIODS: usize = 8;
/// What is left of windows, as a share of the motion's rms, from which longer ones would be
/// linearised too far from what the model does (by hand).
const FAR: f64 = 0.15;
/// Share of the windows that may be left out (by hand).
pub const MOST_LOST: f64 = 0.3;

/// Paths, and the windows that they are followed in.
#[derive(Clone, Debug)]
pub struct Followed {
    paths: Vec<Path>,
    /// Samples of a window; none before it was found.
    length: Option<usize>,
    /// Windows of the last fit.
    count: usize,
    /// Which windows of that length were followed until they stood still; empty where all count.
    still: Vec<bool>,
    /// What is left of each, in units of the noise's power; no number where the model has no
    /// solution.
    left: Vec<f64>,
}

impl Followed {
    /// Samples of a window.
    pub fn samples(&self) -> usize {
        self.length.unwrap_or(0)
    }

    /// Sample of a stretch at which its windows begin.
    pub fn first(&self, stretch: usize) -> usize {
        self.paths.get(stretch).map_or(0, |p| p.first)
    }

    /// Mean of what is left of the windows, in units of the noise's power.
    pub fn left(&self) -> f64 {
        mean_of(&self.left)
    }

    /// The windows that were followed until they stood still.
    fn kept(&self, setting: &Setting<'_>) -> Option<Vec<Window>> {
        let n = setting.circle.len();
        let lengths: Vec<usize> = self.paths.iter().map(|p| p.len(n)).collect();
        let mut all = windows(&lengths, self.length?, MOST_SAMPLES);
        if self.still.len() == all.len() {
            let mut still = self.still.iter();
            all.retain(|_| still.next().copied().unwrap_or(true));
        }
        Some(all)
    }

    /// The motion in the windows that were followed until they stood still; none before there are
    /// any.
    pub fn settled(&self, setting: &Setting<'_>) -> Option<Settled<'_>> {
        Some(Settled { paths: &self.paths, kept: self.kept(setting)?, width: 2 * setting.circle.len() })
    }

    /// How many blocks, and the length of one, s: of windows, or of what is held out of them.
    pub fn blocks(&self, setting: &Setting<'_>) -> (usize, f64) {
        let (windows, window_s) = self.windows(setting);
        let parts = self.kept(setting).map_or(1, |all| cut::blocks_of(setting, &all));
        (windows * parts, window_s / parts as f64)
    }

    /// How many windows, and the length of one, s.
    pub fn windows(&self, setting: &Setting<'_>) -> (usize, f64) {
        let step_s = setting.raw.first().map_or(0.0, |s| s.step_s);
        (self.count, self.length.map_or(0.0, |l| l as f64 * step_s))
    }
}

/// The motion where it was followed.
pub struct Settled<'a> {
    paths: &'a [Path],
    kept: Vec<Window>,
    /// Coordinates and rates.
    width: usize,
}

impl Settled<'_> {
    /// Coordinates and rates at a sample of a stretch, where it was followed.
    pub fn at(&self, stretch: usize, sample: usize) -> Option<Vec<f64>> {
        let path = self.paths.get(stretch)?;
        let at = sample.checked_sub(path.first)?;
        let holds = |w: &Window| w.stretch == stretch && (w.first..w.first + w.count).contains(&at);
        let m = self.width;
        self.kept.iter().any(holds).then(|| path.states[m * at..m * (at + 1)].to_vec())
    }
}

/// Signs of all columns.
fn signs_of(setting: &Setting<'_>, state: &State, further: &[&Candidate], behind: usize) -> Vec<f64> {
    let mut out = setting.signs.clone();
    for c in state.chosen.iter().map(|k| &k.candidate).chain(further.iter().copied()) {
        out.extend(signs::of(c));
    }
    out.resize(out.len() + behind, 0.0);
    out
}

/// Coefficients of the model's own columns and of what was chosen; zero for what is found as an
/// increment.
fn present(state: &State) -> Vec<f64> {
    super::given::coefficients(state).iter().copied().collect()
}

/// Longest window, samples.
fn longest(setting: &Setting<'_>, lengths: &[usize]) -> usize {
    let step_s = setting.raw.first().map_or(1.0, |s| s.step_s);
    let whole: usize = lengths.iter().sum();
    let own = setting.geometry.windows.length_s / step_s;
    let follows_on = !setting.bound.inputs.is_empty() || setting.blocks < BLOCKS;
    let most = match setting.blocks {
        WHOLE => f64::INFINITY,
        _ if follows_on => TRANSIENTS * own,
        _ => own,
    };
    let asked = setting.window_s.map(|s| (s / step_s).round());
    let wished = asked.unwrap_or((whole as f64 / setting.blocks).min(most)) as usize;
    wished.max(2 * FEWEST_SAMPLES).min(lengths.iter().copied().max().unwrap_or(0))
}

/// Lengths in which windows grow to their full one, and most linearisations at each. What a drive
/// keeps moving may be chaotic: its windows double from one period on, as long as they can be
/// followed.
fn stages(setting: &Setting<'_>, full: usize) -> Vec<(usize, usize)> {
    let step_s = setting.raw.first().map_or(1.0, |s| s.step_s);
    if let Some(drive) = setting.rig.drive {
        let period = (1.0 / (drive.frequency_hz * step_s)).ceil() as usize;
        let doubled = (0..usize::BITS).map(|k| period.max(2 * FEWEST_SAMPLES) << k);
        let lengths: Vec<usize> = match setting.window_s {
            Some(_) => doubled.take_while(|l| *l < full).chain([full]).collect(),
            None => doubled.take_while(|l| *l <= full.min(MOST_PERIODS * period)).collect(),
        };
        return lengths.into_iter().map(|l| (l, PASSES[2])).collect();
    }
    let of = |(share, passes): (f64, usize)| ((share * full as f64) as usize, passes);
    STAGES.into_iter().zip(PASSES).map(of).filter(|s| s.0 >= 2 * FEWEST_SAMPLES).collect()
}

/// Fits the model's own columns and what was chosen from the state's coefficients on, moving the
/// paths with them; none where most windows cannot be followed.
pub fn settle(setting: &Setting<'_>, state: &mut State) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let before = state.followed.take();
    let n = setting.circle.len();
    let of_full = |paths: &[Path]| {
        let lengths: Vec<usize> = paths.iter().map(|p| p.len(n)).collect();
        stages(setting, longest(setting, &lengths))
    };
    // A model that has changed may no longer follow windows of that length about that path; one
    // that was far off may now follow longer ones.
    let goes_on = before.and_then(|f| {
        let length = f.length?;
        let longer = of_full(&f.paths).into_iter().filter(|s| setting.rig.drive.is_none() && s.0 > length);
        let all: Vec<(usize, usize)> = std::iter::once((length, PASSES[2])).chain(longer).collect();
        grown(setting, state, f, &all)
    });
    let goes_on = goes_on.map(|found| astray::back(setting, state, found));
    let (followed, x, covariance) = goes_on.or_else(|| {
        let fresh = Followed {
            paths: state.stretches.iter().map(|s| Path::smoothed(s, &setting.geometry.kernels)).collect(),
            length: None,
            count: 0,
            still: Vec::new(),
            left: Vec::new(),
        };
        let all = of_full(&fresh.paths);
        grown(setting, state, fresh, &all)
    })?;
    remember(setting, state, &followed);
    state.followed = Some(followed);
    Some((DVector::from_vec(x), covariance))
}

/// A fit in windows: paths, coefficients, covariance.
type Fitted = (Followed, Vec<f64>, DMatrix<f64>);

/// Follows the states of effects in the model along the windows' own motion: that of the record is
/// blurred where a velocity turns its sign.
fn remember(setting: &Setting<'_>, state: &mut State, followed: &Followed) {
    let numbers = state.remembered();
    let (Some(kept), false) = (followed.kept(setting), numbers.is_empty()) else { return };
    let m = 2 * setting.circle.len();
    for (k, (stretch, path)) in state.stretches.iter_mut().zip(&followed.paths).enumerate() {
        let own = kept.iter().filter(|w| w.stretch == k);
        let parts = own.map(|w| (path.first + w.first, &path.states[m * w.first..m * (w.first + w.count)]));
        stretch.history = stretch.history.as_ref().map(|h| Arc::new(h.moved(parts, &numbers)));
    }
}

/// Mean over windows that have a number.
fn mean_of(left: &[f64]) -> f64 {
    let all = left.iter().filter(|l| l.is_finite());
    all.clone().sum::<f64>() / all.count().max(1) as f64
}

/// Fits in windows of one length after the other, as long as they can be followed and what is left
/// is small beside the motion.
fn grown(setting: &Setting<'_>, state: &State, mut followed: Followed, stages: &[(usize, usize)]) -> Option<Fitted> {
    let mut x = present(state);
    let own: Vec<usize> = (0..x.len()).collect();
    let signs = signs_of(setting, state, &[], 0);
    let course = Course::new(setting, state);
    let far = FAR * FAR * course.motion_power();
    let mut last: Option<(DMatrix<f64>, Vec<bool>, Vec<f64>)> = None;
    for &(length, passes) in stages {
        let (mut trial, mut moved) = (followed.clone(), x.clone());
        let Some(fit) = stage(&course, &mut trial, &mut moved, length, passes, &own, &signs) else { break };
        let is_far = setting.rig.drive.is_none() && mean_of(&fit.2) > far;
        if is_far && last.is_some() {
            break;
        }
        trial.length = Some(length);
        (followed, x, last) = (trial, moved, Some(fit));
        if is_far {
            break;
        }
    }
    let (covariance, still, left) = last?;
    followed.left = left;
    followed.count = still.iter().filter(|s| **s).count();
    followed.still = still;
    Some((followed, x, covariance))
}

/// Windows about their settled paths, about which the model is linear whatever is fitted to them.
pub struct Ground<'a> {
    course: Course<'a>,
    paths: &'a [Path],
    windows: Vec<Window>,
    linear: Vec<Option<Linear>>,
}

impl<'a> Ground<'a> {
    /// Of what was followed with a state; none where nothing was.
    pub fn new(setting: &'a Setting<'a>, state: &'a State) -> Option<Self> {
        let followed = state.followed.as_ref()?;
        let (windows, course) = (followed.kept(setting)?, Course::new(setting, state));
        let linear = course.linear(&followed.paths, &windows, &present(state))?;
        Some(Self { course, paths: &followed.paths, windows, linear })
    }

    /// Gram matrices of the own columns, of further candidates (with one another where they are
    /// fitted `together`) and of groups of columns of no effect. Columns of no effect are fitted
    /// with those of their group.
    pub fn evidence(&self, further: &[&Candidate], together: bool, behind: &[Vec<Column>]) -> Option<Blocks> {
        let Self { course, paths, windows, linear } = self;
        let (setting, state) = (course.setting, course.state);
        let list = List { x: present(state), further, behind, together };
        let count = behind.iter().map(Vec::len).sum();
        let signs = signs_of(setting, state, further, count);
        let mut blocks = course.reduced(paths, windows, linear, &list, signs)?;
        let own: Vec<usize> = (0..list.x.len()).collect();
        let fit = blocks.fit(&own)?;
        blocks.weigh(&blocks.misfits(&fit.all));
        blocks.still = is_applied(state, own.len());
        Some(blocks)
    }
}

/// The same of one list, about the settled paths.
pub fn evidence(
    setting: &Setting<'_>,
    state: &State,
    further: &[&Candidate],
    together: bool,
    behind: &[Vec<Column>],
) -> Option<Blocks> {
    Ground::new(setting, state)?.evidence(further, together, behind)
}

//! The model while effects are added to it: coefficients, effects with their strengths, and the angles with sensor effects taken off.

use nalgebra::DVector;

use super::design::{self, base_terms};
use super::effects::{Action, Context, EFFECTS, Effect, Place, Variant};
use crate::error::Result;
use crate::identify::{self, Identification};
use crate::rig::Rig;
use crate::signal::angles::AngleSegment;

/// A candidate: an effect at a place in one form.
#[derive(Clone)]
pub(super) struct Candidate {
    pub(super) effect: &'static Effect,
    pub(super) place: Place,
    pub(super) variant: Variant,
}

impl Candidate {
    pub(super) fn name(&self) -> String {
        format!("{}@{}", self.effect.id, self.place.name())
    }
}

/// An effect in the model: its form and strengths.
#[derive(Clone)]
pub(super) struct Chosen {
    pub(super) candidate: Candidate,
    pub(super) strengths: Vec<f64>,
}

impl Chosen {
    /// A candidate that joins the model with strengths of zero, in its refined form where it has one.
    pub(super) fn new(c: &Context, mut candidate: Candidate) -> Self {
        if let (Some(refine), [(_, form), ..]) = (candidate.variant.refine, &candidate.variant.shape[..]) {
            candidate.variant = refine(c, candidate.place, *form);
        }
        Self { strengths: vec![0.0; candidate.variant.action.len()], candidate }
    }
}

/// Every candidate for this rig.
pub(super) fn candidates(c: &Context) -> Vec<Candidate> {
    EFFECTS
        .iter()
        .flat_map(|effect| {
            effect.places.iter().flat_map(move |&place| {
                (effect.variants)(c, place).into_iter().map(move |variant| Candidate { effect, place, variant })
            })
        })
        .collect()
}

/// The nominal dampings as chosen effects.
pub(super) fn nominal(rig: &Rig, c: &Context) -> Result<Vec<Chosen>> {
    let ids: Vec<&str> = identify::dampings(rig)?.iter().map(|d| d.id).collect();
    Ok(candidates(c)
        .into_iter()
        .filter(|k| ids.contains(&k.name().as_str()))
        .map(|candidate| Chosen { strengths: vec![0.0], candidate })
        .collect())
}

/// The model's coefficients and what was computed with them.
#[derive(Clone)]
pub(super) struct State {
    pub(super) context: Context,
    /// Nominal dampings, then effects added.
    pub(super) chosen: Vec<Chosen>,
    /// How many of `chosen` are nominal.
    pub(super) nominal: usize,
    pub(super) base: Vec<f64>,
    /// Angles with the sensor effects found so far taken off.
    pub(super) segments: Vec<AngleSegment>,
}

impl State {
    pub(super) fn model(&self) -> Vec<(&Variant, Vec<f64>)> {
        self.chosen.iter().map(|k| (&k.candidate.variant, k.strengths.clone())).collect()
    }

    /// Columns of the B terms and of everything chosen, which come first.
    pub(super) fn own_columns(&self) -> usize {
        2 * base_terms(self.context.driven) + self.chosen.iter().map(|k| k.strengths.len()).sum::<usize>()
    }

    /// Effects depend on the coefficients (ratios of inertias, the drive's share): renews their columns.
    pub(super) fn renew(&mut self) {
        let all = candidates(&self.context);
        for k in &mut self.chosen {
            if let (Some(refine), [(_, form), ..]) = (k.candidate.variant.refine, &k.candidate.variant.shape[..]) {
                // A Gauss–Newton step of the form's parameter, at most by half.
                let step = if k.strengths[0] == 0.0 { 0.0 } else { k.strengths[1] / k.strengths[0] };
                let limit = 0.5 * form.abs();
                k.candidate.variant = refine(&self.context, k.candidate.place, form + step.max(-limit).min(limit));
                k.strengths[1] = 0.0;
                continue;
            }
            let name = k.candidate.name();
            if let Some(new) = all.iter().find(|n| n.name() == name && n.variant.shape == k.candidate.variant.shape) {
                k.candidate.variant = new.variant.clone();
            }
        }
    }

    /// Takes coefficients over: B terms, then strengths; those of effects that are applied to the data are increments.
    pub(super) fn take(&mut self, x: &DVector<f64>, raw: &[AngleSegment]) {
        let n = 2 * base_terms(self.context.driven);
        self.base = x.rows(0, n).iter().copied().collect();
        let mut at = n;
        let mut sensors = false;
        for k in &mut self.chosen {
            let applied = k.candidate.variant.action.is_applied();
            sensors |= applied;
            for s in &mut k.strengths {
                *s = x[at] + if applied { *s } else { 0.0 };
                at += 1;
            }
        }
        let per = n / 2;
        for i in 0..2 {
            (0..per).for_each(|j| self.context.b[i][j] = self.base[i * per + j]);
        }
        if sensors {
            self.segments = raw.to_vec();
            for k in &self.chosen {
                match &k.candidate.variant.action {
                    Action::Force(_) => {}
                    Action::Sensor(laws) => {
                        for (law, s) in laws.iter().zip(&k.strengths) {
                            self.segments = self.segments.iter().map(|g| design::correct(g, law, *s)).collect();
                        }
                    }
                    Action::Runaway(_) => {
                        let rate = core::f64::consts::TAU * k.strengths[0];
                        let from = self.context.span_s[0];
                        self.segments.iter_mut().for_each(|g| g.runaway = (from, rate));
                    }
                }
            }
        }
    }
}

/// The state before anything is added.
pub(super) fn start(rig: &Rig, first: &Identification, raw: &[AngleSegment]) -> Result<State> {
    let value = |name: String| first.parameter(&name).map_or(0.0, |p| p.value);
    let b = [1, 2].map(|i| [1, 2, 3, 4].map(|j| value(format!("B{i}{j}"))));
    let start = raw.first().map_or(0.0, |s| s.start_s);
    let end = raw.last().map_or(0.0, |s| s.time(s.len()));
    let mut known = rig.known.clone();
    for p in &first.parameters {
        if !p.name.starts_with('B') && !p.name.starts_with('C') {
            known.entry(p.name.clone()).or_insert(p.value);
        }
    }
    let context = Context {
        omega: rig.omega(),
        driven: rig.drive.is_some(),
        b,
        g: known.get("g").copied().unwrap_or(crate::rig::GRAVITY),
        known,
        relative: raw.first().is_none_or(|s| s.relative),
        span_s: [start, (end - start).max(f64::MIN_POSITIVE)],
    };
    let chosen = nominal(rig, &context)?;
    let n = base_terms(context.driven);
    let base = (0..2).flat_map(|i| context.b[i][..n].to_vec()).collect();
    Ok(State { nominal: chosen.len(), chosen, context, base, segments: raw.to_vec() })
}

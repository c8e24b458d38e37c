//! Which effect is added next: every candidate is added in turn, everything refitted, and the best
//! of those that are significant over the whole list is taken; the simplest within a standard error
//! of it, since simpler ones explain as much.

mod detection;
mod evidence;
mod pairs;
mod refused;

use std::collections::BTreeMap;

use nalgebra::DVector;
use rayon::prelude::*;

pub(super) use self::evidence::{Evidence, Rows};
use super::explanation::{Ranked, Refused};
use super::ranking::{self, Fit};

/// Probability of naming anything on a record in which nothing is missing, over everything that is
/// tried.
pub(super) const FAMILY_WISE: f64 = 0.01;
/// The same for each of the two families that are tried (Bonferroni): the list of effects, and the
/// tones of all frequencies.
pub(super) const OF_A_FAMILY: f64 = FAMILY_WISE / 2.0;

/// Share of the held-out residual power from which weights are estimated anew with each candidate:
/// those of a model that misses so much misjudge forms that are close to each other (by hand).
const STRONG: f64 = 0.15;
/// Difference of that held-out score, −2 ln of a likelihood ratio, up to which two candidates are
/// not told apart: two standard errors, four, times the two and a half by which correlated
/// neighbouring frequencies count too often.
const CLOSE: f64 = 10.0;
/// Times the probability by chance that what is not told from the strongest may have: it is not the
/// one that has to be clear of all that were tried (by hand).
const NEARLY: f64 = 10.0;
/// Share of a gain below which a difference is rounding.
const EXACT: f64 = 1e-6;
/// Difference of two candidates, in that below which they are not told apart, that is a likelihood
/// ratio of e^½: how common laws are differs by more.
const ONE_NOISE: f64 = 0.25;
/// Share of a gain within which another's is the same: columns that are one and the same leave
/// rounding errors without scatter.
const ALIKE: f64 = 1e-3;
/// Share above which the forms of one effect are told apart in this way as well, and the most forms
/// judged below and above it (by hand).
const OVERWHELMING: f64 = 0.75;
const RERANKED: [usize; 2] = [20, 60];

/// A candidate whose columns stand behind the model's own, in the order of the offers.
#[derive(Clone, Debug)]
pub(super) struct Offer {
    /// `ID@PLACE`; several forms of one effect have the same.
    pub(super) name: String,
    /// Number of its columns.
    pub(super) strengths: usize,
    /// Whether its first strength is positive: a friction that feeds the motion is none, whatever
    /// it explains.
    pub(super) positive: bool,
    /// Number of its shape parameters.
    pub(super) shapes: usize,
    /// The simpler effect at the same place that it refines, `ID@PLACE`.
    pub(super) refines: Option<String>,
    /// Whether the model has it already, or it was refused.
    pub(super) taken: bool,
    /// Whether its form was moved to what is left.
    pub(super) moved: bool,
}

/// What was chosen.
pub(super) struct Choice {
    /// Its number among the offers.
    pub(super) index: usize,
    /// The fit with it, its strengths last.
    pub(super) fit: ranking::Fit,
    /// Probability by chance.
    pub(super) p_value: f64,
    /// Share of the held-out residual power that it takes away.
    pub(super) share: f64,
    /// Others that held-out data do not tell from it.
    pub(super) twins: Vec<String>,
    /// The next best and its share.
    pub(super) runner_up: Option<(String, f64)>,
}

/// Probability by chance below which a candidate was close.
const NEAR: f64 = 0.01;
/// Share of what is left above the noise that a form which was moved to it may leave when it was
/// refitted (by hand: those that stood in for another shape left half).
pub(super) const LEFT_BY_MOVED: f64 = 0.25;

/// A candidate's fit beside the model.
struct Score {
    index: usize,
    gain: f64,
    deviations: f64,
    p: f64,
    fit: Fit,
}

impl Score {
    /// Of the offer of this number, whose `d` strengths stand last in a fit, beside that without it.
    fn new(index: usize, d: usize, fit: Fit, plain: &Fit) -> Self {
        let (gain, _) = ranking::gain(&plain.held_out, &fit.held_out);
        let deviations = ranking::deviations(&plain.held_out, &fit.held_out);
        Self { index, gain, deviations, p: ranking::p_value(&fit, d), fit }
    }
}

/// What a step of the selection is made from.
pub(super) struct Selection<'a> {
    /// What every set of columns leaves.
    pub(super) evidence: &'a dyn Evidence,
    /// Columns of the model.
    pub(super) own: &'a [usize],
    /// The candidates; their columns follow those of the model in this order.
    pub(super) offers: &'a [Offer],
}

/// Every candidate with its columns.
struct Field<'a> {
    evidence: &'a dyn Evidence,
    own: &'a [usize],
    offers: &'a [Offer],
    /// First column of each, and their number.
    places: Vec<(usize, usize)>,
    plain: Fit,
    total: f64,
    blocks: f64,
    scores: Vec<Score>,
}

impl<'a> Field<'a> {
    fn new(selection: &Selection<'a>) -> Option<Self> {
        let Selection { evidence, own, offers } = *selection;
        let plain = evidence.fit(own)?;
        let total: f64 = plain.held_out.iter().sum();
        let mut at = own.len();
        let places: Vec<(usize, usize)> = offers
            .iter()
            .map(|o| {
                at += o.strengths;
                (at - o.strengths, o.strengths)
            })
            .collect();
        let scores = (0..offers.len())
            .into_par_iter()
            .filter(|&i| !offers[i].taken)
            .filter_map(|index| {
                let (from, d) = places[index];
                let columns: Vec<usize> = own.iter().copied().chain(from..from + d).collect();
                Some(Score::new(index, d, evidence.fit(&columns)?, &plain))
            })
            .collect();
        let blocks = plain.held_out.len() as f64;
        Some(Self { evidence, own, offers, places, plain, total, blocks, scores })
    }

    fn name(&self, s: &Score) -> &'a str {
        &self.offers[s.index].name
    }

    /// The best form of each effect at each place, and, where weights from a model that misses much
    /// are wrong and so is the order that they give, scores by weights of their own.
    fn best(&self) -> (BTreeMap<&str, &Score>, BTreeMap<usize, f64>) {
        let mut likelihood: BTreeMap<usize, f64> = BTreeMap::new();
        let mut best: BTreeMap<&str, &Score> = BTreeMap::new();
        for s in &self.scores {
            let entry = best.entry(self.name(s)).or_insert(s);
            if s.gain > entry.gain {
                *entry = s;
            }
        }
        let greatest = best.values().map(|s| s.gain * self.blocks).fold(0.0, f64::max);
        if greatest > STRONG * self.total {
            let most = RERANKED[usize::from(greatest > OVERWHELMING * self.total)];
            let gains: Vec<_> = self.scores.iter().map(|s| (s.gain, self.places[s.index])).collect();
            if let Some(again) = self.evidence.rescored(self.own, most, &gains) {
                for (name, entry) in &mut best {
                    let own_forms = self.scores.iter().zip(&again).filter(|(s, _)| self.name(s) == *name);
                    let finite = own_forms.filter(|(_, j)| j.is_finite());
                    if let Some((form, _)) = finite.min_by(|a, b| a.1.total_cmp(b.1)) {
                        *entry = form;
                    }
                }
                likelihood = self.scores.iter().zip(&again).map(|(s, j)| (s.index, *j)).collect();
            }
        }
        (best, likelihood)
    }

    /// A friction that feeds the motion is none, whatever it explains. The first strength stands
    /// where the candidate's own begin.
    fn feeds(&self, s: &Score) -> bool {
        let d = self.places[s.index].1;
        self.offers[s.index].positive && s.fit.all[s.fit.all.len() - d] <= 0.0
    }

    /// Whether a gain of that much a block is more than as good as nothing.
    fn is_something(&self, gain: f64) -> bool {
        gain > 0.0 && gain * self.blocks > self.evidence.least_gain(self.total)
    }

    /// Whether a candidate's gain by itself is, and clear of how it scatters from block to block, or
    /// of the noise where there is nothing else.
    fn stands(&self, s: &Score) -> bool {
        let is_clear = s.deviations > self.evidence.least_deviations()
            || self.evidence.is_above_noise(s.gain * self.blocks, self.total);
        is_clear && self.is_something(s.gain)
    }

    /// Whether a candidate is significant over all that were tried, and a gain, and neither feeds
    /// the motion nor is one of those `feigned`, which the sensors alone give.
    fn is_significant(&self, s: &Score, feigned: &[usize]) -> bool {
        self.is_supported(s, feigned, 1.0)
    }

    /// The same with so many times the probability by chance.
    fn is_supported(&self, s: &Score, feigned: &[usize], times: f64) -> bool {
        let is_rare = s.p * self.tests() < times * OF_A_FAMILY;
        is_rare && self.stands(s) && !self.feeds(s) && !feigned.contains(&s.index)
    }

    /// How many forms were tried.
    fn tests(&self) -> f64 {
        self.scores.len().max(1) as f64
    }

    /// The strongest, where its form was moved to what is left and promises most of it: its
    /// probability by chance is that of a form on its way, and says less than what it leaves when it
    /// was refitted, by which the search keeps it or does not.
    fn on_trial<'b>(&self, order: &[&'b Score]) -> Option<&'b Score> {
        let promises = |s: &Score| s.gain * self.blocks > (1.0 - LEFT_BY_MOVED) * self.total && s.p < NEAR;
        let is_tried = |s: &&&Score| self.offers[s.index].moved && promises(s) && self.stands(s) && !self.feeds(s);
        order.first().filter(is_tried).copied()
    }

    /// A candidate as the choice.
    fn choice(&self, s: &Score, order: &[&Score], twins: Vec<String>) -> Choice {
        let next = order.iter().find(|o| self.name(o) != self.name(s));
        Choice {
            index: s.index,
            fit: s.fit.clone(),
            p_value: s.p,
            share: self.share(s),
            twins,
            runner_up: next.map(|o| (self.name(o).to_owned(), self.share(o))),
        }
    }
}

/// What some offers are judged by beside one another, by their numbers; none where pairs are not
/// looked for.
pub(super) type Together<'a> = dyn Fn(&[usize]) -> Option<Box<dyn Evidence>> + 'a;

/// What is told of a step beside what was chosen.
#[derive(Default)]
pub(super) struct Audit {
    /// Every candidate in its best form.
    pub(super) ranking: Vec<Ranked>,
    /// Why those that were close are not taken.
    pub(super) refused: Vec<Refused>,
    /// Where nothing is: strengths from which on each candidate would have been named.
    pub(super) limits: Vec<(usize, DVector<f64>)>,
}

/// The next effect; none where no candidate is supported. `feigned_by_sensors` says whether the
/// sensors alone give such strengths, for `together` see [`Together`].
pub(super) fn choose(
    selection: &Selection<'_>,
    step: usize,
    audit: &mut Audit,
    feigned_by_sensors: &dyn Fn(usize, &Fit) -> bool,
    together: &Together<'_>,
) -> Option<Choice> {
    let offers = selection.offers;
    let field = Field::new(selection)?;
    let (total, blocks) = (field.total, field.blocks);
    let (best, likelihood) = field.best();
    let mut order: Vec<&Score> = best.values().copied().collect();
    order.sort_by(|a, b| {
        let j = |s: &Score| likelihood.get(&s.index).copied().unwrap_or(f64::INFINITY);
        j(a).total_cmp(&j(b)).then(b.gain.total_cmp(&a.gain))
    });
    audit.ranking.extend(order.iter().map(|s| Ranked {
        name: field.name(s).to_owned(),
        gain: s.gain * blocks / total,
        deviations: s.deviations,
        p_value: s.p,
        step,
    }));
    // Of those within a standard error of the best, the simplest (Breiman et al. 1984, the
    // one-standard-error rule).
    let complexity = |s: &Score| {
        let o = &offers[s.index];
        o.strengths + o.shapes
    };
    let mut feigned: Vec<usize> = Vec::new();
    let winner = loop {
        let significant = |s: &Score| field.is_significant(s, &feigned);
        let Some(strongest) = order.iter().find(|s| significant(s)) else { break None };
        // Once something is, the others need not be clear of all that were tried by themselves.
        let within = order.iter().filter(|s| field.is_supported(s, &feigned, NEARLY)).filter(|s| {
            let (mean, error) = ranking::gain(&s.fit.held_out, &strongest.fit.held_out);
            mean <= error || mean * blocks < field.evidence.least_apart()
        });
        // A refinement is not named where what it refines does as well.
        let within: Vec<&&Score> = within.collect();
        let simpler = |s: &&&&Score| {
            let refined = offers[s.index].refines.as_deref();
            !within.iter().any(|o| Some(field.name(o)) == refined)
        };
        let Some(winner) = within.iter().filter(simpler).min_by_key(|s| complexity(s)).copied() else { break None };
        // Of those that are one and the same beside the model, or of which the noise makes the
        // difference, the first of the catalogue: its laws are in the order of how common they are.
        let same = order.iter().filter(|s| significant(s) && complexity(s) == complexity(winner));
        let rounding = (EXACT * winner.gain).max(ONE_NOISE * field.evidence.least_apart() / blocks);
        let same = same.filter(|s| (s.gain - winner.gain).abs() < rounding).min_by_key(|s| s.index);
        let winner = same.unwrap_or(winner);
        // What is overwhelming is no artefact of the sensors.
        let small = winner.gain * blocks < STRONG * total;
        if !(small && feigned_by_sensors(winner.index, &winner.fit)) {
            break Some(*winner);
        }
        feigned.push(winner.index);
    };
    audit.refused = field.refusals(&order, &feigned);
    if winner.is_none() {
        let feigned = |s: &Score| feigned_by_sensors(s.index, &s.fit);
        audit.refused.extend(field.with_the_other_sign(&order, &feigned));
    }
    let trial = field.on_trial(&order).filter(|s| winner.is_none_or(|w| w.index != s.index));
    if let Some(strongest) = trial {
        // What is not told from a form on its way may be told from it in the end.
        return Some(field.choice(strongest, &order, Vec::new()));
    }
    let Some(winner) = winner else {
        audit.limits = field.detection_limits();
        let indices: Vec<usize> = order.iter().map(|s| s.index).collect();
        let (first, p_value) = field.pair(&order, &*together(&indices)?)?;
        return Some(Choice { p_value, ..field.choice(first, &order, Vec::new()) });
    };
    let twins: Vec<String> = order
        .iter()
        .filter(|s| field.name(s) != field.name(winner) && field.is_supported(s, &feigned, NEARLY))
        .filter(|s| {
            let (mean, error) = ranking::gain(&s.fit.held_out, &winner.fit.held_out);
            let worse = match (likelihood.get(&s.index), likelihood.get(&winner.index)) {
                (Some(a), Some(b)) => a - b,
                _ => f64::INFINITY,
            };
            let is_alike = mean < ALIKE * winner.gain || mean * blocks < field.evidence.least_apart();
            mean < 2.0 * error || worse < CLOSE || is_alike
        })
        .map(|s| field.name(s).to_owned())
        .collect();
    Some(field.choice(winner, &order, twins))
}

//! A round of an explanation: the model with what was chosen fitted, and the columns of every candidate beside it.
//!
//! Where the model can be integrated and follows its record, columns are those of trajectories ([`super::trajectories`]), all equations
//! together; otherwise those of the weak form, equation by equation.

use std::collections::BTreeMap;

use nalgebra::DVector;

use super::candidates::Candidate;
use super::fit::{Blocks, Held};
use super::signs::Signs;
use super::trajectories::Trajectories;
use super::{Setting, singular};
use crate::error::Result;
use crate::explain::ranking::Fit;
use crate::identify::general;
use crate::identify::general::noise::Remeasured;
use crate::identify::general::per_record::Split;
use crate::identify::general::series::System;
use crate::identify::windows::{WindowRows, rows_of};
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::model::model_file::expression::Node;
use crate::model::model_file::weak_form::{Column, WeakForm};

/// Standard errors by which a coefficient must have its sign in the first fit to keep it.
const CLEAR: f64 = 2.0;

/// Columns that are fitted together: the model's own, then what was chosen, then every candidate.
pub struct Group {
    /// The model's own coefficients.
    pub names: Vec<String>,
    /// Fit of these and what was chosen.
    pub own: Held,
    /// Sign of every column; 0 for either.
    pub signs: Vec<f64>,
    /// Blocks.
    pub blocks: Blocks,
}

/// The fit of one step.
pub struct Round {
    /// One for each equation, or one for all.
    pub groups: Vec<Group>,
}

impl Round {
    /// The group in which a candidate's columns stand.
    pub fn group_of(&self, c: &Candidate) -> usize {
        if self.groups.len() == 1 { 0 } else { c.equation }
    }

    /// Sum of squares on blocks that were not fitted.
    pub fn held_out(&self) -> f64 {
        self.groups.iter().flat_map(|g| &g.own.fit.held_out).sum()
    }

    /// Coefficients by name, those of what was chosen by [`column_name`]; of several records the first one's own.
    pub fn coefficients(&self, chosen: &[Candidate], pick: fn(&Fit) -> &DVector<f64>) -> BTreeMap<String, f64> {
        let mut out: BTreeMap<String, f64> = BTreeMap::new();
        let mut behind = Vec::new();
        for g in &self.groups {
            for (n, x) in g.names.iter().zip(pick(&g.own.fit).iter()) {
                out.entry(n.clone()).or_insert(*x);
                if let Some(short) = n.strip_suffix("_1") {
                    out.entry(short.to_owned()).or_insert(*x);
                }
            }
            behind.push(g.names.len());
        }
        for c in chosen {
            let g = self.group_of(c);
            for k in 0..c.columns.len() {
                // What was chosen after this round has no coefficient in it yet.
                if let Some(x) = pick(&self.groups[g].own.fit).get(behind[g]) {
                    out.insert(column_name(c, k), *x);
                }
                behind[g] += 1;
            }
        }
        out
    }
}

/// Name of a column of a candidate in equations of motion: its form, which several candidates of one effect differ by, in it.
pub fn column_name(c: &Candidate, column: usize) -> String {
    match c.shape {
        Some((name, value)) => format!("{} {name}={value:?} {column}", c.name()),
        None => format!("{} {column}", c.name()),
    }
}

/// Terms of candidates for [`EquationsOfMotion::with_columns`].
pub fn terms<'a>(of: impl IntoIterator<Item = &'a Candidate>) -> Vec<(usize, String, Node)> {
    of.into_iter()
        .flat_map(|c| c.columns.iter().enumerate().map(|(k, of)| (c.equation, column_name(c, k), of.clone())))
        .collect()
}

/// Signs that the model's own coefficients keep: those of laws that take energy away, where the first fit shows that they do.
pub fn own_signs(setting: &Setting<'_>, first: &Round) -> BTreeMap<String, f64> {
    let model = &*setting.bound.model;
    let coefficients = first.coefficients(&[], |f| &f.all);
    let omega = setting.rig.omega();
    let signs = Signs::new(model, omega, &|n| coefficients.get(n).copied().unwrap_or(0.0));
    let mut out = BTreeMap::new();
    for g in &first.groups {
        for (i, name) in g.names.iter().enumerate() {
            let short = name.rsplit_once('_').map_or(name.as_str(), |(s, _)| s);
            let known = model.coefficients().contains(name);
            let sign = signs.of_term(model, omega, if known { name } else { short });
            let error = g.own.fit.covariance[(i, i)].max(0.0).sqrt();
            if sign * g.own.fit.all[i] > CLEAR * error {
                out.insert(name.clone(), sign);
            }
        }
    }
    out
}

/// Signs of all columns of a group.
fn group_signs<'a>(
    setting: &Setting<'_>,
    names: &[String],
    own: &BTreeMap<String, f64>,
    coefficients: &BTreeMap<String, f64>,
    further: impl Iterator<Item = &'a Candidate>,
) -> Vec<f64> {
    let model = &*setting.bound.model;
    let signs = Signs::new(model, setting.rig.omega(), &|n| coefficients.get(n).copied().unwrap_or(0.0));
    let mut out: Vec<f64> = names.iter().map(|n| own.get(n).copied().unwrap_or(0.0)).collect();
    for c in further {
        out.extend(std::iter::repeat_n(signs.of_candidate(model, c), c.columns.len()));
    }
    out
}

/// Signs of coefficients by name, those of what was chosen by [`column_name`].
pub fn signs_of(
    setting: &Setting<'_>,
    own: &BTreeMap<String, f64>,
    round: &Round,
    chosen: &[Candidate],
    names: &[String],
) -> Vec<f64> {
    let model = &*setting.bound.model;
    let coefficients = round.coefficients(chosen, |f| &f.all);
    let signs = Signs::new(model, setting.rig.omega(), &|n| coefficients.get(n).copied().unwrap_or(0.0));
    let mut by_name = own.clone();
    for c in chosen {
        for k in 0..c.columns.len() {
            by_name.insert(column_name(c, k), signs.of_candidate(model, c));
        }
    }
    names.iter().map(|n| by_name.get(n).copied().unwrap_or(0.0)).collect()
}

/// The round by trajectories from the coefficients `start`, by name (those that are not in it start from nothing); none where they cannot be
/// followed with what was chosen.
pub fn by_trajectories(
    setting: &Setting<'_>,
    trajectories: &mut Trajectories<'_>,
    own: &BTreeMap<String, f64>,
    start: &BTreeMap<String, f64>,
    chosen: &[Candidate],
    all: &[Candidate],
) -> Option<Round> {
    let model = &*setting.bound.model;
    let omega = setting.rig.omega();
    let names = trajectories.columns.names.clone();
    let further = terms(chosen);
    let mut x: Vec<f64> =
        names.iter().chain(further.iter().map(|t| &t.1)).map(|n| start.get(n).copied().unwrap_or(0.0)).collect();
    let motion = EquationsOfMotion::with_columns(model, omega, &further).ok()?;
    let signs = group_signs(setting, &names, own, start, chosen.iter().chain(all));
    x = trajectories.settle(&motion, further.len(), x.clone(), &signs[..x.len()])?;
    let every = terms(chosen.iter().chain(all));
    let motion = EquationsOfMotion::with_columns(model, omega, &every).ok()?;
    let mine = x.len();
    x.resize(names.len() + every.len(), 0.0);
    let blocks = Blocks::of(trajectories.grams(&motion, every.len(), &x)?);
    let columns: Vec<usize> = (0..mine).collect();
    let own = blocks.fit(&columns, &signs[..mine])?;
    Some(Round { groups: vec![Group { names, own, signs, blocks }] })
}

/// The round by the weak form.
///
/// # Errors
/// Equations that the record does not determine.
pub fn by_weak_form(
    setting: &Setting<'_>,
    own_signs: &BTreeMap<String, f64>,
    before: Option<&Round>,
    chosen: &[Candidate],
    all: &[Candidate],
) -> Result<Round> {
    let model = &*setting.bound.model;
    let omega = setting.rig.omega();
    let mut extra: Vec<Vec<Column>> = vec![Vec::new(); model.equations.len()];
    for c in chosen.iter().chain(all) {
        for (k, of) in c.columns.iter().enumerate() {
            extra[c.equation].push(Column { name: column_name(c, k), of: of.clone() });
        }
    }
    let own_weak = WeakForm::new(model, omega, &[])?;
    let weak = WeakForm::new(model, omega, &extra)?;
    let kernels = &setting.geometry.kernels;
    let windows = &setting.geometry.windows;
    let rows = |weak: &WeakForm| -> Vec<WindowRows> {
        let system = System { stretches: setting.stretches, weak, kernels, circle: &setting.circle };
        rows_of(&system, &weak.equations, kernels, windows)
    };
    let (mut own_rows, mut rows) = (rows(&own_weak), rows(&weak));
    setting.split.spread(&mut own_rows, setting.record_of);
    let split = setting.split.with_shared(&extra.iter().map(Vec::len).collect::<Vec<_>>());
    split.spread(&mut rows, setting.record_of);
    let own = setting.split.terms();
    let total = split.terms();
    let names = split_names(&setting.split);
    // What is lacking is weighed evenly over the frequencies, beside the sensors' noise.
    let system = System { stretches: setting.stretches, weak: &own_weak, kernels, circle: &setting.circle };
    let again = Remeasured::new(&system, windows, setting.bound, setting.sensors, &setting.split, setting.record_of);
    let given = general::noise_weights(&own_rows, &own, windows.frequencies, &again).map_err(|_| singular())?;
    let coefficients = before.map(|b| b.coefficients(&[], |f| &f.all)).unwrap_or_default();
    let mut groups = Vec::new();
    for e in 0..model.equations.len() {
        let mine: usize = chosen.iter().filter(|c| c.equation == e).map(|c| c.columns.len()).sum();
        let columns: Vec<usize> = (0..own[e] + mine).collect();
        let b = Blocks::new(&rows, e, total[e], &given[e], setting.block_s);
        let here = chosen.iter().chain(all).filter(|c| c.equation == e);
        let signs = group_signs(setting, &names[e], own_signs, &coefficients, here);
        let own = b.fit(&columns, &signs[..columns.len()]).ok_or_else(singular)?;
        groups.push(Group { names: names[e].clone(), own, signs, blocks: b });
    }
    Ok(Round { groups })
}

fn split_names(split: &Split) -> Vec<Vec<String>> {
    let names = split.names();
    let mut at = 0;
    split
        .terms()
        .iter()
        .map(|p| {
            at += p;
            names[at - p..at].to_vec()
        })
        .collect()
}

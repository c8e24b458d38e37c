//! An identified model of the double pendulum with its effects, as equations that can be integrated.
//!
//! An effect of strength k adds k f to the left-hand side of equation i: φ̈ changes by −M⁻¹ Ω² k f, M the mass matrix. Effects that act on sensors or let the drive run away
//! change what is recorded, not the motion: they are named and left out.

use crate::error::{BadInput, Result};
use crate::explain::effects::{Action, Context, EFFECTS};
use crate::identify::model_file::double_pendulum;
use crate::model::double_pendulum_dynamics::DoublePendulum;
use crate::model::dynamics::{Dynamics, Instant};
use crate::model::identified::{IdentifiedModel, RECORD_S};
use crate::model::weak::{Sample, Series};
use crate::rig::Rig;

/// The equations of motion of a model file.
pub struct MotionModel {
    /// The nominal equations.
    pub base: DoublePendulum,
    /// Their parameters.
    pub parameters: Vec<f64>,
    /// Additions to the left-hand sides, with their strengths.
    forces: Vec<([Option<Series>; 2], f64)>,
    /// Indices of B11 and B21.
    coupling: [usize; 2],
    /// Effects that do not act on the motion, `ID@PLACE`.
    pub left_out: Vec<String>,
}

impl MotionModel {
    /// The equations of a model on a rig; `span_s`: time of the record's first sample and the record's length. Where the model says on how
    /// long a record its effects were found, a drift goes on at that rate.
    ///
    /// # Errors
    /// A model of another system, parameters or effects that do not belong to it.
    pub fn of(model: &IdentifiedModel, rig: &Rig, span_s: [f64; 2]) -> Result<Self> {
        let (base, parameters) = double_pendulum(model)?;
        let at = |name: &str| base.names().iter().position(|n| n == name).unwrap_or(0);
        let coupling = [at("B11"), at("B21")];
        let b = |i: usize, k: usize| model.parameter(&format!("B{}{}", i + 1, k + 1)).map_or(0.0, |p| p.value);
        let mut known = rig.known.clone();
        for (name, value) in model.found_with.iter().filter(|(name, _)| *name != RECORD_S) {
            known.entry(name.clone()).or_insert(*value);
        }
        let context = Context {
            omega: rig.omega(),
            driven: rig.drive.is_some(),
            b: core::array::from_fn(|i| core::array::from_fn(|k| b(i, k))),
            g: known.get("g").copied().unwrap_or(crate::rig::GRAVITY),
            known,
            relative: rig.channel.iter().any(|c| c.measures == "theta2"),
            span_s: [span_s[0], model.found_with.get(RECORD_S).copied().unwrap_or(span_s[1])],
        };
        let mut forces = Vec::new();
        let mut left_out = Vec::new();
        for (i, e) in model.effects.iter().enumerate() {
            let name = format!("{}@{}", e.id, e.at);
            let bad = |found: String, expected: &str| {
                Err(BadInput::new(found, expected)
                    .at(format!("effect {}", i + 1))
                    .remedy("Write the model anew with `whirl explain -o`"))
            };
            let Some((effect, place)) = EFFECTS
                .iter()
                .find(|k| k.id == e.id)
                .and_then(|k| k.places.iter().find(|p| p.name() == e.at).map(|p| (k, *p)))
            else {
                return bad(format!("\"{name}\""), "an effect of `whirl list effects`");
            };
            let variants = (effect.variants)(&context, place);
            let fits = |v: &&crate::explain::effects::Variant| {
                v.refine.is_some() || v.shape.iter().all(|(s, x)| e.parameters.get(*s) == Some(x))
            };
            let Some(mut variant) = variants.iter().find(fits).cloned() else {
                return bad(format!("\"{name}\" with other parameters"), "an effect that this rig can have");
            };
            if let (Some(refine), Some((form, _))) = (variant.refine, variant.shape.first()) {
                variant = refine(&context, place, e.parameters.get(*form).copied().unwrap_or(e.value));
            }
            match variant.action {
                Action::Force(columns) if columns.len() >= e.strengths.len() => {
                    forces.extend(columns.into_iter().zip(e.strengths.iter().copied()));
                }
                Action::Force(columns) => {
                    return bad(
                        format!("{} strengths of {name}", e.strengths.len()),
                        &format!("{} strengths", columns.len()),
                    );
                }
                _ => left_out.push(name),
            }
        }
        Ok(Self { base, parameters, forces, coupling, left_out })
    }

    /// Whether effects act on the motion beside the nominal equations.
    pub fn has_forces(&self) -> bool {
        !self.forces.is_empty()
    }

    /// Adds the effects' share to accelerations of the nominal equations.
    fn add_forces(&self, p: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) {
        if self.forces.is_empty() {
            return;
        }
        let ((sin1, cos1), (sin2, cos2)) = (q[0].sin_cos(), q[1].sin_cos());
        let (sin_tau, cos_tau) = at.tau.sin_cos();
        let rate = [v[0], v[1]];
        let sample = Sample {
            raw: [q[0], q[1]],
            phi: [q[0], q[1]],
            rate,
            clear_rate: rate,
            clear_step: [0.0; 2],
            turn: [0.0; 2],
            // Loads depend on accelerations weakly: those of the nominal equations do.
            accel: [out[0], out[1]],
            sin: [sin1, sin2],
            cos: [cos1, cos2],
            sin_tau,
            cos_tau,
            time: at.time,
        };
        let mut left = [0.0; 2];
        for (pair, k) in &self.forces {
            for (left, series) in left.iter_mut().zip(pair) {
                if let Some(f) = series {
                    *left += k * f(&sample);
                }
            }
        }
        let square = self.base.omega() * self.base.omega();
        let cos_delta = cos2 * cos1 + sin2 * sin1;
        let m = self.coupling.map(|i| p[i] * cos_delta);
        let determinant = 1.0 - m[0] * m[1];
        out[0] -= square * (left[0] - m[0] * left[1]) / determinant;
        out[1] -= square * (left[1] - m[1] * left[0]) / determinant;
    }
}

impl Dynamics for MotionModel {
    fn degrees_of_freedom(&self) -> usize {
        2
    }

    fn parameter_count(&self) -> usize {
        self.base.parameter_count()
    }

    fn acceleration(&self, p: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, out: &mut [f64]) -> bool {
        let good = self.base.acceleration(p, q, v, at, out);
        self.add_forces(p, q, v, at, out);
        good && out[0].is_finite() && out[1].is_finite()
    }

    fn switches(&self) -> &[Vec<f64>] {
        self.base.switches()
    }

    fn acceleration_held(&self, p: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, s: &[f64], out: &mut [f64]) -> bool {
        let good = self.base.acceleration_held(p, q, v, at, s, out);
        self.add_forces(p, q, v, at, out);
        good && out[0].is_finite() && out[1].is_finite()
    }

    fn partials_held(&self, p: &[f64], q: &[f64], v: &[f64], at: &Instant<'_>, s: &[f64], out: &mut [f64]) -> bool {
        if !self.base.partials_held(p, q, v, at, s, out) {
            return false;
        }
        if self.forces.is_empty() {
            return true;
        }
        // The effects' share by central differences over the state; parameters enter it through the mass matrix alone.
        let width = 4 + p.len();
        let mut x = [q[0], q[1], v[0], v[1]];
        for k in 0..4 {
            let step = 1e-6 * if k < 2 { 1.0 } else { x[k].abs().max(1.0) };
            let mut ends = [[0.0; 2]; 2];
            for (end, sign) in ends.iter_mut().zip([1.0, -1.0]) {
                let kept = x[k];
                x[k] += sign * step;
                let mut plain = [0.0; 2];
                if !self.base.acceleration_held(p, &x[..2], &x[2..], at, s, &mut plain) {
                    return false;
                }
                *end = plain;
                self.add_forces(p, &x[..2], &x[2..], at, end);
                end.iter_mut().zip(plain).for_each(|(e, p)| *e -= p);
                x[k] = kept;
            }
            for i in 0..2 {
                out[i * width + k] += (ends[0][i] - ends[1][i]) / (2.0 * step);
            }
        }
        true
    }

    fn linearise_held(
        &self,
        p: &[f64],
        q: &[f64],
        v: &[f64],
        at: &Instant<'_>,
        signs: &[f64],
        acceleration: &mut [f64],
        partials: &mut [f64],
    ) -> bool {
        if self.forces.is_empty() {
            return self.base.linearise_held(p, q, v, at, signs, acceleration, partials);
        }
        self.acceleration_held(p, q, v, at, signs, acceleration) && self.partials_held(p, q, v, at, signs, partials)
    }
}

//! The built-in systems as what the one identification takes: their equations written out, and what
//! is told beside the coefficients.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use super::system::System;
use super::{Parameter, physical};
use crate::error::{BadInput, Result};
use crate::model::double_pendulum_dynamics::DoublePendulum;
use crate::model::dynamics::Dynamics;
use crate::model::model_file::equations_of_motion::EquationsOfMotion;
use crate::rig::measures::ObservedModel;
use crate::rig::{Rig, as_own};
use crate::system::library::Pendulum;
use crate::system::ties::Identified;
use crate::warning::Warning;

/// A rig with equations: itself, or that of a built-in system with them written out.
///
/// # Errors
/// A model that there is not, dampings that it does not have, channels that do not measure its
/// angles.
pub fn written(rig: &Rig) -> Result<Cow<'_, Rig>> {
    if rig.bound.is_some() {
        return Ok(Cow::Borrowed(rig));
    }
    let system = System::of(rig)?;
    let own = match system.pendulum {
        Pendulum::Single => as_own::single_pendulum(rig, &system.coefficients(), true)?,
        Pendulum::Double => as_own::double_pendulum(rig, &system.dampings)?,
    };
    Ok(Cow::Owned(own))
}

/// A rig beside itself with its equations written out, as [`written`] and [`bound`] give them.
#[derive(Clone, Copy)]
pub struct WrittenRig<'a> {
    /// The rig file's.
    pub rig: &'a Rig,
    /// With equations.
    pub own: &'a Rig,
    /// The equations and what the channels measure of them.
    pub bound: &'a ObservedModel,
}

/// The equations and channels of a rig that [`written`] gave.
///
/// # Errors
/// A rig without equations.
pub fn bound(rig: &Rig) -> Result<&ObservedModel> {
    rig.bound.as_deref().ok_or_else(|| {
        BadInput::new(format!("\"{}\"", rig.model), "a model that has equations")
            .in_file(&rig.path)
            .at("model")
            .remedy("`whirl list models` shows the models")
    })
}

/// A rig's equations of motion, `own` being the rig with them written out, and the names of their
/// coefficients. Those of the built-in double pendulum are compiled by hand, but where its base is
/// measured.
///
/// # Errors
/// Equations that cannot be integrated.
pub fn equations_of_motion(rig: &Rig, own: &Rig, bound: &ObservedModel) -> Result<(Box<dyn Dynamics>, Vec<String>)> {
    if rig.bound.is_none()
        && rig.base().is_none()
        && let System { pendulum: Pendulum::Double, dampings } = System::of(rig)?
    {
        let compiled = DoublePendulum::new(rig.omega(), rig.drive.is_some(), &dampings);
        let names = compiled.names().to_vec();
        return Ok((Box::new(compiled), names));
    }
    let written = EquationsOfMotion::new(&bound.model, own.omega())?;
    let names = written.coefficients().to_vec();
    Ok((Box::new(written), names))
}

/// Coefficients with standard errors as they are told, and behind them what follows from them and
/// `[known]`; the ties' misfit with its degrees of freedom, where there are any. A built-in
/// system's are ordered by name, B_i5 = √(B_i3² + B_i4²) among them.
pub fn parameters(
    rig: &Rig,
    identified: &Identified<'_>,
    units: &[String],
    warnings: &mut Vec<Warning>,
) -> (Vec<Parameter>, Option<(f64, usize)>) {
    let Identified { names, values, covariance, .. } = *identified;
    let parameter = |i: usize| Parameter {
        name: names[i].clone(),
        value: values[i],
        std_error: covariance[(i, i)].max(0.0).sqrt(),
        unit: units[i].clone(),
    };
    let mut out: Vec<Parameter> = (0..names.len()).map(parameter).collect();
    if let Some(bound) = &rig.bound {
        let misfit = physical::add(rig, &bound.model, identified, &mut out, warnings);
        return (out, misfit);
    }
    out.extend(drive_amplitudes(names, values, covariance));
    out.sort_by(|a, b| a.name.cmp(&b.name));
    let fit = System::of(rig).ok().and_then(|s| s.physical(identified, rig));
    let Some(fit) = fit else { return (out, None) };
    out.extend(fit.parameters.iter().map(|p| Parameter {
        name: p.name.to_owned(),
        value: p.value,
        std_error: p.std_error,
        unit: p.unit.to_owned(),
    }));
    if !fit.undetermined.is_empty() {
        warnings.push(Warning::new(
            physical::OPEN,
            format!("the known quantities leave {} open", fit.undetermined.join(", ")),
            "Put what you weighed or measured (a mass, a length, an amplitude) into the rig file, under [known]",
        ));
    }
    (out, (fit.freedom > 0).then_some((fit.misfit, fit.freedom)))
}

/// B_i5 of each equation that has a drive.
fn drive_amplitudes<'a>(
    names: &'a [String],
    values: &'a DVector<f64>,
    covariance: &'a DMatrix<f64>,
) -> impl Iterator<Item = Parameter> + 'a {
    ["1", "2"].into_iter().filter_map(|n| {
        let find = |k: &str| names.iter().position(|x| *x == format!("B{n}{k}"));
        let (c, s) = (find("3")?, find("4")?);
        let (x, y) = (values[c], values[s]);
        let size = x.hypot(y);
        let variance = if size > 0.0 {
            (x * x * covariance[(c, c)] + 2.0 * x * y * covariance[(c, s)] + y * y * covariance[(s, s)]) / (size * size)
        } else {
            covariance[(c, c)].max(covariance[(s, s)])
        };
        let std_error = variance.max(0.0).sqrt();
        Some(Parameter { name: format!("B{n}5"), value: size, std_error, unit: "1".to_owned() })
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::model::double_pendulum::DAMPINGS;
    use crate::model::dynamics::{Here, Instant, Linearisation};

    /// What is compiled by hand moves as the equations that are written out, free and driven, with
    /// every damping; its partials too.
    #[test]
    fn compiled_equations_are_those_written_out() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/chaotic.toml");
        let mut rig = Rig::read(path).unwrap();
        rig.nominal = Some(DAMPINGS.iter().map(|d| d.id.to_owned()).collect());
        for driven in [true, false] {
            if !driven {
                rig.drive = None;
            }
            let own = written(&rig).unwrap();
            let bound = bound(&own).unwrap();
            let (compiled, names) = equations_of_motion(&rig, &own, bound).unwrap();
            let (plain, same) = equations_of_motion(&own, &own, bound).unwrap();
            assert_eq!(names, same);
            let p: Vec<f64> = (0..names.len()).map(|k| 0.1 + 0.03 * k as f64).collect();
            let width = 4 + p.len();
            let mut seed = 5_u32;
            let mut random = move || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
            };
            for _ in 0..200 {
                let (q, v) = ([9.0 * random(), 9.0 * random()], [60.0 * random(), 60.0 * random()]);
                let at = Instant { time: 0.0, tau: 9.0 * random(), inputs: &[] };
                // A joint's sign may stand for either sense of turning.
                assert_eq!(compiled.switches().len(), plain.switches().len());
                let run = |d: &dyn Dynamics| {
                    let signs: Vec<f64> = d.switches().iter().map(|s| s.rate(&v, &[]).signum()).collect();
                    let (mut a, mut by) = ([0.0; 2], vec![0.0; 2 * width]);
                    let out = Linearisation { acceleration: &mut a, partials: &mut by };
                    assert!(d.linearise_held(Here { parameters: &p, q: &q, v: &v, at: &at, signs: &signs }, out));
                    a.into_iter().chain(by).collect::<Vec<f64>>()
                };
                for (a, b) in run(&*compiled).iter().zip(run(&*plain)) {
                    assert!((a - b).abs() <= 1e-10 * (1.0 + b.abs()) * rig.omega(), "{driven} {a} {b}");
                }
            }
        }
    }
}

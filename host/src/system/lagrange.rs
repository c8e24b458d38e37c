//! Lagrange's equations, product of parameters by product: E_e = d/dt ∂T/∂q_e′ − ∂T/∂q_e +
//! ∂V/∂q_e − Q_e = 0.
//!
//! T and V come from the bodies and the file's own energies, Q_e = Σ value ∂(does_work_on)/∂q_e
//! from its forces and the nominal effects.

use std::collections::BTreeMap;

use super::derivative::{NoDerivative, by_time, partial};
use super::joints::Nominal;
use super::language::{Placed, SystemFile};
use super::polynomial::{Atom, Polynomial, Product};
use crate::error::{BadInput, Result};
use crate::model::model_file::expression::Symbol;

/// What a product of parameters multiplies in an equation.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Parameters with their powers; empty for what is known.
    pub product: Product,
    /// Expression of the motion, accelerations included.
    pub of: Polynomial,
    /// Its share of the equation's own inertia, ∂²T/∂q_e′².
    pub inertia: Polynomial,
}

/// Equation e: Σ product × column = 0.
pub type Equation = Vec<Column>;

/// The message for something without a derivative.
pub fn without(file: &SystemFile, at: usize, e: NoDerivative) -> BadInput {
    let bad = |found: String, expected: &str, remedy: &str| file.source.bad(at, found, expected).remedy(remedy);
    match e {
        NoDerivative::Jumps => bad(
            "a jump (sign, or abs twice differentiated)".to_owned(),
            "smooth energies and points",
            "Friction is a force: write it under [[force]] or as a nominal effect",
        ),
        NoDerivative::Input(k) => bad(
            format!("the measured input {} in a motion", file.words.inputs[k]),
            "inputs in forces",
            "A drive of known frequency is a_c*cos(tau) + a_s*sin(tau) in a point. For a base whose motion is measured count the points from the base and make its acceleration an input named base, a force on each body, as `whirl list models --show double-pendulum-measured-base` does; its channel has measures = \"base\"",
        ),
        NoDerivative::TooLarge => bad(
            "an energy that multiplies out to too many products".to_owned(),
            "a simpler mechanism",
            "Choose coordinates or points in which it is shorter",
        ),
    }
}

/// T and V of the whole system.
fn energies(file: &SystemFile, omega: f64) -> Result<(Polynomial, Polynomial)> {
    let g = file.gravity_strength();
    let (mut kinetic, mut potential) = (Polynomial::default(), Polynomial::default());
    for body in &file.bodies {
        let (t, v) = body
            .value
            .energies(file.coordinates.len(), omega, file.gravity.as_ref(), &g)
            .map_err(|e| without(file, body.at, e))?;
        (kinetic, potential) = (kinetic.plus(&t), potential.plus(&v));
    }
    if let Some(t) = &file.kinetic {
        kinetic = kinetic.plus(&t.value);
    }
    if let Some(v) = &file.potential {
        if v.value.moves(|s| matches!(s, Symbol::Rate(_))) {
            return Err(file
                .source
                .bad(v.at, "a rate in the potential energy", "coordinates, inputs and tau")
                .remedy("Velocities belong to kinetic, friction to [[force]]"));
        }
        potential = potential.plus(&v.value);
    }
    Ok((kinetic, potential))
}

/// All equations, one for each coordinate; an equation without columns is that of a coordinate that
/// only written equations hold.
///
/// # Errors
/// Energies that have no derivative, with their place.
pub fn equations(file: &SystemFile, nominal: &[Nominal], omega: f64) -> Result<Vec<Equation>> {
    let n = file.coordinates.len();
    let (kinetic, potential) = energies(file, omega)?;
    let at = file.kinetic.as_ref().or(file.potential.as_ref()).map_or(0, |p| p.at);
    let strengths = file.parameters.len();
    let mut work: Vec<(Polynomial, &Placed<Polynomial>)> =
        file.forces.iter().map(|f| (f.value.value.clone(), &f.does_work_on)).collect();
    for (k, effect) in nominal.iter().enumerate() {
        let moves = effect.moves(file);
        let column = effect.column(file, omega).map_err(|e| without(file, moves.at, e))?;
        let strength = Polynomial::atom(Atom::Parameter(strengths + k));
        work.push((strength.times(&column).map_err(|e| without(file, moves.at, e.into()))?, moves));
    }
    (0..n)
        .map(|e| {
            let (whole, inertia) = conservative(&kinetic, &potential, e, n, omega).map_err(|x| without(file, at, x))?;
            let mut whole = whole;
            for (value, moves) in &work {
                let along = partial(&moves.value, &Atom::Motion(Symbol::Coordinate(e)));
                let force = along.and_then(|d| Ok(value.times(&d)?)).map_err(|x| without(file, moves.at, x))?;
                whole = whole.minus(&force);
            }
            let mut inertia: BTreeMap<Product, Polynomial> = inertia.by_parameters();
            Ok(whole
                .by_parameters()
                .into_iter()
                .map(|(product, of)| Column { inertia: inertia.remove(&product).unwrap_or_default(), product, of })
                .collect())
        })
        .collect()
}

/// d/dt ∂T/∂q_e′ − ∂T/∂q_e + ∂V/∂q_e, and ∂²T/∂q_e′².
fn conservative(
    kinetic: &Polynomial,
    potential: &Polynomial,
    e: usize,
    coordinates: usize,
    omega: f64,
) -> core::result::Result<(Polynomial, Polynomial), NoDerivative> {
    let (q, v) = (Atom::Motion(Symbol::Coordinate(e)), Atom::Motion(Symbol::Rate(e)));
    let momentum = partial(kinetic, &v)?;
    let rate = by_time(&momentum, coordinates, omega)?;
    let whole = rate.minus(&partial(kinetic, &q)?).plus(&partial(potential, &q)?);
    Ok((whole, partial(&momentum, &v)?))
}

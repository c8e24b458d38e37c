//! A system file's equations as a model file: each equation over its own inertia, or equal to what
//! is known of it.
//!
//! Products of parameters that share an expression are one coefficient
//! ([`super::base_parameters`]); a record determines their ratios. What they are divided by is the
//! equation's inertia, its constant part where it varies; an equation that holds a measured input
//! without an unknown factor has a scale of its own and is not divided. The model file is written
//! as text, read by the reader of model files, so that it is one in every respect: what is
//! identified is saved with its equations.

use std::fmt::Write;
use std::sync::Arc;

use super::base_parameters::{Base, collect};
use super::joints::Nominal;
use super::lagrange::{self, Column, Equation};
use super::language::{SystemFile, is_system};
use super::mechanism::{Coefficient, Mechanism, Named, unused};
use super::polynomial::{Atom, Polynomial, Product};
use crate::error::{BadInput, Result};
use crate::model::model_file::expression::{FUNCTIONS, Symbol};
use crate::model::model_file::toml_place::{MODEL_PAGE, Source};
use crate::model::model_file::units::Unit;
use crate::model::model_file::{Coordinate, ModelFile, Space};
use crate::wording::toml_words;

/// An expression of the motion as the text that model files hold.
pub fn text_of(p: &Polynomial, coordinates: &[String], inputs: &[String]) -> String {
    let rec = |p: &Polynomial| text_of(p, coordinates, inputs);
    let mut out = String::new();
    for (product, c) in p.terms() {
        let mut factors: Vec<String> = Vec::new();
        if c.abs() != 1.0 || product.is_empty() {
            factors.push(format!("{:?}", c.abs()));
        }
        for (a, n) in product {
            let base = match a {
                Atom::Motion(Symbol::Coordinate(i)) => coordinates[*i].clone(),
                Atom::Motion(Symbol::Rate(i)) => format!("{}'", coordinates[*i]),
                Atom::Motion(Symbol::Acceleration(i)) => format!("{}''", coordinates[*i]),
                Atom::Motion(Symbol::Input(k)) => inputs[*k].clone(),
                Atom::Motion(_) => "tau".to_owned(),
                Atom::Call(f, p) => {
                    let name = FUNCTIONS.iter().find(|x| x.1 == *f).map_or("", |x| x.0);
                    format!("{name}({})", rec(p))
                }
                Atom::Sum(p) => format!("({})", rec(p)),
                Atom::Power(a, b) => format!("({})^({})", rec(a), rec(b)),
                // Refused where equations are made.
                Atom::Parameter(_) | Atom::Atan2(..) => "0".to_owned(),
            };
            factors.push(if *n == 1 { base } else { format!("{base}^{n}") });
        }
        match (out.is_empty(), c < 0.0) {
            (true, false) => {}
            (true, true) => out.push('-'),
            (false, negative) => out.push_str(if negative { " - " } else { " + " }),
        }
        out.push_str(&factors.join("*"));
    }
    if out.is_empty() { "0".to_owned() } else { out }
}

/// The equation of coordinate `e` with what multiplies its own acceleration alone in columns of its
/// own, where there are several such: with lengths that are numbers a mass multiplies its inertia
/// and its coupling alike, and an equation divided by a part of its inertia would have the rest of
/// it, times the acceleration, as a column beside what it is held against.
fn with_whole_inertia(equation: Equation, e: usize) -> Equation {
    let constant = |c: &Column| c.inertia.as_number().filter(|x| *x != 0.0);
    if equation.iter().filter(|c| constant(c).is_some()).count() < 2 {
        return equation;
    }
    let acceleration = Polynomial::motion(Symbol::Acceleration(e));
    let parts = |c: Column| -> Vec<Column> {
        let Some(inertia) = constant(&c) else { return vec![c] };
        let own = acceleration.scaled(inertia);
        let rest = c.of.minus(&own);
        if rest.is_zero() {
            return vec![c];
        }
        let rest = Column { product: c.product.clone(), of: rest, inertia: Polynomial::default() };
        vec![Column { of: own, ..c }, rest]
    };
    equation.into_iter().flat_map(parts).collect()
}

/// Columns in the order in which they are kept: a known input, then inertia (constant before
/// varying), then short products.
fn preferred(mut equation: Equation) -> Equation {
    let rank = |c: &Column| {
        let scale = c.product.is_empty() && c.of.moves(|s| matches!(s, Symbol::Input(_)));
        let degree: i32 = c.product.iter().map(|(_, n)| n.abs()).sum();
        let inertia = match c.inertia.as_number() {
            Some(0.0) => 2,
            Some(_) => 0,
            None => 1,
        };
        (!scale, inertia, degree)
    };
    equation.sort_by_key(rank);
    equation
}

/// Name of a coefficient: its coordinate and its product.
fn name_of(coordinate: &str, product: &Product, parameters: &[Named], taken: &[String]) -> String {
    let mut name = coordinate.to_owned();
    for (a, n) in product {
        if let Atom::Parameter(k) = a {
            let plain: String =
                parameters[*k].name.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
            let power = match n {
                1 => String::new(),
                n if *n > 0 => n.to_string(),
                n => format!("_per{}", -n),
            };
            let _ = write!(name, "_{plain}{power}"); // writing into a string cannot fail
        }
    }
    if product.is_empty() {
        name.push_str("_known");
    }
    // Names are at most 64 characters long.
    let mut name: String = name.chars().take(60).collect();
    let mut k = 2;
    let plain = name.clone();
    while taken.contains(&name) {
        name = format!("{plain}_{k}");
        k += 1;
    }
    name
}

/// Parameters of the file and strengths of its nominal effects.
fn named(file: &SystemFile, nominal: &[Nominal]) -> Vec<Named> {
    let positive = |u: &Unit| ["kg", "kg m^2", "m/s^2"].iter().any(|t| Unit::parse(t).as_ref() == Some(u));
    let own = file.parameters.iter().map(|p| Named {
        name: p.name.clone(),
        unit: p.unit.clone(),
        positive: positive(&p.unit),
    });
    own.chain(nominal.iter().map(|n| Named { name: n.name.clone(), unit: n.unit(file), positive: false })).collect()
}

fn nominal(file: &SystemFile, of_rig: Option<&[String]>) -> Result<Vec<Nominal>> {
    let own: Vec<String> = file.nominal.iter().map(|n| n.value.clone()).collect();
    let mut out: Vec<Nominal> = Vec::new();
    for (i, text) in of_rig.unwrap_or(&own).iter().enumerate() {
        let wrong = |found: String, expected: String| {
            let error = match of_rig {
                Some(_) => BadInput::new(found, expected).at("nominal.effects"),
                None => file.source.bad(file.nominal[i].at, found, expected),
            };
            error.remedy("Correct the nominal model's effects")
        };
        let found = Nominal::find(file, text).map_err(|(f, e)| wrong(f, e))?;
        if out.contains(&found) {
            return Err(wrong(format!("\"{text}\" a second time"), "each effect once".to_owned()));
        }
        out.push(found);
    }
    Ok(out)
}

/// What is written of an equation, and its coefficients.
struct Written {
    text: String,
    scale: Polynomial,
    coefficients: Vec<Coefficient>,
}

/// One equation over its own inertia; none where nothing is in it.
fn written(
    file: &SystemFile,
    e: usize,
    equation: Equation,
    parameters: &[Named],
    taken: &[String],
) -> Result<Option<Written>> {
    if equation.is_empty() {
        return Ok(None);
    }
    let coordinate = &file.words.coordinates[e];
    let bad = |found: String, expected: &str, remedy: &str| {
        let at = file.kinetic.as_ref().map(|k| k.at).or(file.bodies.first().map(|b| b.at)).unwrap_or(0);
        Err(file.source.bad(at, found, expected).remedy(remedy))
    };
    let mut base = collect(&preferred(with_whole_inertia(equation, e))).into_iter();
    let Some(first) = base.next() else { return Ok(None) };
    if !first.of.moves(|s| matches!(s, Symbol::Acceleration(_) | Symbol::Input(_))) {
        return bad(
            format!("no inertia of {coordinate}"),
            "a mass or inertia that moves with every coordinate",
            "Give a body mass or inertia that this coordinate moves, or write its [[equation]]",
        );
    }
    let scale_known = first.sum.as_number().is_some();
    let show = |p: &Polynomial| text_of(p, &file.words.coordinates, &file.words.inputs);
    let mut out = Written {
        scale: first.sum.clone(),
        text: format!("\n[[equation]]\nbalance = \"{}\"\n[equation.terms]\n", show(&first.of.scaled(-1.0))),
        coefficients: Vec::new(),
    };
    let mut names = taken.to_vec();
    for Base { product, sum, of } in base {
        let name = name_of(coordinate, &product, parameters, &names);
        names.push(name.clone());
        let (numerator, denominator) = if scale_known {
            let size = first.sum.as_number().unwrap_or(1.0);
            (sum.scaled(1.0 / size), Polynomial::number(1.0))
        } else {
            (sum, first.sum.clone())
        };
        let _ = writeln!(out.text, "{name} = \"{}\"", show(&of)); // writing into a string cannot fail
        out.coefficients.push(Coefficient { name, numerator, denominator });
    }
    if out.coefficients.is_empty() {
        return bad(
            format!("nothing unknown in the equation of {coordinate}"),
            "a parameter that a record can determine",
            "Declare what is to be found under parameters, or add a nominal effect",
        );
    }
    Ok(Some(out))
}

/// The written equations of a file, as text.
fn own_equations(file: &SystemFile) -> Result<String> {
    let mut out = String::new();
    if !file.written {
        return Ok(out);
    }
    let table: toml::Table = toml::from_str(&file.source.text)
        .map_err(|e| toml_words::told(&e, &file.source.text, "a system file", MODEL_PAGE).in_file(&file.source.path))?;
    for equation in table.get("equation").and_then(toml::Value::as_array).into_iter().flatten() {
        out.push_str("\n[[equation]]\n");
        for (k, v) in equation.as_table().into_iter().flatten() {
            let _ = writeln!(out, "{k} = {v}"); // writing into a string cannot fail
        }
    }
    Ok(out)
}

/// The head of the model file: name, coordinates, inputs, time.
fn head(file: &SystemFile, time: Option<&str>) -> String {
    let coordinates: Vec<String> = file
        .coordinates
        .iter()
        .map(|(c, _)| {
            let space = if c.space == Space::Circle { "S1" } else { "R" };
            format!("{{ name = \"{}\", space = \"{space}\" }}", c.name)
        })
        .collect();
    let inputs: Vec<String> = file.words.inputs.iter().map(|n| format!("\"{n}\"")).collect();
    let name = toml::Value::String(file.name.clone());
    let mut out = format!("name = {name}\ncoordinates = [{}]\n", coordinates.join(", "));
    if !inputs.is_empty() {
        let _ = writeln!(out, "inputs = [{}]", inputs.join(", ")); // writing into a string cannot fail
    }
    if let Some(t) = time {
        let _ = writeln!(out, "time = \"{t}\"");
    }
    out
}

/// Whether a parameter stands anywhere in the file.
fn used(file: &SystemFile, k: usize) -> bool {
    let has = |p: &Polynomial| p.any(&|a| *a == Atom::Parameter(k));
    file.bodies.iter().any(|b| b.value.uses(k))
        || file.kinetic.iter().chain(&file.potential).any(|p| has(&p.value))
        || file.forces.iter().any(|f| has(&f.value.value) || has(&f.does_work_on.value))
        || (file.gravity.is_some() && file.parameters[k].name == "g")
}

/// The written equations alone as a model file, for their mistakes at their own places.
fn check_own(file: &SystemFile) -> Result<()> {
    if !file.written {
        return Ok(());
    }
    let table = file.source.table()?;
    let top = table.get_ref();
    debug_assert!(is_system(top));
    let coordinates: Vec<Coordinate> = file.coordinates.iter().map(|(c, _)| c.clone()).collect();
    ModelFile::equations_of(&file.source, top, table.span(), &coordinates, &file.words.inputs).map(|_| ())
}

/// The model file of a system; `of_rig` are the nominal effects of a rig file that names some.
///
/// # Errors
/// An effect that there is not, a parameter that nothing uses, a coordinate without inertia, an
/// equation without a weak form.
pub fn model(file: &SystemFile, of_rig: Option<&[String]>, omega: f64) -> Result<ModelFile> {
    check_own(file)?;
    let nominal = nominal(file, of_rig)?;
    if let Some(p) = unused(&file.parameters, |k| used(file, k)) {
        return Err(file
            .source
            .bad(p.at, format!("the parameter {}, which nothing uses", p.value), "parameters that take part")
            .remedy("Remove it, or correct the name where it is meant"));
    }
    let parameters = named(file, &nominal);
    let mut text = String::new();
    let (mut coefficients, mut scales): (Vec<Coefficient>, Vec<(usize, Polynomial)>) = (Vec::new(), Vec::new());
    let mut taken: Vec<String> = [&file.words.coordinates[..], &file.words.inputs, &file.words.parameters].concat();
    for (e, equation) in lagrange::equations(file, &nominal, omega)?.into_iter().enumerate() {
        if let Some(w) = written(file, e, equation, &parameters, &taken)? {
            text.push_str(&w.text);
            scales.push((e, w.scale));
            taken.extend(w.coefficients.iter().map(|c| c.name.clone()));
            coefficients.extend(w.coefficients);
        }
    }
    let time = match (&file.time, text.is_empty()) {
        (Some(t), false) if t != "s" => {
            return Err(file
                .source
                .bad(0, format!("time = \"{t}\" beside bodies or energies"), "time = \"s\", or none")
                .remedy("In a system file a prime is d/dt"));
        }
        (_, false) => Some("s"),
        (time, true) => time.as_deref(),
    };
    let whole = format!("{}{text}{}", head(file, time), own_equations(file)?);
    let source = Source { text: whole, path: file.source.path.clone() };
    let mut model = ModelFile::from_source(source).map_err(|e| BadInput {
        place: Some("the equations that follow from the bodies and energies".to_owned()),
        remedy: "Simplify the mechanism, or write its equations as [[equation]]".to_owned(),
        ..e
    })?;
    let quantities = file.quantities.clone();
    model.mechanism = Some(Arc::new(Mechanism {
        parameters,
        coefficients,
        quantities,
        scales,
        file: Some(Arc::new(file.clone())),
        sensors: file.sensors.clone(),
        own_gravity: file.parameters.iter().any(|p| p.name == "g" && p.declared.is_some()),
        apart: Vec::new(),
    }));
    Ok(model)
}

//! A rig of a built-in system as one of a model file, for what works on any system.
//!
//! Channels measure coordinates then: `theta1` is phi1, `theta2` is phi2 − phi1.

use std::fmt::Write;
use std::sync::Arc;

use nalgebra::DMatrix;

use super::measures::ObservedModel;
use super::{Direction, Rig};
use crate::error::{BadInput, Result};
use crate::model::damping::Damping;
use crate::model::model_file::ModelFile;
use crate::model::model_file::toml_place::Source;
use crate::system;
use crate::system::library::{self, Pendulum};

/// The rig of a single pendulum with its equation (2.6) written out: `dampings` by the names of
/// their coefficients (`c_r`, `C11`). With `all`, the terms of a base that moves any way and of a
/// centroid off the arm's line; otherwise those of the rig file's direction and of gravity alone.
///
/// # Errors
/// Channels that do not measure the angle.
pub fn single_pendulum(rig: &Rig, dampings: &[&str], all: bool) -> Result<Rig> {
    let mut terms = Vec::new();
    for d in dampings {
        terms.push(if *d == "c_r" { "c_r = \"phi1'\"" } else { "C11 = \"sign(phi1')\"" });
    }
    // Along the drive a base that is measured takes the place of one that is assumed.
    let base = rig.base().is_some();
    let horizontal = ["n_cos = \"cos(phi1)*cos(tau)\"", "p_cos = \"cos(phi1)*sin(tau)\""];
    let vertical = ["n_sin = \"sin(phi1)*cos(tau)\"", "p_sin = \"sin(phi1)*sin(tau)\""];
    if let Some(drive) = rig.drive {
        for (direction, list) in [(Direction::Horizontal, horizontal), (Direction::Vertical, vertical)] {
            if (all || drive.direction == direction) && !(base && drive.direction == direction) {
                terms.extend(list);
            }
        }
    }
    if base {
        terms.push(match rig.direction() {
            Some(Direction::Horizontal) => "u_cos = \"cos(phi1)*base\"",
            _ => "u_sin = \"sin(phi1)*base\"",
        });
    }
    if all {
        terms.push("q_cos = \"cos(phi1)\"");
    }
    terms.push("q_sin = \"sin(phi1)\"");
    let equation = format!("\n[[equation]]\nbalance = \"-phi1''\"\nterms = {{ {} }}\n", terms.join(", "));
    // Effects act at its joint and its arm, by the built-in's names.
    let names = "coordinates = { phi1 = \"angle\" }\n[[joint]]\nname = \"joint1\"\nmoves = \"phi1\"\n[[body]]\nname = \"arm1\"\nangle = \"phi1\"\n";
    // The base's acceleration along its direction.
    let inputs = if base { "inputs = { base = \"m/s^2\" }\n" } else { "" };
    let text = format!("name = \"{}\"\ntime = \"tau\"\n{inputs}{names}{equation}", rig.model);
    let source = Source { text, path: rig.path.clone() };
    with_model(rig, system::model_of(source, None, rig.omega())?)
}

/// The rig of a double pendulum with its equations (3.4) written out, with some dampings.
///
/// # Errors
/// Channels that do not measure both angles.
pub fn double_pendulum(rig: &Rig, dampings: &[&Damping]) -> Result<Rig> {
    let mut equations = String::new();
    let rates =
        ["phi1''*cos(phi2 - phi1) + phi1'^2*sin(phi2 - phi1)", "phi2''*cos(phi2 - phi1) - phi2'^2*sin(phi2 - phi1)"];
    for (i, other) in rates.into_iter().rev().enumerate() {
        let n = i + 1;
        let mut terms = vec![format!("B{n}1 = \"{other}\""), format!("B{n}2 = \"sin(phi{n})\"")];
        if rig.base().is_some() {
            terms.push(format!("B{n}6 = \"sin(phi{n})*base\""));
        } else if rig.drive.is_some() {
            terms.push(format!("B{n}3 = \"sin(phi{n})*cos(tau)\""));
            terms.push(format!("B{n}4 = \"sin(phi{n})*sin(tau)\""));
        }
        for damping in dampings {
            let Some(name) = damping.names[i] else { continue };
            let velocity = match (damping.id.ends_with("joint2"), i) {
                (false, _) => "phi1'",
                (true, 0) => "phi1' - phi2'",
                (true, _) => "phi2' - phi1'",
            };
            let law = if damping.viscous { velocity.to_owned() } else { format!("sign({velocity})") };
            terms.push(format!("{name} = \"{law}\""));
        }
        // Writing into a string cannot fail.
        let _ = write!(equations, "\n[[equation]]\nbalance = \"-phi{n}''\"\n[equation.terms]\n{}\n", terms.join("\n"));
    }
    bound(rig, Pendulum::Double.coordinates(), inputs(rig), &equations)
}

/// The key of a model file that declares the base's motion, where it is measured.
fn inputs(rig: &Rig) -> &'static str {
    if rig.base().is_some() { "inputs = [\"base\"]\n" } else { "" }
}

/// The name of the system file that ships with the program for a rig's base.
pub fn of_bodies(rig: &Rig) -> &'static str {
    match (rig.base(), rig.drive) {
        (Some(_), _) => "double-pendulum-measured-base",
        (None, Some(_)) => "double-pendulum",
        (None, None) => "double-pendulum-free",
    }
}

/// The rig of a double pendulum with the system file that ships with the program, with nominal
/// dampings by their ids.
///
/// # Errors
/// Channels that do not measure both angles, dampings that are not in the list of effects.
pub fn double_pendulum_of_bodies(rig: &Rig, nominal: &[String]) -> Result<Rig> {
    let text = library::text(of_bodies(rig)).unwrap_or_default().to_owned();
    let model = system::model_of(Source { text, path: rig.path.clone() }, Some(nominal), rig.omega())?;
    let out = with_model(rig, model)?;
    Ok(Rig { channel: rig.channel.clone(), nominal: Some(nominal.to_vec()), ..out })
}

/// The rig of a single pendulum with the system file that ships with the program, with nominal
/// dampings by their ids.
///
/// # Errors
/// As [`double_pendulum_of_bodies`].
pub fn single_pendulum_of_bodies(rig: &Rig, nominal: &[String]) -> Result<Rig> {
    let is_horizontal = rig.direction() == Some(Direction::Horizontal);
    let name = if is_horizontal { "single-pendulum-horizontal" } else { "single-pendulum" };
    let text = library::text(name).unwrap_or_default().to_owned();
    let model = system::model_of(Source { text, path: rig.path.clone() }, Some(nominal), rig.omega())?;
    let out = with_model(rig, model)?;
    Ok(Rig { channel: rig.channel.clone(), nominal: Some(nominal.to_vec()), ..out })
}

/// The rig of a built-in system with its coordinates alone: its equations say nothing of the
/// system.
///
/// # Errors
/// Channels that do not measure the angles.
pub fn coordinates(rig: &Rig) -> Result<Rig> {
    let names = rig.pendulum().unwrap_or(Pendulum::Double).coordinates();
    let mut equations = String::new();
    for n in names {
        // Writing into a string cannot fail.
        let base = if rig.base().is_some() { format!(", u_{n} = \"sin({n})*base\"") } else { String::new() };
        let _ = write!(equations, "\n[[equation]]\nbalance = \"-{n}''\"\nterms = {{ k_{n} = \"sin({n})\"{base} }}\n");
    }
    bound(rig, names, inputs(rig), &equations)
}

fn bound(rig: &Rig, coordinates: &[&str], inputs: &str, equations: &str) -> Result<Rig> {
    let list: Vec<String> = coordinates.iter().map(|c| format!("{{ name = \"{c}\", space = \"S1\" }}")).collect();
    let text = format!("name = \"{}\"\ncoordinates = [{}]\n{inputs}{equations}", rig.model, list.join(", "));
    with_model(rig, ModelFile::parse(&text, &rig.path)?)
}

/// The rig with a model whose coordinates are the absolute angles of its arms, in their order.
fn with_model(rig: &Rig, model: ModelFile) -> Result<Rig> {
    let n = model.coordinates.len();
    let (mut sensors, mut shown) = (Vec::new(), DMatrix::identity(n, n));
    for k in 0..n {
        let names = ["theta", "phi"].map(|w| format!("{w}{}", k + 1));
        let channel = |name: &String| rig.channel.iter().position(|c| c.measures == *name);
        let found = names.iter().find_map(channel).ok_or_else(|| {
            let expected = format!("a [[channel]] that measures {} or {}", names[0], names[1]);
            BadInput::new("no such channel", expected)
                .in_file(&rig.path)
                .at("channel")
                .remedy("Each arm's angle needs a channel")
        })?;
        // An encoder on arm 1 shows arm 2 relative to it.
        if k > 0 && rig.channel[found].measures == names[0] {
            shown[(k, k - 1)] = -1.0;
        }
        sensors.push(found);
    }
    // Ones on the diagonal and nothing above it.
    let coordinates = shown.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(n, n));
    let inputs: Vec<usize> = if model.inputs.is_empty() { Vec::new() } else { rig.base().into_iter().collect() };
    let base = (!inputs.is_empty()).then_some(0);
    let angles = model.circle();
    let bound = ObservedModel { model: Arc::new(model), sensors, shown, coordinates, angles, inputs, base };
    let mut out = Rig { bound: Some(Arc::new(bound)), ..rig.clone() };
    for c in &mut out.channel {
        c.measures = match c.measures.as_str() {
            "theta1" => "phi1",
            "theta2" => "phi2 - phi1",
            other => other,
        }
        .to_owned();
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn shipped_rigs_become_ones_of_their_own() {
        let read = |n: &str| Rig::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(n)).unwrap();
        let single = single_pendulum(&read("single-pendulum.toml"), &["c_r"], false).unwrap().bound.unwrap();
        assert_eq!(single.model.coefficients(), ["c_r", "n_cos", "p_cos", "q_sin"]);
        let all = single_pendulum(&read("single-pendulum.toml"), &["c_r", "C11"], true).unwrap().bound.unwrap();
        assert_eq!(all.model.coefficients().len(), 8);
        let base = "\n[[channel]]\nname = \"base\"\nmeasures = \"base\"\nunit = \"mm\"\n";
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/single-pendulum.toml");
        let text =
            std::fs::read_to_string(&path).unwrap().replacen("\n[[channel]]", &format!("{base}\n[[channel]]"), 1);
        let measured = single_pendulum(&Rig::parse(&text, &path).unwrap(), &["c_r"], false).unwrap().bound.unwrap();
        assert_eq!(measured.model.coefficients().len(), 3, "{:?}", measured.model.coefficients());
        assert_eq!((measured.inputs.len(), measured.base), (1, Some(0)));
        let double = coordinates(&read("chaotic.toml")).unwrap().bound.unwrap();
        assert_eq!(double.shown, nalgebra::DMatrix::from_row_slice(2, 2, &[1.0, 0.0, -1.0, 1.0]));
    }
}

//! `[[force]]`: generalised forces by their virtual work, δW = value · δ(does_work_on).
//!
//! A force between coordinates, along a sum of them such as `x2 - x1`, is a joint as well where no
//! `[[joint]]` moves so: there is something between them in which effects can sit.

use toml::de::DeTable;

use super::joints::Joint;
use super::language::{Placed, Reader};
use super::polynomial::{Atom, Polynomial, Product};
use super::words::Scope;
use crate::error::Result;
use crate::model::model_file::expression::Symbol;

/// A force.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    /// The displacement that it works along.
    pub does_work_on: Placed<Polynomial>,
    /// Its value.
    pub value: Placed<Polynomial>,
    /// Its name, or what it works along as it was written.
    name: String,
}

impl Force {
    /// A spring −p x that does work on a displacement x, p a parameter, which no file has written.
    pub fn spring(along: &Polynomial, parameter: usize) -> Self {
        let stiffness = Polynomial::atom(Atom::Parameter(parameter)).scaled(-1.0);
        let force = along.times(&stiffness).unwrap_or_default();
        let placed = |value: Polynomial| Placed { value, at: 0 };
        Self { does_work_on: placed(along.clone()), value: placed(force), name: String::new() }
    }
}

/// Reads the forces.
///
/// # Errors
/// Keys that are missing or unknown, expressions that are no numbers.
pub fn read(r: &Reader<'_>, top: &DeTable<'_>) -> Result<Vec<Force>> {
    let mut out = Vec::new();
    for (table, at) in r.tables(top, "force")? {
        r.source.known_keys(table, &["does_work_on", "value", "name"], "a force")?;
        let placed = |key: &str, expected: &str| -> Result<Placed<Polynomial>> {
            let v = r.source.required(table, at..at, key, expected)?;
            Ok(Placed { value: r.scalar(v, Scope::Motion)?, at: r.source.inside(v, 0) })
        };
        let does_work_on = placed("does_work_on", "the displacement that it works along, such as \"x\"")?;
        let value = placed("value", "the force or torque, such as \"force - k*x\"")?;
        let text = |key: &str| table.get(key).and_then(|v| v.get_ref().as_str()).unwrap_or_default();
        let name = Some(text("name")).filter(|n| !n.is_empty()).unwrap_or(text("does_work_on"));
        let name = name.split_whitespace().collect();
        out.push(Force { does_work_on, value, name });
    }
    Ok(out)
}

/// Adds the joints that forces between coordinates are.
pub fn join(forces: &[Force], joints: &mut Vec<Joint>) {
    for Force { does_work_on, name, .. } in forces {
        let along = &does_work_on.value;
        let moves_so = |j: &Joint| {
            let own = &j.moves.value;
            own.minus(along).is_zero() || own.plus(along).is_zero()
        };
        if is_between(along) && !joints.iter().any(|j| moves_so(j) || j.name == *name) {
            joints.push(Joint { name: name.clone(), at: None, moves: does_work_on.clone(), carries: Vec::new() });
        }
    }
}

/// Whether it is a sum of several coordinates, with numbers before them.
fn is_between(along: &Polynomial) -> bool {
    let is_coordinate = |p: &Product| matches!(p[..], [(Atom::Motion(Symbol::Coordinate(_)), 1)]);
    along.terms().count() > 1 && along.terms().all(|(product, _)| is_coordinate(product))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::model::model_file::toml_place::Source;
    use crate::system::language::SystemFile;

    fn joints(between: &str, joint: &str) -> Vec<String> {
        let text = format!(
            "name = \"two\"\ncoordinates = {{ x1 = \"m\", x2 = \"m\" }}\nparameters = {{ m = \"kg\", k = \"N/m\" }}\n\
             kinetic = \"m*(x1'^2 + x2'^2)/2\"\n{joint}[[force]]\ndoes_work_on = \"x1\"\nvalue = \"-k*x1\"\n\
             [[force]]\n{between}\nvalue = \"-k*(x2 - x1)\"\n"
        );
        let file = SystemFile::from_source(Source { text, path: Path::new("two.toml").to_path_buf() }).unwrap();
        file.joints.iter().map(|j| j.name.clone()).collect()
    }

    #[test]
    fn a_force_between_coordinates_is_a_joint_where_none_moves_so() {
        assert_eq!(joints("does_work_on = \"x2 - x1\"", ""), ["x2-x1"]);
        assert_eq!(joints("name = \"coupling\"\ndoes_work_on = \"x2 - x1\"", ""), ["coupling"]);
        let spring = "[[joint]]\nname = \"spring\"\nmoves = \"x1 - x2\"\n";
        assert_eq!(joints("does_work_on = \"x2 - x1\"", spring), ["spring"]);
        assert!(joints("does_work_on = \"x2 - x1*x2\"", "").is_empty());
    }
}

//! Units that contradict each other are refused with their place, and what leaves a unit open is not.

use std::path::Path;

use crate::model::model_file::toml_place::Source;
use crate::system::language::SystemFile;
use crate::system::library;

const CART: &str = r#"name = "cart"
coordinates = { x = "length", theta = "angle" }
inputs = { force = "N", torque = "N m" }
gravity = "down"
parameters = { M = "kg", m = "kg", e = "m", J = "kg m^2", k = "N/m", s = "1" }
constants = { N = 50 }

[points]
cart = "[x, 0]"

[[body]]
name = "cart"
mass = "M"
centroid = "cart"

[[body]]
name = "arm"
from = "cart"
angle = "theta"
mass = "m"
centroid = "e"
inertia = "J"

[[force]]
does_work_on = "x"
value = "force - k*x + s*force"

[[force]]
does_work_on = "theta"
value = "torque"

[quantities]
moment = "m*e"
"#;

fn read(text: &str) -> Result<SystemFile, String> {
    let source = Source { text: text.to_owned(), path: Path::new("m.toml").to_path_buf() };
    SystemFile::from_source(source).map_err(|e| e.to_string())
}

fn with(from: &str, to: &str) -> Result<SystemFile, String> {
    assert!(CART.contains(from), "{from}");
    read(&CART.replacen(from, to, 1))
}

#[test]
fn what_units_contradict_is_refused_where_it_stands() {
    for (from, to, told) in [
        (
            "force - k*x +",
            "force - k*x^2 +",
            "m.toml: line 26, column 16: found the difference of N and N m in \"force - k*x^2 + s*force\", \
             expected terms of one unit. Correct the expression, or a unit where it is declared",
        ),
        (
            "inertia = \"J\"",
            "inertia = \"m*e + 0*J\"",
            "line 22, column 12: found the inertia \"m*e + 0*J\" in kg m, expected kg m²",
        ),
        ("mass = \"M\"", "mass = \"M*e\"", "found the mass \"M*e\" in kg m, expected kg"),
        ("centroid = \"e\"", "centroid = \"e^2\"", "found the centroid \"e^2\" in m², expected m"),
        ("angle = \"theta\"", "angle = \"x\"", "found the angle \"x\" in m, expected an angle in rad"),
        ("[x, 0]", "[x^2, 0]", "found the point \"[x^2, 0]\" in m², expected m"),
        ("- k*x", "- k*sin(x)", "found sin of what is in m in"),
        ("- k*x", "- k*x*2^x", "found a power of m in"),
        ("- k*x", "- k*x'", "found the difference of N and N/s in"),
        (
            "value = \"torque\"",
            "value = \"force\"",
            "found the force \"force\" in N, expected N m, whose work along \"theta\" is in J as the bodies' energy",
        ),
        ("does_work_on = \"theta\"", "does_work_on = \"x*theta\"", "found the force \"torque\" in N m, expected N,"),
        ("moment = \"m*e\"", "moment = \"m*e + J\"", "found the sum of kg m and kg m² in \"m*e + J\""),
        ("gravity = \"down\"", "gravity = \"[0, -g*m]\"", "found gravity \"[0, -g*m]\" in m kg/s², expected m/s²"),
        (
            "gravity = \"down\"",
            "gravity = \"down\"\npotential = \"k*x\"",
            "found the potential energy \"k*x\" in N, expected J as the bodies' energy",
        ),
    ] {
        let e = with(from, to).expect_err(to);
        assert!(e.contains(told), "{to}:\n{e}\n{told}");
    }
}

#[test]
fn a_unit_that_is_not_written_may_be_any() {
    for (from, to) in [
        // Numbers that carry a unit: alone, beside what moves, under constants.
        ("- k*x", "- 2.5*x - k*x"),
        ("- k*x", "- 3*x^3 - 50*x'^2 + 12 - k*x"),
        ("- k*x", "- N*x^2 - k*x"),
        // A coefficient of one is not written.
        ("- k*x", "- x - k*x"),
        ("- k*x", "+ x - x^3 - k*x"),
        ("force - k*x", "force - 0.05*x' - x^3 - k*x"),
        ("- k*x", "- k*x*(1 + 2*x)"),
        ("- k*x", "- k*(2*x + 1)*x"),
        ("- k*x", "- k*x*(1 - 3*x^2)"),
        ("- k*x", "- k*x*(1 - x/10)"),
        ("- k*x", "- k*(x^2 - 1)*x'"),
        ("mass = \"M\"", "mass = \"M*(1 + x/2)\""),
        ("value = \"torque\"", "value = \"torque - theta'\""),
        ("value = \"torque\"", "value = \"2*force\""),
        ("does_work_on = \"theta\"", "does_work_on = \"10*x - theta\""),
        ("does_work_on = \"theta\"", "does_work_on = \"theta - 10*x\""),
        ("- k*x", "- k*x - 9.81*m"),
        ("- k*x", "- k*x*sin(100*x)*exp(-x/0.2)"),
        // What is declared in 1, and angles: so many of anything.
        ("- k*x", "- s*x^2 - k*x"),
        ("value = \"torque\"", "value = \"torque - theta - 3*sin(theta)\""),
        ("inertia = \"J\"", "inertia = \"m*e^2/3 + J + M*N^2*s\""),
        ("[x, 0]", "[x + sin(theta), 0]"),
        // Whole and broken powers, and what functions leave of a unit.
        ("- k*x", "- k*sqrt(x^2)*sign(x') - k*abs(x)"),
        ("- k*x", "- k*(x^6)^(1/6)*(1 - cos(2*theta))*theta^2"),
        ("moment = \"m*e\"", "moment = \"atan2(m*e, M*e)\""),
    ] {
        assert!(with(from, to).is_ok(), "{to}: {:?}", with(from, to).err());
    }
    // Divided by a mass, in units of an acceleration.
    let scaled = "name = \"m\"\ncoordinates = { x = \"length\" }\ninputs = { a = \"m/s^2\" }\nparameters = { w = \"1/s^2\" }\n\
                  kinetic = \"x'^2/2\"\npotential = \"w*x^2/2\"\n[[force]]\ndoes_work_on = \"x\"\nvalue = \"a\"\n";
    assert!(read(scaled).is_ok(), "{:?}", read(scaled).err());
    let e = read(&scaled.replace("m/s^2", "V")).unwrap_err();
    assert!(e.contains("found the force \"a\" in V, expected m/s², whose work along \"x\" is in"), "{e}");
}

#[test]
fn what_ships_contradicts_nothing() {
    for (name, text) in library::all() {
        assert!(library::read(name, text).is_ok(), "{name}");
    }
    assert_eq!(read(CART).unwrap().quantities[0].unit.to_string(), "kg m");
}

//! Mistakes of effect entries with their places, and the combinations of shape parameters.

use std::path::Path;

use super::*;
use crate::error::Result;
use crate::model::model_file::toml_place::Source;

fn of(text: &str) -> Result<Vec<Entry>> {
    read(&Source { text: text.to_owned(), path: Path::new("e.toml").to_path_buf() })
}

#[test]
fn mistakes_are_told_with_their_place() {
    let head = "[[effect]]\nid = \"magnet\"\nat = \"joint\"\nstrengths = [\"k\"]\n";
    for (rest, line, told) in [
        ("", 1, "without a law"),
        ("force = \"-k*z\"", 5, "z"),
        ("force = \"-k*x\"\nreads = \"x + k\"", 5, "one law"),
        ("moves = \"k*along\"", 5, "moves at this place"),
        ("force = \"-k^2*x\"", 5, "one strength as a factor"),
        ("force = \"x\"", 5, "one strength as a factor"),
        ("force = \"-k*x\"\nsign = { q = \"+\" }", 6, "the name q"),
        ("force = \"-k*x\"\nsign = { k = \"plus\" }", 6, "Write \"+\" where"),
        ("force = \"-k*x\"\nsign = { k = \"-\" }", 6, "Turn the law's sign"),
        ("force = \"-k*x\"\nshape = { n = { grid = [1.0], within = [3.0, 0.01] } }", 6, "Write within = [0.01, 3]"),
        ("force = \"-k*x\"\nshape = { n = { whole = [1, 1e9] } }", 6, "whole numbers"),
        ("force = \"-k*x\"\nshape = { n = { grid = [1.0], within = [2.0, 3.0] } }", 6, "outside"),
        ("force = \"-k*x\"\nshape = { n = { whole = [1, 30] }, m = { whole = [1, 30] } }", 6, "900 combinations"),
        ("force = \"-k*x*exp(-v)\"\nshape = { v = { grid = [1.0] } }", 6, "\"v\" a second time"),
        ("force = \"-k*x*t\"\nshape = { t = { grid = [1.0] } }", 6, "\"t\" a second time"),
        ("force = \"-k*x/T\"\nshape = { T = { grid = [1.0] } }", 6, "\"T\" a second time"),
        ("force = \"-k*x\"\nshape = { k = { grid = [1.0] } }", 6, "\"k\" a second time"),
        ("force = \"-k*x*pi\"\nshape = { pi = { grid = [1.0] } }", 6, "do not use otherwise"),
        ("force = \"-k*sin(x)\"\nshape = { sin = { grid = [1.0] } }", 6, "do not use otherwise"),
        ("force = \"-k*x\"\nshape = { n = { whole = [1, 3] } }", 6, "the shape n, which no law uses"),
        (
            "force = \"-k*x/a/b/c/d/e\"\nshape = { a = { grid = [1.0] }, b = { grid = [1.0] }, c = { grid = [1.0] }, d = { grid = [1.0] }, e = { grid = [1.0] } }",
            6,
            "more than 4 shapes",
        ),
        ("force = \"-k*x\"\ncolour = \"red\"", 6, "colour"),
        ("force = \"-k*x\"\ncolour = \"red\"", 6, "see docs/effects.md"),
        ("force = \"-k*x\"\nvalue = \"k*q\"", 6, "q"),
        ("drags = \"-k*v\"", 5, "drags at this place"),
    ] {
        let error = of(&format!("{head}{rest}\n")).unwrap_err().to_string();
        assert!(error.contains(told) && error.contains(&format!("line {line}")), "{rest}: {error}");
    }
    let arm = "[[effect]]\nid = \"air\"\nat = \"arm\"\nstrengths = [\"k\"]\n";
    for (rest, told) in [("drags = \"-k*v\"", "without a length"), ("drags = \"-k*omega\"", "drags without")] {
        assert!(of(&format!("{arm}{rest}\n")).unwrap_err().to_string().contains(told), "{rest}");
    }
    let drive = "[[effect]]\nid = \"shaken\"\nat = \"drive\"\nstrengths = [\"k\"]\nmoves = \"k*along*size\"\n";
    for word in ["along", "size", "T"] {
        let error = of(&format!("{drive}shape = {{ {word} = {{ grid = [1.0] }} }}\n")).unwrap_err().to_string();
        assert!(error.contains(&format!("\"{word}\" a second time")), "{error}");
    }
    assert!(of("[[effect]]\nid = \"a b\"\n").unwrap_err().to_string().contains("small letters"));
    assert!(of("").unwrap_err().to_string().contains("[[effect]]"));
}

/// What names another effect names one of its file, whatever their order, or one of the list.
#[test]
fn a_file_stands_beside_the_list() {
    let entry = |id: &str, rest: &str| {
        format!("[[effect]]\nid = \"{id}\"\nat = \"joint\"\nstrengths = [\"k\"]\nforce = \"-k*x^3\"\n{rest}\n")
    };
    let beside = |text: &str| {
        let source = Source { text: text.to_owned(), path: Path::new("e.toml").to_path_buf() };
        read_beside(&source, crate::effects::catalogue().iter()).map_err(|e| e.to_string())
    };
    let good = entry("own", "refines = \"other\"") + &entry("other", "takes_from = \"coulomb-friction\"");
    assert_eq!(beside(&good).unwrap().len(), 2);
    for (text, line, told) in [
        (entry("own", "refines = \"coulomb\""), 6, "found refines = \"coulomb\", expected the id of another effect"),
        (entry("own", "takes_from = \"own\""), 6, "found takes_from = \"own\""),
        (entry("cogging", ""), 2, "the effect cogging, which there is already"),
    ] {
        let said = beside(&text).unwrap_err();
        assert!(said.contains(told) && said.contains(&format!("line {line}")), "{said}");
    }
}

#[test]
fn forms_are_all_combinations() {
    let text = "[[effect]]\nid = \"m\"\nat = \"joint\"\nstrengths = [\"k\"]\nforce = \"-k*exp(-x/d)*sin(n*x)\"\nshape = { d = { grid = [0.1, 0.2] }, n = { whole = [1, 3] } }\n";
    let e = of(text).unwrap().remove(0);
    assert_eq!(e.forms().len(), 6);
    assert_eq!(e.forms()[5], [("d".to_owned(), 0.2), ("n".to_owned(), 3.0)]);
}

/// The record's length is a time: what grows along the record has the unit of what it is in the end.
#[test]
fn a_share_of_the_record_is_a_number() {
    let entry = crate::effects::catalogue().iter().find(|e| e.id == "friction-drift").unwrap();
    let x = Polynomial::motion(Symbol::Coordinate(0));
    let of = multiplied(entry, &entry.forms()[0], &x, 1, 1.0).unwrap();
    assert!(!of.any(&|s| s == Symbol::Time), "{of:?}");
}

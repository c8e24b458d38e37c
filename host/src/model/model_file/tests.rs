use super::*;

const GOOD: &str = r#"name = "positioning drive"
coordinates = [{ name = "q", space = "R" }]
inputs = ["force"]
[[equation]]
balance = "force"
terms = { M = "q''", F_v = "q'" }
"#;

fn error(text: &str) -> String {
    ModelFile::parse(text, Path::new("m.toml")).expect_err(text).to_string()
}

#[test]
fn the_page_s_example_is_read() {
    let m = ModelFile::parse(GOOD, Path::new("m.toml")).unwrap();
    assert_eq!(
        (m.name.as_str(), m.coordinates.len(), m.inputs.as_slice()),
        ("positioning drive", 1, &["force".to_owned()][..])
    );
    assert_eq!(m.coefficients(), ["M", "F_v"]);
    // Terms keep the order of the file, not of the alphabet.
    let m =
        ModelFile::parse(&GOOD.replace("M = \"q''\", F_v = \"q'\"", "Z = \"q''\", A = \"q'\""), Path::new("m.toml"))
            .unwrap();
    assert_eq!(m.coefficients(), ["Z", "A"]);
}

#[test]
fn a_key_of_a_system_says_what_it_stands_beside() {
    let told = error(&format!("{GOOD}[[joint]]\nname = \"axis\"\nmoves = \"q\"\n"));
    assert!(told.contains("beside coordinates that are a table"), "{told}");
    let told = error(&format!("gravity = \"down\"\n{GOOD}"));
    assert!(told.contains("beside coordinates that are a table"), "{told}");
    let told = error(&format!("colour = 1\n{GOOD}"));
    assert!(told.contains("These are the keys of a model file") && !told.contains("that are a table"), "{told}");
}

/// Twenty-nine mistakes, each message with its line, column, what was found and what to do.
#[test]
fn malformed_files_are_told_where_and_what_to_do() {
    for (from, to, parts) in [
        ("q''", "q'' +", &["line 6, column 21", "the end", "a number, a name", "Complete"][..]),
        ("q''", "sen(q)", &["line 6, column 16", "\"sen\"", "sin, cos, tan", "in \"sen(q)\"", "Correct the function"]),
        ("q''", "3 q''", &["line 6, column 18", "q''", "an operator", "\"*\""]),
        ("q''", "(q''", &["line 6, column 16", "without its", "Close"]),
        ("q''", "q'')", &["line 6, column 19", "without its", "Remove"]),
        ("q''", "q'''", &["line 6, column 16", "order 3", "at most the second"]),
        ("q''", "m*q''", &["line 6, column 16", "\"m\"", "one of q, force, tau, pi", "terms"]),
        ("q''", "force'", &["line 6, column 16", "derivative of force", "coordinates only"]),
        ("q''", "q'' = 2", &["line 6, column 20", "\"=\"", "balance"]),
        ("q''", "", &["line 6, column 16", "nothing", "q'"]),
        ("q''", "sign(q'')", &["line 6, column 16", "inside a function", "sign(q'')", "acceleration"]),
        ("q''", "q''^2", &["power of an acceleration", "factor"]),
        ("q''", "0*q", &["M = \"0*q\", which is 0", "varies"]),
        ("\"q'\"", "\"q''\"", &["F_v = \"q''\", the same as M", "told apart"]),
        ("\"q'\"", "3", &["line 6, column 28", "found 3", "quotes"]),
        ("balance = \"force\"", "balance = \"0\"", &["line 5", "right-hand side that is 0", "factor"]),
        ("balance = \"force\"\n", "", &["line 4, column 1", "no key \"balance\"", "Add balance"]),
        ("balance", "ballance", &["line 5, column 1", "the key \"ballance\"", "balance, terms"]),
        ("terms = { M = \"q''\", F_v = \"q'\" }", "terms = { }", &["line 6", "no term", "Add a term"]),
        ("terms = { M = \"q''\", F_v = \"q'\" }", "", &["no key \"terms\"", "Add terms"]),
        ("space = \"R\"", "space = \"S2\"", &["line 2, column 38", "\"S2\"", "\"S1\""]),
        (", space = \"R\"", "", &["line 2, column 16", "no key \"space\"", "Add space"]),
        ("name = \"q\"", "name = \"sin\"", &["line 2, column 25", "\"sin\"", "Rename"]),
        ("[\"force\"]", "[\"q\"]", &["line 3, column 11", "\"q\" a second time", "Rename"]),
        ("[\"force\"]", "\"force\"", &["line 3", "found \"force\"", "a list"]),
        ("[[equation]]", "[equation]", &["a table", "double brackets"]),
        ("inputs", "input", &["line 3, column 1", "the key \"input\"", "inputs"]),
        ("coordinates = [{ name = \"q\", space = \"R\" }]", "coordinates = []", &["line 2", "0 coordinates", "1 to"]),
        ("[[equation]]", "[[equation", &["line 4", "without its closing brackets"]),
        ("name = \"positioning drive\"\n", "", &["no key \"name\"", "Add name"]),
        ("\"q''\"", "{ basis = \"wavelet\", of = \"q\" }", &["\"wavelet\"", "harmonic", "bases"]),
        ("\"q''\"", "{ basis = \"harmonic\", of = \"q\" }", &["no key \"order\"", "Add order"]),
        ("\"q''\"", "{ basis = \"harmonic\", of = \"q\", order = 900 }", &["found 900", "1 to 60"]),
    ] {
        assert!(GOOD.contains(from), "{from}");
        let message = error(&GOOD.replacen(from, to, 1));
        assert!(message.starts_with("m.toml: line "), "{message}");
        for part in parts {
            assert!(message.contains(part), "{from} -> {to}: no {part:?} in {message}");
        }
    }
}

#[test]
fn a_factor_that_jumps_on_the_circle_is_refused() {
    let text = r#"name = "p"
coordinates = [{ name = "q", space = "S1" }, { name = "x", space = "R" }]
[[equation]]
balance = "-q''"
terms = { k = "q*x''" }
"#;
    let message = error(text);
    assert!(message.contains("not periodic") && message.contains("line 5, column 16"), "{message}");
    assert!(ModelFile::parse(&text.replace("q*x''", "sin(q)*x''"), Path::new("m.toml")).is_ok());
    assert!(ModelFile::parse(&text.replace("q*x''", "q^3"), Path::new("m.toml")).is_ok());
}

#[test]
fn bases_stand_for_several_terms() {
    let text = GOOD.replace(
        "F_v = \"q'\"",
        "f = { basis = \"harmonic\", of = \"q\", order = 2 }, g = { basis = \"interpolation\", of = \"q'\", points = 3, from = -1, to = 1, times = \"q'\" }",
    );
    let m = ModelFile::parse(&text, Path::new("m.toml")).unwrap();
    assert_eq!(m.coefficients(), ["M", "f_cos", "f_sin", "f_cos2", "f_sin2", "g_1", "g_2", "g_3"]);
    let at = |k: usize, q: f64, v: f64| {
        m.equations[0].terms[k].of.value(&|s| if s == Symbol::Coordinate(0) { q } else { v })
    };
    assert!((at(4, 0.3, 0.0) - 0.6_f64.sin()).abs() < 1e-15);
    // Hats sum to one, times the factor.
    assert!((at(5, 0.0, 0.3) + at(6, 0.0, 0.3) + at(7, 0.0, 0.3) - 0.3).abs() < 1e-15);
}

#[test]
fn random_bytes_and_mutations_never_panic() {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let alphabet: Vec<char> = "q'()+-*/^.\"sin=[]{}e0 9\n#é,u".chars().collect();
    for _ in 0..3000 {
        let mut text: Vec<char> = GOOD.chars().collect();
        for _ in 0..rng.random_range(1..6) {
            let at = rng.random_range(0..text.len());
            let c = alphabet[rng.random_range(0..alphabet.len())];
            if rng.random_range(0..3) == 0 { text.insert(at, c) } else { text[at] = c }
        }
        let text: String = text.into_iter().collect();
        if let Err(e) = ModelFile::parse(&text, Path::new("m.toml")) {
            assert!(e.to_string().starts_with("m.toml: "));
        }
    }
}

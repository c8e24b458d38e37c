//! Names of a model as names of a language: letters, digits and _, none of them taken or reserved.

/// Greek letters by name.
const GREEK: [(char, &str); 34] = [
    ('α', "alpha"),
    ('β', "beta"),
    ('γ', "gamma"),
    ('δ', "delta"),
    ('ε', "epsilon"),
    ('ζ', "zeta"),
    ('η', "eta"),
    ('θ', "theta"),
    ('ι', "iota"),
    ('κ', "kappa"),
    ('λ', "lambda"),
    ('μ', "mu"),
    ('ν', "nu"),
    ('ξ', "xi"),
    ('π', "pi"),
    ('ρ', "rho"),
    ('σ', "sigma"),
    ('τ', "tau"),
    ('υ', "upsilon"),
    ('φ', "phi"),
    ('χ', "chi"),
    ('ψ', "psi"),
    ('ω', "omega"),
    ('Γ', "Gamma"),
    ('Δ', "Delta"),
    ('Θ', "Theta"),
    ('Λ', "Lambda"),
    ('Ξ', "Xi"),
    ('Π', "Pi"),
    ('Σ', "Sigma"),
    ('Φ', "Phi"),
    ('Ψ', "Psi"),
    ('Ω', "Omega"),
    ('µ', "mu"),
];

/// A name in ASCII that begins with a letter.
pub fn plain(wanted: &str) -> String {
    let mut out = String::new();
    for c in wanted.chars() {
        match GREEK.iter().find(|g| g.0 == c) {
            Some((_, name)) => out.push_str(name),
            None if c.is_ascii_alphanumeric() || c == '_' => out.push(c),
            None if c == '-' || c == '@' || c == ' ' => out.push('_'),
            None => out.push_str(&format!("u{:x}", u32::from(c))),
        }
    }
    // No language allows a digit at the beginning; in some an underscore there means something.
    if out.starts_with(|c: char| c.is_ascii_alphabetic()) { out } else { format!("p{out}") }
}

/// Names that are given out once each.
#[derive(Debug, Default)]
pub struct Names {
    taken: Vec<String>,
}

impl Names {
    /// No name that is reserved; blanks between them.
    pub fn new(reserved: &str) -> Self {
        Self { taken: reserved.split_whitespace().map(str::to_owned).collect() }
    }

    /// The name wanted, or one like it.
    pub fn give(&mut self, wanted: &str) -> String {
        let plain = plain(wanted);
        let mut name = plain.clone();
        let mut k = 1;
        while self.taken.contains(&name) {
            name = if k == 1 { format!("{plain}_") } else { format!("{plain}_{k}") };
            k += 1;
        }
        self.taken.push(name.clone());
        name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain_and_differ() {
        let mut names = Names::new("x lambda");
        let given: Vec<String> =
            ["x", "x", "λ", "2a", "quadratic-drag@arm2", "é", "_y"].iter().map(|n| names.give(n)).collect();
        assert_eq!(given, ["x_", "x_2", "lambda_", "p2a", "quadratic_drag_arm2", "ue9", "p_y"]);
    }
}

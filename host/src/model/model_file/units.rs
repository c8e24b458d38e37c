//! Units of coefficients, from those of the channels: \[λ\] = \[balance\]/\[term\].
//!
//! Angles and pure numbers have none; a derivative divides by seconds (not where primes are by the
//! drive's phase). Functions give pure numbers. A sum has the unit of its first summand that is not
//! a bare number.

use super::expression::{Expression as E, Function, Node, Symbol};

/// Units of one kind, and what they are made of; sizes are left out.
const KINDS: [(&[&str], &str); 19] = [
    (&["m", "km", "cm", "mm", "um", "µm", "μm"], "m"),
    (&["s", "ms", "us", "µs", "min", "h"], "s"),
    (&["kg", "g"], "kg"),
    (&["A", "mA"], "A"),
    (&["deg", "°"], "1"),
    (&["N", "kN", "mN"], "kg m/s^2"),
    (&["J", "kJ", "mJ"], "kg m^2/s^2"),
    (&["W", "kW", "mW"], "kg m^2/s^3"),
    (&["Pa", "kPa", "MPa"], "kg/m s^2"),
    (&["Hz", "kHz"], "1/s"),
    (&["V", "kV", "mV"], "kg m^2/s^3 A"),
    (&["C"], "A s"),
    (&["T"], "kg/s^2 A"),
    (&["Wb"], "kg m^2/s^2 A"),
    (&["Ω", "Ohm", "ohm"], "kg m^2/s^3 A^2"),
    (&["H", "mH"], "kg m^2/s^2 A^2"),
    (&["F", "mF", "uF", "µF", "nF"], "A^2 s^4/kg m^2"),
    (&["K", "mol"], "K"),
    (&["count", "counts"], "1"),
];

/// Powers of units, by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unit(Vec<(String, f64)>);

impl Unit {
    /// A channel's SI unit ([`crate::rig::Channel::si_unit`]), such as `m`, `N`, `m/s`, `rad`.
    pub fn of_channel(si: &str) -> Self {
        Self::parse(si).unwrap_or_default()
    }

    /// A unit as it is written: `kg m^2`, `N m/A`, `m/s²`, `1`; what follows a stroke divides. None
    /// where it is no unit.
    pub fn parse(text: &str) -> Option<Self> {
        let mut out = Self::default();
        for (i, part) in text.split('/').enumerate() {
            let words: Vec<&str> = part.split([' ', '*', '·']).filter(|w| !w.is_empty()).collect();
            if words.is_empty() || words.len() > 8 {
                return None;
            }
            for word in words {
                let name: String = word.chars().take_while(|c| c.is_alphabetic() || *c == '°').collect();
                let after = &word[name.len()..];
                let power: String = after.chars().map(plain_digit).filter(|c| *c != '^').collect();
                let power = if after.is_empty() { 1 } else { power.parse::<i32>().ok().filter(|p| p.abs() <= 9)? };
                match name.as_str() {
                    "" if word == "1" => {}
                    "" => return None,
                    // Angles have no unit.
                    "rad" => {}
                    _ => {
                        let sign = if i == 0 { 1.0 } else { -1.0 };
                        out = out.times(&Self(vec![(name, 1.0)]), sign * f64::from(power));
                    }
                }
            }
        }
        Some(out)
    }

    /// A unit as a person writes it, of names that are known alone; none where it is no unit.
    ///
    /// # Errors
    /// The name that is none.
    pub fn known(text: &str) -> Option<core::result::Result<Self, String>> {
        let unit = Self::parse(text)?;
        let is_known = |name: &str| KINDS.iter().any(|(names, _)| names.contains(&name));
        let unknown = unit.0.iter().map(|(name, _)| name.clone()).find(|name| !is_known(name));
        Some(unknown.map_or(Ok(unit), Err))
    }

    /// Names of units that are known, for messages.
    pub fn names() -> String {
        let all: Vec<&str> = KINDS.iter().flat_map(|(names, _)| names.iter().copied()).collect();
        format!("{}, rad, 1", all.join(", "))
    }

    /// This unit times another to a power.
    pub fn times(&self, other: &Self, power: f64) -> Self {
        let mut out = self.clone();
        for (name, p) in &other.0 {
            match out.0.iter_mut().find(|(n, _)| n == name) {
                Some((_, q)) => *q += p * power,
                None => out.0.push((name.clone(), p * power)),
            }
        }
        out.0.retain(|(_, p)| *p != 0.0);
        out
    }

    /// The same in kg, m, s and A, whatever its size; none where it is made of what is not known.
    pub fn in_base_units(&self) -> Option<Self> {
        let mut out = Self::default();
        for (name, power) in &self.0 {
            let known = KINDS.iter().find(|(names, _)| names.contains(&name.as_str()));
            out = out.times(&Self::parse(known?.1)?, *power);
        }
        out.0.sort_by(|a, b| a.0.cmp(&b.0));
        Some(out)
    }

    /// Whether it is of the same kind as another, whatever their sizes; so is what is not known.
    pub fn agrees(&self, other: &Self) -> bool {
        let ratio = self.times(other, -1.0).in_base_units();
        ratio.is_none_or(|r| r.0.iter().all(|(_, power)| power.abs() < 1e-9))
    }

    fn second(power: f64) -> Self {
        Self(vec![("s".to_owned(), power)])
    }

    fn power(&self, power: f64) -> Self {
        Self::default().times(self, power)
    }
}

/// A digit or sign set high as a plain one.
fn plain_digit(c: char) -> char {
    let high = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    match high.iter().position(|h| *h == c) {
        Some(d) => char::from_digit(d as u32, 10).unwrap_or(c),
        None if c == '⁻' => '-',
        None => c,
    }
}

impl std::fmt::Display for Unit {
    /// `N s²/m`; `1` for a pure number.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // A power that was found has more digits than anybody reads.
        let shown = |power: f64| (1e3 * power).round() / 1e3;
        let powers: Vec<(&str, f64)> = self.0.iter().map(|(n, p)| (n.as_str(), shown(*p))).collect();
        let write = |power: f64| -> String {
            if power == 1.0 {
                return String::new();
            }
            format!("{power}")
                .chars()
                .map(|c| match c {
                    '0'..='9' => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][c as usize - '0' as usize],
                    '-' => '⁻',
                    _ => '·',
                })
                .collect()
        };
        let list = |sign: f64| -> Vec<String> {
            powers.iter().filter(|(_, p)| p * sign > 0.0).map(|(n, p)| format!("{n}{}", write(p * sign))).collect()
        };
        let (up, down) = (list(1.0), list(-1.0));
        match (up.is_empty(), down.is_empty()) {
            (true, true) => write!(f, "1"),
            (false, true) => write!(f, "{}", up.join(" ")),
            (true, false) => {
                let all: Vec<String> =
                    powers.iter().filter(|p| p.1 != 0.0).map(|(n, p)| format!("{n}{}", write(*p))).collect();
                write!(f, "{}", all.join(" "))
            }
            _ => write!(f, "{}/{}", up.join(" "), down.join("/")),
        }
    }
}

/// Unit of an expression; `time` is whether a prime divides by seconds. None for a bare number.
pub fn of(e: &Node, coordinates: &[Unit], inputs: &[Unit], time: bool) -> Option<Unit> {
    let rec = |e: &Node| of(e, coordinates, inputs, time);
    let get = |list: &[Unit], i: usize| list.get(i).cloned().unwrap_or_default();
    let per = |u: Unit, power: f64| if time { u.times(&Unit::second(power), 1.0) } else { u };
    match &**e {
        E::Number(_) => None,
        E::Symbol(s) => Some(match *s {
            Symbol::Coordinate(i) | Symbol::Raw(i) => get(coordinates, i),
            Symbol::Rate(i) | Symbol::ClearRate(i) => per(get(coordinates, i), -1.0),
            Symbol::Acceleration(i) => per(get(coordinates, i), -2.0),
            Symbol::Input(k) | Symbol::RawInput(k) => get(inputs, k),
            Symbol::InputRate(k) => get(inputs, k).times(&Unit::second(-1.0), 1.0),
            Symbol::Tau | Symbol::Held(_) | Symbol::State(_) | Symbol::Memory(_) => Unit::default(),
            Symbol::Time => Unit::second(1.0),
        }),
        E::Add(a, b) | E::Subtract(a, b) => rec(a).or_else(|| rec(b)),
        E::Multiply(a, b) => match (rec(a), rec(b)) {
            (Some(a), Some(b)) => Some(a.times(&b, 1.0)),
            (a, b) => a.or(b),
        },
        E::Divide(a, b) => match (rec(a), rec(b)) {
            (a, Some(b)) => Some(a.unwrap_or_default().times(&b, -1.0)),
            (a, None) => a,
        },
        E::PowerWhole(a, n) => rec(a).map(|u| u.power(f64::from(*n))),
        E::Power(a, b) => match super::expression::as_number(b) {
            Some(p) => rec(a).map(|u| u.power(p)),
            None => rec(a),
        },
        E::Call(Function::Abs | Function::Wrap, a) => rec(a),
        E::Call(Function::Sqrt, a) => rec(a).map(|u| u.power(0.5)),
        E::Call(..) | E::Hat { .. } | E::Memory(..) => Some(Unit::default()),
    }
}

/// Unit of a coefficient, printed.
pub fn coefficient(balance: &Node, term: &Node, coordinates: &[Unit], inputs: &[Unit], time: bool) -> String {
    let b = of(balance, coordinates, inputs, time).unwrap_or_default();
    let t = of(term, coordinates, inputs, time).unwrap_or_default();
    b.times(&t, -1.0).to_string()
}

#[cfg(test)]
mod tests {
    use super::super::parser::{Names, parse};
    use super::*;

    #[test]
    fn written_units_are_read() {
        for (text, shown) in [
            ("kg m^2", "kg m²"),
            ("N m/A", "N m/A"),
            ("m/s²", "m/s²"),
            ("1", "1"),
            ("rad", "1"),
            ("N/m^3", "N/m³"),
            ("kg*m", "kg m"),
            ("s^-1", "s⁻¹"),
            ("1/s", "s⁻¹"),
        ] {
            assert_eq!(Unit::parse(text).map(|u| u.to_string()).as_deref(), Some(shown), "{text}");
        }
        let found = Unit::second(1.0).times(&Unit::second(1.0), 0.035_419_964_527_532_2);
        assert_eq!(found.to_string(), "s¹·⁰³⁵");
        let found = Unit::second(-1.0).times(&Unit::second(1.0), 0.999_6);
        assert_eq!(found.to_string(), "1");
        for text in ["", "kg m^", "kg^x", "2", "/s", "m^99", "kg,m"] {
            assert_eq!(Unit::parse(text), None, "{text}");
        }
    }

    #[test]
    fn a_unit_that_is_not_known_is_told_by_its_name() {
        for text in ["kg m^2", "N m s/rad", "V/A", "1", "mm", "Ω", "H/s", "°"] {
            assert!(matches!(Unit::known(text), Some(Ok(_))), "{text}");
        }
        for (text, name) in [("kgg", "kgg"), ("N/metre", "metre"), ("Nm", "Nm")] {
            assert_eq!(Unit::known(text), Some(Err(name.to_owned())), "{text}");
        }
        assert!(Unit::known("m^").is_none() && Unit::names().contains("kg, g, A"));
        // Every kind is of units that are known.
        assert!(KINDS.iter().all(|(_, of)| matches!(Unit::known(of), Some(Ok(_)))));
    }

    #[test]
    fn units_follow_from_channels() {
        let names = Names { coordinates: vec!["q".into(), "phi".into()], inputs: vec!["force".into()] };
        let unit = |balance: &str, term: &str| {
            coefficient(
                &parse(balance, &names).unwrap(),
                &parse(term, &names).unwrap(),
                &[Unit::of_channel("m"), Unit::of_channel("rad")],
                &[Unit::of_channel("N")],
                true,
            )
        };
        assert_eq!(unit("force", "q''"), "N s²/m");
        assert_eq!(unit("force", "q'"), "N s/m");
        assert_eq!(unit("force", "sign(q')"), "N");
        assert_eq!(unit("force", "1"), "N");
        assert_eq!(unit("-phi''", "sin(phi)"), "s⁻²");
        assert_eq!(unit("-phi''", "phi'*abs(phi')"), "1");
        assert_eq!(unit("-q''", "2*q^3 + 1"), "m⁻²·s⁻²".replace('·', " "));
    }
}

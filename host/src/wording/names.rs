//! Plain names of effects and of the parameters of the systems that ship, for people who do not
//! know the symbols.

/// An effect `ID@PLACE` in plain words: `quadratic drag on arm 2`. Whether somebody's own place is an
/// angle or a length its name does not say: words hold for both.
pub fn effect(name: &str) -> String {
    let Some((id, at)) = name.split_once('@') else { return name.to_owned() };
    let words = id
        .split('-')
        .map(|w| match w {
            "coulomb" => "Coulomb",
            "stribeck" => "Stribeck",
            "dahl" => "Dahl",
            "lugre" => "LuGre",
            other => other,
        })
        .collect::<Vec<_>>()
        .join(" ")
        .replace(" dependent ", "-dependent ")
        .replace("power law ", "power-law ");
    let letters = at.trim_end_matches(|c: char| c.is_ascii_digit());
    // Joints of this name are the pendulums'.
    let words = if id == "torsion-spring" && letters != "joint" { "spring".to_owned() } else { words };
    let number = &at[letters.len()..];
    let numbered = |word: &str| if number.is_empty() { format!("the {word}") } else { format!("{word} {number}") };
    if let ("coupling-stiffness", Some((one, other))) = (id, at.split_once('-')) {
        return format!("{words} between {one} and {other}");
    }
    if id == "body-drag" {
        return format!("drag on {at}");
    }
    match letters {
        "joint" => format!("{words} in {}", numbered("joint")),
        "arm" => format!("{words} on {}", numbered("arm")),
        "encoder" => format!("{words} of {}", numbered("sensor")),
        // The id says of what it is already.
        "drive" | "frame" if words.starts_with(letters) => words,
        "drive" | "frame" => format!("{words} of the {letters}"),
        _ => format!("{words} at {at}"),
    }
}

/// Several names in a sentence: `a`, `a and b`, `a, b and c`.
pub fn listed(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// What a parameter of a pendulum or a physical quantity is; none for a name of somebody's own.
pub fn parameter(name: &str) -> Option<&'static str> {
    Some(match name {
        "B11" => "how strongly arm 2 pulls at arm 1",
        "B21" => "how strongly arm 1 pulls at arm 2",
        "B12" => "gravity on arm 1",
        "B22" => "gravity on arm 2",
        "B13" => "drive on arm 1, in phase",
        "B14" => "drive on arm 1, a quarter period off",
        "B15" => "drive on arm 1, amplitude",
        "B16" => "the base's acceleration on arm 1",
        "B23" => "drive on arm 2, in phase",
        "B24" => "drive on arm 2, a quarter period off",
        "B25" => "drive on arm 2, amplitude",
        "B26" => "the base's acceleration on arm 2",
        "C11" => "dry friction in joint 1",
        "C12" => "viscous friction in joint 2, as arm 1 feels it",
        "C2" => "viscous friction in joint 2, as arm 2 feels it",
        "C13" => "viscous friction in joint 1",
        "C14" => "dry friction in joint 2, as arm 1 feels it",
        "C4" => "dry friction in joint 2, as arm 2 feels it",
        "c_r" => "viscous friction in the joint",
        "n_cos" => "drive on the arm, in phase, by the cosine of its angle",
        "n_sin" => "drive on the arm, in phase, by the sine of its angle",
        "p_cos" => "drive on the arm, a quarter period off, by the cosine of its angle",
        "p_sin" => "drive on the arm, a quarter period off, by the sine of its angle",
        "q_sin" => "gravity on the arm",
        "q_cos" => "gravity across the arm's line",
        "J_o1" => "moment of inertia of arm 1 about its joint",
        "J_o2" => "moment of inertia of arm 2 about its joint",
        "m1" => "mass of arm 1",
        "m2" => "mass of arm 2",
        "e1" => "distance of arm 1's centroid from its joint",
        "e2" => "distance of arm 2's centroid from its joint",
        "m1e1" => "mass of arm 1 times its centroid's distance",
        "l1" => "length of arm 1 from joint to joint",
        "a" => "amplitude of the drive",
        "psi" => "phase of the drive",
        "g" => "acceleration of gravity",
        "base_gain" => "what the base's sensor shows of 1",
        "tau_c1" => "dry friction torque in joint 1",
        "tau_c2" => "dry friction torque in joint 2",
        "c_r1" => "viscous friction in joint 1",
        "c_r2" => "viscous friction in joint 2",
        _ => return None,
    })
}

/// A text with a capital letter first.
pub fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().chain(letters).collect())
}

/// Words with which whirl's own sentences begin. Whatever else a sentence begins with may be a name
/// of a file, and stays.
const OPENINGS: [&str; 20] = [
    "All", "An", "Between", "Both", "Each", "From", "It", "Its", "No", "Nothing", "Of", "Over", "Some", "The", "These",
    "This", "Under", "What", "Where", "With",
];

/// A sentence as part of another: an opening word begins with a small letter; a symbol, and a name
/// that a file gave, stays.
pub fn inside(text: &str) -> String {
    let first = text.split_whitespace().next().unwrap_or_default();
    if OPENINGS.contains(&first) { first.to_lowercase() + &text[first.len()..] } else { text.to_owned() }
}

/// A text as a sentence of its own: with a capital letter first, unless it begins with a symbol, a
/// number or the name of a file.
pub fn sentence(text: &str) -> String {
    let first = text.split_whitespace().next().unwrap_or_default().trim_end_matches([',', ';', ':']);
    let word = first.len() > 1 && first.chars().all(|c| c.is_ascii_lowercase() || c == '-');
    if word { capitalised(text) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_have_plain_names() {
        for (name, plain) in [
            ("quadratic-drag@arm2", "quadratic drag on arm 2"),
            ("coulomb-friction@joint1", "Coulomb friction in joint 1"),
            ("zero-offset@encoder2", "zero offset of sensor 2"),
            ("eccentricity@encoder2", "eccentricity of sensor 2"),
            ("torsion-spring@joint1", "torsion spring in joint 1"),
            ("torsion-spring@slide", "spring at slide"),
            ("drive-harmonic-2@drive", "drive harmonic 2"),
            ("frame-tilt@frame", "frame tilt"),
            ("amplitude-dependent-damping@q", "amplitude-dependent damping at q"),
            ("power-law-damping@joint1", "power-law damping in joint 1"),
            ("coupling-stiffness@x1-x2", "coupling stiffness between x1 and x2"),
            ("cubic-stiffness@q", "cubic stiffness at q"),
            ("body-drag@load", "drag on load"),
            ("refit", "refit"),
        ] {
            assert_eq!(effect(name), plain);
        }
        let names = ["a", "b", "c"].map(str::to_owned);
        assert_eq!((listed(&names), listed(&names[..1])), ("a, b and c".to_owned(), "a".to_owned()));
    }

    #[test]
    fn a_sentence_begins_with_a_capital_letter_unless_with_a_symbol_or_a_name() {
        for (text, sentence) in [
            ("what is left has", "What is left has"),
            ("residuals, all of them", "Residuals, all of them"),
            ("t deviates", "t deviates"),
            ("theta1 and theta2", "theta1 and theta2"),
            ("run.csv: one line", "run.csv: one line"),
            ("φ₁ turns", "φ₁ turns"),
            ("", ""),
        ] {
            assert_eq!(super::sentence(text), sentence);
        }
    }

    #[test]
    fn names_of_columns_keep_their_letters_inside_a_sentence() {
        for (text, within) in [
            ("Upper arm (deg) and Lower arm (deg) are in deg", "Upper arm (deg) and Lower arm (deg) are in deg"),
            ("These coefficients contradict each other", "these coefficients contradict each other"),
            ("The drive runs", "the drive runs"),
            ("B11 is negative", "B11 is negative"),
            ("", ""),
        ] {
            assert_eq!(super::inside(text), within);
        }
    }

    #[test]
    fn every_coefficient_of_the_double_pendulum_has_one() {
        for d in crate::model::double_pendulum::DAMPINGS {
            assert!(d.names.iter().flatten().all(|n| parameter(n).is_some()), "{}", d.id);
        }
        for n in ["B11", "B12", "B13", "B14", "B15", "B21", "B22", "B23", "B24", "B25"] {
            assert!(parameter(n).is_some(), "{n}");
        }
    }
}

//! The card of an identification: see [`crate::report::card`].

use super::best::{CANNOT_BE, MISSES_SOMETHING, MORE_THAN_NOISE};
use super::identifiability::{CORRELATION, RELATIVE_ERROR, size};
use super::model_file::identified_model;
use super::presentation::method_name;
use super::{ERROR_BOUND, Identification, suspects};
use crate::explain::card::equations;
use crate::report::card::{Card, CardRow};
use crate::rig::Rig;
use crate::system::library::Pendulum;
use crate::warning::Warning;
use crate::wording::format::{Z95, count, significant};
use crate::wording::names;
use crate::wording::symbols::symbol_plain;

/// How an identification without fault ends.
const DESCRIBE: &str = "and its equations describe the record";
/// The same of a record that holds so little of the motion that most equations would.
const TOO_SHORT: &str = "and its equations describe the record, which is too short to contradict them";
/// Parameters up to which the precision of all is told, not that of half of them.
const FEW: usize = 3;

/// The card of an identification of a rig.
pub fn card(result: &Identification, rig: &Rig) -> Card {
    let equations = identified_model(result, rig).ok().and_then(|m| equations(&m, rig));
    let parameters = result.parameters.iter().map(|p| CardRow::of(p, equations.as_ref(), rig)).collect();
    // Of an answer that cannot stand nothing else is worth knowing.
    let groups = if cause(result).is_some() { &[][..] } else { &result.groups_not_separable[..] };
    let (together, open): (Vec<_>, Vec<_>) = groups.iter().partition(|g| is_known(result, g));
    Card {
        verdict: sentence(result),
        parameters,
        remarks: together.into_iter().map(|g| go_together(g)).collect(),
        equations,
        undecided: open.into_iter().map(|g| undecided(g)).collect(),
        ..Card::default()
    }
}

/// Why an answer cannot stand: rather a mistake that was recognised than what follows from it, and
/// first one without which the equations fit to the noise.
fn cause(result: &Identification) -> Option<&Warning> {
    let follows = |w: &&Warning| w.id == MISSES_SOMETHING || CANNOT_BE.contains(&w.id);
    let all = || result.warnings.iter().filter(|w| w.invalidates);
    let explains = |w: &&Warning| !follows(w) && suspects::explains(w);
    all().find(explains).or_else(|| all().find(|w| !follows(w))).or_else(|| all().next())
}

/// What was identified, how well, and whether it stands.
fn sentence(result: &Identification) -> String {
    let how = format!("{} samples by {}", count(result.record.samples as u64), method_name(&result.method));
    // A name that a person gave stands as it is.
    let system = match Pendulum::named(&result.model) {
        Some(_) => format!("The {}", result.model.replace('-', " ")),
        None => format!("The system \"{}\"", result.model),
    };
    if let Some(w) = cause(result) {
        let text = names::inside(w.text.trim_end_matches('.'));
        let advice = if w.advice.is_empty() { String::new() } else { format!(" {}.", w.advice.trim_end_matches('.')) };
        return format!("This answer cannot stand: {text}.{advice} ({system} was fitted to {how}.)");
    }
    let (names, values): (Vec<String>, Vec<f64>) = result.parameters.iter().map(|p| (p.name.clone(), p.value)).unzip();
    // Of a part that is zero (the drive's off phase, gravity across an arm) the whole tells how
    // well it is known.
    let relative = |i: usize| Z95 * result.parameters[i].std_error / size(&names, &values, i);
    let mut known: Vec<f64> = (0..names.len()).map(relative).filter(|r| r.is_finite() && *r > 0.0).collect();
    known.sort_by(f64::total_cmp);
    // Of few there is no half, and all are told where each is determined.
    let is_open = result.parameters.iter().any(|p| p.std_error.is_infinite());
    let precision = if names.len() <= FEW && !is_open {
        of_few(result)
    } else {
        known.get(known.len() / 2).map_or_else(String::new, |bound| {
            let percent = significant(100.0 * bound, 2);
            let how = if *bound < 1.0 {
                format!("± {percent} % or better")
            } else {
                format!("no better than ± {percent} %")
            };
            format!(", half of its parameters to {how}")
        })
    };
    format!("{system} was identified from {how}{precision}, {}.", stands(result))
}

/// How well each of a few parameters is known; one that may be zero is not known to any percentage.
fn of_few(result: &Identification) -> String {
    let estimated = result.parameters.iter().filter(|p| p.std_error > 0.0);
    let each: Vec<f64> = estimated.map(|p| Z95 * p.std_error / p.value.abs()).collect();
    let apart: Vec<f64> = each.iter().copied().filter(|r| *r < 1.0).collect();
    let Some(bound) = apart.iter().copied().reduce(f64::max) else {
        return if each.is_empty() { String::new() } else { ", none of its parameters apart from zero".to_owned() };
    };
    let percent = significant(100.0 * bound, 2);
    match apart.len() {
        n if n == each.len() => format!(", all of its parameters to ± {percent} % or better"),
        1 => format!(", the one parameter that differs from zero to ± {percent} %"),
        _ => format!(", those of its parameters that differ from zero to ± {percent} % or better"),
    }
}

/// Whether the equations describe the record, as the end of a sentence.
fn stands(result: &Identification) -> String {
    match left_out(result) {
        Some((what, worst)) if result.within_bound() => {
            // Equations of balance were dropped until ε was below its bound.
            let (balance, percent) = ("its equations balance", significant(100.0 * worst, 2));
            if worst > ERROR_BOUND {
                format!(
                    "but on {what} that were left out {balance} to {percent} % only: identify without --method, or with --differentiation five-point"
                )
            } else {
                format!("and on {what} that were left out {balance} to {percent} %")
            }
        }
        _ => by_residuals(result).to_owned(),
    }
}

/// What a harmonic balance is made of, and the greatest ε of its equations on some that were left
/// out.
fn left_out(result: &Identification) -> Option<(&'static str, f64)> {
    let held = result.balance.as_ref()?.equations.iter().filter_map(|e| Some(e.held_out?.optimised[0]));
    let what = if result.method == "upo" { "orbits" } else { "pieces" };
    Some((what, held.reduce(f64::max)?))
}

/// The same by what the equations leave of the record.
fn by_residuals(result: &Identification) -> &'static str {
    let is_warned = |ids: &[&str]| result.warnings.iter().any(|w| ids.contains(&w.id));
    if !result.within_bound() && result.details.expected_error.is_empty() {
        // What the sensors make of it is not known.
        "but its equations do not balance on this record: something is missing, or its sensors are noisy; run `whirl explain`"
    } else if !result.within_bound() {
        "but its equations do not balance on this record: something is missing, run `whirl explain`"
    } else if is_warned(&[MISSES_SOMETHING, MORE_THAN_NOISE]) {
        "but these equations miss something: run `whirl explain`"
    } else if is_warned(&["misses-over-long"]) {
        "but over long stretches these equations miss something faint: run `whirl explain`"
    } else if result.identification_error.iter().any(|e| *e > ERROR_BOUND) {
        "and its equations leave no more of the record than the sensors' noise explains"
    } else if is_warned(&["few-periods"]) {
        TOO_SHORT
    } else {
        DESCRIBE
    }
}

/// Whether several coefficients whose errors are correlated are each known all the same.
fn is_known(result: &Identification, group: &[String]) -> bool {
    let (names, values): (Vec<String>, Vec<f64>) = result.parameters.iter().map(|p| (p.name.clone(), p.value)).unzip();
    let is = |name: &String| {
        let of = |i: usize| result.parameters[i].std_error <= RELATIVE_ERROR * size(&names, &values, i);
        names.iter().position(|n| n == name).is_some_and(of)
    };
    group.len() > 1 && group.iter().all(is)
}

fn symbols(group: &[String]) -> String {
    names::listed(&group.iter().map(|n| symbol_plain(n)).collect::<Vec<_>>())
}

/// What correlated errors mean where each coefficient is known.
fn go_together(group: &[String]) -> String {
    format!(
        "The errors of {} go together (correlation above {CORRELATION}): each is known as well as its interval says, their difference or ratio better or worse.",
        symbols(group)
    )
}

/// What this record does not determine, and what would.
fn undecided(group: &[String]) -> String {
    if let [_] = group {
        let one = symbols(group);
        return format!(
            "{one} cannot be determined from this record alone: a larger amplitude or a longer record would."
        );
    }
    format!(
        "{} trade off against each other, and this record does not separate them: a larger amplitude does, or one of them measured otherwise \
         (and put under [known] in the rig file).",
        symbols(group)
    )
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::identify::Parameter;

    fn rig() -> Rig {
        Rig::parse(include_str!("../../../rigs/chaotic.toml"), Path::new("rig.toml")).unwrap()
    }

    fn identified() -> Identification {
        let p = |name: &str, value, std_error| Parameter { name: name.into(), value, std_error, unit: "1".into() };
        Identification {
            model: rig().model,
            method: "weak".to_owned(),
            parameters: vec![
                p("B11", 0.11312, 2e-5),
                p("B14", 0.0, 1e-5),
                p("B22", 0.2632, 1e-5),
                p("C2", 0.01, 0.004),
            ],
            identification_error: vec![0.003, 0.004],
            groups_not_separable: [&["B14"][..], &["B11", "C2"], &["B11", "B22"]]
                .map(|g| g.iter().map(|n| (*n).to_owned()).collect())
                .to_vec(),
            ..Identification::default()
        }
    }

    #[test]
    fn parts_that_are_zero_do_not_tell_how_well_the_whole_is_known() {
        let p = |name: &str, value, std_error| Parameter { name: name.into(), value, std_error, unit: "1".into() };
        let parameters = vec![
            p("c_r", 0.036, 4e-6),
            p("p_cos", -1.52, 2e-5),
            p("p_sin", 1e-5, 2e-5),
            p("n_cos", 1e-6, 2e-5),
            p("n_sin", -2e-6, 2e-5),
            p("q_cos", 2e-6, 2e-5),
            p("q_sin", 1.44, 2e-5),
        ];
        let single = Identification { parameters, ..identified() };
        let said = card(&single, &rig()).verdict;
        assert!(said.contains("half of its parameters to ± 0.0026 % or better"), "{said}");
    }

    /// Of noisy sensors ε may be large where nothing is missing.
    #[test]
    fn what_the_sensors_leave_is_no_misfit() {
        let said = |error: f64, expected: &[f64]| {
            let mut result = Identification { identification_error: vec![error], ..identified() };
            result.details.expected_error = expected.to_vec();
            (result.within_bound(), card(&result, &rig()).verdict)
        };
        let (within, told) = said(1.45, &[1.70]);
        assert!(within && told.ends_with("leave no more of the record than the sensors' noise explains."), "{told}");
        let (within, told) = said(1.45, &[0.9]);
        assert!(
            !within && told.ends_with("do not balance on this record: something is missing, run `whirl explain`."),
            "{told}"
        );
        let (within, told) = said(1.45, &[]);
        assert!(!within && told.contains("or its sensors are noisy"), "{told}");
        assert!(said(0.09, &[0.001]).0 && said(0.13, &[0.1]).0 && !said(f64::NAN, &[0.1]).0);
    }

    #[test]
    fn of_a_harmonic_balance_what_it_leaves_of_others_is_told() {
        use crate::identify::harmonic_balance::account::{Account, EquationAccount};
        use crate::identify::harmonic_balance::settings::Settings;
        use crate::identify::harmonic_balance::solve::{HeldOut, Trail};
        let said = |error: f64| {
            let held_out = Some(HeldOut { groups: 5, plain: [0.3; 2], optimised: [error; 2] });
            let equations = vec![EquationAccount { trail: Trail { rounds: Vec::new(), reached: true }, held_out }];
            let balance = Some(Account {
                settings: Settings::orbits(0.05),
                orbits: Vec::new(),
                delay: None,
                recurrences: 0,
                cut_off_hz: None,
                equations,
                functions: Vec::new(),
                before_energy_balance: Vec::new(),
            });
            card(&Identification { method: "upo".to_owned(), balance, ..identified() }, &rig()).verdict
        };
        assert!(said(0.311).contains("but on orbits that were left out its equations balance to 31 % only"));
        assert!(said(0.019).ends_with("and on orbits that were left out its equations balance to 1.9 %."));
    }

    #[test]
    fn of_few_parameters_all_are_told() {
        let mut result = identified();
        result.parameters.retain(|p| p.name.starts_with("B1") || p.name == "B22");
        let said = card(&result, &rig()).verdict;
        assert!(said.contains("those of its parameters that differ from zero to ± 0.035 % or better"), "{said}");
        let mut apart = result.clone();
        apart.parameters[1].value = 4e-5;
        let said = card(&apart, &rig()).verdict;
        assert!(said.contains("all of its parameters to ± 49 % or better"), "{said}");
        apart.parameters[2].value = 1e-6;
        apart.parameters[1].value = -1e-6;
        let said = card(&apart, &rig()).verdict;
        assert!(said.contains("the one parameter that differs from zero to ± 0.035 %"), "{said}");
        apart.parameters[0].value = 0.0;
        let said = card(&apart, &rig()).verdict;
        assert!(said.contains("none of its parameters apart from zero"), "{said}");
        result.parameters[0].std_error = f64::INFINITY;
        let said = card(&result, &rig()).verdict;
        assert!(!said.contains("all of its parameters"), "{said}");
    }

    /// What leaves nothing but noise once it is mended comes before what may follow from it.
    #[test]
    fn a_mistake_that_explains_the_record_is_the_headline() {
        let mut result = identified();
        let suspect = |after: f64| {
            let w = Warning::new("sign-reversed", "Upper arm counts in the wrong sense", "Negate one column");
            w.invalidating().with("residual_after", after)
        };
        let known = Warning::new("known-contradicted", "[known] L disagrees with the record by 276 %", "Measure it");
        result.warnings = vec![known.invalidating(), suspect(1.0)];
        let said = card(&result, &rig()).verdict;
        assert!(said.starts_with("This answer cannot stand: Upper arm counts in the wrong sense. Negate"), "{said}");
        result.warnings[1] = suspect(30.0);
        let said = card(&result, &rig()).verdict;
        assert!(said.starts_with("This answer cannot stand: [known] L disagrees"), "{said}");
    }

    #[test]
    fn the_sentence_says_how_well_and_whether_it_stands() {
        let rig = rig();
        let mut result = identified();
        let shown = card(&result, &rig);
        assert!(shown.verdict.contains("half of its parameters to ± 0.035 % or better"), "{}", shown.verdict);
        assert!(shown.verdict.contains("and its equations describe the record"), "{}", shown.verdict);
        assert!(shown.undecided[0].starts_with("B₁₄ cannot be determined"), "{:?}", shown.undecided);
        assert!(shown.undecided[1].starts_with("B₁₁ and C₂ trade off"), "{:?}", shown.undecided);
        assert!(shown.remarks[0].starts_with("The errors of B₁₁ and B₂₂ go together"), "{:?}", shown.remarks);
        assert_eq!((shown.remarks.len(), shown.undecided.len()), (1, 2));
        let mut short = result.clone();
        short.warnings.push(Warning::new("few-periods", "", ""));
        assert!(card(&short, &rig).verdict.ends_with("which is too short to contradict them."));
        result.warnings.push(Warning::new("negative-gravity", "B22 is negative", "").invalidating());
        result.warnings.push(Warning::new("x", "The record runs backwards", "Turn it round").invalidating());
        let shown = card(&result, &rig);
        assert!(
            shown
                .verdict
                .starts_with("This answer cannot stand: the record runs backwards. Turn it round. (The double"),
            "{}",
            shown.verdict
        );
        assert!(shown.undecided.is_empty() && shown.remarks.is_empty());
    }
}

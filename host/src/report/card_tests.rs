//! The card in a terminal and in a page.

use super::*;

fn card() -> Card {
    let term =
        |negative, text: &str| WrittenTerm { negative, mathml: format!("<mi>{text}</mi>"), text: text.to_owned() };
    let equation = WrittenEquation { left: vec![term(false, "a"), term(true, "b")], right: Vec::new() };
    let row = |symbol: &str, before, after| CardRow {
        symbol: symbol.to_owned(),
        plain: "friction <i>".to_owned(),
        before,
        after,
        unit: "N m".to_owned(),
    };
    let bar = |name: &str, value| GapBar { name: name.to_owned(), value, label: format!("{value} noise floors") };
    Card {
        verdict: "The model misses a drag & more.".to_owned(),
        equations: Some(WrittenOut {
            equations: vec![equation],
            notes: vec!["A note.".into()],
            ..WrittenOut::default()
        }),
        parameters: vec![row("C2", Some((0.05455, 4e-5)), (0.048493, 5.5e-6)), row("", None, (2e-7, 2e-11))],
        remarks: vec!["Both go together.".to_owned()],
        gap: ("Gap over 0.2 s".to_owned(), vec![bar("before", 4.5), bar("after", 1.0)]),
        picture: Some(Compared {
            measures: "theta2".to_owned(),
            unit: "°".to_owned(),
            from_s: 12.0,
            fitted_s: 0.2,
            t: vec![0.0, 0.5, 1.0],
            measured: vec![0.0, 10.0, 20.0],
            before: vec![0.0, 1.0],
            after: vec![0.0, 0.1, 0.2],
        }),
        confirm: vec!["Swing it in a vacuum.".to_owned()],
        failed: Vec::new(),
        undecided: Vec::new(),
    }
}

#[test]
fn a_terminal_has_the_answer_first() {
    let text = card().text();
    assert!(text.starts_with("The model misses a drag & more.\n\nEquations of motion\n  a − b = 0\n"), "{text}");
    assert!(text.contains("0.05455 ± 0.00008  →  0.048493 ± 0.000011"), "{text}");
    assert!(text.contains("C₂, friction") && text.contains("−11 %") && text.contains("  new\n"), "{text}");
    let remark = text.find("\n  Both go together.\n").unwrap();
    assert!(text.find("C₂, friction").unwrap() < remark && remark < text.find("Gap over").unwrap(), "{text}");
    let length = |name: &str| text.lines().find(|l| l.starts_with(&format!("  {name} "))).unwrap().matches('█').count();
    assert_eq!((length("before"), length("after")), (40, 9), "{text}");
    assert!(text.contains("To confirm it\n  Swing") && !text.contains("Not decided"), "{text}");
}

#[test]
fn a_page_has_the_same_escaped() {
    let page = card().html().0;
    assert!(page.starts_with("<p class=verdict>The model misses a drag &amp; more.</p>"), "{page}");
    assert!(page.contains("<math><mrow><mo form=infix>−</mo><mi>b</mi></mrow></math>"), "{page}");
    assert!(page.contains("0.048493 ±\u{a0}0.000011") && page.contains("friction &lt;i&gt;"), "{page}");
    assert!(page.contains("</table></div>\n<p>Both go together.</p>"), "{page}");
    assert!(page.contains("predicted by the new model") && page.contains("<svg"), "{page}");
}

#[test]
fn long_equations_break_between_terms() {
    let term =
        |k: usize| WrittenTerm { negative: k % 2 == 1, mathml: String::new(), text: "0.123 sin(φ₁) cos(τ)".into() };
    let e = WrittenEquation { left: (0..12).map(term).collect(), right: vec![term(0)] };
    let text = lines(&e);
    assert!(text.lines().count() > 2 && text.lines().all(|l| l.chars().count() <= WIDE), "{text}");
    assert!(text.trim_end().ends_with("= 0.123 sin(φ₁) cos(τ)"), "{text}");
}

/// A coefficient `a` of an oscillator's own file is no amplitude of a drive; that of the built-in
/// pendulum is, and so is one of arms from bodies.
#[test]
fn plain_names_are_a_pendulum_s() {
    let p = |name: &str| Parameter { name: name.to_owned(), value: 1.0, std_error: 0.1, unit: "1".to_owned() };
    let plain = |rig: &str, name: &str| {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(rig);
        CardRow::of(&p(name), None, &Rig::read(path).unwrap()).plain
    };
    assert_eq!(plain("van-der-pol.toml", "a"), "");
    assert_eq!(plain("mass-pendulum-model-file.toml", "m1"), "");
    assert_eq!(plain("chaotic.toml", "a"), "amplitude of the drive");
    assert_eq!(plain("double-pendulum-from-bodies.toml", "m1"), "mass of arm 1");
}

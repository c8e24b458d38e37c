//! The whole line with nothing plugged in.

use super::program::{done, json};

#[test]
fn the_demo_ends_with_one_report_that_puts_the_truth_beside_the_answer() {
    let folder = tempfile::tempdir().unwrap();
    let told = done(folder.path(), "demo -o out --json out.json");
    let pages: Vec<_> = std::fs::read_dir(folder.path().join("out"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|x| x == "html" || x == "htm"))
        .collect();
    assert_eq!(pages, [folder.path().join("out/report.html")]);
    let page = std::fs::read_to_string(&pages[0]).unwrap();
    assert!(page.len() < 5_000_000 && page.contains("<svg"), "{} bytes", page.len());
    // Self-contained: nothing is fetched from anywhere.
    for fetched in ["<script src", "<link ", "<img ", "@import", "url(http"] {
        assert!(!page.contains(fetched), "{fetched}");
    }
    assert!(page.matches("<sub>22</sub></td>").count() >= 2, "identified, and beside the truth");
    // The answer comes first, in the terminal and in the page: what is missing, and C2 as the model
    // with it has it.
    for text in [&told, &page] {
        let answer = text.find("The model lacks quadratic drag on arm 2").expect("the answer");
        let line = text.find("unbroken stretch").expect("what was captured");
        assert!(answer < line, "{answer} {line}");
        assert!(
            text[answer..line].contains("0.0484") || text[answer..line].contains("0.0485"),
            "{}",
            &text[answer..line]
        );
    }
    assert!(told.starts_with("The model lacks"), "{told}");
    assert!(page.contains("<math>") && page.contains("predicted by the new model"));
    // The truth stands behind everything else, with the hidden effect.
    let truth = page.find("id=\"truth\"").expect("the truth");
    assert!(page[truth..].contains("quadratic-drag@arm2") && page[truth..].contains("found − true"));
    assert!(!page[..truth].contains("found − true"));
    assert!(page[truth..].contains(">Quadratic drag on arm 2</td>"));
    // One number for one thing.
    assert_eq!(page.matches("χ²").count(), 1);
    // What to do next comes last, in the terminal and in the page.
    let next = "The next experiment: ";
    let last: Vec<&str> = told.trim_end().lines().rev().take(2).collect();
    assert!(last[0].starts_with("report: ") && last[1].starts_with(next) && last[1].contains(" Hz at "), "{last:?}");
    let setting = &last[1][next.len()..last[1].find(',').unwrap()];
    assert!(page[truth..].contains(&format!("<p>{setting}")) && !page[truth..].contains(next), "{setting}");
    let out = json(&folder.path().join("out.json"));
    assert!(
        out["plan"]["best"]["parameters"]
            .as_array()
            .is_some_and(|p| p.iter().any(|q| q["name"] == "quadratic-drag@arm2"))
    );
    let parameters = out["identify"]["parameters"].as_array().unwrap();
    let b22 = parameters.iter().find(|p| p["name"] == "B22").unwrap()["value"].as_f64().unwrap();
    assert!((b22 / 0.26317 - 1.0).abs() < 0.002, "{b22}");
    assert_eq!(out["capture"]["losses"]["received"], 60_000);
}

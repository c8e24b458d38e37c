//! docs/json.md names every key that a real result has, and every result and file has its version.

use std::collections::BTreeSet;

use serde_json::Value;
use whirl_tests::repository;

use super::program::{json, rig_file, whirl};
use super::schema;

/// Objects whose keys are names of things, not of results.
const FREE: [&str; 5] = ["known", "verdicts", "initial", "options", "std_errors"];

/// Words between backticks.
fn named() -> BTreeSet<String> {
    let page = std::fs::read_to_string(repository("docs/json.md")).unwrap();
    let code = page.split('`').skip(1).step_by(2);
    let words = code.flat_map(|c| c.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == '-')));
    words.map(str::to_owned).collect()
}

/// Paths of keys that are not named.
fn unnamed(value: &Value, path: &str, named: &BTreeSet<String>, out: &mut BTreeSet<String>) {
    match value {
        Value::Array(list) => list.iter().for_each(|v| unnamed(v, &format!("{path}[]"), named, out)),
        Value::Object(object) => {
            for (key, v) in object {
                let of_warning = ["id", "text", "advice", "invalidates"].contains(&key.as_str());
                if path.ends_with("warnings[]") && !of_warning {
                    continue;
                }
                let here = format!("{path}.{key}");
                if !named.contains(key) {
                    out.insert(here.clone());
                }
                let of_a_form = key == "parameters" && v.is_object();
                if !FREE.contains(&key.as_str()) && !of_a_form {
                    unnamed(v, &here, named, out);
                }
            }
        }
        _ => {}
    }
}

/// Results of the test below by the command whose schema they follow.
const RESULTS: [(&str, &str, &[&str]); 12] = [
    ("simulate", "simulate", &["simulate"]),
    ("simulate --model", "simulate-model", &["simulate-model"]),
    ("capture", "capture", &["capture", "planned"]),
    ("inspect", "inspect", &["inspect"]),
    ("identify", "identify", &["identify", "frequency"]),
    ("validate", "validate", &["validate"]),
    ("explain", "explain", &["explain"]),
    ("explain --ledger", "explain-ledger", &["ledger"]),
    ("reduce", "reduce", &["reduce"]),
    ("plan", "plan", &["plan"]),
    ("export", "export", &["export"]),
    ("batch", "batch", &["batch", "merge"]),
];

/// `docs/schemas` holds what the page and the results say, and the results follow it.
/// `WHIRL_BLESS=1` writes it anew.
fn schemas(at: &std::path::Path) {
    let page = schema::page(&std::fs::read_to_string(repository("docs/json.md")).unwrap());
    let folder = repository("docs/schemas");
    let mut wrong = Vec::new();
    for (command, file, names) in RESULTS {
        let path = folder.join(format!("{file}.json"));
        let before = std::fs::read(&path).ok().map(|b| serde_json::from_slice::<Value>(&b).unwrap());
        let results: Vec<Value> = names.iter().map(|n| json(&at.join(format!("{n}.json")))).collect();
        let bless = std::env::var_os("WHIRL_BLESS").is_some();
        let now =
            schema::schema(&page, command, &if bless { results.iter().collect() } else { vec![] }, before.as_ref());
        if bless {
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(&path, serde_json::to_string_pretty(&now).unwrap() + "\n").unwrap();
        }
        if before.as_ref().is_some_and(|b| *b != now) || (before.is_none() && !bless) {
            wrong.push(format!("{} is not what docs/json.md says: WHIRL_BLESS=1 writes it anew", path.display()));
        }
        results.iter().for_each(|r| schema::violations(r, &now, command, &mut wrong));
        // One that lacks a key is seen.
        let mut less = results[0].clone();
        less.as_object_mut().unwrap().remove("format");
        let mut seen = Vec::new();
        schema::violations(&less, &now, command, &mut seen);
        assert_eq!(seen.len(), 1, "{command}: {seen:?}");
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn every_key_of_real_results_stands_on_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 1.0")]);
    let named = named();
    let run =
        "frequency_hz = 5.0\namplitude_m = 0.0155\nseconds = 1.0\npose = [0.1, 0.2]\n[run.std_errors]\nC2 = 0.1\n";
    std::fs::write(at.join("short.toml"), format!("format = 1\nrig = \"x\"\n[[run]]\n{run}")).unwrap();
    for (name, command) in [
        ("simulate", "simulate --rig rig.toml --effect quadratic-drag@arm2=2e-7 --seconds 40 --seed 1 -o r.parquet"),
        ("capture", "capture --from sim --rig rig.toml --seconds 2 -o c.parquet"),
        ("inspect", "inspect r.parquet --rig rig.toml"),
        ("identify", "identify r.parquet --rig rig.toml -o model.toml"),
        ("frequency", "identify r.parquet --rig rig.toml --method frequency"),
        ("validate", "validate r.parquet --rig rig.toml --model model.toml --starts 8"),
        ("explain", "explain r.parquet --rig rig.toml --most-effects 1 --ledger ledger.json"),
        ("reduce", "reduce r.parquet --rig rig.toml"),
        ("plan", "plan --rig rig.toml --model model.toml --precise C2=0.5% --budget 2 -o plan.toml"),
        ("planned", "capture --from sim --rig rig.toml --plan short.toml -o p.parquet"),
        ("export", "export model.toml --to c -o model.c"),
        ("simulate-model", "simulate --model model.toml --seconds 1 -o s.csv"),
        ("batch", "batch identify r.parquet c.parquet --rig rig.toml --method weak --out t.csv"),
        ("merge", "batch merge t.csv --out m.csv"),
    ] {
        let run = whirl(at, &format!("{command} --json {name}.json"));
        assert!(run.status < 2, "{command}: {run:?}");
    }
    let mut missing = BTreeSet::new();
    let mut results = 0;
    for entry in std::fs::read_dir(at).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.ends_with(".json") {
            let result = json(&path);
            assert_eq!(result["format"], 1, "{name}");
            assert_eq!(result.as_object().unwrap().keys().next().unwrap(), "format", "{name}: the first key");
            unnamed(&result, &name, &named, &mut missing);
            results += 1;
        }
    }
    assert_eq!(results, 15);
    schemas(at);
    assert!(missing.is_empty(), "not in docs/json.md: {missing:#?}");
    // A word that no page would have is missed.
    unnamed(&serde_json::json!({ "no_such_key": 1 }), "", &named, &mut missing);
    assert_eq!(missing.len(), 1);
    assert!(std::fs::read_to_string(at.join("model.toml")).unwrap().starts_with("format = 1\n"));
    assert!(std::fs::read_to_string(at.join("t.csv.journal")).unwrap().starts_with("{\"format\":1,"));
}

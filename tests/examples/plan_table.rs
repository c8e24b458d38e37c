//! The table of docs/plan.md: rigs of the simulator whose first record cannot decide, what was
//! planned, and what the planned record showed.
//! `cargo run --release -p whirl-tests --example plan_table [BUDGET [FILTER]]`; FILTER is part of why
//! the first record cannot decide, or of what is hidden. Rows are told as they are done, then sorted.

use indicatif::ProgressBar;
use rayon::prelude::*;
use whirl::error::Result;
use whirl::explain::{Explanation, Settings as ExplainSettings, Verdict, explain};
use whirl::identify::model_file::identified_model;
use whirl::identify::{Settings as IdentifySettings, identify};
use whirl::plan::goals::{Goals, Tell};
use whirl::plan::{Plan, Settings, plan, presentation, rig_at};
use whirl::record::{ReadOptions, Record};
use whirl::rig::Rig;
use whirl::simulate;
use whirl_tests::repository;

/// Why the first record cannot decide, the rig, its record's length in s, the effect that is
/// hidden, and what it may be taken for.
const CASES: [(&str, &str, f64, &str, &str); 20] = [
    ("locked", "seed", 60.0, "eccentricity@encoder1=0.004", "zero-offset@encoder1"),
    ("locked", "seed", 60.0, "eccentricity@encoder2=0.004", "zero-offset@encoder2"),
    ("locked", "seed", 60.0, "zero-offset@encoder1=0.01", "eccentricity@encoder1"),
    ("locked", "seed", 60.0, "zero-offset@encoder2=0.01", "eccentricity@encoder2"),
    ("locked", "seed", 60.0, "quadratic-drag@arm2=2e-7", "viscous-friction@joint1"),
    ("locked", "seed", 60.0, "quadratic-drag@arm1=3e-6", "viscous-friction@joint1"),
    ("locked", "seed", 60.0, "viscous-friction@joint1=3e-5", "quadratic-drag@arm1"),
    ("locked", "seed", 60.0, "coulomb-friction@joint2=3e-5", "quadratic-drag@arm2"),
    ("locked", "seed", 60.0, "frame-tilt@frame=0.01", "zero-offset@encoder1"),
    ("locked", "seed", 60.0, "torsion-spring@joint1=0.002", "frame-tilt@frame"),
    ("too short", "chaotic", 6.0, "eccentricity@encoder1=0.001", "zero-offset@encoder1"),
    ("too short", "chaotic", 6.0, "zero-offset@encoder2=0.001", "eccentricity@encoder2"),
    ("too short", "chaotic", 6.0, "quadratic-drag@arm2=3e-9", "viscous-friction@joint1"),
    ("too short", "chaotic", 6.0, "viscous-friction@joint1=3e-6", "quadratic-drag@arm1"),
    ("too short", "chaotic", 6.0, "coulomb-friction@joint2=3e-6", "quadratic-drag@arm2"),
    ("too faint", "chaotic", 15.0, "eccentricity@encoder1=0.0003", "zero-offset@encoder1"),
    ("too faint", "chaotic", 15.0, "zero-offset@encoder2=0.0003", "eccentricity@encoder2"),
    ("too faint", "chaotic", 15.0, "quadratic-drag@arm2=1e-9", "viscous-friction@joint1"),
    ("too faint", "chaotic", 15.0, "viscous-friction@joint1=3e-7", "quadratic-drag@arm1"),
    ("too faint", "chaotic", 15.0, "coulomb-friction@joint2=3e-7", "quadratic-drag@arm2"),
];

/// One row.
struct Row {
    first: String,
    planned: String,
    found: String,
    right: bool,
    /// Expected over found standard error of each parameter.
    ratios: Vec<f64>,
}

fn record(rig: &Rig, effect: &str, seconds: f64, seed: u64) -> Result<Record> {
    let folder = tempfile::tempdir().expect("a folder for a record");
    let path = folder.path().join("record.parquet");
    simulate::record(rig, &[effect.to_owned()], seconds, seed, &path, &ProgressBar::hidden())?;
    Record::read(&path, rig, &ReadOptions::default())
}

/// What an explanation shows, and whether the effect is in it and not taken for its rival.
fn shown(found: &Explanation, effect: &str, rival: &str) -> (String, bool) {
    let names: Vec<String> = found.effects.iter().map(|e| format!("{}@{}", e.id, e.at)).collect();
    let clear = found
        .effects
        .iter()
        .any(|e| format!("{}@{}", e.id, e.at) == effect && !e.indistinguishable_from.iter().any(|n| n == rival));
    let text = if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
    (text, clear && names.len() == 1 && found.verdict != Verdict::NotDecidable)
}

fn planned(rig: &Rig, first: &Record, effect: &str, rival: &str, budget: usize) -> Result<Plan> {
    let model = identified_model(&identify(std::slice::from_ref(first), rig, &IdentifySettings::default())?, rig)?;
    let sized = Tell::parse(effect).expect("an effect with its size");
    let settings = Settings {
        goals: Goals { tell: vec![sized.name.clone(), rival.to_owned()], precise: Vec::new() },
        sizes: vec![sized],
        limits: Default::default(),
        record: None,
        budget,
        seed: 1,
    };
    plan(rig, &model, &settings, &|_, _| {})
}

fn row(index: usize, budget: usize) -> Result<Row> {
    let (_, name, seconds, effect, rival) = CASES[index];
    let rig = Rig::read(repository("rigs").join(format!("{name}.toml")))?;
    let id = effect.split('=').next().unwrap_or(effect);
    let seed = index as u64 + 1;
    let first = record(&rig, effect, seconds, seed)?;
    let before = explain(std::slice::from_ref(&first), &rig, &ExplainSettings::default());
    let (said, decided) = match &before {
        Ok(e) if e.verdict == Verdict::NotDecidable => ("not decidable".to_owned(), false),
        Ok(e) => shown(e, id, rival),
        Err(e) => (e.to_string(), false),
    };
    let plan = planned(&rig, &first, effect, rival, budget)?;
    let Some(best) = &plan.best else {
        return Ok(Row {
            first: said,
            planned: "nothing".into(),
            found: String::new(),
            right: false,
            ratios: Vec::new(),
        });
    };
    let there = rig_at(&rig, &best.setting)?;
    let second = record(&there, effect, best.seconds, seed + 100)?;
    let after = explain(std::slice::from_ref(&second), &there, &ExplainSettings::default())?;
    let (found, right) = shown(&after, id, rival);
    let ratio = |p: &whirl::identify::Parameter| {
        let expected = best.parameters.iter().find(|q| q.name == p.name)?;
        Some(expected.std_error / p.std_error).filter(|r| r.is_finite() && *r > 0.0)
    };
    let ratios = if right { after.parameters.iter().filter_map(ratio).collect() } else { Vec::new() };
    Ok(Row {
        first: if decided { format!("{said} (decided)") } else { said },
        planned: format!("{}, {}", presentation::setting(&best.setting), presentation::length(best.seconds)),
        found,
        right,
        ratios,
    })
}

/// A row of the table.
fn told(index: usize, row: &Result<Row>) -> String {
    let (why, name, seconds, effect, rival) = CASES[index];
    let begin = format!("| {why}, {name}, {seconds} s | {effect} | {rival} |");
    match row {
        Ok(r) => {
            let mut ratios = r.ratios.clone();
            ratios.sort_by(f64::total_cmp);
            let at = |q: f64| ratios.get((q * ratios.len() as f64) as usize).copied().unwrap_or(f64::NAN);
            let yes = if r.right { "yes" } else { "no" };
            let of = format!("{:.2} ({:.2} to {:.2})", at(0.5), at(0.0), at(0.999));
            format!("{begin} {} | {} | {} | {yes} | {of} |", r.first, r.planned, r.found)
        }
        Err(e) => format!("{begin} {e} | | | no | |"),
    }
}

fn main() {
    let budget = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(12);
    let filter = std::env::args().nth(2).unwrap_or_default();
    let chosen: Vec<usize> =
        (0..CASES.len()).filter(|&k| CASES[k].0.contains(&filter) || CASES[k].3.contains(&filter)).collect();
    let done = |k: usize| {
        let row = row(k, budget);
        eprintln!("{}", told(k, &row));
        row
    };
    let rows: Vec<_> = chosen.par_iter().map(|&k| done(k)).collect();
    println!(
        "| first record | hidden | may be taken for | it showed | planned | the planned record showed | right | expected over found standard errors |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    chosen.iter().zip(&rows).for_each(|(&k, row)| println!("{}", told(k, row)));
    let good = || rows.iter().filter_map(|r| r.as_ref().ok());
    let right = good().filter(|r| r.right).count();
    let all: Vec<f64> = good().flat_map(|r| r.ratios.iter().copied()).collect();
    let within = all.iter().filter(|r| (1.0 / 1.3..=1.3).contains(*r)).count();
    println!(
        "\n{right} of {} decided rightly; {within} of {} standard errors within a factor of 1.3",
        chosen.len(),
        all.len()
    );
}

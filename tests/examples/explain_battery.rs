//! The battery of hidden effects: how often what is hidden is what is named, and how often
//! something is named where nothing is hidden.
//! `cargo run --release -p whirl-tests --example explain_battery -- RESULTS.csv [SEEDS] [FILTER]
//! [RIG]`. `RIG` is the file of `rigs/` that explains, `chaotic.toml` unless said otherwise;
//! `double-pendulum-model-file.toml` states the same equations as a model file.
//! Results are appended as they come; what is in the file already is not run again, so that a long
//! battery may be interrupted.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::Mutex;

use rayon::prelude::*;
use whirl::explain::Verdict;
use whirl_tests::battery::{Case, Kind, Said, cases};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = arguments.first().expect("a file for the results").clone();
    let seeds: u64 = arguments.get(1).and_then(|s| s.parse().ok()).unwrap_or(1);
    let filter = arguments.get(2).cloned().unwrap_or_default();
    let rig = arguments.get(3).cloned().unwrap_or_else(|| "chaotic.toml".to_owned());
    let done: BTreeMap<String, String> = std::fs::read_to_string(&path)
        .unwrap_or_default()
        .lines()
        .filter_map(|l| l.split_once('\t').map(|(a, b)| (a.to_owned(), b.to_owned())))
        .collect();
    let all: Vec<Case> = cases(1..=seeds).into_iter().filter(|c| c.name().contains(&filter)).collect();
    let file =
        Mutex::new(std::fs::OpenOptions::new().create(true).append(true).open(&path).expect("the file can be written"));
    let lines: Vec<(Case, String)> = all
        .into_par_iter()
        .with_max_len(1)
        .map(|case| {
            let name = case.name();
            let line = done.get(&name).cloned().unwrap_or_else(|| {
                let line = line(&case, &Said::of(&case, &case.explained_by(&rig)));
                let mut file = file.lock().expect("no writer panicked");
                writeln!(file, "{name}\t{line}").expect("the file can be written");
                line
            });
            (case, line)
        })
        .collect();
    summary(&lines);
}

/// One result: verdict, score, effects named, twins of the first, gap before and after,
/// detectability, error in standard errors.
fn line(case: &Case, said: &Said) -> String {
    format!(
        "{:?}\t{}\t{}\t{}\t{:.3}\t{:.3}\t{:.2}\t{:.2}",
        said.verdict,
        score(case, said),
        said.named.join(" "),
        said.twins.join(" "),
        said.gap[0],
        said.gap[1],
        said.deviations,
        said.error_sigmas
    )
}

fn score(case: &Case, said: &Said) -> &'static str {
    let truth = case.truth();
    if truth.len() > 2 {
        return if said.verdict == Verdict::Unexplained { "right" } else { "dressed-up" };
    }
    if truth.len() == 2 {
        let found = truth.iter().filter(|t| said.named.iter().any(|n| n == *t)).count();
        return ["neither", "one", "both"][found];
    }
    match (truth.first(), said.named.first()) {
        (None, None) if said.verdict == Verdict::NothingMissing => "right",
        (None, _) => "false-alarm",
        (Some(t), Some(n)) if t == n || equivalent(t, n) => "first",
        (Some(t), Some(_)) if said.twins.iter().any(|x| x == t) => "twin",
        (Some(_), Some(_)) => "wrong",
        // An effect may lock the motion to the drive.
        (Some(_), None) if said.verdict == Verdict::NotDecidable => "not-decidable",
        (Some(_), None) => "missed",
    }
}

/// Pairs that no record tells apart: an offset of encoder 2 turns arm 2's line as an imbalance
/// does; with a Coulomb level in the joint, a level that differs with direction is that level and a
/// constant force.
fn equivalent(a: &str, b: &str) -> bool {
    [["zero-offset@encoder2", "imbalance@arm2"], ["asymmetric-friction@joint1", "constant-force@joint1"]]
        .iter()
        .any(|pair| pair.contains(&a) && pair.contains(&b))
}

fn summary(lines: &[(Case, String)]) {
    let mut groups: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    // How often an effect is named by how clearly it shows on held-out data: named first, named as
    // a twin, all.
    let mut curve = [[0_usize; 3]; EDGES.len() + 1];
    for (case, line) in lines {
        let fields: Vec<&str> = line.split('\t').collect();
        let field = |i: usize| fields.get(i).copied().unwrap_or("");
        let number = |i: usize| field(i).parse::<f64>().unwrap_or(f64::NAN);
        let kind = match case.kind {
            Kind::Driven => "",
            Kind::Driven52 => ", 5.2 Hz",
            Kind::Free => ", free",
        };
        let group = groups.entry(format!("{} counts, {} s{kind}", case.counts, case.seconds)).or_default();
        let mut count = |what: &str| *group.entry(what.to_owned()).or_default() += 1;
        if case.effects.is_empty() {
            count(if field(1) == "right" { "clean: nothing missing" } else { "clean: false alarm" });
            if field(1) != "right" {
                println!("{}  {line}", case.name());
            }
            continue;
        }
        if case.effects.len() > 1 {
            count(&format!("{}: {}", if case.effects.len() == 2 { "two hidden" } else { "nameless" }, field(1)));
            if !matches!(field(1), "both" | "right") {
                println!("{}  {line}", case.name());
            }
            continue;
        }
        if field(1) != "not-decidable" {
            let bin = EDGES.iter().filter(|e| number(6) > **e).count();
            curve[bin][0] += usize::from(field(1) == "first");
            curve[bin][1] += usize::from(field(1) == "twin");
            curve[bin][2] += 1;
        }
        let clear = if number(6) > 5.0 { "detectable" } else { "faint" };
        count(&format!("{clear}: {}", field(1)));
        if field(1) == "first" && field(0) == "Explained" {
            count(if number(5) <= 1.3 { "explained: gap <= 1.3" } else { "explained: gap > 1.3" });
        }
        if clear == "detectable" && !matches!(field(1), "first") {
            println!("{}  {line}", case.name());
        }
    }
    for (title, group) in groups {
        println!("{title}:");
        for (what, n) in group {
            println!("  {what:<28} {n}");
        }
    }
    println!("held-out gain in standard errors: named first, as a twin, of");
    for (i, [first, twin, all]) in curve.iter().enumerate() {
        let from = i.checked_sub(1).map_or("below".to_owned(), |k| EDGES[k].to_string());
        let to = EDGES.get(i).map_or("up".to_owned(), f64::to_string);
        println!("  {from:>5} … {to:<5} {first:>4} {twin:>4} {all:>4}");
    }
}

/// Edges of the curve's bins.
const EDGES: [f64; 7] = [0.0, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0];

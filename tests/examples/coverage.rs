//! The table of coverage: how often 95 % intervals of weak form and shooting hold the truth, over
//! seeded records of the chaotic rig.
//! `cargo run --release -p whirl-tests --example coverage [SEEDS] [COUNTS] [SECONDS] [weak|shooting]`

use whirl_tests::coverage::{Method, tally};

fn main() {
    let argument = |i: usize, default: f64| std::env::args().nth(i).and_then(|s| s.parse().ok()).unwrap_or(default);
    let (seeds, counts, seconds) = (argument(1, 200.0) as u64, argument(2, 4096.0) as u32, argument(3, 120.0));
    println!("{seeds} records of {seconds} s at {counts} counts a turn");
    let methods = match std::env::args().nth(4).as_deref() {
        Some("weak") => vec![Method::Weak],
        Some("shooting") => vec![Method::Shooting],
        _ => vec![Method::Weak, Method::Shooting],
    };
    for (method, all) in methods.iter().zip(tally(counts, seconds, 1..=seeds, &methods)) {
        println!(
            "\n| {method:?} | within 95 % | mean z | rms z | rms error | over Cramér–Rao |\n|---|---|---|---|---|---|"
        );
        for t in all {
            println!(
                "| {} | {:.1} % | {:+.2} | {:.2} | {:.5} % | {:.2} |",
                t.name,
                100.0 * t.share(),
                t.mean,
                t.rms,
                100.0 * t.relative,
                t.over_bound
            );
        }
    }
}

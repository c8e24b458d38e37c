//! The table of measured accuracy: 120 s of the chaotic rig at 4096 counts, 20 seeds, at 5 Hz and
//! at 5.2 Hz, where a period is no whole number of samples.
//! `cargo run --release -p whirl-tests --example identification_table [SEEDS]`

use whirl_tests::accuracy::{ALL, INDEPENDENT, coverage, table};

fn main() {
    let seeds: u64 = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(20);
    println!("| | allowed | 5 Hz: largest | rms | in σ, largest | 5.2 Hz: largest | rms | in σ, largest |");
    println!("|---|---|---|---|---|---|---|---|");
    let all = table(&[5.0, 5.2], 1..=seeds);
    for name in ALL {
        let mut line = format!("| {name} |");
        for (i, frequency) in [5.0, 5.2].into_iter().enumerate() {
            let of: Vec<_> = all.iter().filter(|c| c.name == name && c.frequency_hz == frequency).collect();
            let largest = of.iter().map(|c| c.relative()).fold(0.0, f64::max);
            let rms = (of.iter().map(|c| c.relative().powi(2)).sum::<f64>() / of.len().max(1) as f64).sqrt();
            let sigma = of.iter().map(|c| c.deviations()).fold(0.0, f64::max);
            if i == 0 {
                line += &format!(" {} % |", of.first().map_or(0.0, |c| 100.0 * c.allowed()));
            }
            line += &format!(" {:.4} % | {:.4} % | {sigma:.2} |", 100.0 * largest, 100.0 * rms);
        }
        println!("{line}");
    }
    let (comparisons, within, worst) = coverage(&all);
    println!(
        "\n{seeds} seeds at each frequency; of {comparisons} comparisons ({}) {within} ({:.2} %) lie within 3 standard errors, the farthest at {worst:.2}",
        INDEPENDENT.join(" "),
        100.0 * within as f64 / comparisons.max(1) as f64
    );
}

//! A simulated day (or as many hours as are asked for) through every kind of link fault, piece by
//! piece, each sample accounted for, and the memory that this took.
//! `cargo run --release -p whirl-tests --example soak_day [HOURS] [SEED]`

use std::time::Instant;

use whirl_tests::accuracy::chaotic_rig;
use whirl_tests::faulty::capture;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let hours: f64 = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(24.0);
    let seed: u64 = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(1);
    let begun = Instant::now();
    let account = capture(&chaotic_rig(5.0), 3600.0 * hours, seed);
    let l = &account.outcome.losses;
    println!("device time          {hours} h, wall time {:.0} s", begun.elapsed().as_secs_f64());
    println!("most memory          {}", peak().unwrap_or_else(|| "not known here".to_owned()));
    println!("ticks                {}", account.ticks);
    println!("received + missing   {} + {}", l.received, l.lost());
    println!("came too late        {}", l.dropped_late);
    println!("links lost           {}", account.outcome.reconnections);
    println!("ticks on which the capture and the fault injector disagree: {}", account.disagreements);
    if l.received + l.lost() != account.ticks || account.disagreements > 0 {
        std::process::exit(1);
    }
}

/// The most memory that this process has held, where the system tells.
fn peak() -> Option<String> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    Some(status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().to_owned())
}

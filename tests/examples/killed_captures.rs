//! Two hundred captures (or as many as are asked for) killed at random moments, made records, and
//! resumed.
//! `cargo build -p whirl-cli && cargo run -p whirl-tests --example killed_captures [COUNT] [SEED]`

use std::time::Instant;

use rayon::prelude::*;
use whirl_tests::killed::Whole;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let count: u64 = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(200);
    let seed: u64 = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(1);
    let own = std::env::current_exe().expect("a path");
    let program = own.ancestors().nth(2).expect("target/PROFILE").join("whirl");
    assert!(program.exists(), "{} is not there: cargo build -p whirl", program.display());
    let whole = Whole::new(&program, 30.0);
    let begun = Instant::now();
    let left: Vec<_> = (0..count).into_par_iter().map(|i| whole.kill(seed * 1_000_000 + i)).collect();
    let number = |f: &dyn Fn(&whirl_tests::killed::Killed) -> bool| left.iter().filter(|k| f(k)).count();
    println!("killed captures                      {count} in {:.0} s", begun.elapsed().as_secs_f64());
    println!("before their journal was begun       {}", number(&|k| k.journal == 0 && !k.ended));
    println!("with a journal without a sample      {}", number(&|k| k.journal > 0 && k.samples == 0));
    println!("with samples, made a record, resumed {}", number(&|k| k.samples > 0));
    println!("behind their end                     {}", number(&|k| k.ended));
    println!("samples journalled, all in records   {}", left.iter().map(|k| k.samples).sum::<usize>());
}

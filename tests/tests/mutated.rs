//! Mutated inputs of every kind: each ends in an answer or in an error of one line, in bounded time
//! and memory, without a panic.
//!
//! 500 seeds a kind; `WHIRL_SEEDS=20000` tries as many (from `WHIRL_FIRST_SEED` on). What fails
//! says its seed. The same entries stand behind the targets in `fuzz/`, which need a nightly
//! toolchain.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use faer::{Mat, Par};
use peak_alloc::PeakAlloc;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use whirl_tests::mutation_samples::Samples;
use whirl_tests::mutation_targets::{Bench, Depth, Input};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Memory that an input of at most some 300 kB may take beside what was taken before, MB.
const MEMORY_MB: f32 = 300.0;
/// Guard against hangs, far above what the slowest input takes on a busy machine.
const HANG: Duration = Duration::from_secs(90);
/// Of the records that are read, one in so many is inspected and identified as well.
const ANALYSED: u64 = 25;

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).map_or(otherwise, |text| text.parse().expect("a number"))
}

/// The input that is being tried, and since when.
static TRIED: Mutex<Option<(String, Instant)>> = Mutex::new(None);

/// Ends the program where an input takes too long: a thread that hangs cannot be ended.
fn guard(over: &AtomicBool) {
    while !over.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(200));
        if let Some((what, since)) = TRIED.lock().expect("no panic while it is held").as_ref()
            && since.elapsed() > HANG
        {
            eprintln!("{what} has not ended after {HANG:?}");
            std::process::exit(101);
        }
    }
}

/// Lets every thread have the room that its products of matrices work in, so that no input is
/// charged with it: faer keeps addresses for twice the processor's last cache for each thread, of
/// which it touches what a product needs (960 MB where a machine tells a cache of 480 MB).
fn keep_room_for_products() {
    let product = || {
        let mut out = Mat::<f64>::zeros(64, 64);
        let factor = Mat::<f64>::identity(64, 64);
        faer::linalg::matmul::matmul(&mut out, faer::Accum::Replace, &factor, &factor, 1.0, Par::Seq);
        assert!(out == factor, "a product with the identity");
    };
    product();
    rayon::broadcast(|_| product());
}

/// Tries seeds of one kind; what was wrong. Read and refused ones are counted.
fn replay(bench: &Bench, samples: &Samples, input: Input, seeds: std::ops::Range<u64>) -> (Vec<String>, [usize; 2]) {
    let (mut wrong, mut counts) = (Vec::new(), [0; 2]);
    let mut slowest = (Duration::ZERO, 0);
    let mut largest: (f32, u64) = (0.0, 0);
    for seed in seeds {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let bytes = samples.spoilt(input, &mut rng);
        let depth = Depth { recover: seed % 3 == 0, analyse: seed % ANALYSED == 0 };
        let start = Instant::now();
        *TRIED.lock().expect("no panic while it is held") = Some((format!("{input:?}, seed {seed}"), start));
        let before = MEMORY.current_usage_as_mb();
        MEMORY.reset_peak_usage();
        let ended = catch_unwind(AssertUnwindSafe(|| bench.check(input, &bytes, depth)));
        let took = MEMORY.peak_usage_as_mb() - before;
        slowest = slowest.max((start.elapsed(), seed));
        if took > largest.0 {
            largest = (took, seed);
        }
        match ended {
            Ok(read) => counts[usize::from(!read)] += 1,
            Err(panic) => {
                let text = panic.downcast_ref::<String>().cloned();
                let text = text.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).to_owned())).unwrap_or_default();
                wrong.push(format!("{input:?}, seed {seed}: {text}"));
            }
        }
        if took > MEMORY_MB {
            wrong.push(format!("{input:?}, seed {seed}: {took} MB"));
        }
    }
    *TRIED.lock().expect("no panic while it is held") = None;
    println!(
        "{input:?}: {} read, {} refused; slowest {:.2?} (seed {}), most memory {:.1} MB (seed {})",
        counts[0], counts[1], slowest.0, slowest.1, largest.0, largest.1
    );
    (wrong, counts)
}

#[test]
fn every_mutated_input_ends_in_an_answer_or_in_one_line() {
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| guard(&over));
        // Panics are told below, with their seed.
        let ended = catch_unwind(|| {
            keep_room_for_products();
            let bench = Bench::new();
            let samples = Samples::new(&bench);
            let first = number("WHIRL_FIRST_SEED", 0);
            let last = first + number("WHIRL_SEEDS", 500);
            let mut wrong = Vec::new();
            for input in Input::ALL {
                let mut rng = ChaCha8Rng::seed_from_u64(0);
                let whole = samples.whole(input, &mut rng);
                if input != Input::Frames && !bench.check(input, &whole, Depth::default()) {
                    wrong.push(format!("{input:?}: the whole input is refused"));
                }
                let (more, [read, refused]) = replay(&bench, &samples, input, first..last);
                wrong.extend(more);
                // Mutations that are all refused, or all read, try nothing.
                let least = ((last - first) / 100) as usize;
                if !matches!(input, Input::Decoder | Input::Console) && (read < least || refused < least) {
                    wrong.push(format!("{input:?}: {read} read and {refused} refused"));
                }
            }
            wrong
        });
        over.store(true, Ordering::Relaxed);
        let wrong = ended.expect("the samples can be made");
        assert!(wrong.is_empty(), "{}:\n{}", wrong.len(), wrong.join("\n"));
    });
}

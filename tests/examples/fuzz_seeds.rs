//! Writes whole inputs for the fuzz targets to start from, into `fuzz/corpus/TARGET/`.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use whirl_tests::mutation_samples::Samples;
use whirl_tests::mutation_targets::{Bench, Input};
use whirl_tests::repository;

fn main() -> std::io::Result<()> {
    let samples = Samples::new(&Bench::new());
    for input in Input::ALL {
        let folder = repository("fuzz/corpus").join(input.name());
        std::fs::create_dir_all(&folder)?;
        // Some kinds have several.
        for seed in 0..8 {
            let whole = samples.whole(input, &mut ChaCha8Rng::seed_from_u64(seed));
            std::fs::write(folder.join(seed.to_string()), whole)?;
        }
    }
    Ok(())
}

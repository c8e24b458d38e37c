//! End-to-end tests over the whole line, from encoder edges to the report: what the tests in
//! `tests/` and the longer runs in `examples/` share.
//!
//! | module | what |
//! |---|---|
//! | [`accuracy`] | simulated records of the chaotic rig, identified, beside the truth |
//! | [`battery`] | records in which an effect is hidden, explained |
//! | [`coverage`] | how often intervals hold the truth, over seeded records |
//! | [`faulty`] | a capture through every kind of link fault, held against the link's own account |
//! | [`killed`] | captures that are killed at any moment, made records, and resumed |
//! | [`mutation`] | inputs spoilt on purpose |
//! | [`mutation_targets`] | whatever takes bytes from outside: entries for replays of mutated inputs and for the fuzz targets |
//! | [`mutation_samples`] | an input of every kind that is whole |

pub mod accuracy;
pub mod battery;
pub mod coverage;
pub mod faulty;
pub mod killed;
pub mod mutation;
pub mod mutation_samples;
pub mod mutation_targets;

use std::path::PathBuf;

/// A file or folder of the repository.
pub fn repository(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

//! Any text as a model file and as a saved model with effects.
#![no_main]

use whirl_tests::mutation_targets::{Input, one};

libfuzzer_sys::fuzz_target!(|data: &[u8]| one(Input::Model, data));

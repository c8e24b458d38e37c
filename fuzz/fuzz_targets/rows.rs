//! Any bytes as a record of regression rows, identified where it is read.
#![no_main]

use whirl_tests::mutation_targets::{Input, one};

libfuzzer_sys::fuzz_target!(|data: &[u8]| one(Input::Rows, data));

//! Any bytes as the wire's, or a journal, from which a record is made.
#![no_main]

use whirl_tests::mutation_targets::{Input, one};

libfuzzer_sys::fuzz_target!(|data: &[u8]| one(Input::Frames, data));

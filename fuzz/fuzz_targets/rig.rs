//! Any text as a rig file; one that can be simulated is, for a moment.
#![no_main]

use whirl_tests::mutation_targets::{Input, one};

libfuzzer_sys::fuzz_target!(|data: &[u8]| one(Input::Rig, data));

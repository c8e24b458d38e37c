//! Any bytes to the firmware between its ticks: the base stays within its limits, and what is sent
//! decodes.
#![no_main]

use whirl_tests::mutation_targets::{Input, one};

libfuzzer_sys::fuzz_target!(|data: &[u8]| one(Input::Console, data));

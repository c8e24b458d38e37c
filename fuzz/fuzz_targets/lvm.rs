//! Any bytes as a record as LabVIEW writes it.
#![no_main]

use whirl_tests::mutation_targets::{Input, one};

libfuzzer_sys::fuzz_target!(|data: &[u8]| one(Input::Lvm, data));

//! Any bytes as a record as HDF5.
#![no_main]

use whirl_tests::mutation_targets::{Input, one};

libfuzzer_sys::fuzz_target!(|data: &[u8]| one(Input::Hdf5, data));

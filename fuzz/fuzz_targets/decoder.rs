//! Any bytes to both decoders of the wire: every byte accounted for, whatever decodes encodes
//! again.
#![no_main]

use whirl_tests::mutation_targets::{Input, one};

libfuzzer_sys::fuzz_target!(|data: &[u8]| one(Input::Decoder, data));

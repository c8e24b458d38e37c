//! Feeds the decoders a given number of good, damaged and random bytes, half of them in each
//! direction.
//!
//! ```text
//! cargo run --release -p whirl-shared --example decoder_torture -- [BYTES] [SEED]
//! ```
//!
//! Ends with exit status 0 and an account where every byte was accounted for and every intact frame
//! came out as it was sent; panics otherwise. The same seed gives the same digest on every machine.

#[path = "../tests/support/mod.rs"]
mod support;

use std::process::ExitCode;
use std::time::Instant;

use support::{Source, torture};
use whirl_shared::frame::{DeviceMessage, HostMessage};

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u64| match arguments.next() {
        None => Some(default),
        Some(text) => text.replace('_', "").parse().ok(),
    };
    let (Some(bytes), Some(seed)) = (number(100_000_000), number(1)) else {
        eprintln!("usage: decoder_torture [BYTES] [SEED], both whole numbers");
        return ExitCode::from(2);
    };
    let start = Instant::now();
    let device = torture::<DeviceMessage>(seed, bytes.div_ceil(2), Source::device);
    let host = torture::<HostMessage>(seed.wrapping_add(1), bytes.div_ceil(2), Source::host);
    for (name, account) in [("device → host", device), ("host → device", host)] {
        println!(
            "{name}: {} bytes, intact frames {} of {}, other good frames {}, bad frames {}, digest {:016x}",
            account.bytes,
            account.intact_received,
            account.intact_sent,
            account.others_received,
            account.bad,
            account.digest
        );
        assert_eq!(account.intact_sent, account.intact_received, "an intact frame was lost");
    }
    println!("{:.1} s", start.elapsed().as_secs_f64());
    ExitCode::SUCCESS
}

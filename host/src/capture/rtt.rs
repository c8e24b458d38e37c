//! `rtt[:CHIP]`: the stream through a debug probe. It needs the probe library, which this build is without.

use super::source::{SourceKind, bad};

pub(super) const KIND: SourceKind = SourceKind {
    id: "rtt",
    form: "rtt[:CHIP]",
    about: "through a debug probe (needs a build with --features probe)",
    parse: |argument, _| {
        Err(bad(
            &argument.map_or("rtt".to_owned(), |chip| format!("rtt:{chip}")),
            "a whirl built with --features probe",
        )
        .remedy("Build it with `cargo build --release --features probe`, or use serial:/dev/ttyACM0"))
    },
};

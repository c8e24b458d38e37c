//! `sim`: the rig of `[plant]`, simulated, with the firmware's own logic in lock-step, over an in-process pipe.

use super::source::{SourceKind, bad};

pub(super) const KIND: SourceKind = SourceKind {
    id: "sim",
    form: "sim",
    about: "the simulated rig of [plant] (feature sim)",
    parse: |_, _| Err(bad("sim", "a whirl built with --features sim").remedy("Build it with `cargo build --release`")),
};

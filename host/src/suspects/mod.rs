//! What a record or its rig file seems to have wrong.

pub mod equations;

//! The ledger: everything from which an explanation can be audited and repeated, as JSON.
//!
//! Program and version, rig file as text, every record with its length and the CRC-32 of its
//! samples' bytes, choices, windows and low-pass, the sensors' noise, every candidate of every step
//! with its held-out gain and probability, and the result. Thresholds are constants of the program:
//! its version says which.

use serde::Serialize;
use serde_json::{Value, json};

use super::{Explanation, Settings};
use crate::record::{Column, Record};
use crate::rig::Rig;

/// The ledger of an explanation.
pub fn ledger(records: &[Record], rig: &Rig, settings: &Settings, result: &Explanation) -> Value {
    let records: Vec<Value> = records
        .iter()
        .map(|r| {
            json!({
                "file": r.path.display().to_string(),
                "samples": r.samples(),
                "lost": r.losses.lost(),
                "segments": r.segments.len(),
                "crc32": format!("{:08x}", checksum(r)),
            })
        })
        .collect();
    json!({
        "format": crate::files::FORMAT,
        "program": concat!("whirl ", env!("CARGO_PKG_VERSION")),
        "command": "explain",
        "rig": { "file": rig.path.display().to_string(), "text": rig.text },
        "records": records,
        "settings": value(settings),
        "details": value(&result.details),
        "candidates": value(&result.ranking),
        "result": value(result),
    })
}

fn value(x: &impl Serialize) -> Value {
    // Our own types hold nothing that JSON cannot.
    serde_json::to_value(x).unwrap_or(Value::Null)
}

/// CRC-32 (ISO-HDLC) over the samples of all columns, little-endian.
pub fn checksum(record: &Record) -> u32 {
    let crc = flate2::Crc::new();
    let crc = record.segments.iter().fold(crc, |mut crc, s| {
        crc.update(&s.start_s.to_le_bytes());
        for column in &s.columns {
            match column {
                Column::Counts(c) => c.iter().for_each(|v| crc.update(&v.to_le_bytes())),
                Column::Values(v) => v.iter().for_each(|v| crc.update(&v.to_le_bytes())),
            }
        }
        crc
    });
    crc.sum()
}

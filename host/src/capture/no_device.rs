//! What to tell about a wire on which no device is heard, or no longer.

use std::time::Duration;

use crate::error::BadInput;

/// Bytes and frames since the link was last good.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heard {
    pub(super) bytes: u64,
    pub(super) bad: u64,
    /// Frames with a right checksum that are no message of this version.
    pub(super) foreign: u64,
}

/// What is known of a wire.
pub(super) struct Wire<'a> {
    /// The source, as named.
    pub(super) from: &'a str,
    /// Whether the link is open.
    pub(super) open: bool,
    /// Bytes since the start.
    pub(super) bytes: u64,
    pub(super) heard: Heard,
    /// A hello came that no command of this session had asked for.
    pub(super) old_hello: bool,
    /// Why the link was lost, or could not be opened.
    pub(super) lost_because: &'a str,
    /// What the source advises.
    pub(super) remedy: String,
}

impl Wire<'_> {
    /// The error where no hello came within some seconds.
    pub(super) fn no_hello(&self, s: f64) -> BadInput {
        let h = self.heard;
        let error = |found: String, remedy: &str| {
            BadInput::new(found, "a device's hello").in_file(self.from).at("handshake").remedy(remedy)
        };
        if !self.open {
            return error(format!("no connection after {s:.1} s ({})", self.lost_because), &self.remedy);
        }
        if self.bytes == 0 {
            return error(
                format!("no byte in {s:.1} s"),
                "See that the device has power and runs whirl's firmware, and that this is its port",
            );
        }
        if self.old_hello {
            return error(
                format!("a hello that answers nothing in {s:.1} s"),
                "The device sends but does not hear, or the link gives back what it held: look at the line from host to device, restart the device",
            );
        }
        if h.bad == 0 && h.bytes < self.bytes {
            return error(
                format!("good frames but no hello in {s:.1} s"),
                "The device sends but does not hear: look at the line from host to device",
            );
        }
        if h.foreign > 0 && h.foreign * 2 > h.bad {
            return error(
                format!("{} frames of another protocol version in {s:.1} s", h.foreign),
                "Flash the firmware that belongs to this whirl: `whirl flash`",
            );
        }
        error(
            format!("noise: {} bytes in {s:.1} s, {} damaged frames and no good one", self.bytes, h.bad),
            "See to the baud rate (serial:PORT@BAUD), the port, and that the device runs whirl's firmware",
        )
    }

    /// The error where a device is there and brings nothing new.
    pub(super) fn stalled(&self, lasts: Duration) -> BadInput {
        let error = BadInput::new(
            format!("no new sample for {:.1} s from a device that still sends", lasts.as_secs_f64()),
            "new samples within --reconnect-s",
        );
        error
            .in_file(self.from)
            .remedy("Look at the device's log and load, and restart it: it answers, but does not sample")
    }

    /// The error where a link did not come back.
    pub(super) fn lost(&self, down: Duration, reconnect_s: f64) -> BadInput {
        let (s, h) = (down.as_secs_f64(), self.heard);
        let found = if self.open && h.bytes > 0 {
            format!("a link lost for {s:.1} s (noise: {} bytes, {} damaged frames)", h.bytes, h.bad)
        } else {
            format!("a link lost for {s:.1} s ({})", self.lost_because)
        };
        BadInput::new(found, format!("the device back within {reconnect_s} s (--reconnect-s)"))
            .in_file(self.from)
            .remedy(self.remedy.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Noise is told only of an open link on which there was some.
    #[test]
    fn a_lost_link_is_told_with_what_was_heard() {
        let told = |open: bool, bytes: u64| {
            let heard = Heard { bytes, bad: 3, foreign: 0 };
            let wire = Wire {
                from: "serial:x",
                open,
                bytes,
                heard,
                old_hello: false,
                lost_because: "the stream ended",
                remedy: "Look at the plug".to_owned(),
            };
            wire.lost(Duration::from_millis(2500), 5.0).to_string()
        };
        assert!(told(true, 7).contains("lost for 2.5 s (noise: 7 bytes, 3 damaged frames)"), "{}", told(true, 7));
        for quiet in [told(true, 0), told(false, 7)] {
            assert!(
                quiet.contains("lost for 2.5 s (the stream ended)") && quiet.contains("5 s (--reconnect-s)"),
                "{quiet}"
            );
        }
    }
}

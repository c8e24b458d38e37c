//! A device's boots, as its hellos tell them: what ended the one before, and which zero its counts
//! have.
//!
//! An encoder counts from a zero that is known by its id: the same id, in whatever boot, is the
//! same zero, and counts that have it belong together. After a reset by the watchdog an arm that
//! rested keeps its zero; after power-on every zero is another.

use serde::{Deserialize, Serialize};
use whirl_shared::frame::{Hello, ResetCause, Zero, ZeroSource};

use crate::error::plain;

/// A boot of the device of which samples are in the record.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct DeviceBoot {
    /// Tick of the record at which its samples begin.
    pub tick: i64,
    /// Its id, another one at every boot; where it is the one before's, the ticks went back under
    /// it.
    pub boot_id: u32,
    /// What ended the boot before: `unknown`, `power`, `pin`, `software`, `watchdog` or `panic`.
    pub reset: String,
    /// The text of that panic.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub panic: String,
    /// Where each encoder's zero is from.
    pub zeros: Vec<EncoderZero>,
}

/// An encoder's zero.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct EncoderZero {
    /// The same id, in whatever boot, is the same zero.
    pub id: u32,
    /// `power-up`, `command`, or `carried` over a reset in which the arm turned.
    pub from: String,
    /// Count within a turn at which the encoder's index mark was first seen since the zero was set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub index: Option<u32>,
}

/// What ended a boot: as records and JSON have it, and for people.
pub fn reset_words(cause: ResetCause) -> (&'static str, &'static str) {
    match cause {
        ResetCause::Unknown => ("unknown", "a reset whose cause the board does not tell"),
        ResetCause::Power => ("power", "the power came"),
        ResetCause::Pin => ("pin", "its reset pin was pulled"),
        ResetCause::Software => ("software", "it was told to restart"),
        ResetCause::Watchdog => ("watchdog", "its watchdog reset it"),
        ResetCause::Panic => ("panic", "its firmware failed"),
    }
}

/// Where a zero is from, in a word.
pub fn zero_word(zero: &Zero) -> &'static str {
    match zero.source {
        ZeroSource::PowerUp => "power-up",
        ZeroSource::Commanded => "command",
        ZeroSource::Carried => "carried",
    }
}

impl DeviceBoot {
    /// The boot that a hello tells of, with samples from a tick of the record on.
    pub fn of(hello: &Hello, tick: i64) -> Self {
        let zero = |zero: &Zero| EncoderZero { id: zero.id, from: zero_word(zero).to_owned(), index: zero.index };
        Self {
            tick,
            boot_id: hello.boot_id,
            reset: reset_words(hello.reset).0.to_owned(),
            panic: hello.panic.as_str().to_owned(),
            zeros: hello.zeros.iter().map(zero).collect(),
        }
    }

    /// Whether the first so many encoders count from the same zeros as in another boot. Ids of boots
    /// that have one boot id tell nothing: they were drawn from it again.
    pub fn has_zeros_of(&self, other: &Self, encoders: usize) -> bool {
        if self.is_again(other) {
            return false;
        }
        let pairs = || self.zeros.iter().zip(&other.zeros).take(encoders);
        pairs().count() == encoders.min(self.zeros.len())
            && pairs().all(|(a, b)| a.id == b.id)
            && !self.zeros.is_empty()
    }

    /// Whether this is another boot with the same boot id.
    fn is_again(&self, other: &Self) -> bool {
        self.boot_id == other.boot_id && self.tick != other.tick
    }

    /// What ended the boot before, in a word, with a panic's text.
    fn cause(&self) -> String {
        match (self.reset.as_str(), self.panic.is_empty()) {
            ("" | "unknown", true) => "for a reason that it does not tell".to_owned(),
            (reset, true) => plain(reset),
            (reset, false) => format!("{} \"{}\"", plain(reset), plain(&self.panic)),
        }
    }

    /// What a restart was and what became of the counts, after a boot before: one line.
    pub fn after(&self, before: &Self) -> String {
        if self.is_again(before) {
            return "its ticks began again under the same boot id, so that nothing tells whether its counts have the \
                    same zero: they are taken to have another one"
                .to_owned();
        }
        let counts = if self.has_zeros_of(before, self.zeros.len()) {
            "its counts were kept"
        } else if self.zeros.iter().any(|zero| zero.from == "carried") {
            "its arms turned meanwhile: its counts have another zero now"
        } else {
            "its counts began anew, from another zero"
        };
        format!("{}; {counts}", self.cause())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restart_is_told_with_its_cause_and_what_became_of_the_counts() {
        let zero = |id, source| Zero { id, source, index: None };
        let mut hello = Hello { zeros: [zero(7, ZeroSource::Commanded); 2].into(), ..Hello::default() };
        let before = DeviceBoot::of(&hello, 0);
        hello.reset = ResetCause::Watchdog;
        hello.boot_id = 1;
        assert_eq!(DeviceBoot::of(&hello, 9).after(&before), "watchdog; its counts were kept");
        hello.zeros[1] = zero(8, ZeroSource::Carried);
        let turned = DeviceBoot::of(&hello, 9);
        assert_eq!(turned.after(&before), "watchdog; its arms turned meanwhile: its counts have another zero now");
        // Of encoder 1 alone the zero is the same.
        assert!(turned.has_zeros_of(&before, 1) && !turned.has_zeros_of(&before, 2));
        hello.zeros = [zero(9, ZeroSource::PowerUp); 2].into();
        hello.reset = ResetCause::Panic;
        hello.panic = heapless::String::try_from("index out of bounds\u{1b}[2J").unwrap();
        assert_eq!(
            DeviceBoot::of(&hello, 9).after(&before),
            "panic \"index out of bounds\\u{1b}[2J\"; its counts began anew, from another zero"
        );
        // Its boot id and with it the zeros' ids came again.
        let mut again = before.clone();
        again.tick = 9;
        assert!(!again.has_zeros_of(&before, 2) && before.has_zeros_of(&before, 2));
        assert!(again.after(&before).contains("same boot id"), "{}", again.after(&before));
        // A record that does not tell zeros.
        assert!(!DeviceBoot::default().has_zeros_of(&DeviceBoot::default(), 2));
    }
}

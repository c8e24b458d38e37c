//! A quadrature decoder in a PIO state machine: every edge counts one, up or down, in 32 bits;
//! nothing is asked of the processor.
//!
//! A and B are two pins in a row. With s = A + 2B the pair goes through 0, 1, 3, 2, 0 when the
//! encoder turns up: four counts a line. The program keeps the count in Y and the last pair in OSR.
//! It jumps into a table of sixteen entries by the last pair and the new one; a pair in which both
//! lines have changed at once cannot come from one edge, and moves nothing. After each look at the
//! pins the count goes to entry 0 of the RX FIFO, which the processor may read at any time (RP2350
//! datasheet, 11.4.8: "for example a quadrature decoder"), and to entry 1 as long as the index's
//! pin is high: there the count stands that the encoder had when it left the mark.
//!
//! A round takes 8 to 13 cycles. At [`DIVIDER`] that is 1.3 µs at most: 187 turns a second at 4096
//! counts, nine times what the rig turns. There is no filter: a line that spikes and returns counts
//! one up and one down, whatever is seen of it.

use pio::{Program, pio_asm};

/// Instructions that a PIO holds.
pub const LENGTH: usize = 32;
/// The state machine's clock is the processor's by this: 10 MHz of 150.
pub const DIVIDER: u8 = 15;
/// Entry of the RX FIFO in which the count stands.
pub const COUNT: usize = 0;
/// Entry of the RX FIFO in which the count stands that was last seen within the index's mark.
pub const MARK: usize = 1;

/// The program. It must lie at address 0, shift in to the left and out to the right, and have the
/// RX FIFO as status.
#[must_use]
pub fn program() -> Program<LENGTH> {
    pio_asm!(
        ".origin 0",
        // The last pair 0, the new one 0, 1, 2, 3.
        "jmp same",
        "jmp up",
        "jmp down",
        "jmp same",
        // The last pair 1.
        "jmp down",
        "jmp same",
        "jmp same",
        "jmp up",
        // The last pair 2.
        "jmp up",
        "jmp same",
        "jmp same",
        "jmp down",
        // The last pair 3.
        "jmp same",
        "jmp down",
        "jmp up",
        "jmp same",
        "down:",
        "jmp y--, same",
        ".wrap_target",
        "same:",
        "mov isr, y",
        "mov rxfifo[0], isr",
        "jmp pin, marked",
        "look:",
        "out isr, 2",
        "in pins, 2",
        "mov osr, isr",
        "mov pc, isr",
        "marked:",
        "mov rxfifo[1], isr",
        "jmp look",
        "up:",
        // One more is the complement of one less of the complement.
        "mov y, ~y",
        "jmp y--, back",
        "back:",
        "mov y, ~y",
        ".wrap",
    )
    .program
}

/// What is to be executed before the program: the count is zero, and the last pair is the present
/// one.
#[must_use]
pub fn start() -> Program<LENGTH> {
    pio_asm!("set y, 0", "mov isr, null", "in pins, 2", "mov osr, isr").program
}

/// What the processor makes of the index: a count once for every time that the encoder has left its
/// mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark {
    told: u32,
}

impl Mark {
    /// Entry [`MARK`] holds this now.
    #[must_use]
    pub const fn new(entry: u32) -> Self {
        Self { told: entry }
    }

    /// The count at which the mark was left since this was last asked, modulo 2¹⁶; none as long as
    /// the encoder is within it. A line that is not wired is pulled up, as if it never left. The
    /// entry is to be read before the pin.
    pub fn left(&mut self, entry: u32, high: bool) -> Option<u16> {
        if high || entry == self.told {
            return None;
        }
        self.told = entry;
        Some(entry as u16)
    }
}

#[cfg(test)]
mod tests;

//! Why the chip was reset, of what it tells: the watchdog's reason, a word that lasts over resets
//! from within, and the power manager's flags.
//!
//! The flags tell of the last reset of the whole chip, and stay as they are over resets from
//! within; so does the word, which power, the RUN pin and brown-outs clear (RP2350 datasheet,
//! 12.9.5 and 7.3). The boot ROM's own restarts (after an image has been dropped on its drive) look
//! like ours but for the word: arms may have turned meanwhile, so that nothing is believed to have
//! lasted.

use whirl_shared::frame::ResetCause;

/// The word of a board that runs.
pub const RUNNING: u32 = 0x7768_6972;
/// The word of a board that restarts itself.
pub const RESTARTING: u32 = 0x7768_6973;

/// What the chip tells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Told {
    /// The word as it was found.
    pub word: u32,
    /// The watchdog ran out.
    pub timer: bool,
    /// The watchdog was told to reset.
    pub force: bool,
    /// The whole chip was reset by power-on or a brown-out.
    pub power: bool,
    /// By the RUN pin.
    pub run_pin: bool,
}

/// The cause.
#[must_use]
pub const fn cause(told: &Told) -> ResetCause {
    match *told {
        Told { word: RUNNING, timer: true, .. } => ResetCause::Watchdog,
        Told { word: RESTARTING, force: true, .. } => ResetCause::Software,
        // A debugger's reset, or the boot ROM's.
        Told { word: RUNNING | RESTARTING, .. } | Told { timer: true, .. } | Told { force: true, .. } => {
            ResetCause::Unknown
        }
        Told { power: true, .. } => ResetCause::Power,
        Told { run_pin: true, .. } => ResetCause::Pin,
        Told { .. } => ResetCause::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whirl_firmware::zero::keeps_memory;

    #[test]
    fn each_way_to_a_boot_has_its_cause() {
        // The flag of power-on stays set over all that follow it.
        let power = Told { power: true, ..Told::default() };
        let running = Told { word: RUNNING, ..power };
        for (told, want) in [
            (power, ResetCause::Power),
            (Told { run_pin: true, ..Told::default() }, ResetCause::Pin),
            (Told { timer: true, ..running }, ResetCause::Watchdog),
            (Told { word: RESTARTING, force: true, ..power }, ResetCause::Software),
            // A debugger's reset clears the watchdog's reason.
            (running, ResetCause::Unknown),
            // An image was dropped on the boot ROM's drive, which was reached by power or RUN.
            (Told { force: true, ..power }, ResetCause::Unknown),
            (Told { timer: true, ..power }, ResetCause::Unknown),
            // The boot ROM was reached by a restart of somebody else's making.
            (Told { force: true, ..running }, ResetCause::Unknown),
            (Told::default(), ResetCause::Unknown),
        ] {
            assert_eq!(cause(&told), want, "{told:?}");
            let ours = matches!(want, ResetCause::Watchdog | ResetCause::Software);
            assert_eq!(keeps_memory(want), ours);
        }
    }
}

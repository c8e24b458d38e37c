//! What only the chip can tell of this boot: its own number, and why it was reset.

use embassy_stm32::pac;
use whirl_board_lasting as lasting;
use whirl_firmware::settings::Boot;
use whirl_shared::frame::ResetCause;

/// The id of this boot. To be called once, before anything else runs.
pub fn id() -> u32 {
    lasting::boot_id(embassy_stm32::uid::uid())
}

/// Why the chip was reset. The flags are cleared, so that the next reset shows its own. A reset
/// from within pulls the pin too, and power sets more than its own flag: the order decides.
fn cause() -> ResetCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    pac::RCC.csr().modify(|w| w.set_rmvf(false));
    #[cfg(chip = "g474re")]
    let (power, watchdog, pin) = (flags.borrstf(), flags.iwdgrstf(), flags.pinrstf());
    #[cfg(chip = "f446re")]
    let (power, watchdog, pin) = (flags.porrstf() || flags.borrstf(), flags.wdgrstf(), flags.padrstf());
    if power {
        ResetCause::Power
    } else if watchdog || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.sftrstf() {
        ResetCause::Software
    } else if pin {
        ResetCause::Pin
    } else {
        ResetCause::Unknown
    }
}

/// What came before. To be called once, before the tick runs.
pub fn before() -> Boot {
    lasting::before(Some(cause()))
}

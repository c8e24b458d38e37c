//! What happens when nothing can go on: the plant is told that the shaker is silent, then the
//! emulation ends, or, where a test wants it, the machine is reset as a watchdog does it.

use core::fmt::Write;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use whirl_board_lasting::{Panicked, tell_once};
use whirl_board_mps2_an386::semihosting;

use crate::plant;

/// Whether a panic ends in a reset.
pub static RESETS: AtomicBool = AtomicBool::new(false);

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    let resets = RESETS.load(Relaxed);
    // Where the board comes back, its first request says the same.
    if !resets {
        plant::last_words();
    }
    tell_once(&Panicked(info), |cause| {
        // The emulation ends in any case.
        let _ = writeln!(semihosting::Console, "{cause}");
    });
    if resets {
        cortex_m::peripheral::SCB::sys_reset();
    }
    semihosting::exit(false)
}

/// A fault of the processor ends as a panic does.
// The attribute makes the function unsafe to be called by others; nobody does.
#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    panic!("hard fault at {:#010x}", frame.pc());
}

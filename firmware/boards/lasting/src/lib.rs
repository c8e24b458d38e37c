//! What lasts over a reset of a board, in memory that nothing initialises: the boot's id, both
//! counts, a panic's text.
//!
//! After power-on such memory holds the noise of its cells, after a reset what was there. What is
//! kept in it goes by the checksums of [`whirl_firmware::kept`]. One place for all boards: they
//! differ in how they tell why they were reset, and in what makes a boot's id differ from
//! another's.
#![no_std]

#[cfg(test)]
extern crate std;

use core::fmt;
use core::panic::PanicInfo;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicBool, AtomicU8, Ordering::Relaxed};

use whirl_firmware::kept::{KEPT_LEN, Kept, NOTE_LEN, newest, note, read_note, to_bytes};
use whirl_firmware::settings::Boot;
use whirl_firmware::zero::keeps_memory;
use whirl_shared::frame::ResetCause;

/// Bytes of noise that go into a boot's id: of a cell in a hundred nobody knows how it wakes up.
const NOISE: usize = 1_024;

#[cfg_attr(target_os = "none", unsafe(link_section = ".uninit.boot"))]
static BOOT: Place<NOISE> = Place::new();
#[cfg_attr(target_os = "none", unsafe(link_section = ".uninit.number"))]
static NUMBER: Place<4> = Place::new();
#[cfg_attr(target_os = "none", unsafe(link_section = ".uninit.counts"))]
static COUNTS: [Place<KEPT_LEN>; 2] = [Place::new(), Place::new()];
#[cfg_attr(target_os = "none", unsafe(link_section = ".uninit.note"))]
static NOTE: Place<NOTE_LEN> = Place::new();

/// Bytes that are read as they are found: the compiler is not to believe in the value that a static
/// begins with.
struct Place<const N: usize>([AtomicU8; N]);

impl<const N: usize> Place<N> {
    const fn new() -> Self {
        Self([const { AtomicU8::new(0) }; N])
    }

    fn load(&self) -> [u8; N] {
        // SAFETY: the pointer is that of a byte which is there, whatever it holds.
        core::array::from_fn(|i| unsafe { read_volatile(self.0[i].as_ptr()) })
    }

    fn store(&self, bytes: &[u8; N]) {
        for (place, &byte) in self.0.iter().zip(bytes) {
            // SAFETY: as above; each place has one writer: the boot, the tick's interrupt or, with
            // interrupts off, a panic.
            unsafe { write_volatile(place.as_ptr(), byte) };
        }
    }
}

/// The id of this boot: a hash (FNV-1a) of what the memory held and of bytes that are the board's
/// own, left there so that the next reset has another one. To be called once, before anything else
/// runs.
pub fn boot_id(own: impl IntoIterator<Item = u8>) -> u32 {
    let mut noise = BOOT.load();
    let hash = |hash: u32, byte: u8| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
    let id = noise.into_iter().chain(own).fold(0x811c_9dc5, hash);
    noise[..4].copy_from_slice(&id.to_le_bytes());
    BOOT.store(&noise);
    id
}

/// The number of this boot, from 1 where power has just come. To be called once.
pub fn boot_number(first: bool) -> u32 {
    let number = if first { 1 } else { u32::from_le_bytes(NUMBER.load()).wrapping_add(1) };
    NUMBER.store(&number.to_le_bytes());
    number
}

/// What came before. To be called once, before the tick runs.
///
/// `cause` is what the chip tells of its reset; none where it cannot: counts that are whole then
/// say that it was one from within. A panic ends in the watchdog's reset, and is known by the text
/// that it left.
pub fn before(cause: Option<ResetCause>) -> Boot {
    let kept = newest(&COUNTS.each_ref().map(Place::load)).map(|(_, kept)| kept);
    let unknown = if kept.is_some() { ResetCause::Watchdog } else { ResetCause::Unknown };
    let mut boot = Boot { reset: cause.unwrap_or(unknown), ..Boot::default() };
    if let Some(text) = read_note(&NOTE.load()).filter(|_| boot.reset == ResetCause::Watchdog) {
        boot.reset = ResetCause::Panic;
        boot.panic = text;
    }
    NOTE.store(&[0; NOTE_LEN]);
    boot.kept = kept.filter(|_| keeps_memory(boot.reset));
    boot
}

/// Leaves both counts for the next boot; `number` counts the calls. The tick's interrupt alone
/// calls it.
pub fn keep(number: u32, kept: &Kept) {
    COUNTS[(number & 1) as usize].store(&to_bytes(number, kept));
}

/// A panic's place and message.
pub struct Panicked<'a>(pub &'a PanicInfo<'a>);

impl fmt::Display for Panicked<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = self.0.location() {
            write!(f, "{}:{}: ", place.file(), place.line())?;
        }
        write!(f, "{}", self.0.message())
    }
}

/// Leaves the text of a panic or a fault for the next boot, then tells it. With interrupts off.
/// What panics while that is done comes here again, and is neither left nor told: it must not go
/// round.
pub fn tell_once<C: fmt::Display>(cause: &C, tell: impl FnOnce(&C)) {
    static ENTERED: AtomicBool = AtomicBool::new(false);
    once(&ENTERED, cause, tell);
}

fn once<C: fmt::Display>(entered: &AtomicBool, cause: &C, tell: impl FnOnce(&C)) {
    // No swap: it is one core's, with interrupts off.
    if !entered.load(Relaxed) {
        entered.store(true, Relaxed);
        NOTE.store(&note(cause));
        tell(cause);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use whirl_firmware::zero::KeptEncoder;

    fn leave_note(text: &str) {
        NOTE.store(&note(text));
    }

    fn kept(count: i32) -> Kept {
        let mut kept = Kept::default();
        kept[0] = KeptEncoder { count, at_rest: true, ..KeptEncoder::default() };
        kept
    }

    /// One test: the places are statics, as on a board, and boots come one after another.
    #[test]
    fn boots_find_what_the_one_before_has_left() {
        // Power-on: nothing whole is there.
        let first = before(None);
        assert_eq!((first.reset, first.kept, first.panic.as_str()), (ResetCause::Unknown, None, ""));
        assert_eq!(boot_number(first.kept.is_none()), 1);
        let id = boot_id([1, 2, 3]);

        // A watchdog's reset keeps the newest counts; the id is another one with the same noise.
        for number in 1..=7 {
            keep(number, &kept(10 * number as i32));
        }
        let second = before(Some(ResetCause::Watchdog));
        assert_eq!((second.reset, second.kept), (ResetCause::Watchdog, Some(kept(70))));
        assert_eq!(boot_number(second.kept.is_none()), 2);
        assert_ne!(boot_id([1, 2, 3]), id);
        // A board without flags knows it by its counts.
        assert_eq!(before(None), second);

        // A panic's text is told once.
        leave_note("ordered to");
        let third = before(Some(ResetCause::Watchdog));
        assert_eq!((third.reset, third.panic.as_str()), (ResetCause::Panic, "ordered to"));
        assert_eq!(third.kept, Some(kept(70)));
        assert_eq!(before(Some(ResetCause::Watchdog)), second);

        // Power that came anew after a panic tells of neither; nor are counts believed after it.
        leave_note("long ago");
        let fourth = before(Some(ResetCause::Power));
        assert_eq!((fourth.reset, fourth.kept, fourth.panic.as_str()), (ResetCause::Power, None, ""));
        assert_eq!(before(Some(ResetCause::Watchdog)), second);
        // A count that was torn leaves the one before.
        COUNTS[1].store(&[0x5a; KEPT_LEN]);
        assert_eq!(before(Some(ResetCause::Software)).kept, Some(kept(60)));
        what_panics_in_a_panic_s_report_is_left_and_told_no_more();
    }

    /// A cause that panics while it is written: what comes of it goes to the handler again.
    struct Bomb<'a>(&'a AtomicBool, &'a AtomicU8);

    impl fmt::Display for Bomb<'_> {
        fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
            let written = self.1.fetch_add(1, Relaxed);
            assert!(written < 5, "it goes round");
            once(self.0, self, |_| panic!("told"));
            panic!("while it is written");
        }
    }

    fn what_panics_in_a_panic_s_report_is_left_and_told_no_more() {
        // While the text is made.
        let (entered, written) = (AtomicBool::new(false), AtomicU8::new(0));
        let bomb = Bomb(&entered, &written);
        assert!(catch_unwind(AssertUnwindSafe(|| once(&entered, &bomb, |_| panic!("told")))).is_err());
        assert_eq!(written.load(Relaxed), 1);
        assert_eq!(before(Some(ResetCause::Watchdog)).reset, ResetCause::Watchdog);
        // While it is told: the text is there by then.
        let (entered, told) = (AtomicBool::new(false), AtomicU8::new(0));
        once(&entered, &"first", |_| {
            told.fetch_add(1, Relaxed);
            once(&entered, &"second", |_| panic!("told"));
        });
        assert_eq!((told.load(Relaxed), before(Some(ResetCause::Watchdog)).panic.as_str()), (1, "first"));
    }
}

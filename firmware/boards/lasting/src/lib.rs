//! What lasts over a reset of a board, in memory that nothing initialises: the boot's id, both
//! counts, a panic's text.
//!
//! After power-on such memory holds the noise of its cells, after a reset what was there. What is
//! kept in it goes by the checksums of [`whirl_firmware::kept`]. One place for all boards: they
//! differ in how they tell why they were reset, and in what makes a boot's id differ from
//! another's.
#![no_std]

use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::AtomicU8;

use whirl_firmware::kept::{KEPT_LEN, Kept, NOTE_LEN, newest, read_note, to_bytes};
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

/// Leaves a panic's text for the next boot. With interrupts off.
pub fn leave_note(bytes: &[u8; NOTE_LEN]) {
    NOTE.store(bytes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use whirl_firmware::kept::note;
    use whirl_firmware::zero::KeptEncoder;

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
        leave_note(&note("ordered to"));
        let third = before(Some(ResetCause::Watchdog));
        assert_eq!((third.reset, third.panic.as_str()), (ResetCause::Panic, "ordered to"));
        assert_eq!(third.kept, Some(kept(70)));
        assert_eq!(before(Some(ResetCause::Watchdog)), second);

        // Power that came anew after a panic tells of neither; nor are counts believed after it.
        leave_note(&note("long ago"));
        let fourth = before(Some(ResetCause::Power));
        assert_eq!((fourth.reset, fourth.kept, fourth.panic.as_str()), (ResetCause::Power, None, ""));
        assert_eq!(before(Some(ResetCause::Watchdog)), second);
        // A count that was torn leaves the one before.
        COUNTS[1].store(&[0x5a; KEPT_LEN]);
        assert_eq!(before(Some(ResetCause::Software)).kept, Some(kept(60)));
    }
}

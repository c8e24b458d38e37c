//! An id that changes at every boot.
//!
//! Memory that nothing initialises holds, after power-on, noise of its cells, and after a reset, what was there. Both are
//! hashed together with the chip's number; the result is left there, so that the next reset has another one.

use core::mem::MaybeUninit;
use core::ptr::{addr_of_mut, read_volatile, write_volatile};

/// Words of noise.
const WORDS: usize = 256;

#[unsafe(link_section = ".uninit.boot")]
static mut NOISE: MaybeUninit<[u32; WORDS]> = MaybeUninit::uninit();

/// The id of this boot. To be called once, before anything else runs.
pub fn id() -> u32 {
    let noise = addr_of_mut!(NOISE).cast::<u32>();
    let mut hash = 0x811c_9dc5_u32;
    let mut take = |byte: u8| hash = (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193);
    for word in 0..WORDS {
        // SAFETY: within the array; it is memory that is there, whatever its content, and read by nobody else.
        let value = unsafe { read_volatile(noise.add(word)) };
        value.to_le_bytes().into_iter().for_each(&mut take);
    }
    embassy_stm32::uid::uid().into_iter().for_each(&mut take);
    // SAFETY: as above.
    unsafe { write_volatile(noise, hash) };
    hash
}

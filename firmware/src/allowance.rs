//! What the stream leaves of the line for samples that are sent again.
//!
//! Time is told by the samples: each brings the bytes of its tick at [`PERCENT`] of the line, every
//! frame takes its own, and a block is sent again only where there are bytes left for the longest.
//! No more than the bytes of [`BURST`] blocks are saved up. So any time T that ends with such a
//! block has at most `BURST + PERCENT·T` bytes in it, however much the rest is.
//!
//! ```text
//! bytes left ← min(bytes left + PERCENT/100 · baud/10 · samples/rate, BURST), then − bytes of each frame
//! ```

use whirl_shared::codec::samples_frame_len;

/// Share of the line (ten bits a byte) that is filled up: with [`BURST`] less than 70 % of 115 200
/// baud in any second, with two encoders.
pub(crate) const PERCENT: u32 = 67;
/// Most blocks' bytes that are saved up, so that what is left beside one block of the stream is
/// there behind the next.
pub(crate) const BURST: usize = 3;

/// 1/256 of a byte: a tick's share is not a whole number of bytes.
const BYTE: i32 = 256;

/// Bytes that are left.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Allowance {
    /// What a sample brings, and what a second does, 1/256 of a byte.
    sample: i32,
    second: i32,
    left: i32,
    /// The longest block, 1/256 of a byte.
    block: i32,
}

impl Allowance {
    /// None yet, at a line's rate and a sampling rate (mHz; 0 counts as 1), for blocks of so many
    /// channels.
    pub fn new(baud: u32, rate_millihertz: u32, channels: usize) -> Self {
        let second = u64::from(baud) * u64::from(PERCENT) * BYTE.unsigned_abs() as u64 / 1_000;
        let sample = second * 1_000 / u64::from(rate_millihertz.max(1));
        let bounded = |n: u64| i32::try_from(n).unwrap_or(i32::MAX);
        Self {
            sample: bounded(sample),
            second: bounded(second),
            left: 0,
            block: samples_frame_len(channels) as i32 * BYTE,
        }
    }

    /// So many samples were taken.
    pub fn sampled(&mut self, samples: u32) {
        let more = self.sample.saturating_mul(i32::try_from(samples).unwrap_or(i32::MAX));
        self.left = self.left.saturating_add(more).min(BURST as i32 * self.block);
    }

    /// A frame of so many bytes was sent. A debt is paid for a second at most.
    pub fn sent(&mut self, bytes: usize) {
        // At most MAX_FRAME.
        self.left = self.left.saturating_sub(bytes as i32 * BYTE).max(self.second.saturating_neg());
    }

    /// Whether a block may be sent again.
    pub fn is_enough(&self) -> bool {
        self.left >= self.block
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of so many bytes that a second has room for, beside a stream of 50 blocks of so many.
    fn again(baud: u32, streamed: usize, block: usize) -> usize {
        let mut allowance = Allowance::new(baud, 500_000, 2);
        let (mut sent, seconds) = (0, 100);
        for _ in 0..50 * seconds {
            allowance.sampled(10);
            allowance.sent(streamed);
            while allowance.is_enough() {
                allowance.sent(block);
                sent += 1;
            }
        }
        sent / seconds
    }

    #[test]
    fn what_is_left_of_the_line_is_used_and_no_more() {
        // 115 200 baud are 11 520 bytes a second, of which 7718.
        assert_eq!(again(115_200, 86, 86), (7_718 - 50 * 86) / 86);
        assert_eq!(again(115_200, 140, 95), (7_718 - 50 * 140) / 95);
        assert_eq!([again(115_200, 155, 95), again(57_600, 86, 86)], [0, 0]);
        // Two blocks with each that is streamed, however fast the line.
        assert_eq!(again(2_000_000, 86, 86), 100);
    }

    #[test]
    fn in_no_second_is_more_than_seventy_percent_of_the_line() {
        assert!(((BURST * samples_frame_len(2)) as u32 + 115_200 / 10 * PERCENT / 100) * 10 <= 115_200 * 70 / 100);
    }

    #[test]
    fn debts_and_savings_are_bounded() {
        let mut allowance = Allowance::new(115_200, 500_000, 2);
        (0..1_000).for_each(|_| allowance.sent(300));
        for _ in 0..1_000 {
            allowance.sampled(1);
        }
        assert!(allowance.is_enough());
        let mut most = Allowance::new(u32::MAX, 0, 3);
        most.sampled(u32::MAX);
        most.sampled(10);
        assert!(most.is_enough());
        (0..3).for_each(|_| most.sent(samples_frame_len(3)));
        assert!(!most.is_enough());
    }
}

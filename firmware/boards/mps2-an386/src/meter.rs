//! How many instructions a part takes.

use core::fmt::Write;
use core::hint::black_box;

use crate::machine;
use crate::semihosting::Console;

/// Instructions of the measured part: count, sum, most.
#[derive(Default)]
pub struct Meter {
    times: u32,
    sum: u64,
    most: u32,
}

impl Meter {
    /// Does a part, measured.
    pub fn take<T>(&mut self, part: impl FnOnce() -> T) -> T {
        let empty = {
            let start = machine::clock();
            machine::clock().wrapping_sub(start)
        };
        let start = machine::clock();
        let result = black_box(part());
        let clocks = machine::clock().wrapping_sub(start).saturating_sub(empty);
        self.times += 1;
        self.sum += u64::from(clocks);
        self.most = self.most.max(clocks);
        result
    }

    /// Another meter's figures, too.
    pub fn add(&mut self, other: &Self) {
        self.times += other.times;
        self.sum += other.sum;
        self.most = self.most.max(other.most);
    }

    /// A line about it.
    pub fn tell(&self, name: &str) {
        // 40 ns a clock, 32 ns an instruction.
        let mean = self.sum * 5 / (4 * u64::from(self.times.max(1)));
        // The console is the emulator's own; it does not fail.
        let _ = writeln!(Console, "{name}: mean {mean} most {}", u64::from(self.most) * 5 / 4);
    }
}

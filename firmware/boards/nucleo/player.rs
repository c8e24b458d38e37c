//! The shaker's points: TIM7 asks for one at each of its updates, and DMA brings it from memory to
//! the converter.
//!
//! Each tick's points are a run of their own, not a ring: where the next tick does not come (a
//! debugger, an erasure of the flash), the converter stands at the last point, and does not play
//! the last tick over and over. TIM7 runs in step with the tick's timer, and a run begins with the
//! point whose time comes next, so that latency moves nothing. A debugger's halt stops TIM7 too.

use embassy_stm32::pac;
use static_cell::ConstStaticCell;
use whirl_firmware::pacing::Schedule;
use whirl_firmware::sweep::BEYOND;

/// Most points of a tick: 40 kHz at 250 Hz.
const MOST: usize = 160;

/// Two runs, one of which is played while the other is written.
static RUNS: ConstStaticCell<[[u16; MOST + BEYOND]; 2]> = ConstStaticCell::new([[0; MOST + BEYOND]; 2]);

/// The player.
pub struct Player {
    runs: &'static mut [[u16; MOST + BEYOND]; 2],
    written: usize,
    schedule: Schedule,
}

/// DMA1 channel 3 (G4), by DMAMUX request 9, TIM7's update (RM0440, table 91).
#[cfg(chip = "g474re")]
mod channel {
    use embassy_stm32::pac::bdma::vals::{Dir, Pl, Size};
    use embassy_stm32::pac::{DMA1, DMAMUX1};

    const CHANNEL: usize = 2;
    const TIM7_UP: u8 = 9;

    pub fn stop() {
        DMA1.ch(CHANNEL).cr().modify(|w| w.set_en(false));
    }

    pub fn start(from: *const u16, count: u16, to: *mut u16) {
        stop();
        DMAMUX1.ccr(CHANNEL).write(|w| w.set_dmareq_id(TIM7_UP));
        let channel = DMA1.ch(CHANNEL);
        channel.par().write_value(to as u32);
        channel.mar().write_value(from as u32);
        channel.ndtr().write(|w| w.set_ndt(count));
        channel.cr().write(|w| {
            w.set_dir(Dir::FROM_MEMORY);
            w.set_minc(true);
            w.set_msize(Size::BITS16);
            w.set_psize(Size::BITS16);
            w.set_pl(Pl::VERY_HIGH);
            w.set_en(true);
        });
    }
}

/// DMA1 stream 2, channel 1 (F4), TIM7's update (RM0390, table 28).
#[cfg(chip = "f446re")]
mod channel {
    use embassy_stm32::pac::DMA1;
    use embassy_stm32::pac::dma::vals::{Dir, Pl, Size};

    const STREAM: usize = 2;
    const TIM7_UP: u8 = 1;

    pub fn stop() {
        let stream = DMA1.st(STREAM);
        stream.cr().modify(|w| w.set_en(false));
        // The transfer that is under way is finished first: some clocks.
        while stream.cr().read().en() {}
    }

    pub fn start(from: *const u16, count: u16, to: *mut u16) {
        stop();
        // A stream starts with its flags cleared only.
        DMA1.ifcr(0).write(|w| {
            w.set_feif(STREAM, true);
            w.set_dmeif(STREAM, true);
            w.set_teif(STREAM, true);
            w.set_htif(STREAM, true);
            w.set_tcif(STREAM, true);
        });
        let stream = DMA1.st(STREAM);
        stream.par().write_value(to as u32);
        stream.m0ar().write_value(from as u32);
        stream.ndtr().write(|w| w.set_ndt(count));
        stream.cr().write(|w| {
            w.set_chsel(TIM7_UP);
            w.set_dir(Dir::MEMORY_TO_PERIPHERAL);
            w.set_minc(true);
            w.set_msize(Size::BITS16);
            w.set_psize(Size::BITS16);
            w.set_pl(Pl::VERY_HIGH);
            w.set_en(true);
        });
    }
}

impl Player {
    /// The player, which stands; TIM7's clock is on.
    pub fn new(schedule: Schedule) -> Self {
        pac::TIM7.psc().write_value(0);
        pac::TIM7.arr().write(|w| w.set_arr(schedule.point_reload));
        pac::TIM7.egr().write(|w| w.set_ug(true));
        Self { runs: RUNS.take(), written: 0, schedule }
    }

    /// Starts TIM7, right behind the tick's timer.
    pub fn start() {
        pac::TIM7.cr1().modify(|w| w.set_cen(true));
    }

    /// Points of a tick; 1, a staircase, where there are more than the room holds.
    pub fn points(&self) -> usize {
        if self.schedule.points > MOST { 1 } else { self.schedule.points }
    }

    /// The point of this tick that is out.
    pub fn now(&self) -> usize {
        let since = u32::from(pac::TIM6.cnt().read().cnt());
        // A tick's counts are below 2¹⁶, its points fewer than 2⁸.
        (since * self.points() as u32 / self.schedule.period()) as usize
    }

    /// Where the next run goes.
    pub fn room(&mut self) -> &mut [u16] {
        let length = self.points() + BEYOND;
        self.runs[self.written].get_mut(..length).unwrap_or(&mut [])
    }

    /// Plays what was written, from the next point on.
    pub fn play(&mut self) {
        let length = self.points() + BEYOND;
        let run = &self.runs[self.written];
        loop {
            let now = self.now();
            let from = (now + 1).min(length - 1);
            // What was written is in memory before the channel reads it.
            cortex_m::asm::dmb();
            channel::start(run[from..].as_ptr(), (length - from) as u16, pac::DAC1.dhr12r(0).as_ptr().cast());
            pac::TIM7.dier().write(|w| w.set_ude(true));
            // A point that came meanwhile would delay all that follow.
            if self.now() == now {
                break;
            }
        }
        self.written = 1 - self.written;
    }

    /// Stands.
    pub fn stop(&mut self) {
        pac::TIM7.dier().write(|w| w.set_ude(false));
        channel::stop();
    }
}

//! The shaker's points on the chip's registers ([`whirl_firmware::player`]): TIM7 asks for one at
//! each of its updates, and DMA brings it from memory to the converter, which takes it at once.
//!
//! TIM7 runs in step with the tick's timer, started right behind it; a debugger's halt stops it.

use embassy_stm32::pac;
use whirl_firmware::pacing::Schedule;
use whirl_firmware::player::Channel;

/// TIM7, its DMA channel, and the converter.
pub struct Registers;

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

    pub fn left() -> u16 {
        DMA1.ch(CHANNEL).ndtr().read().ndt()
    }

    pub fn start(from: *const u16, count: u16, to: *mut u16) {
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

    pub fn left() -> u16 {
        DMA1.st(STREAM).ndtr().read().ndt()
    }

    pub fn start(from: *const u16, count: u16, to: *mut u16) {
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

impl Registers {
    /// TIM7, which stands; its clock is on.
    pub fn new(schedule: Schedule) -> Self {
        pac::TIM7.psc().write_value(0);
        pac::TIM7.arr().write(|w| w.set_arr(schedule.point_reload));
        pac::TIM7.egr().write(|w| w.set_ug(true));
        Self
    }

    /// Starts TIM7, right behind the tick's timer.
    pub fn begin() {
        pac::TIM7.cr1().modify(|w| w.set_cen(true));
    }
}

impl Channel for Registers {
    const MAX: u16 = 4_095;
    const AHEAD: usize = 0;
    const UNCLEAR: u32 = 8;

    fn since_tick(&self) -> u32 {
        u32::from(pac::TIM6.cnt().read().cnt())
    }

    fn write(&mut self, code: u16) {
        pac::DAC1.dhr12r(0).write(|w| w.set_dhr(code));
    }

    fn start(&mut self, codes: &[u16]) {
        // What was written is in memory before the channel reads it.
        cortex_m::asm::dmb();
        // A run has at most 168 codes.
        channel::start(codes.as_ptr(), codes.len() as u16, pac::DAC1.dhr12r(0).as_ptr().cast());
        // Updates until now have asked for nothing: one that waited would be served at once.
        pac::TIM7.dier().write(|w| w.set_ude(true));
    }

    fn left(&self) -> usize {
        usize::from(channel::left())
    }

    fn stop(&mut self) {
        pac::TIM7.dier().write(|w| w.set_ude(false));
        channel::stop();
    }
}

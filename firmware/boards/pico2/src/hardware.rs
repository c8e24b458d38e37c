//! The firmware's traits on the chip's registers.

use embassy_rp::Peri;
use embassy_rp::gpio::Pull;
use embassy_rp::pac;
use embassy_rp::pac::dma::vals::{DataSize, TreqSel};
use embassy_rp::peripherals::PIO0;
use embassy_rp::pio::{
    Common, Config, Direction, FifoJoin, LoadedProgram, Pin, PioPin, ShiftConfig, ShiftDirection, StateMachine,
};
use whirl_board_pico2::decoder::{self, COUNT, MARK, Mark};
use whirl_board_pico2::player::WIDTH;
use whirl_firmware::QuadratureCounter;
use whirl_firmware::player::Channel;

/// Slice of the points (GP16 is its output A), and that of the tick, which has no pins on this
/// chip.
pub const POINTS: usize = 0;
/// Slice of the tick.
pub const TICK: usize = 8;
/// DMA channel of the points.
const CHANNEL: usize = 0;
/// Amplifier enable, GP17.
const ENABLE: usize = 17;

/// A decoder: a state machine and its index's pin.
pub struct Decoder<const SM: usize> {
    machine: StateMachine<'static, PIO0, SM>,
    index: u8,
    mark: Mark,
}

impl<const SM: usize> Decoder<SM> {
    /// Takes a state machine and three pins, A and B in a row, all pulled up: a line that is not
    /// wired, or whose buffer has no supply, is a level and no noise.
    pub fn new(
        mut machine: StateMachine<'static, PIO0, SM>,
        common: &mut Common<'static, PIO0>,
        program: &LoadedProgram<'static, PIO0>,
        a: Peri<'static, impl PioPin>,
        b: Peri<'static, impl PioPin>,
        index: Peri<'static, impl PioPin>,
    ) -> Self {
        let mut input = |mut pin: Pin<'static, PIO0>| {
            pin.set_pull(Pull::Up);
            pin
        };
        let pins = [common.make_pio_pin(a), common.make_pio_pin(b), common.make_pio_pin(index)].map(&mut input);
        let [a, b, index] = &pins;
        let mut config = Config::default();
        config.use_program(program, &[]);
        config.set_in_pins(&[a, b]);
        config.set_jmp_pin(index);
        config.clock_divider = decoder::DIVIDER.into();
        config.shift_in = ShiftConfig { direction: ShiftDirection::Left, ..ShiftConfig::default() };
        config.shift_out = ShiftConfig { direction: ShiftDirection::Right, ..ShiftConfig::default() };
        config.fifo_join = FifoJoin::RxAsStatus;
        machine.set_config(&config);
        machine.set_pin_dirs(Direction::In, &[a, b, index]);
        for &instruction in &decoder::start().code {
            // SAFETY: they set Y, ISR and OSR of this state machine, which stands.
            unsafe { machine.exec_instr(instruction) };
        }
        let index = index.pin();
        machine.set_enable(true);
        let mark = Mark::new(machine.get_rxf_entry(MARK));
        Self { machine, index, mark }
    }
}

impl<const SM: usize> QuadratureCounter for Decoder<SM> {
    fn count(&mut self) -> u16 {
        self.machine.get_rxf_entry(COUNT) as u16
    }

    fn index(&mut self) -> Option<u16> {
        let entry = self.machine.get_rxf_entry(MARK);
        let high = pac::SIO.gpio_in(0).read() & 1 << self.index != 0;
        self.mark.left(entry, high)
    }
}

/// Slices and DMA channel of the points.
pub struct Registers;

impl Channel for Registers {
    const MAX: u16 = WIDTH;
    const AHEAD: usize = 1;
    const UNCLEAR: u32 = 8;

    fn since_tick(&self) -> u32 {
        u32::from(pac::PWM.ch(TICK).ctr().read().ctr())
    }

    fn write(&mut self, width: u16) {
        pac::PWM.ch(POINTS).cc().write(|w| w.set_a(width));
    }

    fn start(&mut self, widths: &[u16]) {
        let channel = pac::DMA.ch(CHANNEL);
        channel.read_addr().write_value(widths.as_ptr() as u32);
        channel.write_addr().write_value(pac::PWM.ch(POINTS).cc().as_ptr() as u32);
        channel.trans_count().write(|w| w.set_count(widths.len() as u32));
        // Wraps until now are none of this run's.
        channel.dbg_ctdreq().write(|w| w.set_dbg_ctdreq(0));
        // What was written is in memory before the channel reads it.
        cortex_m::asm::dmb();
        channel.ctrl_trig().write(|w| {
            w.set_treq_sel(TreqSel::PWM_WRAP0);
            // A half word goes to both halves of the register (datasheet, 2.1.5): output B has no
            // pin.
            w.set_data_size(DataSize::SIZE_HALFWORD);
            w.set_incr_read(true);
            w.set_incr_write(false);
            w.set_high_priority(true);
            // To no other channel.
            w.set_chain_to(CHANNEL as u8);
            w.set_irq_quiet(true);
            w.set_en(true);
        });
    }

    fn left(&self) -> usize {
        pac::DMA.ch(CHANNEL).trans_count().read().count() as usize
    }

    fn stop(&mut self) {
        stop_points();
    }
}

/// Ends a run. The channel is switched off before it is aborted (datasheet, erratum RP2350-E5).
fn stop_points() {
    let channel = pac::DMA.ch(CHANNEL);
    channel.al1_ctrl().write_value(0);
    pac::DMA.chan_abort().write(|w| w.set_chan_abort(1 << CHANNEL));
    while pac::DMA.chan_abort().read().chan_abort() & 1 << CHANNEL != 0 {}
}

/// Amplifier off, no more points, set point at rest: by registers, since whoever owns them may be
/// the one who panicked. Blocks that are still in reset are left alone: an access may fault.
pub fn silence() {
    pac::SIO.gpio_out(0).value_clr().write_value(1 << ENABLE);
    pac::SIO.gpio_oe(0).value_set().write_value(1 << ENABLE);
    let in_reset = pac::RESETS.reset().read();
    if !in_reset.dma() {
        stop_points();
    }
    if !in_reset.pwm() {
        pac::PWM.ch(POINTS).cc().write(|w| w.set_a(WIDTH / 2));
    }
}

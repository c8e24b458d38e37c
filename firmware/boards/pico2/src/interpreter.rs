//! A PIO state machine for tests: the instructions that the decoder uses, as in the RP2350
//! datasheet, 11.4, one cycle each.

use pio::Program;

/// A state machine with its program at address 0.
pub struct StateMachine {
    code: std::vec::Vec<u16>,
    wrap: (u8, u8),
    pc: u8,
    pub x: u32,
    pub y: u32,
    isr: u32,
    osr: u32,
    /// The RX FIFO's entries, as the processor reads them.
    pub entries: [Option<u32>; 4],
    /// Levels of the pins from the first one in.
    pub pins: u32,
    /// Level of the pin that jumps ask for.
    pub jump_pin: bool,
    pub cycles: u64,
}

/// Bits `high` to `low` of an instruction.
fn field(instruction: u16, high: u32, low: u32) -> u32 {
    u32::from(instruction) >> low & ((1 << (high - low + 1)) - 1)
}

fn mask(bits: u32) -> u32 {
    if bits == 0 { u32::MAX } else { (1 << bits) - 1 }
}

impl StateMachine {
    pub fn new<const N: usize>(program: &Program<N>) -> Self {
        assert_eq!(program.origin, Some(0), "jumps into the table want address 0");
        assert!(program.code.len() <= 32);
        Self {
            code: program.code.to_vec(),
            wrap: (program.wrap.source, program.wrap.target),
            pc: 0,
            // What a restart leaves as it was.
            x: 0xdead_beef,
            y: 0xdead_beef,
            isr: 0xdead_beef,
            osr: 0xdead_beef,
            entries: [None; 4],
            pins: 0,
            jump_pin: false,
            cycles: 0,
        }
    }

    /// The next instruction, and the wrap behind it.
    pub fn step(&mut self) {
        let at = self.pc;
        let next = if at == self.wrap.0 { self.wrap.1 } else { at + 1 };
        let instruction = *self.code.get(usize::from(at)).expect("ran out of the program");
        self.pc = self.execute(instruction).unwrap_or(next);
        self.cycles += 1;
    }

    /// One instruction; where it jumps to.
    pub fn execute(&mut self, instruction: u16) -> Option<u8> {
        assert_eq!(field(instruction, 12, 8), 0, "no delay and no side set");
        let (middle, low) = (field(instruction, 7, 5), field(instruction, 4, 0));
        match field(instruction, 15, 13) {
            0b000 => return self.jump(middle).then_some(low as u8),
            0b010 => {
                assert_eq!(middle, 0, "in from pins");
                self.isr = self.isr << (low % 32) | self.pins & mask(low);
            }
            0b011 => {
                assert_eq!(middle, 0b110, "out to ISR");
                self.isr = self.osr & mask(low);
                self.osr >>= low % 32;
            }
            0b100 => {
                // MOV to RX: bit 7 clear, bit 4 set, bit 3 for an entry by its number.
                assert_eq!(field(instruction, 7, 3), 0b0_0011);
                self.entries[field(instruction, 1, 0) as usize] = Some(self.isr);
            }
            0b101 => return self.move_to(middle, field(instruction, 4, 3), field(instruction, 2, 0)),
            0b111 => match middle {
                0b001 => self.x = low,
                0b010 => self.y = low,
                _ => panic!("set to {middle:03b}"),
            },
            other => panic!("instruction {other:03b}"),
        }
        None
    }

    fn jump(&mut self, condition: u32) -> bool {
        let less = |register: &mut u32| {
            let jumps = *register != 0;
            *register = register.wrapping_sub(1);
            jumps
        };
        match condition {
            0b000 => true,
            0b010 => less(&mut self.x),
            0b100 => less(&mut self.y),
            0b110 => self.jump_pin,
            _ => panic!("jump {condition:03b}"),
        }
    }

    fn move_to(&mut self, to: u32, operation: u32, from: u32) -> Option<u8> {
        let value = match from {
            0b001 => self.x,
            0b010 => self.y,
            0b011 => 0,
            0b110 => self.isr,
            0b111 => self.osr,
            _ => panic!("mov from {from:03b}"),
        };
        let value = match operation {
            0 => value,
            1 => !value,
            _ => panic!("operation {operation}"),
        };
        match to {
            0b001 => self.x = value,
            0b010 => self.y = value,
            0b101 => return Some((value & 31) as u8),
            0b110 => self.isr = value,
            0b111 => self.osr = value,
            _ => panic!("mov to {to:03b}"),
        }
        None
    }
}

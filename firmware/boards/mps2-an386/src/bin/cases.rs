//! One of the cases of `firmware/cases` on the target, by its index among the arguments. The exit
//! status is 0 where it passed; without an index the names of all are printed.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod on_target {
    use core::fmt::Write;
    use core::panic::PanicInfo;

    use whirl_board_mps2_an386::machine::{self, Vector};
    use whirl_board_mps2_an386::semihosting::{Console, arguments, exit};
    use whirl_firmware_cases::CASES;

    #[unsafe(link_section = ".vector_table.interrupts")]
    #[unsafe(no_mangle)]
    static __INTERRUPTS: [Vector; 32] = machine::empty_table();

    #[panic_handler]
    fn panic(info: &PanicInfo<'_>) -> ! {
        // The emulation ends in any case.
        let _ = writeln!(Console, "{info}");
        exit(false)
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let mut buffer = [0; 256];
        let index = arguments(&mut buffer).and_then(|text| text.split(' ').next_back()?.parse::<usize>().ok());
        let Some(index) = index else {
            for (name, _) in CASES {
                // The console is the emulator's own; it does not fail.
                let _ = writeln!(Console, "case {name}");
            }
            exit(true)
        };
        let Some((name, case)) = CASES.get(index) else { panic!("no case {index}") };
        case();
        let _ = writeln!(Console, "passed {name}");
        exit(true)
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("whirl-cases-mps2-an386 is firmware: build it with --target thumbv7em-none-eabihf");
    std::process::exit(2);
}

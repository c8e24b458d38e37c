//! Boards that have firmware: one line each in [`BOARDS`].

/// A board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// What it is called on the command line and calls itself in its hello.
    pub id: &'static str,
    /// The package of its firmware; its image has the same name.
    pub package: &'static str,
    /// The chip, as debug probes know it; none where there is nothing to be flashed.
    pub chip: Option<&'static str>,
    /// The target that its firmware is built for, as rustup knows it; empty where that is this
    /// machine.
    pub target: &'static str,
    /// Extension of the image that the drive takes which the board shows on USB; empty where it
    /// shows none.
    pub drop: &'static str,
    /// Whether samples come through a serial port of some rate.
    pub has_baud: bool,
    /// What it is.
    pub about: &'static str,
}

/// Cortex-M4 with floating point.
const CORTEX_M4F: &str = "thumbv7em-none-eabihf";

/// Every board.
pub static BOARDS: &[Board] = &[
    Board {
        id: "nucleo-g474re",
        package: "whirl-board-nucleo-g474re",
        chip: Some("STM32G474RETx"),
        target: CORTEX_M4F,
        drop: "bin",
        has_baud: true,
        about: "ST NUCLEO-G474RE, Cortex-M4F at 170 MHz: `whirl flash --board nucleo-g474re`, docs/boards.md",
    },
    Board {
        id: "nucleo-f446re",
        package: "whirl-board-nucleo-f446re",
        chip: Some("STM32F446RETx"),
        target: CORTEX_M4F,
        drop: "bin",
        has_baud: true,
        about: "ST NUCLEO-F446RE, Cortex-M4F at 180 MHz: `whirl flash --board nucleo-f446re`, docs/boards.md",
    },
    Board {
        id: "pico2",
        package: "whirl-board-pico2",
        chip: Some("RP235x"),
        target: "thumbv8m.main-none-eabihf",
        drop: "uf2",
        has_baud: false,
        about: "Raspberry Pi Pico 2, Cortex-M33 at 150 MHz: drop its .uf2 on the drive that it shows, docs/boards.md",
    },
    Board {
        id: "mps2-an386",
        package: "whirl-board-mps2-an386",
        chip: None,
        target: CORTEX_M4F,
        drop: "",
        has_baud: false,
        about: "Cortex-M4F emulated by QEMU, against the simulated rig (docs/boards.md)",
    },
    Board {
        id: "virtual-rig",
        package: "whirl-firmware",
        chip: None,
        target: "",
        drop: "",
        has_baud: false,
        about: "the firmware in lock-step with the simulated rig (`whirl capture --from sim`)",
    },
];

/// The board of that name.
#[must_use]
pub fn of(id: &str) -> Option<&'static Board> {
    BOARDS.iter().find(|board| board.id == id)
}

/// Names of the boards that can be flashed, for messages.
#[must_use]
pub fn flashable() -> String {
    BOARDS.iter().filter(|board| board.chip.is_some()).map(|board| board.id).collect::<Vec<_>>().join(", ")
}

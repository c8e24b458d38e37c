//! The program `whirl` as the host library has it, for the end-to-end tests.

use std::process::ExitCode;

fn main() -> ExitCode {
    whirl::cli::main()
}

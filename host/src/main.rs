//! The program `whirl`: parse, dispatch, exit status.

use std::process::ExitCode;

fn main() -> ExitCode {
    whirl::cli::main()
}

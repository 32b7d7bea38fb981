//! The `esm` command. All of it lives in [`host_tools::cli`], where tests can reach it.

use std::process::ExitCode;

fn main() -> ExitCode {
    host_tools::cli::main()
}

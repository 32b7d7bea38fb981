//! The `esm` command with this robot on the board `host`:
//! `cargo run -- run mission.esm --board host --until '30 s'`.

use std::process::ExitCode;

use esm::host_tools;

use my_pico::MyPico;

fn main() -> ExitCode {
    host_tools::cli::main_with(|parts, run| {
        let measures = &my_pico::MEASURES;
        let mut robot = MyPico::new(parts.into(), measures);
        run(&mut robot.banks())
    })
}

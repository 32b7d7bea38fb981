//! The `esm` command with this robot on the board `host`:
//! `cargo run -- run mission.esm --board host --until '30 s'`.

use std::process::ExitCode;

use esm::host_tools;

use my_robot::MyRobot;

fn main() -> ExitCode {
    host_tools::cli::main_with(|parts, run| {
        let measures = &my_robot::MEASURES;
        let mut robot = MyRobot::new(parts.into(), measures);
        run(&mut robot.banks())
    })
}

//! Puts the linker script where the linker looks for it, and turns the numbers of `board.toml`, and
//! the shipped rover's file, into constants.

fn main() {
    board_settings::write();
    board_settings::linker_script("pico2.x");
    robot_file::build("robot.toml");
}

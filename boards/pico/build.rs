//! Puts the linker script where the linker looks for it, and turns the numbers of `board.toml`, and
//! the shipped rover's file, into constants.

fn main() {
    board_settings::write();
    board_settings::linker_script("pico.x");
    let has_sensors = std::env::var_os("CARGO_FEATURE_SENSORS").is_some();
    robot_file::build(match has_sensors {
        true => "sensors.toml",
        false => "robot.toml",
    });
}

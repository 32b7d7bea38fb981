//! Turns the robot's file into constants.

fn main() {
    robot_file::build("../robot.toml");
}

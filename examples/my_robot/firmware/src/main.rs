//! The robot's firmware: its registry, on the emulated board.
#![no_std]
#![no_main]

use my_robot::MyRobot;
use my_robot::esm::lm3s6965::{self, PINS};
use my_robot::esm::rt_firmware::body::StopPin;

lm3s6965::app! {
    firmware: concat!("my_robot ", env!("CARGO_PKG_VERSION")),
    robot: MyRobot<'static> = MyRobot::new,
    emergency_stop: StopPin<'static> = PINS.stop_button(),
}

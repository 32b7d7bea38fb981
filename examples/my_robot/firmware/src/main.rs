//! The robot's firmware: its registry, on the board lm3s6965.
#![no_std]
#![no_main]

use my_robot::esm::lm3s6965::{self, PINS};

use my_robot::MyRobot;
use my_robot::esm::rt_firmware::body::{SONARS, StopPin};
use my_robot::esm::rt_firmware::robot_parts::PinParts;

lm3s6965::app! {
    firmware: concat!("my_robot ", env!("CARGO_PKG_VERSION")),
    robot: MyRobot<PinParts<'static>, SONARS> =
        |pins| MyRobot::new(pins.into(), &my_robot::MEASURES),
    emergency_stop: StopPin<'static> = PINS.stop_button(),
}

//! The robot's firmware: its registry, on the emulated board.
#![no_std]
#![no_main]

use lm3s6965::PINS;
use lm3s6965::rt_firmware::body::StopPin;
use my_robot::MyRobot;

lm3s6965::app! {
    firmware: concat!("my_robot ", env!("CARGO_PKG_VERSION")),
    robot: MyRobot<'static> = MyRobot::new,
    emergency_stop: StopPin<'static> = PINS.stop_button(),
}

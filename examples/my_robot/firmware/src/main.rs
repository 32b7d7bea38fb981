//! The robot's firmware: its registry, on the emulated board.
#![no_std]
#![no_main]

use my_robot::MyRobot;

lm3s6965::app! {
    firmware: concat!("my_robot ", env!("CARGO_PKG_VERSION")),
    robot: MyRobot<'static> = MyRobot::new,
}

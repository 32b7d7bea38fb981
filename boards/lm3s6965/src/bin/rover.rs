//! The default robot: its registry of tasks, on this board, with a button for emergencies, and a
//! mission of its own for a flash that has none.
#![no_std]
#![no_main]

use lm3s6965::{PINS, settings};
use rt_firmware::body::StopPin;
use rt_firmware::rover::{CHASSIS, COUNTS_PER_REVOLUTION, PinRover, RoverParts};

// What `board.toml` tells others of the body is what the robot drives with.
const _: () = assert!(settings::WHEEL_BASE_M == CHASSIS.wheel_base_m);
const _: () = assert!(settings::COUNTS_PER_REVOLUTION == COUNTS_PER_REVOLUTION);

lm3s6965::app! {
    firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
    robot: PinRover<'static> = |pins| PinRover::new(RoverParts::from(pins)),
    emergency_stop: StopPin<'static> = PINS.stop_button(),
    default_mission: include_bytes!("../../../stand_by.blob"),
}

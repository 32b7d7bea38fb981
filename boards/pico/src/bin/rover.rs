//! The default robot: its registry of tasks, on this board, with a button for emergencies, and a
//! mission of its own for a flash that has none.
#![no_std]
#![no_main]

use pico::pins::BoardRover;
use pico::settings;
use rt_firmware::rover::{CHASSIS, COUNTS_PER_REVOLUTION};

// What `board.toml` tells others of the body is what the robot drives with.
const _: () = assert!(settings::WHEEL_BASE_M == CHASSIS.wheel_base_m);
const _: () = assert!(settings::COUNTS_PER_REVOLUTION == COUNTS_PER_REVOLUTION);

pico::app! {
    firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
    robot: BoardRover = BoardRover::new,
    default_mission: include_bytes!("../../../stand_by.blob"),
}

//! The default robot: its registry of tasks, on this board, with a button for emergencies, and a
//! mission of its own for a flash that has none.
#![no_std]
#![no_main]

use pico::pins::BoardRover;
use rt_firmware::rover::Measures;


pico::app! {
    firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
    robot: BoardRover = |parts| BoardRover::new(parts, &Measures::ROVER),
    default_mission: include_bytes!("../../../stand_by.blob"),
}

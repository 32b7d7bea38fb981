//! The default robot: its registry of tasks, on this board, with a button for emergencies, and a
//! mission of its own for a flash that has none.
#![no_std]
#![no_main]

/// What `robot.toml` says.
mod robot {
    include!(concat!(env!("OUT_DIR"), "/robot.rs"));
}

use robot::{MEASURES, Robot, WIRING};

pico2::app! {
    firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
    wiring: WIRING,
    robot: Robot = |parts| Robot::new(parts.rover, &MEASURES),
    default_mission: include_bytes!("../../../stand_by.blob"),
}

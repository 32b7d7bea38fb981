//! A robot of one's own on a Raspberry Pi Pico: what it measures, and which pin is what, stands in
//! `robot.toml`. Its tasks are those of the rover.
#![no_std]
#![no_main]

/// What `robot.toml` says.
mod robot {
    include!(concat!(env!("OUT_DIR"), "/robot.rs"));
}

use robot::{MEASURES, Robot, WIRING};

pico::app! {
    firmware: concat!("my_pico ", env!("CARGO_PKG_VERSION")),
    wiring: WIRING,
    robot: Robot = |parts| Robot::new(parts.rover, &MEASURES),
}

//! The robot's firmware: its registry, on the board pico, with what `robot.toml` says.
#![no_std]
#![no_main]

/// What `robot.toml` says.
mod robot {
    use my_pico::esm::pico;

    include!(concat!(env!("OUT_DIR"), "/robot.rs"));
}

use my_pico::MyPico;
use my_pico::esm::pico::{self, pins::BoardParts};

use robot::{MEASURES, WIRING};

pico::app! {
    firmware: concat!("my_pico ", env!("CARGO_PKG_VERSION")),
    wiring: WIRING,
    robot: MyPico<BoardParts, { MEASURES.sonars.len() }> = |parts| MyPico::new(parts, &MEASURES),
}

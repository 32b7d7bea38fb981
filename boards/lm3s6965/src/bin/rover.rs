//! The default robot: its registry of tasks, on this board.
#![no_std]
#![no_main]

use rt_firmware::rover::{PinRover, RoverParts};

lm3s6965::app! {
    firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
    robot: PinRover<'static> = |pins| PinRover::new(RoverParts::from(pins)),
}

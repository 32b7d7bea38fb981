//! The default robot: its registry of tasks, on this board, with a button for emergencies, and a
//! mission of its own for a flash that has none.
#![no_std]
#![no_main]

use lm3s6965::PINS;
use rt_firmware::body::StopPin;
use rt_firmware::rover::{Measures, PinRoverPlaces, RoverParts};

lm3s6965::app! {
    firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
    robot_in_place: PinRoverPlaces<'static> = |places, pins| {
        places.fill(RoverParts::from(pins), &Measures::ROVER)
    },
    emergency_stop: StopPin<'static> = PINS.stop_button(),
    default_mission: include_bytes!("../../../stand_by.blob"),
}

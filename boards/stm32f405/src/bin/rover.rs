//! The default robot: its registry of tasks, on this board, with a button for emergencies, and a
//! mission of its own for a flash that has none.
#![no_std]
#![no_main]

use rt_firmware::rover::Measures;

#[cfg(feature = "emulation")]
mod emulated {
    use rt_firmware::body::StopPin;
    use rt_firmware::rover::{PinRover, RoverParts};
    use stm32f405::PINS;

    use super::Measures;

    stm32f405::app! {
        firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
        robot: PinRover<'static> = |pins| PinRover::new(RoverParts::from(pins), &Measures::ROVER),
        emergency_stop: StopPin<'static> = PINS.stop_button(),
        default_mission: include_bytes!("../../../stand_by.blob"),
    }
}

#[cfg(not(feature = "emulation"))]
mod silicon {
    use stm32f405::silicon::parts::BoardRover;

    use super::Measures;

    stm32f405::app! {
        firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
        robot: BoardRover = |parts| BoardRover::new(parts, &Measures::ROVER),
        default_mission: include_bytes!("../../../stand_by.blob"),
    }
}

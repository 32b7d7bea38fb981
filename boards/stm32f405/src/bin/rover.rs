//! The default robot: its registry of tasks, on this board, with a button for emergencies, and a
//! mission of its own for a flash that has none.
#![no_std]
#![no_main]

#[cfg(feature = "emulation")]
mod emulated {
    use rt_firmware::body::StopPin;
    use rt_firmware::rover::{Measures, PinRover, RoverParts};
    use stm32f405::cortex_m_board::plant_board::PINS;

    stm32f405::app! {
        firmware: concat!("rover ", env!("CARGO_PKG_VERSION")),
        robot: PinRover<'static> = |pins| PinRover::new(RoverParts::from(pins), &Measures::ROVER),
        emergency_stop: StopPin<'static> = PINS.stop_button(),
        default_mission: include_bytes!("../../../stand_by.blob"),
    }
}

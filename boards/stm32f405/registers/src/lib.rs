//! The drivers of the board STM32F405, as the firmware for the part has them, on a host: their
//! files are compiled here once more, and their registers are memory at the same addresses that
//! [`mock`] watches. So tests see each access, in its order, and answer as the part does.
//!
//! Addresses and bits of the tests are from the reference manual (RM0090), and not from the crate
//! that the drivers have them from.
#![cfg(all(test, target_os = "linux", target_arch = "x86_64"))]
#![allow(dead_code, missing_docs, reason = "the board's files, as they are")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

// What the board's files call so are modules of this crate.
extern crate self as cortex_m;
extern crate self as cortex_m_board;

use stm32f4::stm32f405 as pac;

#[path = "../../../cortex_m/src/bridge.rs"]
mod bridge;
#[path = "../../../cortex_m/src/can_line.rs"]
mod can_line;
#[path = "../../../cortex_m/src/captured_echo.rs"]
mod captured_echo;
#[path = "../../../cortex_m/src/chip.rs"]
mod chip;
#[path = "../../../cortex_m/src/on_chip_flash.rs"]
mod on_chip_flash;
#[path = "../../../cortex_m/src/pings.rs"]
mod pings;
#[path = "../../../cortex_m/src/sys_tick.rs"]
mod sys_tick;
#[path = "../../../cortex_m/src/wire.rs"]
mod wire;

mod peripheral {
    pub use real_cortex_m::peripheral::{NVIC, SYST, syst};
}

mod line {
    pub use crate::wire::*;
}

pub use real_cortex_m::singleton;

/// The chip, for what is common to boards.
pub struct Stm32f405;

impl chip::Chip for Stm32f405 {
    const TICKS_PER_US: u32 = settings::TICKS_PER_US;

    fn feed_watchdog() {
        watchdog::feed();
    }
}

/// The board, as far as a link has to do with it.
pub struct SlotBoard {
    device: Option<can_line::Device<Stm32f405>>,
}

impl SlotBoard {
    pub fn board_mut(&mut self) -> &mut Self {
        self
    }

    pub fn connect(&mut self, device: can_line::Device<Stm32f405>) {
        self.device = Some(device);
    }
}

mod settings {
    /// As `board.toml` has it.
    pub const TICKS_PER_US: u32 = 21;
}

#[path = "../../src/clock.rs"]
mod clock;
#[path = "../../src/usart.rs"]
mod usart;
#[path = "../../src/watchdog.rs"]
mod watchdog;

#[path = "../../src/silicon/analog.rs"]
mod analog;
#[path = "../../src/silicon/can.rs"]
mod can;
#[path = "../../src/silicon/encoders.rs"]
mod encoders;
#[path = "../../src/silicon/motors.rs"]
mod motors;
#[path = "../../src/silicon/parts.rs"]
mod parts;
#[path = "../../src/silicon/pins.rs"]
mod pins;
#[path = "../../src/silicon/sectors.rs"]
mod sectors;
#[path = "../../src/silicon/sonars.rs"]
mod sonars;
#[path = "../../src/silicon/uart_dma.rs"]
mod uart_dma;
#[path = "../../src/silicon/wiring.rs"]
mod wiring;

mod interrupt;
mod mock;
mod tests;

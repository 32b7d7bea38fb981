//! What is on a part of silicon and not in the emulator: pins, and all that is at them, and the
//! chip's flash.

pub mod analog;
#[cfg(feature = "can")]
pub mod can;
pub mod encoders;
#[cfg(feature = "store")]
pub mod flash;
pub mod motors;
pub mod parts;
pub mod pins;
#[cfg(feature = "store")]
pub mod sectors;
pub mod sonars;
pub mod uart_dma;
pub mod wiring;

use cortex_m_board::chip::MotorChip;
use cortex_m_board::chip_board::ChipBoard;
use rt_firmware::WithStopButton;

use crate::Stm32f405;

/// Time, motors, watchdog and the button of the emergency stop for the slot timer's handler.
pub type SlotBoard = WithStopButton<ChipBoard<Stm32f405>, pins::Pin>;

impl MotorChip for Stm32f405 {
    fn motors_off() {
        motors::all_off();
    }
}

/// Starts what is at the pins.
pub(crate) fn start() -> (SlotBoard, parts::BoardRoverParts) {
    let (stop_button, parts) = parts::start();
    (SlotBoard::new(ChipBoard::new(), stop_button), parts)
}

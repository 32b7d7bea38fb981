//! The board as the real-time side sees it.

use cortex_m_board::usb_wire::Device;
use embedded_hal::digital::OutputPin;
use esm_link::message::SafeReason;
use rt_firmware::{ActivationStart, Board, WithStopButton};

use crate::clock::{self, TICKS_PER_US};
use crate::hal::usb::UsbBus;
use crate::pins::{Led, SwitchPin};
use crate::{motors, outputs, watchdog};

/// The board for the slot timer's handler, with the button of the emergency stop.
pub type SlotBoard = WithStopButton<OwnParts, SwitchPin>;

/// Time, motors, LED and watchdog; and until the line starts, its USB.
pub struct OwnParts {
    pub(crate) led: Led,
    pub(crate) usb: Option<&'static mut Device<UsbBus>>,
}

impl Board for OwnParts {
    const TICKS_PER_US: u32 = TICKS_PER_US;

    fn now_ticks(&mut self) -> u64 {
        clock::now_us()
    }

    #[inline(always)]
    fn now_low_ticks(&mut self) -> u32 {
        clock::count()
    }

    /// The LED is lit while a mission runs; after a stop it glows, since each activation lights it
    /// for as long as it takes to take the motors' power.
    fn begin_activation(&mut self, _: &ActivationStart) -> Result<(), SafeReason> {
        let Ok(()) = self.led.set_high();
        Ok(())
    }

    fn feed_watchdog(&mut self) {
        watchdog::feed();
    }

    fn motors_off(&mut self) {
        motors::all_off();
        outputs::all_off();
        let Ok(()) = self.led.set_low();
    }
}

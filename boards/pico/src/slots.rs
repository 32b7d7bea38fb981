//! The board as the real-time side sees it.

use embedded_hal::digital::OutputPin;
use esm_link::message::SafeReason;
use rp2040_hal::Watchdog;
use rt_firmware::{ActivationStart, Board};

use crate::clock::{self, TICKS_PER_US};
use crate::pins::Led;
use crate::{motors, outputs, watchdog};

/// Time, motors, LED and watchdog for the slot timer's handler.
pub struct SlotBoard {
    watchdog: Watchdog,
    led: Led,
}

impl SlotBoard {
    pub(crate) fn new(watchdog: Watchdog, led: Led) -> Self {
        Self { watchdog, led }
    }

    /// Starts the watchdog; nothing but a reset stops it.
    pub fn start_watchdog(&mut self) {
        watchdog::start(&mut self.watchdog);
    }
}

impl Board for SlotBoard {
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
        self.watchdog.feed();
    }

    fn motors_off(&mut self) {
        motors::all_off();
        outputs::all_off();
        let Ok(()) = self.led.set_low();
    }
}

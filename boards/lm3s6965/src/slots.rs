//! The board as the real-time side sees it.

use esm_link::message::SafeReason;
use rt_firmware::body::{Freshness, PlantExchange};
use rt_firmware::{ActivationStart, Board};

use crate::clock::{self, TICKS_PER_US};
use crate::{PINS, plant, post_mortem, watchdog};

/// Time, body and pins for the slot timer's handler.
pub struct SlotBoard {
    exchange: PlantExchange,
    /// Plant time when this run of the firmware began its first mission: where the last run left
    /// it.
    plant_epoch_us: u64,
}

impl SlotBoard {
    /// The board of a firmware that starts when the plant's time is `plant_epoch_us`.
    pub(crate) fn new(plant_epoch_us: u64) -> Self {
        Self {
            exchange: PlantExchange::new(),
            plant_epoch_us,
        }
    }
}

impl Board for SlotBoard {
    const TICKS_PER_US: u32 = TICKS_PER_US;
    const COUNT_BITS: u32 = clock::SYS_TICK_BITS;

    fn now_ticks(&mut self) -> u64 {
        clock::advance()
    }

    #[inline(always)]
    fn now_low_ticks(&mut self) -> u32 {
        clock::low_ticks()
    }

    #[inline(always)]
    fn count(&mut self) -> u32 {
        clock::count()
    }

    // Not inlined: no task should run on top of the exchange's messages.
    #[inline(never)]
    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        let request = self.exchange.request(
            &PINS,
            self.plant_epoch_us + activation.start_us,
            self.plant_epoch_us + activation.previous_end_us,
        );
        post_mortem::note_exchange(&request);
        let reply = plant::exchange(&request);
        match self.exchange.accept(&PINS, reply.as_ref()) {
            Freshness::Fresh | Freshness::Stale => Ok(()),
            Freshness::Lost => Err(SafeReason::BodyLost),
        }
    }

    fn feed_watchdog(&mut self) {
        watchdog::feed();
    }

    fn motors_off(&mut self) {
        PINS.safe();
    }
}

//! The board without a plant, for firmware that measures what is between the timer and the tasks.

use crate::chip::clock::TICKS_PER_US;
use crate::chip::slots::SlotBoard;
use esm_link::message::SafeReason;
use rt_firmware::{ActivationStart, Board};

use super::origin;

/// The board without a plant.
pub struct BenchBoard(pub SlotBoard);

impl Board for BenchBoard {
    const TICKS_PER_US: u32 = TICKS_PER_US;
    const COUNT_BITS: u32 = SlotBoard::COUNT_BITS;

    #[inline(always)]
    fn count(&mut self) -> u32 {
        self.0.count()
    }

    fn now_ticks(&mut self) -> u64 {
        self.0.now_ticks()
    }

    #[inline(always)]
    fn now_low_ticks(&mut self) -> u32 {
        self.0.now_low_ticks()
    }

    #[inline(always)]
    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        origin::note(activation);
        Ok(())
    }

    fn feed_watchdog(&mut self) {
        self.0.feed_watchdog();
    }

    fn motors_off(&mut self) {
        self.0.motors_off();
    }
}

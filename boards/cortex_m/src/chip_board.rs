//! A board with a body of its own, as the real-time side sees it, on cores whose time is
//! [`sys_tick`]'s.

use core::marker::PhantomData;

use rt_firmware::Board;

use crate::chip::MotorChip;
use crate::sys_tick;

/// Time, motors and watchdog for the slot timer's handler.
pub struct ChipBoard<C>(PhantomData<C>);

impl<C> ChipBoard<C> {
    /// The board.
    #[allow(clippy::new_without_default, reason = "there is one")]
    pub const fn new() -> Self {
        ChipBoard(PhantomData)
    }
}

impl<C: MotorChip> Board for ChipBoard<C> {
    const TICKS_PER_US: u32 = C::TICKS_PER_US;
    const COUNT_BITS: u32 = sys_tick::BITS;

    fn now_ticks(&mut self) -> u64 {
        sys_tick::advance()
    }

    #[inline(always)]
    fn now_low_ticks(&mut self) -> u32 {
        sys_tick::low_ticks()
    }

    #[inline(always)]
    fn count(&mut self) -> u32 {
        sys_tick::count()
    }

    fn feed_watchdog(&mut self) {
        C::feed_watchdog();
    }

    fn motors_off(&mut self) {
        C::motors_off();
    }
}

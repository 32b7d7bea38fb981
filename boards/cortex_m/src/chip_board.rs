//! A board with a body of its own, as the real-time side sees it, on cores whose time is
//! [`sys_tick`]'s.

use core::marker::PhantomData;

#[cfg(feature = "can")]
use esm_link::message::SafeReason;
#[cfg(feature = "can")]
use rt_firmware::ActivationStart;
use rt_firmware::Board;
#[cfg(feature = "can")]
use rt_firmware::frames::LinkDevice;

#[cfg(feature = "can")]
use crate::can_line::{CanChip as BoardChip, Device};
#[cfg(not(feature = "can"))]
use crate::chip::Chip as BoardChip;
use crate::chip::MotorChip;
use crate::sys_tick;

/// Time, motors and watchdog for the slot timer's handler.
pub struct ChipBoard<C: BoardChip> {
    #[cfg(feature = "can")]
    frames: Option<Device<C>>,
    chip: PhantomData<C>,
}

impl<C: BoardChip> ChipBoard<C> {
    /// The board.
    #[allow(clippy::new_without_default, reason = "there is one")]
    pub const fn new() -> Self {
        ChipBoard {
            #[cfg(feature = "can")]
            frames: None,
            chip: PhantomData,
        }
    }

    /// Gives it the device of a mission's link.
    #[cfg(feature = "can")]
    pub fn connect(&mut self, frames: Device<C>) {
        self.frames = Some(frames);
    }
}

impl<C: MotorChip + BoardChip> Board for ChipBoard<C> {
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

    /// The device learns how robot time goes with the clock.
    #[cfg(feature = "can")]
    #[inline(always)]
    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        if let Some(frames) = &mut self.frames {
            frames.note(activation.start_us, activation.start_ticks);
        }
        Ok(())
    }

    #[cfg(feature = "can")]
    fn link(&mut self, index: usize) -> Option<&mut dyn LinkDevice> {
        let device = self.frames.as_mut().filter(|_| index == 0)?;
        Some(device)
    }

    fn feed_watchdog(&mut self) {
        C::feed_watchdog();
    }

    fn motors_off(&mut self) {
        C::motors_off();
    }
}

//! When the mission's time was 0.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::chip::clock::TICKS_PER_US;
use rt_firmware::ActivationStart;

/// The clock's ticks when the mission's time was 0, their low half.
pub static ORIGIN: AtomicU32 = AtomicU32::new(0);

/// Takes it from the start of an activation of the interpreter's slot.
#[inline(always)]
pub fn note(activation: &ActivationStart) {
    if activation.interpreter {
        let since_ticks = (activation.start_us as u32).wrapping_mul(TICKS_PER_US);
        let start_ticks = activation.start_ticks as u32;
        ORIGIN.store(start_ticks.wrapping_sub(since_ticks), Relaxed);
    }
}

//! Why the firmware ended, and what happened last, kept in RAM that no start-up code clears, and
//! told after the reset.
//!
//! Everything that ends the firmware comes through [`end`]: motors off, reason kept, reset. A reset
//! that left no reason was the watchdog's own (interrupts were masked for good) or came from
//! outside: then the chip's own register says more.

use cortex_m_board::{crash, last_exchange};
use esm_link::message::ResetReason;
use rt_firmware::retained_ram::CrashCause;

use crate::registers::system_control;
use crate::reset_cause;

/// Value for PBORCTL with which a supply that sags resets the chip, and is told as that. After a
/// reset the register says that it shall be an interrupt, with the same times.
const RESET_ON_BROWN_OUT: u32 = 0x7FFF;

/// Why the firmware starts, and how far the plant's time had come. To be called once, at the start.
pub fn take() -> (ResetReason, u64) {
    let plant_time_us = last_exchange::take();
    let hardware = reset_cause::reason(system_control::RESC.read());
    // Each bit stays until it is cleared: the next reset is to be told from this one.
    system_control::RESC.write(0);
    system_control::PBORCTL.write(RESET_ON_BROWN_OUT);
    (crash::begin(hardware), plant_time_us)
}

/// Ends the firmware: motors off, the reason kept, reset. From any context.
pub fn end(cause: &CrashCause<'_>) -> ! {
    crash::end(cause, last_exchange::motors_off)
}

cortex_m_board::crash_handlers!(end);

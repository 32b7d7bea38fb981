//! Why the firmware starts, and how it ends: motors off, the reason kept in RAM that no start-up
//! code clears, reset.

use cortex_m_board::crash;
#[cfg(feature = "emulation")]
use cortex_m_board::last_exchange::motors_off;
use esm_link::message::ResetReason;
use rt_firmware::retained_ram::CrashCause;

#[cfg(not(feature = "emulation"))]
use crate::silicon::motors::all_off as motors_off;
use crate::{clock, reset_cause};

/// Why the firmware starts. To be called once, at the start.
pub fn take() -> ResetReason {
    let hardware = reset_cause::reason(clock::rcc().csr().read().bits());
    // Each bit stays until it is cleared: the next reset is to be told from this one.
    clock::rcc().csr().modify(|_, w| w.rmvf().set_bit());
    crash::begin(hardware)
}

/// Ends the firmware: motors off, the reason kept, reset. From any context.
pub fn end(cause: &CrashCause<'_>) -> ! {
    crash::end(cause, motors_off)
}

cortex_m_board::crash_handlers!(end);

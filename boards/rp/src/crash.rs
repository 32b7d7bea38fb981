//! How the firmware ends, and why it starts.

use cortex_m_board::crash;
pub use cortex_m_board::crash::{kept, log_reset};
use esm_link::message::ResetReason;
use rt_firmware::retained_ram::CrashCause;

use crate::chip::{ChipReset, chip_reset};
use crate::hal::pac::WATCHDOG;
use crate::{motors, outputs};

/// Why the firmware starts. To be called once, at the start.
pub(crate) fn take(chip: &ChipReset, watchdog: &WATCHDOG) -> ResetReason {
    let by_watchdog = watchdog.reason().read();
    // The chip tells the last reset of all of it; the watchdog, and the core's own request, are
    // resets behind that.
    let hardware = if by_watchdog.timer().bit_is_set() {
        Some(ResetReason::Watchdog)
    } else if by_watchdog.force().bit_is_set() {
        Some(ResetReason::Software)
    } else {
        chip_reset(chip)
    };
    crash::begin(hardware)
}

/// Ends the firmware: motors off, the reason kept, reset. From any context.
pub fn end(cause: &CrashCause<'_>) -> ! {
    crash::end(cause, || {
        motors::all_off();
        outputs::all_off();
    })
}

cortex_m_board::crash_handlers!(end);

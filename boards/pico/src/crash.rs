//! How the firmware ends, and why it starts.

use cortex_m_board::crash;
pub use cortex_m_board::crash::{kept, log_reset};
use esm_link::message::ResetReason;
use rp2040_hal::pac::{VREG_AND_CHIP_RESET, WATCHDOG};
use rt_firmware::retained_ram::CrashCause;

use crate::{motors, outputs};

/// Why the firmware starts. To be called once, at the start.
pub fn take(chip: &VREG_AND_CHIP_RESET, watchdog: &WATCHDOG) -> ResetReason {
    let cause = chip.chip_reset().read();
    let by_watchdog = watchdog.reason().read();
    // The chip tells the last reset of all of it; the watchdog, and the core's own request, are
    // resets behind that.
    let hardware = if by_watchdog.timer().bit_is_set() {
        Some(ResetReason::Watchdog)
    } else if by_watchdog.force().bit_is_set() {
        Some(ResetReason::Software)
    } else if cause.had_run().bit_is_set() {
        Some(ResetReason::Pin)
    } else if cause.had_por().bit_is_set() {
        Some(ResetReason::PowerOn)
    } else {
        None
    };
    kept().begin(hardware)
}

/// Ends the firmware: motors off, the reason kept, reset. From any context.
pub fn end(cause: &CrashCause<'_>) -> ! {
    crash::end(cause, || {
        motors::all_off();
        outputs::all_off();
    })
}

cortex_m_board::crash_handlers!(end);

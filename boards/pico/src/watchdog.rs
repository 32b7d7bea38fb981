//! The hardware watchdog: what ends a task that never returns.
//!
//! The real-time side feeds it as long as all show heartbeats who should:
//! [`rt_firmware::supervision`]. If it does not for [`TIMEOUT_US`], the watchdog resets the chip,
//! which lets go of all pins: the motors stop. There is no last word of the firmware then, and the
//! chip tells the reason at the next start.

use rp2040_hal::Watchdog;
use rp2040_hal::fugit::MicrosDurationU32;

/// How long the slot timer's handler may stay away, in microseconds: several times the longest
/// sleep of the slot timer.
pub const TIMEOUT_US: u32 = 300_000;

/// Starts the watchdog; nothing but a reset stops it.
pub(crate) fn start(watchdog: &mut Watchdog) {
    watchdog.start(MicrosDurationU32::from_ticks(TIMEOUT_US));
}

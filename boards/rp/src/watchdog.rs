//! The hardware watchdog: what ends a task that never returns.
//!
//! The real-time side feeds it as long as all show heartbeats who should:
//! [`rt_firmware::supervision`]. If it does not for [`TIMEOUT_US`], the watchdog resets the chip,
//! which lets go of all pins: the motors stop. There is no last word of the firmware then, and the
//! chip tells the reason at the next start.

use crate::chip::WATCHDOG_COUNTS_PER_US;
use crate::hal::Watchdog;
use crate::hal::fugit::MicrosDurationU32;
use crate::hal::pac::{Peripherals, WATCHDOG};

/// How long the slot timer's handler may stay away, in microseconds: several times the longest
/// sleep of the slot timer.
pub const TIMEOUT_US: u32 = 300_000;

/// Starts the watchdog; nothing but a reset stops it.
pub fn start() {
    // SAFETY: the clocks, which had it, are started.
    let mut watchdog = Watchdog::new(unsafe { Peripherals::steal() }.WATCHDOG);
    watchdog.start(MicrosDurationU32::from_ticks(TIMEOUT_US));
}

/// Starts the count anew.
pub(crate) fn feed() {
    // SAFETY: the register is there for the chip's whole life, and any bits are a count.
    unsafe {
        let registers = &*WATCHDOG::ptr();
        registers
            .load()
            .write(|w| w.bits(TIMEOUT_US * WATCHDOG_COUNTS_PER_US));
    }
}

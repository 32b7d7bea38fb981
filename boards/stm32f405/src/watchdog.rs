//! The independent watchdog, which counts a clock of its own: what ends a task that never returns.
//!
//! The real-time side feeds it as long as all show heartbeats who should:
//! [`rt_firmware::supervision`]. If it does not for [`TIMEOUT_US`], the watchdog resets the chip,
//! which lets go of all pins: the motors stop. There is no last word of the firmware then, and the
//! chip tells the reason at the next start. The emulator has no such part.

use crate::pac::{IWDG, iwdg};

/// How long the slot timer's handler may stay away, in microseconds, at the clock's nominal 32 kHz.
/// It has 17 to 47 (data sheet, table 34), so that it is between 341 ms and 941 ms: always several
/// times the longest sleep of the slot timer.
pub const TIMEOUT_US: u32 = 500_000;

const KEY_ACCESS: u16 = 0x5555;
const KEY_FEED: u16 = 0xAAAA;
const KEY_START: u16 = 0xCCCC;

#[inline(always)]
fn watchdog() -> &'static iwdg::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. They are written by `start`, with
    // interrupts off, and by the slot timer's handler.
    unsafe { &*IWDG::PTR }
}

/// Starts the watchdog; nothing but a reset stops it.
pub fn start() {
    /// 32 kHz, divided by 16.
    const TICKS_PER_MS: u32 = 2;
    const RELOAD: u16 = (TIMEOUT_US / 1_000 * TICKS_PER_MS) as u16;
    // SAFETY: keys, and a count of 12 bits, as the part takes them.
    unsafe {
        watchdog().kr().write(|w| w.bits(KEY_START));
        watchdog().kr().write(|w| w.bits(KEY_ACCESS));
        watchdog().pr().write(|w| w.pr().divide_by16());
        watchdog().rlr().write(|w| w.rl().bits(RELOAD));
    }
    feed();
}

/// Starts the count anew. Inlined, since the flash cannot always be read where it is called.
#[inline(always)]
pub fn feed() {
    // SAFETY: a key.
    watchdog().kr().write(|w| unsafe { w.bits(KEY_FEED) });
}

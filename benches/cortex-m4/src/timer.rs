//! The board's timer 0 (CMSDK APB timer): it counts down, 25 million times a second, 32 bits wide.
#![expect(
    unsafe_code,
    reason = "registers of a peripheral for which there is no crate"
)]

use core::ptr::{read_volatile, write_volatile};

const CONTROL: *mut u32 = 0x4000_0000 as *mut u32;
const VALUE: *mut u32 = 0x4000_0004 as *mut u32;
const RELOAD: *mut u32 = 0x4000_0008 as *mut u32;
const CONTROL_ENABLE: u32 = 1;

/// The timer, while it runs.
pub struct Timer(());

impl Timer {
    /// Starts it.
    #[must_use]
    pub fn start() -> Self {
        // SAFETY: the addresses are the timer's registers on the only board that this is for; they
        // are words, aligned, and may be written at any time.
        unsafe {
            write_volatile(RELOAD, u32::MAX);
            write_volatile(VALUE, u32::MAX);
            write_volatile(CONTROL, CONTROL_ENABLE);
        }
        Self(())
    }

    /// Ticks since some time; they wrap.
    #[inline(always)]
    #[must_use]
    pub fn now(&self) -> u32 {
        // SAFETY: as above; reading has no effect.
        !unsafe { read_volatile(VALUE) }
    }
}

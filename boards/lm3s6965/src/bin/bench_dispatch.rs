//! A robot that measures how its slots are started, on this board: `cargo xtask bench dispatch`.
//! What it does stands in `cortex_m/measured/dispatch.rs`.
#![no_std]
#![no_main]

use lm3s6965 as chip;

#[path = "../../../cortex_m/measured/dispatch.rs"]
mod dispatch;

mod own {
    //! What the chip has in its own way.

    use lm3s6965::pac::Interrupt;
    use lm3s6965::registers::watchdog0;

    /// Interrupts of the link and of its line.
    pub const LINK: [Interrupt; 2] = [Interrupt::SSI0, Interrupt::UART0];

    /// Before checks are measured: the watchdog counts down from 86 seconds, which is longer than
    /// all of them take, and is the stopwatch.
    pub fn begin_checks() {
        watchdog0::LOAD.write(u32::MAX);
    }

    /// What some work takes, in ticks of the clock.
    pub fn ticks_of(work: impl FnOnce()) -> u32 {
        let before = watchdog0::VALUE.read();
        work();
        before.wrapping_sub(watchdog0::VALUE.read())
    }
}

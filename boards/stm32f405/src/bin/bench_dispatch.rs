//! A robot that measures how its slots are started, on this board: `cargo xtask bench dispatch
//! --board stm32f405`. What it does stands in `cortex_m/measured/dispatch.rs`.
#![no_std]
#![no_main]

use stm32f405 as chip;

#[path = "../../../cortex_m/measured/dispatch.rs"]
mod dispatch;

mod own {
    //! What the chip has in its own way.

    use stm32f405::clock::TICKS_PER_US;
    use stm32f405::pac::{Interrupt, TIM3};

    /// Interrupts of the link and of its lines.
    pub const LINK: [Interrupt; 3] = [Interrupt::CAN2_SCE, Interrupt::USART1, Interrupt::TIM5];

    /// Before checks are measured: the emulator has no watchdog, and its timers run by themselves.
    pub const fn begin_checks() {}

    /// What some work takes, in ticks of the clock. The emulator's timer counts nanoseconds, over
    /// and over in 32 bits, which are 4 s.
    pub fn ticks_of(work: impl FnOnce()) -> u32 {
        // SAFETY: the registers are there for the chip's whole life, and are only read.
        let timer = unsafe { &*TIM3::PTR };
        let before_ns = timer.cnt().read().bits();
        work();
        let took_ns = timer.cnt().read().bits().wrapping_sub(before_ns);
        (u64::from(took_ns) * u64::from(TICKS_PER_US) / 1_000) as u32
    }
}

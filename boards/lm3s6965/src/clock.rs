//! The system clock, and the time since start-up.
//!
//! The core runs at 50 MHz, the most that the part can do: 50 ticks a microsecond, and SysTick's 24
//! bits last for a third of a second. (QEMU derives the ticks of SysTick, timers and watchdog from
//! the divisor in RCC; how long an instruction takes is set by `-icount`.)
//!
//! SysTick counts the time ([`cortex_m_board::sys_tick`]); the slot timer's interrupt comes at
//! least every [`LONGEST_SLEEP_US`](crate::slot_timer::LONGEST_SLEEP_US).

use cortex_m_board::sys_tick::{self, Source};
use rt_firmware::board::microseconds;

use crate::registers::system_control;

pub use crate::settings::TICKS_PER_US;

/// Sets the system clock to 50 MHz and starts SysTick. To be called once, before anything that
/// counts time.
pub fn start() {
    const { assert!(TICKS_PER_US == 50, "the divisor below makes 50 MHz") };
    // From the main oscillator (8 MHz crystal) through the PLL (200 MHz after its fixed divisor),
    // divided by 4.
    const CRYSTAL_8_MHZ: u32 = 0xE << 6;
    const DIVIDE_BY_4: u32 = 3 << 23;
    const USE_DIVISOR: u32 = 1 << 22;
    const PLL_POWER_DOWN: u32 = 1 << 13;
    const BYPASS_PLL: u32 = 1 << 11;
    const PLL_LOCKED: u32 = 1 << 6;
    const LOCK_READS: u32 = 10_000;
    let running = CRYSTAL_8_MHZ | DIVIDE_BY_4 | USE_DIVISOR;
    system_control::RCC.write(running | BYPASS_PLL | PLL_POWER_DOWN);
    system_control::RCC.write(running | BYPASS_PLL);
    // The PLL locks within half a millisecond. Bounded, since a part whose PLL never locks still
    // should say so over its UART.
    for _ in 0..LOCK_READS {
        if system_control::RIS.read() & PLL_LOCKED != 0 {
            break;
        }
    }
    system_control::RCC.write(running);

    sys_tick::start(Source::Core);
}

/// Microseconds since start-up. From any context.
pub fn now_us() -> u64 {
    microseconds(sys_tick::now_ticks(), TICKS_PER_US)
}

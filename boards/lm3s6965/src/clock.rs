//! The system clock, and the time since start-up.
//!
//! The core runs at 50 MHz, the most that the part can do: 50 ticks a microsecond, and SysTick's 24
//! bits last for a third of a second. (QEMU derives the ticks of SysTick, timers and watchdog from
//! the divisor in RCC; how long an instruction takes is set by `-icount`.)
//!
//! SysTick runs free and interrupts nobody. The slot timer's interrupt, which comes at least every
//! [`LONGEST_SLEEP_US`](crate::slot_timer::LONGEST_SLEEP_US), takes over what it has counted
//! ([`rt_firmware::clock`]).

use rt_firmware::board::microseconds;
use rt_firmware::clock::Clock;

use crate::registers::{sys_tick, system_control};

pub use crate::settings::TICKS_PER_US;

/// Bits that SysTick counts.
pub const SYS_TICK_BITS: u32 = 24;
/// Where SysTick begins, and the mask of a difference of two of its counts.
pub const SYS_TICK_MAX: u32 = (1 << SYS_TICK_BITS) - 1;

static CLOCK: Clock<SYS_TICK_BITS> = Clock::new();

/// Ticks since start-up, their [lowest bits](SYS_TICK_BITS): SysTick counts down. Those above mean
/// nothing.
#[inline(always)]
pub fn count() -> u32 {
    !sys_tick::CVR.read()
}

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

    const ENABLE_FROM_CORE_CLOCK: u32 = 0b101;
    sys_tick::RVR.write(SYS_TICK_MAX);
    sys_tick::CVR.write(0);
    sys_tick::CSR.write(ENABLE_FROM_CORE_CLOCK);
}

/// Ticks since start-up. From any context.
pub fn now_ticks() -> u64 {
    CLOCK.now(count)
}

/// Microseconds since start-up. From any context.
pub fn now_us() -> u64 {
    microseconds(now_ticks(), TICKS_PER_US)
}

/// Takes over what SysTick has counted, and returns the ticks since start-up. For the slot timer's
/// interrupt alone; it must come at least once in each round of SysTick (a third of a second).
pub fn advance() -> u64 {
    CLOCK.advance(count())
}

/// The low half of the ticks since start-up. For the slot timer's interrupt alone.
#[inline(always)]
pub fn low_ticks() -> u32 {
    CLOCK.low(count())
}

/// Ticks until the clock shows this, in its low half, which is less than half a round of SysTick
/// away; where it has shown it, a [long time](is_past).
#[inline(always)]
pub fn ticks_until(at_ticks: u32) -> u32 {
    // What the counter adds to this, in its bits, is the rest: it counts down.
    let rest = at_ticks.wrapping_sub(SYS_TICK_MAX);
    rest.wrapping_add(sys_tick::CVR.read()) & SYS_TICK_MAX
}

/// Whether [`ticks_until`] says of a time that it has come.
#[inline(always)]
pub fn is_past(ticks: u32) -> bool {
    const LONGEST: u32 = SYS_TICK_MAX / 2;
    ticks == 0 || ticks > LONGEST
}

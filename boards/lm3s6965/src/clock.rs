//! The system clock, and the time in microseconds since start-up.
//!
//! The core runs at 50 MHz, the most that the part can do: 50 ticks a microsecond, and SysTick's 24 bits last for a third of a second.
//! (QEMU derives the ticks of SysTick, timers and watchdog from the divisor in RCC; how long an instruction takes is set by `-icount`.)
//!
//! SysTick runs free and interrupts nobody. The slot timer's interrupt, which comes at least every
//! [`LONGEST_SLEEP_US`](crate::slot_timer::LONGEST_SLEEP_US), adds what it has counted to a base; everybody else adds what it has
//! counted since then to that base. So time needs no lock: one context writes the base, and the others notice if they were
//! interrupted while they read it.

use core::sync::atomic::{AtomicU32, Ordering};

use crate::registers::{sys_tick, system_control};

/// Ticks of the system clock in a microsecond.
pub const TICKS_PER_US: u32 = 50;

/// Bits that SysTick counts.
const SYS_TICK_MASK: u32 = 0x00FF_FFFF;

/// An instant at which [`advance`] read SysTick.
struct Base {
    low_us: AtomicU32,
    high_us: AtomicU32,
    /// Ticks beyond the whole microseconds.
    rest_ticks: AtomicU32,
    /// SysTick's value at that instant.
    count: AtomicU32,
}

impl Base {
    const fn zero() -> Self {
        Self {
            low_us: AtomicU32::new(0),
            high_us: AtomicU32::new(0),
            rest_ticks: AtomicU32::new(0),
            count: AtomicU32::new(SYS_TICK_MASK),
        }
    }
}

/// The base, twice: while one is written, the other holds.
static BASES: [Base; 2] = [const { Base::zero() }; 2];
/// Number of times that the base was moved; its last bit tells which of the two holds.
static MOVES: AtomicU32 = AtomicU32::new(0);

/// Time since the base, or the base itself.
#[derive(Clone, Copy)]
pub struct Instant {
    /// Whole microseconds since start-up.
    pub us: u64,
    /// Ticks beyond them, below [`TICKS_PER_US`].
    pub rest_ticks: u32,
}

/// Sets the system clock to 50 MHz and starts SysTick. To be called once, before anything that counts time.
pub fn start() {
    // From the main oscillator (8 MHz crystal) through the PLL (200 MHz after its fixed divisor), divided by 4.
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
    // The PLL locks within half a millisecond. Bounded, since a part whose PLL never locks still should say so over its UART.
    for _ in 0..LOCK_READS {
        if system_control::RIS.read() & PLL_LOCKED != 0 {
            break;
        }
    }
    system_control::RCC.write(running);

    const ENABLE_FROM_CORE_CLOCK: u32 = 0b101;
    sys_tick::RVR.write(SYS_TICK_MASK);
    sys_tick::CVR.write(0);
    sys_tick::CSR.write(ENABLE_FROM_CORE_CLOCK);
}

/// The time since start-up in microseconds. From any context.
pub fn now_us() -> u64 {
    now().us
}

/// The time since start-up to the tick. From any context.
pub fn now() -> Instant {
    loop {
        let moves = MOVES.load(Ordering::Acquire);
        let base = &BASES[(moves & 1) as usize];
        let us = u64::from(base.high_us.load(Ordering::Relaxed)) << 32
            | u64::from(base.low_us.load(Ordering::Relaxed));
        let rest_ticks = base.rest_ticks.load(Ordering::Relaxed);
        let count = base.count.load(Ordering::Relaxed);
        let ticks = rest_ticks + (count.wrapping_sub(sys_tick::CVR.read()) & SYS_TICK_MASK);
        if MOVES.load(Ordering::Acquire) == moves {
            return Instant {
                us: us + u64::from(ticks / TICKS_PER_US),
                rest_ticks: ticks % TICKS_PER_US,
            };
        }
    }
}

/// Moves the base to now. For the slot timer's interrupt alone; it must come at least once in each round of SysTick (a third of a second).
pub fn advance() -> Instant {
    let moves = MOVES.load(Ordering::Relaxed);
    let old = &BASES[(moves & 1) as usize];
    let new = &BASES[(moves.wrapping_add(1) & 1) as usize];
    let count = sys_tick::CVR.read();
    let ticks = old.rest_ticks.load(Ordering::Relaxed)
        + (old.count.load(Ordering::Relaxed).wrapping_sub(count) & SYS_TICK_MASK);
    let us = (u64::from(old.high_us.load(Ordering::Relaxed)) << 32
        | u64::from(old.low_us.load(Ordering::Relaxed)))
        + u64::from(ticks / TICKS_PER_US);
    let rest_ticks = ticks % TICKS_PER_US;
    new.low_us.store(us as u32, Ordering::Relaxed);
    new.high_us.store((us >> 32) as u32, Ordering::Relaxed);
    new.rest_ticks.store(rest_ticks, Ordering::Relaxed);
    new.count.store(count, Ordering::Relaxed);
    MOVES.store(moves.wrapping_add(1), Ordering::Release);
    Instant { us, rest_ticks }
}

//! The system clock, and the time since start-up.
//!
//! The core runs at 50 MHz, the most that the part can do: 50 ticks a microsecond, and SysTick's 24 bits last for a third of a second.
//! (QEMU derives the ticks of SysTick, timers and watchdog from the divisor in RCC; how long an instruction takes is set by `-icount`.)
//!
//! SysTick runs free and interrupts nobody. The slot timer's interrupt, which comes at least every
//! [`LONGEST_SLEEP_US`](crate::slot_timer::LONGEST_SLEEP_US), adds what it has counted to a base; everybody else adds what it has
//! counted since then to that base. So time needs no lock: one context writes the base, and the others notice if they were
//! interrupted while they read it.

use core::sync::atomic::{AtomicU32, Ordering};

use rt_firmware::board::microseconds;

use crate::registers::{sys_tick, system_control};

pub use crate::settings::TICKS_PER_US;

/// Bits that SysTick counts.
const SYS_TICK_MASK: u32 = 0x00FF_FFFF;

/// An instant at which [`advance`] read SysTick.
struct Base {
    /// Ticks since start-up, in two halves.
    low_ticks: AtomicU32,
    high_ticks: AtomicU32,
    /// SysTick's value at that instant.
    count: AtomicU32,
}

impl Base {
    const fn zero() -> Self {
        Self {
            low_ticks: AtomicU32::new(0),
            high_ticks: AtomicU32::new(0),
            count: AtomicU32::new(SYS_TICK_MASK),
        }
    }

    /// The time in ticks when SysTick stands at `count`.
    fn ticks_at(&self, count: u32) -> u64 {
        let base = u64::from(self.high_ticks.load(Ordering::Relaxed)) << 32
            | u64::from(self.low_ticks.load(Ordering::Relaxed));
        // SysTick counts down.
        let since = self.count.load(Ordering::Relaxed).wrapping_sub(count) & SYS_TICK_MASK;
        base + u64::from(since)
    }
}

/// The base, twice: while one is written, the other holds.
static BASES: [Base; 2] = [const { Base::zero() }; 2];
/// Number of times that the base was moved; its last bit tells which of the two holds.
static MOVES: AtomicU32 = AtomicU32::new(0);

/// Sets the system clock to 50 MHz and starts SysTick. To be called once, before anything that counts time.
pub fn start() {
    const { assert!(TICKS_PER_US == 50, "the divisor below makes 50 MHz") };
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

/// Ticks since start-up. From any context.
pub fn now_ticks() -> u64 {
    loop {
        let moves = MOVES.load(Ordering::Acquire);
        let [even, odd] = &BASES;
        let base = if moves.is_multiple_of(2) { even } else { odd };
        let ticks = base.ticks_at(sys_tick::CVR.read());
        // Moved meanwhile: what was read may be of two bases. The next attempt meets no move, since moves are further apart than this takes.
        if MOVES.load(Ordering::Acquire) == moves {
            return ticks;
        }
    }
}

/// Microseconds since start-up. From any context.
pub fn now_us() -> u64 {
    microseconds(now_ticks(), TICKS_PER_US)
}

/// Moves the base to now, and returns it in ticks. For the slot timer's interrupt alone; it must come at least once in each round of
/// SysTick (a third of a second).
pub fn advance() -> u64 {
    let moves = MOVES.load(Ordering::Relaxed);
    let [even, odd] = &BASES;
    let (old, new) = if moves.is_multiple_of(2) {
        (even, odd)
    } else {
        (odd, even)
    };
    let count = sys_tick::CVR.read();
    let ticks = old.ticks_at(count);
    new.low_ticks.store(ticks as u32, Ordering::Relaxed);
    new.high_ticks
        .store((ticks >> 32) as u32, Ordering::Relaxed);
    new.count.store(count, Ordering::Relaxed);
    MOVES.store(moves.wrapping_add(1), Ordering::Release);
    ticks
}

//! The time since start-up, counted by the core's SysTick timer (ARMv7-M architecture, B3.3).
//!
//! SysTick has 24 bits, runs free and interrupts nobody. The slot timer's interrupt takes over what
//! it has counted ([`rt_firmware::clock`]); it must come at least once in each of its rounds.

use cortex_m::peripheral::SYST;
use rt_firmware::clock::Clock;

/// Bits that SysTick counts.
pub const BITS: u32 = 24;
/// Where SysTick begins, and the mask of a difference of two of its counts.
pub const MAX: u32 = (1 << BITS) - 1;

static CLOCK: Clock<BITS> = Clock::new();

/// What SysTick counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The core's clock.
    Core,
    /// The reference clock, which is up to the chip.
    Reference,
}

/// SysTick's registers.
#[inline(always)]
fn registers() -> &'static cortex_m::peripheral::syst::RegisterBlock {
    // SAFETY: the registers are there for the core's whole life. They are written to by `start`
    // alone, before anybody counts time.
    unsafe { &*SYST::PTR }
}

/// Starts SysTick. To be called once, before anything that counts time.
pub fn start(source: Source) {
    const ENABLE: u32 = 1;
    const FROM_CORE_CLOCK: u32 = 1 << 2;
    let enable = match source {
        Source::Core => ENABLE | FROM_CORE_CLOCK,
        Source::Reference => ENABLE,
    };
    // SAFETY: any 24 bits are a value to begin with, and no interrupt is asked for.
    unsafe {
        registers().rvr.write(MAX);
        registers().cvr.write(0);
        registers().csr.write(enable);
    }
}

/// What SysTick shows; it counts down.
#[inline(always)]
pub fn current() -> u32 {
    registers().cvr.read()
}

/// Ticks since start-up, their [lowest bits](BITS). Those above mean nothing.
#[inline(always)]
pub fn count() -> u32 {
    !current()
}

/// Ticks since start-up. From any context.
pub fn now_ticks() -> u64 {
    CLOCK.now(count)
}

/// Takes over what SysTick has counted, and returns the ticks since start-up. For the slot timer's
/// interrupt alone; it must come at least once in each round of SysTick.
pub fn advance() -> u64 {
    CLOCK.advance(count())
}

/// How often [`advance`] was called: each slot does.
#[cfg(feature = "selftest")]
pub fn moves() -> u32 {
    CLOCK.moves()
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
    let rest = at_ticks.wrapping_sub(MAX);
    rest.wrapping_add(current()) & MAX
}

/// Whether [`ticks_until`] says of a time that it has come.
#[inline(always)]
pub fn is_past(ticks: u32) -> bool {
    const LONGEST: u32 = MAX / 2;
    ticks == 0 || ticks > LONGEST
}

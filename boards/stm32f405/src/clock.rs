//! The clocks, and the time since start-up.
//!
//! The core runs at 168 MHz, the most that the part can do, from a crystal of 8 MHz. SysTick counts
//! an eighth of that, 21 ticks a microsecond, so that its 24 bits last for 0.8 s
//! ([`cortex_m_board::sys_tick`]). [The slot timer](crate::slot_timer) keeps the time.
//!
//! The emulator's clock tree is fixed: the core has 168 MHz, and timers count nanoseconds.

use cortex_m_board::sys_tick::{self, Source};
use rt_firmware::board::microseconds;

use crate::pac::{RCC, rcc};

pub use crate::settings::TICKS_PER_US;

/// Frequency of the core in hertz.
pub const CORE_HZ: u32 = 168_000_000;
/// Frequency of the bus of USART 1 and of the timers 1 and 8, in hertz.
pub const APB2_HZ: u32 = CORE_HZ / 2;

const _: () = assert!(TICKS_PER_US == CORE_HZ / 8 / 1_000_000);

/// Clocks and resets of the chip's parts. Bits are set at the start, with interrupts off, and by
/// nobody later.
pub(crate) fn rcc() -> &'static rcc::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life; who writes them is said above.
    unsafe { &*RCC::PTR }
}

/// Starts the clocks, and SysTick. To be called once, before anything that counts time.
pub fn start() {
    #[cfg(not(feature = "emulation"))]
    start_tree();
    sys_tick::start(Source::Reference);
}

/// Sets the core's clock to 168 MHz, APB1 to 42 and APB2 to 84.
#[cfg(not(feature = "emulation"))]
fn start_tree() {
    /// Looks at a bit, 20 ms at 16 MHz and more: a crystal takes 2 ms as a rule, the PLL 0.3 ms at
    /// most (data sheet, characteristics of both). A chip whose crystal does not swing goes on at
    /// 16 MHz, and says nothing that anybody understands at its serial line.
    const LOOKS: u32 = 100_000;
    let rcc = self::rcc();
    let wait = |is_ready: &dyn Fn() -> bool| (0..LOOKS).any(|_| is_ready());
    rcc.cr().modify(|_, w| w.hseon().on());
    if !wait(&|| rcc.cr().read().hserdy().is_ready()) {
        return;
    }
    // 8 MHz / 8 × 336 / 2; 48 MHz for what needs it.
    // SAFETY: divisors as the reference manual (RM0090, 7.3.2) allows them.
    rcc.pllcfgr().write(|w| unsafe {
        w.pllsrc().hse();
        w.pllm()
            .bits(8)
            .plln()
            .bits(336)
            .pllp()
            .div2()
            .pllq()
            .bits(7)
    });
    rcc.cr().modify(|_, w| w.pllon().on());
    if !wait(&|| rcc.cr().read().pllrdy().is_ready()) {
        return;
    }
    // SAFETY: the registers are there for the chip's whole life; nobody else has them.
    let flash = unsafe { &*crate::pac::FLASH::PTR };
    // At 168 MHz and 3.3 V a read of the flash takes 6 cycles (RM0090, table 10).
    flash.acr().write(|w| {
        w.latency().ws5();
        w.prften().enabled().icen().enabled().dcen().enabled()
    });
    rcc.cfgr().write(|w| {
        w.hpre().div1().ppre1().div4().ppre2().div2();
        w.sw().pll()
    });
    wait(&|| rcc.cfgr().read().sws().is_pll());
}

/// Microseconds since start-up. From any context.
pub fn now_us() -> u64 {
    microseconds(sys_tick::now_ticks(), TICKS_PER_US)
}

/// What so many ticks are on the emulator's timers.
#[cfg(feature = "emulation")]
#[inline(always)]
pub(crate) const fn nanoseconds(ticks: u32) -> u32 {
    ticks.wrapping_mul(1_000).div_ceil(TICKS_PER_US)
}

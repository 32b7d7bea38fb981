//! The link's line: moved by the interrupt of timer 7, which looks at what DMA has moved; in the
//! emulator by that of USART 1, or by that of timer 5 (`cortex_m_board::plant_line`).

use crate::pac::Interrupt;
use cortex_m::peripheral::NVIC;
use cortex_m_board::line::{self, LineBoard};
#[cfg(feature = "selftest")]
use cortex_m_board::section_time;
#[cfg(feature = "selftest")]
use esm_link::selftest::Measures;

use crate::flash::{self, BoardStore};
use crate::{Stm32f405, clock, slot_timer};

pub use cortex_m_board::line::{RECEIVE_BYTES, TRANSMIT_BYTES};

/// The link task's end.
pub type LinkEnd = line::LinkEnd<Stm32f405>;

impl LineBoard for Stm32f405 {
    type Store = BoardStore;
    const FLASH_MS: u16 = flash::LONGEST_MS;
    #[cfg(feature = "selftest")]
    const RATES: Option<line::LineRates> = Some(crate::usart::RATES);

    #[cfg(feature = "selftest")]
    fn measures() -> Measures {
        Measures {
            critical_section_ns: Some(section_time::longest_ns(clock::TICKS_PER_US)),
            ..Measures::default()
        }
    }

    fn now_us() -> u64 {
        clock::now_us()
    }

    fn call_line() {
        #[cfg(feature = "emulation")]
        NVIC::pend(Interrupt::USART1);
        #[cfg(not(feature = "emulation"))]
        NVIC::pend(Interrupt::TIM7);
    }

    fn call_slots() {
        slot_timer::call();
    }
}

#[cfg(not(feature = "emulation"))]
pub use cortex_m_board::line::split;

/// The interrupt handler's end.
#[cfg(not(feature = "emulation"))]
pub type Line = line::Line<Stm32f405>;

#[cfg(feature = "emulation")]
pub use emulated::*;

#[cfg(feature = "emulation")]
mod emulated {
    use crate::pac::{TIM5, tim5};
    use cortex_m_board::emulated_line;
    use cortex_m_board::line_timer::LineTimer;

    use crate::Stm32f405;
    use crate::clock::{self, TICKS_PER_US};

    pub use emulated_line::split;

    /// The interrupt handler's end.
    pub type Line = emulated_line::Line<Stm32f405>;

    fn timer() -> &'static tim5::RegisterBlock {
        // SAFETY: the registers are there for the chip's whole life. They are written at the start,
        // with interrupts off, and by the line's handlers, which are of one priority.
        unsafe { &*TIM5::PTR }
    }

    impl LineTimer for Stm32f405 {
        fn start_line_timer() {
            clock::rcc().apb1enr().modify(|_, w| w.tim5en().enabled());
            timer().dier().write(|w| w.uie().enabled());
        }

        fn acknowledge_line_timer() {
            timer().cr1().reset();
            timer().sr().reset();
        }

        /// As the slot timer counts in the emulator.
        fn set_line_timer(ticks: u32) {
            // SAFETY: any bits are a count.
            (timer().arr()).write(|w| unsafe { w.bits(clock::nanoseconds(ticks)) });
            timer().cr1().write(|w| w.cen().enabled());
        }
    }

    /// Lets the timer run for so long; where the plant carries no bytes, without an interrupt.
    pub(crate) fn run_timer(us: u32) {
        Stm32f405::set_line_timer(us * TICKS_PER_US);
    }
}

//! The link's line: moved by the UART's interrupt, or by that of timer 1, in `line_timer`
//! ([`cortex_m_board::plant_line`]).

use cortex_m::peripheral::NVIC;
use cortex_m_board::emulated_line;
use cortex_m_board::line::{self, LineBoard};
#[cfg(feature = "selftest")]
use cortex_m_board::{line::LineRates, section_time};
#[cfg(feature = "selftest")]
use esm_link::selftest::Measures;
use pac::Interrupt;

use crate::clock;
#[cfg(feature = "selftest")]
use crate::clock::TICKS_PER_US;
use crate::flash::{self, BoardStore};
use crate::{Lm3s6965, slot_timer};

pub use cortex_m_board::emulated_line::split;
pub use cortex_m_board::line::{RECEIVE_BYTES, TRANSMIT_BYTES};

/// The interrupt handler's end.
pub type Line = emulated_line::Line<Lm3s6965>;
/// The link task's end.
pub type LinkEnd = line::LinkEnd<Lm3s6965>;

impl LineBoard for Lm3s6965 {
    type Store = BoardStore;
    const FLASH_MS: u16 = flash::LONGEST_MS;
    #[cfg(feature = "selftest")]
    const RATES: Option<LineRates> = Some(crate::uart::RATES);

    #[cfg(feature = "selftest")]
    fn measures() -> Measures {
        Measures {
            critical_section_ns: Some(section_time::longest_ns(TICKS_PER_US)),
            ..Measures::default()
        }
    }

    fn now_us() -> u64 {
        clock::now_us()
    }

    fn call_line() {
        NVIC::pend(Interrupt::UART0);
    }

    fn call_slots() {
        slot_timer::call();
    }
}

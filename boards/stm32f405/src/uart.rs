//! USART 1, the serial line of the link: 115,200 baud, 8 bits, no parity, on PA9 (TX) and PA10
//! (RX).
//!
//! [The line](crate::line) has the queues around it. The part has no FIFO: it calls for each byte.

use crate::pac::{USART1, usart1};
use cortex_m_board::line::Wire;

use crate::clock;
#[cfg(feature = "emulation")]
use crate::{Stm32f405, line};

/// Speed of the line in baud.
pub const BAUD: u32 = 115_200;

/// The part's registers.
fn usart() -> &'static usart1::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. They are written by `start`, with
    // interrupts off, and by the line's handlers, which are of one priority.
    unsafe { &*USART1::PTR }
}

/// Starts the part, with the interrupt of received bytes on.
pub fn start() {
    clock::rcc().apb2enr().modify(|_, w| w.usart1en().enabled());
    #[cfg(not(feature = "emulation"))]
    crate::silicon::parts::connect_usart();
    // SAFETY: 16 bits, of which the lowest 4 are sixteenths.
    (usart().brr()).write(|w| unsafe { w.bits(((clock::APB2_HZ + BAUD / 2) / BAUD) as u16) });
    set_control(false);
}

fn set_control(wants_sent: bool) {
    usart().cr1().write(|w| {
        w.ue().enabled().te().enabled().re().enabled();
        w.rxneie().enabled().txeie().bit(wants_sent)
    });
}

/// The bytes of the line, for its interrupt handler.
pub struct Uart;

impl Wire for Uart {
    const FIFO_BYTES: usize = 1;

    fn acknowledge(&mut self) {
        // A byte that came too late for the one before is gone, and its call is taken back by
        // reading both registers; where there is a byte, it is read anyway.
        let status = usart().sr().read();
        if status.ore().bit_is_set() && status.rxne().bit_is_clear() {
            usart().dr().read();
        }
    }

    /// A wire brings more by itself. The emulator looks at what stands for the wire only where its
    /// virtual time stops: at the deadlines of its timers, while the core sleeps. So a timer
    /// without an interrupt makes some, as long as bytes come.
    #[cfg(feature = "emulation")]
    fn expect_more(&mut self) {
        const LOOK_AGAIN_US: u32 = 40;
        line::run_timer(LOOK_AGAIN_US);
    }

    fn has_received(&mut self) -> bool {
        usart().sr().read().rxne().bit_is_set()
    }

    fn receive(&mut self) -> Option<u8> {
        if !self.has_received() {
            return None;
        }
        Some(usart().dr().read().bits() as u8)
    }

    fn can_send(&mut self) -> bool {
        usart().sr().read().txe().bit_is_set()
    }

    fn send(&mut self, byte: u8) {
        // SAFETY: any byte can be sent.
        usart().dr().write(|w| unsafe { w.bits(byte.into()) });
    }

    fn want_sent(&mut self, sent: bool) {
        set_control(sent);
        // The emulator sends at once, and does not call.
        #[cfg(feature = "emulation")]
        if sent {
            <Stm32f405 as cortex_m_board::line::LineBoard>::call_line();
        }
    }
}

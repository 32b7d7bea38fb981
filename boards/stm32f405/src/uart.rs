//! The bytes of USART 1, in the emulator: 115,200 baud, 8 bits, no parity.
//!
//! [The line](crate::line) has the queues around it. The part has no FIFO: it calls for each byte.

use cortex_m_board::line::{LineBoard, Wire};

use crate::usart::{self, registers};
use crate::{Stm32f405, line};

/// Starts the part, with the interrupt of received bytes on.
pub fn start() {
    usart::start();
    set_control(false);
}

fn set_control(wants_sent: bool) {
    registers().cr1().write(|w| {
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
        let status = registers().sr().read();
        if status.ore().bit_is_set() && status.rxne().bit_is_clear() {
            registers().dr().read();
        }
    }

    /// A wire brings more by itself. The emulator looks at what stands for the wire only where its
    /// virtual time stops: at the deadlines of its timers, while the core sleeps. So a timer
    /// without an interrupt makes some, as long as bytes come.
    fn expect_more(&mut self) {
        const LOOK_AGAIN_US: u32 = 40;
        line::run_timer(LOOK_AGAIN_US);
    }

    fn has_received(&mut self) -> bool {
        registers().sr().read().rxne().bit_is_set()
    }

    fn receive(&mut self) -> Option<u8> {
        self.has_received()
            .then(|| registers().dr().read().bits() as u8)
    }

    fn can_send(&mut self) -> bool {
        registers().sr().read().txe().bit_is_set()
    }

    fn send(&mut self, byte: u8) {
        // SAFETY: any byte can be sent.
        (registers().dr()).write(|w| unsafe { w.bits(byte.into()) });
    }

    fn set_rate(&mut self, baud: u32) {
        usart::set_rate(baud);
    }

    fn want_sent(&mut self, sent: bool) {
        set_control(sent);
        // The emulator sends at once, and does not call.
        if sent {
            Stm32f405::call_line();
        }
    }
}

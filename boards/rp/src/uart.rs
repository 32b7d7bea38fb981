//! UART 0, a serial line of the link: 115,200 baud, 8 bits, no parity, on GP0 (TX) and GP1 (RX).
//!
//! [`line`](crate::line) has the queues around it.

use crate::hal::pac::{RESETS, UART0, uart0};
use cortex_m_board::line::Wire;
use cortex_m_board::speaker::Speaker;

/// Speed of the line in baud.
pub const BAUD: u32 = 115_200;

/// The UART, for its interrupt handler.
pub struct Uart;

/// Starts the UART, with the interrupt of received bytes on.
pub(crate) fn start(_: UART0, peripheral_hz: u32, resets: &mut RESETS) {
    resets.reset().modify(|_, w| w.uart0().clear_bit());
    while resets.reset_done().read().uart0().bit_is_clear() {}
    let uart = registers();
    // The divisor in 64ths: clock / (16 × baud), rounded.
    let divisor_64ths = (peripheral_hz * 4 + BAUD / 2) / BAUD;
    // SAFETY: a divisor of 16 bits, and 64ths of 6 bits, as the registers take them.
    unsafe {
        (uart.uartibrd()).write(|w| w.baud_divint().bits((divisor_64ths / 64) as u16));
        (uart.uartfbrd()).write(|w| w.baud_divfrac().bits((divisor_64ths % 64) as u8));
    }
    const EIGHT_BITS: u8 = 0b11;
    // SAFETY: two bits.
    (uart.uartlcr_h()).write(|w| unsafe { w.wlen().bits(EIGHT_BITS).fen().set_bit() });
    Uart.want_sent(false);
    (uart.uartcr()).write(|w| w.uarten().set_bit().txe().set_bit().rxe().set_bit());
}

fn registers() -> &'static uart0::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life; once they are started, the line's
    // interrupt alone reads and writes them.
    unsafe { &*UART0::ptr() }
}

impl Wire for Uart {
    const FIFO_BYTES: usize = 32;

    fn acknowledge(&mut self) {
        (registers().uarticr()).write(|w| {
            (w.rxic().clear_bit_by_one().rtic().clear_bit_by_one())
                .txic()
                .clear_bit_by_one()
        });
    }

    fn has_received(&mut self) -> bool {
        registers().uartfr().read().rxfe().bit_is_clear()
    }

    fn receive(&mut self) -> Option<u8> {
        if !self.has_received() {
            return None;
        }
        let received = registers().uartdr().read();
        // A byte with a line error goes to the link, whose checksum finds it as well. But nobody
        // has spoken: the line may have been plugged in.
        if received.bits() <= u32::from(u8::MAX) {
            Speaker::Uart.speaks();
        }
        Some(received.data().bits())
    }

    fn can_send(&mut self) -> bool {
        Speaker::Uart.is_answered() && registers().uartfr().read().txff().bit_is_clear()
    }

    fn send(&mut self, byte: u8) {
        // SAFETY: any byte can be sent.
        (registers().uartdr()).write(|w| unsafe { w.data().bits(byte) });
    }

    fn want_sent(&mut self, sent: bool) {
        let sent = sent && Speaker::Uart.is_answered();
        (registers().uartimsc()).write(|w| w.rxim().set_bit().rtim().set_bit().txim().bit(sent));
    }
}

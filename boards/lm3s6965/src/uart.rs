//! UART0, the serial line of the link: 115,200 baud, 8 bits, no parity.
//!
//! [The line](crate::line) has the queues around it.

use cortex_m::peripheral::NVIC;
#[cfg(feature = "selftest")]
use cortex_m_board::line::LineRates;
use cortex_m_board::line::Wire;
use pac::Interrupt;

use crate::clock::TICKS_PER_US;
use crate::line_timer;
use crate::registers::{gpio_a, system_control, uart0};

/// Speed of the line in baud.
pub const BAUD: u32 = 115_200;
/// The clock that rates are made of.
const CLOCK_HZ: u32 = TICKS_PER_US * 1_000_000;
/// The rates that the part can have: its divisor of 16 times the rate is 1 to 65,535.
#[cfg(feature = "selftest")]
pub(crate) const RATES: LineRates = LineRates {
    own: BAUD,
    slowest: CLOCK_HZ / 16 / 65_535 + 1,
    fastest: CLOCK_HZ / 16,
};

const RECEIVER_EMPTY: u32 = 1 << 4;
const TRANSMITTER_FULL: u32 = 1 << 5;
const BUSY: u32 = 1 << 3;
const RECEIVED: u32 = 1 << 4;
const SENT: u32 = 1 << 5;
const RECEIVE_TIMEOUT: u32 = 1 << 6;

/// Starts the UART, with the interrupt of received bytes on.
pub fn start() {
    const UART_0_CLOCK: u32 = 1 << 0;
    const PORT_A_CLOCK: u32 = 1 << 0;
    const PINS_0_AND_1: u32 = 0b11;
    system_control::RCGC1.write(system_control::RCGC1.read() | UART_0_CLOCK);
    system_control::RCGC2.write(system_control::RCGC2.read() | PORT_A_CLOCK);
    gpio_a::AFSEL.write(gpio_a::AFSEL.read() | PINS_0_AND_1);
    gpio_a::DEN.write(gpio_a::DEN.read() | PINS_0_AND_1);
    set_rate(BAUD);
    uart0::IM.write(RECEIVED | RECEIVE_TIMEOUT);
    // The emulator's part keeps its FIFO over a reset of the board, and calls for the first byte in
    // an empty one only: with bytes left in it, it would never call again.
    NVIC::pend(Interrupt::UART0);
    line_timer::start_timer();
}

/// Sets the rate, which the part takes over with its line control register.
fn set_rate(baud: u32) {
    const EIGHT_BITS_WITH_FIFO: u32 = 0b111 << 4;
    const ENABLE_BOTH_DIRECTIONS: u32 = 1 | 1 << 8 | 1 << 9;
    // In 64ths: clock / (16 × baud), rounded.
    let divisor_64ths = (CLOCK_HZ * 4 + baud / 2) / baud.max(1);
    uart0::CTL.write(0);
    uart0::IBRD.write(divisor_64ths / 64);
    uart0::FBRD.write(divisor_64ths % 64);
    uart0::LCRH.write(EIGHT_BITS_WITH_FIFO);
    uart0::CTL.write(ENABLE_BOTH_DIRECTIONS);
}

/// The bytes of the UART, for its interrupt handler.
pub struct Uart;

impl Wire for Uart {
    const FIFO_BYTES: usize = 16;

    fn acknowledge(&mut self) {
        uart0::ICR.write(RECEIVED | RECEIVE_TIMEOUT | SENT);
    }

    /// A wire brings more by itself. The emulator looks at what stands for the wire only where its
    /// virtual time stops: at the deadlines of its timers, while the core sleeps. Between two slots
    /// there would be none, and one FIFO a slot is all that would arrive; so a timer without an
    /// interrupt makes some, as long as bytes come. On the part itself nobody sees it run.
    fn expect_more(&mut self) {
        const LOOK_AGAIN_US: u32 = 200;
        line_timer::run_timer(LOOK_AGAIN_US);
    }

    fn has_received(&mut self) -> bool {
        uart0::FR.read() & RECEIVER_EMPTY == 0
    }

    fn receive(&mut self) -> Option<u8> {
        if !self.has_received() {
            return None;
        }
        // The bits above the byte tell of line errors, which the link's checksum finds as well.
        Some(uart0::DR.read() as u8)
    }

    fn can_send(&mut self) -> bool {
        uart0::FR.read() & TRANSMITTER_FULL == 0
    }

    fn send(&mut self, byte: u8) {
        uart0::DR.write(u32::from(byte));
    }

    fn set_rate(&mut self, baud: u32) {
        set_rate(baud);
    }

    fn is_silent(&mut self) -> bool {
        uart0::FR.read() & BUSY == 0
    }

    fn want_sent(&mut self, sent: bool) {
        let sent = if sent { SENT } else { 0 };
        uart0::IM.write(RECEIVED | RECEIVE_TIMEOUT | sent);
    }
}

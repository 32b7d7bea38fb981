//! UART0, the serial line of the link: 115,200 baud, 8 bits, no parity.
//!
//! Both directions go through queues, so that nobody ever waits for the wire: the interrupt handler moves bytes between them and the part's
//! 16-byte FIFOs, the link task holds the other ends.

use heapless::spsc::{Consumer, Producer};

use crate::clock::TICKS_PER_US;
use crate::registers::{gpio_a, system_control, uart0};

/// Speed of the line in baud.
pub const BAUD: u32 = 115_200;

/// Bytes that the part's own FIFO holds; as many are moved in one interrupt at most.
const FIFO_BYTES: usize = 16;

const RECEIVE_EMPTY: u32 = 1 << 4;
const TRANSMIT_FULL: u32 = 1 << 5;
const RECEIVED: u32 = 1 << 4;
const TRANSMITTED: u32 = 1 << 5;
const RECEIVE_TIMEOUT: u32 = 1 << 6;

/// Starts the UART, with the interrupt of received bytes on.
pub fn start() {
    const UART_0_CLOCK: u32 = 1 << 0;
    const PORT_A_CLOCK: u32 = 1 << 0;
    const PINS_0_AND_1: u32 = 0b11;
    const EIGHT_BITS_WITH_FIFO: u32 = 0b111 << 4;
    const ENABLE_BOTH_DIRECTIONS: u32 = 1 | 1 << 8 | 1 << 9;
    // The divisor in 64ths: clock / (16 × baud), rounded.
    const DIVISOR_64THS: u32 = (TICKS_PER_US * 1_000_000 * 4 + BAUD / 2) / BAUD;
    system_control::RCGC1.write(system_control::RCGC1.read() | UART_0_CLOCK);
    system_control::RCGC2.write(system_control::RCGC2.read() | PORT_A_CLOCK);
    gpio_a::AFSEL.write(gpio_a::AFSEL.read() | PINS_0_AND_1);
    gpio_a::DEN.write(gpio_a::DEN.read() | PINS_0_AND_1);
    uart0::CTL.write(0);
    uart0::IBRD.write(DIVISOR_64THS / 64);
    uart0::FBRD.write(DIVISOR_64THS % 64);
    uart0::LCRH.write(EIGHT_BITS_WITH_FIFO);
    uart0::IM.write(RECEIVED | RECEIVE_TIMEOUT);
    uart0::CTL.write(ENABLE_BOTH_DIRECTIONS);
}

/// The interrupt handler's ends of the two queues.
pub struct Line {
    received: Producer<'static, u8>,
    to_transmit: Consumer<'static, u8>,
    lost_bytes: u32,
}

impl Line {
    /// The handler's state.
    pub fn new(received: Producer<'static, u8>, to_transmit: Consumer<'static, u8>) -> Self {
        Self {
            received,
            to_transmit,
            lost_bytes: 0,
        }
    }

    /// Moves bytes between the FIFOs and the queues. To be called by the UART's interrupt, and, by pending that, whenever bytes were queued
    /// for transmission. A received byte that finds its queue full is lost: the frame that it belongs to fails its CRC and is asked for again.
    ///
    /// Returns whether the link task has something to do: bytes came in, or the last that it queued went out.
    pub fn serve(&mut self) -> bool {
        uart0::ICR.write(RECEIVED | RECEIVE_TIMEOUT | TRANSMITTED);
        let mut worth_a_look = false;
        for _ in 0..FIFO_BYTES {
            if uart0::FR.read() & RECEIVE_EMPTY != 0 {
                break;
            }
            // The bits above the byte tell of line errors, which the CRC finds as well.
            let byte = uart0::DR.read() as u8;
            worth_a_look = true;
            if self.received.enqueue(byte).is_err() {
                self.lost_bytes = self.lost_bytes.saturating_add(1);
            }
        }
        for _ in 0..FIFO_BYTES {
            if uart0::FR.read() & TRANSMIT_FULL != 0 {
                break;
            }
            let Some(byte) = self.to_transmit.dequeue() else {
                break;
            };
            uart0::DR.write(u32::from(byte));
            worth_a_look |= !self.to_transmit.ready();
        }
        let more = if self.to_transmit.ready() {
            TRANSMITTED
        } else {
            0
        };
        uart0::IM.write(RECEIVED | RECEIVE_TIMEOUT | more);
        worth_a_look
    }
}

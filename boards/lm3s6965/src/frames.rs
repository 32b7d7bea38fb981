//! The link of missions: UART1, 8 bits, no parity, at the rate that the mission declares, and GPTM
//! 2 (32 bits, one shot), whose interrupt starts frames.
//!
//! [The board's common part](cortex_m_board::frames) has the frames. The UART goes without its
//! FIFOs: so each byte has its interrupt, and a frame's end is known when it comes.

use cortex_m::peripheral::NVIC;
use cortex_m_board::frames::{FrameLine, FrameUart};
use pac::Interrupt;

use crate::Lm3s6965;
use crate::clock::TICKS_PER_US;
use crate::registers::{gpio_d, system_control, timer2, uart1};

const RECEIVER_EMPTY: u32 = 1 << 4;
const TRANSMITTER_FULL: u32 = 1 << 5;
const RECEIVED: u32 = 1 << 4;
const SENT: u32 = 1 << 5;
const TIMED_OUT: u32 = 1;
const TIMER_A_ENABLE: u32 = 1;

/// The interrupts' end of the link.
pub type Line = FrameLine<Lm3s6965>;

impl FrameUart for Lm3s6965 {
    fn start() {
        const UART_1_CLOCK: u32 = 1 << 1;
        const TIMER_2_CLOCK: u32 = 1 << 18;
        const PORT_D_CLOCK: u32 = 1 << 3;
        const PINS_2_AND_3: u32 = 0b11 << 2;
        const WIDTH_32_BITS: u32 = 0;
        const ONE_SHOT: u32 = 1;
        system_control::RCGC1.write(system_control::RCGC1.read() | UART_1_CLOCK | TIMER_2_CLOCK);
        system_control::RCGC2.write(system_control::RCGC2.read() | PORT_D_CLOCK);
        gpio_d::AFSEL.write(gpio_d::AFSEL.read() | PINS_2_AND_3);
        gpio_d::DEN.write(gpio_d::DEN.read() | PINS_2_AND_3);
        timer2::CTL.write(0);
        timer2::CFG.write(WIDTH_32_BITS);
        timer2::TAMR.write(ONE_SHOT);
        timer2::IMR.write(TIMED_OUT);
    }

    fn set_rate(rate_bps: u32) {
        const EIGHT_BITS_WITHOUT_FIFO: u32 = 0b11 << 5;
        const ENABLE_BOTH_DIRECTIONS: u32 = 1 | 1 << 8 | 1 << 9;
        // The divisor in 64ths: clock / (16 × baud), rounded. A mission declares 1 at least.
        let divisor_64ths = (TICKS_PER_US * 1_000_000 * 4 + rate_bps / 2) / rate_bps.max(1);
        uart1::CTL.write(0);
        uart1::IBRD.write(divisor_64ths / 64);
        uart1::FBRD.write(divisor_64ths % 64);
        uart1::LCRH.write(EIGHT_BITS_WITHOUT_FIFO);
        uart1::IM.write(RECEIVED);
        uart1::CTL.write(ENABLE_BOTH_DIRECTIONS);
        // A byte that the emulator's part has kept over a reset of the board calls for nobody.
        NVIC::pend(Interrupt::UART1);
    }

    fn acknowledge() {
        uart1::ICR.write(RECEIVED | SENT);
    }

    fn receive() -> Option<u8> {
        // The bits above the byte tell of line errors, which the frame's checksum finds as well.
        (uart1::FR.read() & RECEIVER_EMPTY == 0).then(|| uart1::DR.read() as u8)
    }

    fn can_send() -> bool {
        uart1::FR.read() & TRANSMITTER_FULL == 0
    }

    fn send(byte: u8) {
        uart1::DR.write(byte.into());
    }

    fn want_sent(sent: bool) {
        uart1::IM.write(if sent { RECEIVED | SENT } else { RECEIVED });
    }

    fn set_timer(ticks: u32) {
        timer2::TAILR.write(ticks);
        timer2::CTL.write(TIMER_A_ENABLE);
    }

    fn acknowledge_timer() {
        timer2::CTL.write(0);
        timer2::ICR.write(TIMED_OUT);
    }

    fn call() {
        NVIC::pend(Interrupt::TIMER_2A);
    }
}

//! The link of missions in the emulator: USART 2, 8 bits, no parity, at the rate that the mission
//! declares, and TIM3, whose interrupt starts frames.
//!
//! [The board's common part](cortex_m_board::frames) has the frames. The part has no FIFO: each
//! byte has its interrupt.

use cortex_m::peripheral::NVIC;
use cortex_m_board::frames::{FrameLine, FrameUart};

use crate::pac::{Interrupt, TIM3, USART2, tim3, usart1};
use crate::{Stm32f405, clock};

/// Frequency of the bus of USART 2, in hertz.
const APB1_HZ: u32 = clock::CORE_HZ / 4;
/// What the timer counts at most, in ticks: its nanoseconds have 32 bits. Where a frame starts
/// later, it is set anew.
const MOST_TICKS: u32 = 100_000 * clock::TICKS_PER_US;

fn uart() -> &'static usart1::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. They are written at the start,
    // with interrupts off, by the link's handlers, which are of one priority, and by the slots,
    // for the rate, before anything is sent.
    unsafe { &*USART2::PTR }
}

fn timer() -> &'static tim3::RegisterBlock {
    // SAFETY: as above.
    unsafe { &*TIM3::PTR }
}

fn set_control(wants_sent: bool) {
    uart().cr1().write(|w| {
        w.ue().enabled().te().enabled().re().enabled();
        w.rxneie().enabled().txeie().bit(wants_sent)
    });
}

/// The interrupts' end of the link.
pub type Line = FrameLine<Stm32f405>;

impl FrameUart for Stm32f405 {
    fn start() {
        (clock::rcc().apb1enr()).modify(|_, w| w.usart2en().enabled().tim3en().enabled());
        timer().dier().write(|w| w.uie().enabled());
    }

    fn set_rate(rate_bps: u32) {
        let divisor = (APB1_HZ + rate_bps / 2) / rate_bps.max(1);
        // SAFETY: 16 bits, of which the lowest 4 are sixteenths.
        (uart().brr()).write(|w| unsafe { w.bits(divisor as u16) });
        set_control(false);
        // A byte that the emulator's part has kept over a reset of the board calls for nobody.
        NVIC::pend(Interrupt::USART2);
    }

    fn acknowledge() {
        // A byte that came too late for the one before is gone, and its call is taken back by
        // reading both registers; where there is a byte, it is read anyway.
        let status = uart().sr().read();
        if status.ore().bit_is_set() && status.rxne().bit_is_clear() {
            uart().dr().read();
        }
    }

    fn receive() -> Option<u8> {
        let has_received = uart().sr().read().rxne().bit_is_set();
        has_received.then(|| uart().dr().read().bits() as u8)
    }

    fn can_send() -> bool {
        uart().sr().read().txe().bit_is_set()
    }

    fn send(byte: u8) {
        // SAFETY: any byte can be sent.
        (uart().dr()).write(|w| unsafe { w.bits(byte.into()) });
        // The emulator sends at once, and does not call for the next one.
        NVIC::pend(Interrupt::USART2);
    }

    fn want_sent(sent: bool) {
        set_control(sent);
    }

    /// As the slot timer counts in the emulator, which gives this one 32 bits as well.
    fn set_timer(ticks: u32) {
        let ticks = ticks.clamp(1, MOST_TICKS);
        // SAFETY: any bits are a count.
        (timer().arr()).write(|w| unsafe { w.bits(clock::nanoseconds(ticks)) });
        timer().cr1().write(|w| w.cen().enabled());
    }

    fn acknowledge_timer() {
        timer().cr1().reset();
        timer().sr().reset();
    }

    fn call() {
        NVIC::pend(Interrupt::TIM3);
    }
}

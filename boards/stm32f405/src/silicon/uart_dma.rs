//! The bytes of USART 1, 115,200 baud, 8 bits, no parity, moved by DMA 2 (RM0090, 10): stream 2
//! writes what comes into a ring, over and over; stream 7 sends.
//!
//! Timer 7 calls each half millisecond, and the line looks at both then: so a byte that comes while
//! a slot executes is not lost, and no call is made for each.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering, Ordering::Relaxed, fence};

use cortex_m_board::line::Wire;

use super::parts;
use crate::clock;
use crate::pac::{DMA2, TIM7, dma2, tim6};
use crate::usart::{self, registers};

/// Room for what comes: 22 ms of the line at its own rate.
pub(crate) const RING_BYTES: usize = 256;
/// Room for what is sent at a time: more than what comes to be sent in half a millisecond.
pub(crate) const OUT_BYTES: usize = 64;
/// From one look at the line to the next.
const LOOK_US: u16 = 500;

/// Streams of channel 4 that USART 1 has (RM0090, table 43).
const IN: usize = 2;
const OUT: usize = 7;
/// Channel 4; single bytes, of which the memory's address counts up.
const OF_USART: u32 = 4 << 25 | 1 << 10;
const OVER_AND_OVER: u32 = 1 << 8;
const TO_THE_PART: u32 = 0b01 << 6;
const ENABLE: u32 = 1;
/// What stream 7 has told of its last transfer; its flags are taken back before the next.
const OUT_FLAGS: u32 = 0b11_1101 << 22;
/// Transmission complete, in the USART's status; a zero takes it back, ones leave all others.
const SENT: u32 = 1 << 6;

pub(crate) static RING: [AtomicU8; RING_BYTES] = [const { AtomicU8::new(0) }; RING_BYTES];
pub(crate) static TO_SEND: [AtomicU8; OUT_BYTES] = [const { AtomicU8::new(0) }; OUT_BYTES];
/// Place in the ring of the next byte to take. Of the line's handler alone, as is the next.
static NEXT: AtomicUsize = AtomicUsize::new(0);
/// Bytes that wait to be sent.
static STAGED: AtomicUsize = AtomicUsize::new(0);

fn dma() -> &'static dma2::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life; nobody else has them.
    unsafe { &*DMA2::PTR }
}

fn timer() -> &'static tim6::RegisterBlock {
    // SAFETY: the same. Timers 6 and 7 have the same registers.
    unsafe { &*TIM7::PTR }
}

/// Starts part, streams and timer.
pub fn start() {
    usart::start();
    parts::connect_usart();
    clock::rcc().ahb1enr().modify(|_, w| w.dma2en().enabled());
    clock::rcc().apb1enr().modify(|_, w| w.tim7en().enabled());
    // SAFETY: bits and addresses as the registers take them; the stream writes the ring alone.
    unsafe {
        let stream = dma().st(IN);
        stream
            .par()
            .write(|w| w.bits(registers().dr().as_ptr() as u32));
        stream.m0ar().write(|w| w.bits(RING.as_ptr() as u32));
        stream.ndtr().write(|w| w.bits(RING_BYTES as _));
        (stream.cr()).write(|w| w.bits(OF_USART | OVER_AND_OVER | ENABLE));
        registers()
            .cr3()
            .write(|w| w.dmar().enabled().dmat().enabled());
        // Timers on APB1 have twice its clock, 84 MHz.
        const DIVISOR: u16 = (clock::CORE_HZ / 2 / 1_000_000) as u16;
        timer().psc().write(|w| w.psc().bits(DIVISOR - 1));
        timer().arr().write(|w| w.bits((LOOK_US - 1).into()));
    }
    (registers().cr1()).write(|w| w.ue().enabled().te().enabled().re().enabled());
    timer().dier().write(|w| w.uie().enabled());
    timer().cr1().write(|w| w.cen().enabled());
}

/// The bytes of the line, for its interrupt handler.
pub struct Uart;

/// Place in the ring of the byte that comes next.
fn written() -> usize {
    let left = dma().st(IN).ndtr().read().bits() as usize;
    // What is read of the ring is read behind this.
    fence(Ordering::Acquire);
    (RING_BYTES - left.min(RING_BYTES)) % RING_BYTES
}

fn is_sending() -> bool {
    dma().st(OUT).cr().read().bits() & ENABLE != 0
}

impl Wire for Uart {
    const FIFO_BYTES: usize = OUT_BYTES;

    fn acknowledge(&mut self) {
        timer().sr().reset();
    }

    fn has_received(&mut self) -> bool {
        written() != NEXT.load(Relaxed)
    }

    fn receive(&mut self) -> Option<u8> {
        let place = NEXT.load(Relaxed);
        let byte = RING.get(place).filter(|_| self.has_received())?;
        NEXT.store((place + 1) % RING_BYTES, Relaxed);
        Some(byte.load(Relaxed))
    }

    fn can_send(&mut self) -> bool {
        STAGED.load(Relaxed) < OUT_BYTES && !is_sending()
    }

    fn send(&mut self, byte: u8) {
        let staged = STAGED.load(Relaxed);
        if let Some(place) = TO_SEND.get(staged) {
            place.store(byte, Relaxed);
            STAGED.store(staged + 1, Relaxed);
        }
    }

    fn set_rate(&mut self, baud: u32) {
        usart::set_rate(baud);
    }

    fn is_silent(&mut self) -> bool {
        !is_sending() && registers().sr().read().tc().bit_is_set()
    }

    /// Sends what waits. The timer calls in any case.
    fn want_sent(&mut self, _sent: bool) {
        let staged = STAGED.load(Relaxed);
        if staged == 0 || is_sending() {
            return;
        }
        STAGED.store(0, Relaxed);
        // What is to be sent is in memory before the stream reads it.
        fence(Ordering::Release);
        // SAFETY: bits and addresses as the registers take them.
        unsafe {
            dma().hifcr().write(|w| w.bits(OUT_FLAGS));
            registers().sr().write(|w| w.bits(!SENT as _));
            let stream = dma().st(OUT);
            stream
                .par()
                .write(|w| w.bits(registers().dr().as_ptr() as u32));
            stream.m0ar().write(|w| w.bits(TO_SEND.as_ptr() as u32));
            stream.ndtr().write(|w| w.bits(staged as _));
            (stream.cr()).write(|w| w.bits(OF_USART | TO_THE_PART | ENABLE));
        }
    }
}

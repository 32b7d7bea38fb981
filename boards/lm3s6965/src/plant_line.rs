//! The link's bytes by way of the plant, for runs that are to repeat to the byte: two named pipes of their own ([`rt_firmware::body::line`]), and timer 1,
//! which says when.
//!
//! Whoever starts the emulator decides: where the pipes stand in its working directory, the link goes by them and the UART carries nothing; without them, and on a
//! part of silicon, it goes by the UART.

use core::ffi::CStr;
use core::sync::atomic::AtomicI32;

use rt_firmware::body::line::{INTERVAL_US, LinePart, MESSAGE_BYTES};

use crate::clock::TICKS_PER_US;
use crate::plant::{self, CLOSED, file};
use crate::registers::{system_control, timer1};

/// Carries bytes to the host.
const REQUEST_PIPE: &CStr = c"link-request";
/// Carries bytes from the host.
const REPLY_PIPE: &CStr = c"link-reply";

static REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

const TIMED_OUT: u32 = 1;

/// Opens both pipes, which waits until the plant has opened its ends, and starts the timer. Answers whether the link goes this way.
pub fn start() -> bool {
    if plant::open_pair(&REQUESTS, REQUEST_PIPE, &REPLIES, REPLY_PIPE).is_none() {
        return false;
    }
    const TIMER_1_CLOCK: u32 = 1 << 17;
    const WIDTH_32_BITS: u32 = 0;
    const PERIODIC: u32 = 2;
    const TIMER_A_ENABLE: u32 = 1;
    system_control::RCGC1.write(system_control::RCGC1.read() | TIMER_1_CLOCK);
    timer1::CTL.write(0);
    timer1::CFG.write(WIDTH_32_BITS);
    timer1::TAMR.write(PERIODIC);
    timer1::TAILR.write(INTERVAL_US * TICKS_PER_US - 1);
    timer1::IMR.write(TIMED_OUT);
    timer1::CTL.write(TIMER_A_ENABLE);
    true
}

/// Takes the timer's interrupt back. To be called first in its handler.
pub fn acknowledge() {
    timer1::ICR.write(TIMED_OUT);
}

/// Swaps a message with the plant. None if it went away.
pub fn swap(part: &LinePart) -> Option<LinePart> {
    let requests = file(&REQUESTS)?;
    let replies = file(&REPLIES)?;
    plant::send(requests, part.as_bytes())?;
    let mut answer = [0; MESSAGE_BYTES];
    plant::receive(replies, &mut answer)?;
    Some(LinePart::from_bytes(answer))
}

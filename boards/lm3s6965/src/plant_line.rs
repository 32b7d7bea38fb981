//! The link's bytes by way of the plant, for runs that are to repeat to the byte: two named pipes
//! of their own ([`rt_firmware::body::line`]), and timer 1, which says when.
//!
//! Whoever starts the emulator decides: where the pipes stand in its working directory, the link
//! goes by them and the UART carries nothing; without them, and on a part of silicon, it goes by
//! the UART.

use core::ffi::CStr;
use core::sync::atomic::{AtomicI32, AtomicU32, Ordering::Relaxed};

use rt_firmware::body::line::{INTERVAL_US, LinePart, MESSAGE_BYTES};

use crate::clock::{self, TICKS_PER_US};
use crate::plant::{self, CLOSED, file};
use crate::registers::{system_control, timer1};

/// Carries bytes to the host.
const REQUEST_PIPE: &CStr = c"link-request";
/// Carries bytes from the host.
const REPLY_PIPE: &CStr = c"link-reply";

static REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

/// When the timer's interrupt is due: ticks of the clock, their low half. Of its handler alone,
/// once the timer runs.
static DUE: AtomicU32 = AtomicU32::new(0);

const TIMED_OUT: u32 = 1;
const TIMER_A_ENABLE: u32 = 1;
const INTERVAL_TICKS: u32 = INTERVAL_US * TICKS_PER_US;

/// Opens both pipes, which waits until the plant has opened its ends, and starts the timer. Answers
/// whether the link goes this way.
pub fn start() -> bool {
    if plant::open_pair(&REQUESTS, REQUEST_PIPE, &REPLIES, REPLY_PIPE).is_none() {
        return false;
    }
    const TIMER_1_CLOCK: u32 = 1 << 17;
    const WIDTH_32_BITS: u32 = 0;
    // Set anew by its handler. The emulator reloads a periodic timer before it raises the
    // interrupt; while the processor sleeps, it may then let its time pass to the next timer first,
    // or not, as its own threads happen to meet.
    const ONE_SHOT: u32 = 1;
    system_control::RCGC1.write(system_control::RCGC1.read() | TIMER_1_CLOCK);
    timer1::CTL.write(0);
    timer1::CFG.write(WIDTH_32_BITS);
    timer1::TAMR.write(ONE_SHOT);
    timer1::IMR.write(TIMED_OUT);
    DUE.store(clock::now_ticks() as u32, Relaxed);
    set_next();
    true
}

/// Takes the timer's interrupt back and lets the next one come. To be called first in its handler.
pub fn acknowledge() {
    timer1::CTL.write(0);
    timer1::ICR.write(TIMED_OUT);
    set_next();
}

/// Lets the interrupt come a whole number of intervals after it was due last: one, or, where that
/// is past, more.
fn set_next() {
    let (now, due) = (clock::now_ticks() as u32, DUE.load(Relaxed));
    // The clock may show a tick less than the timer has counted.
    let late_ticks = (now.wrapping_sub(due) as i32).max(0) as u32;
    let next = due.wrapping_add((late_ticks / INTERVAL_TICKS + 1) * INTERVAL_TICKS);
    DUE.store(next, Relaxed);
    timer1::TAILR.write(next.wrapping_sub(now));
    timer1::CTL.write(TIMER_A_ENABLE);
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

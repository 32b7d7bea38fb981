//! The link's bytes by way of the plant, for runs that are to repeat to the byte: two named pipes
//! of their own ([`rt_firmware::body::line`]), and a timer of the chip, which says when.
//!
//! Whoever starts the emulator decides: where the pipes stand in its working directory, the link
//! goes by them and the UART carries nothing; without them, and on a part of silicon, it goes by
//! the UART.

use core::ffi::CStr;
use core::sync::atomic::{AtomicI32, AtomicU32, Ordering::Relaxed};

use rt_firmware::body::line::{INTERVAL_US, LinePart, MESSAGE_BYTES};

use crate::chip::Chip;
use crate::line_timer::LineTimer;
use crate::plant::{self, CLOSED, file};
use crate::sys_tick;

/// Carries bytes to the host.
const REQUEST_PIPE: &CStr = c"link-request";
/// Carries bytes from the host.
const REPLY_PIPE: &CStr = c"link-reply";

static REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

/// When the timer's interrupt is due: ticks of the clock, their low half. Of its handler alone,
/// once the timer runs.
static DUE: AtomicU32 = AtomicU32::new(0);

/// Opens both pipes, which waits until the plant has opened its ends, and starts the timer. Answers
/// whether the link goes this way.
pub fn start<C: LineTimer>() -> bool {
    if plant::open_pair(&REQUESTS, REQUEST_PIPE, &REPLIES, REPLY_PIPE).is_none() {
        return false;
    }
    C::start_line_timer();
    DUE.store(sys_tick::now_ticks() as u32, Relaxed);
    set_next::<C>();
    true
}

/// Takes the timer's interrupt back and lets the next one come. To be called first in its handler.
pub fn acknowledge<C: LineTimer>() {
    C::acknowledge_line_timer();
    set_next::<C>();
}

/// Lets the interrupt come a whole number of intervals after it was due last: one, or, where that
/// is past, more.
fn set_next<C: Chip + LineTimer>() {
    let interval_ticks = const { INTERVAL_US * C::TICKS_PER_US };
    let (now, due) = (sys_tick::now_ticks() as u32, DUE.load(Relaxed));
    // The clock may show a tick less than the timer has counted.
    let late_ticks = (now.wrapping_sub(due) as i32).max(0) as u32;
    let next = due.wrapping_add((late_ticks / interval_ticks + 1) * interval_ticks);
    DUE.store(next, Relaxed);
    C::set_line_timer(next.wrapping_sub(now));
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

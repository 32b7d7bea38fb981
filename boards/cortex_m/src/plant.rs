//! The way to the plant: two named pipes, reached by semihosting calls.
//!
//! A semihosting call stops virtual time until the host has answered, so the board and the plant
//! run in lock step, whatever the wall clock does. The pipes stand in the emulator's working
//! directory. Without them (the firmware was started by hand) no exchange succeeds, which the
//! runtime takes as a lost plant.

use core::ffi::CStr;
use core::sync::atomic::{AtomicI32, Ordering::Relaxed};

use rt_firmware::body::{REPLY_BYTES, Request};
use semihosting::fd::{BorrowedFd, RawFd};
use semihosting::sys::arm_compat::{OpenMode, sys_open, sys_read_orig, sys_write_orig};

/// Carries requests to the plant.
const REQUEST_PIPE: &CStr = c"plant-request";
/// Carries replies from the plant.
const REPLY_PIPE: &CStr = c"plant-reply";

/// Not a file.
pub const CLOSED: RawFd = -1;

static REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

/// Opens both pipes, which waits until the plant has opened its ends; they are never closed.
pub fn open() {
    let _ = open_pair(&REQUESTS, REQUEST_PIPE, &REPLIES, REPLY_PIPE);
}

/// Opens a pair of pipes. None if they are not there.
pub fn open_pair(
    requests: &AtomicI32,
    request_pipe: &CStr,
    replies: &AtomicI32,
    reply_pipe: &CStr,
) -> Option<()> {
    // The replies first: opening to read makes no file where there is no pipe, opening to write
    // would.
    for (pipe, path, mode) in [
        (replies, reply_pipe, OpenMode::RDONLY_BINARY),
        (requests, request_pipe, OpenMode::WRONLY_TRUNC_BINARY),
    ] {
        pipe.store(sys_open(path, mode).ok()?.into_raw_fd(), Relaxed);
    }
    Some(())
}

/// Sends `request` and waits for the reply. `None` if there is no plant or it went away.
///
/// Called by the slot timer's handler, and, when that will never run again, by the one that says
/// why.
pub fn exchange(request: &Request) -> Option<[u8; REPLY_BYTES]> {
    let requests = file(&REQUESTS)?;
    let replies = file(&REPLIES)?;
    send(requests, &request.encode())?;
    let mut reply = [0; REPLY_BYTES];
    receive(replies, &mut reply)?;
    Some(reply)
}

/// Writes a message to a pipe. It is shorter than what a pipe takes in one piece, so it is written
/// whole or not at all. The call tells how many bytes are left.
#[inline]
pub fn send(pipe: BorrowedFd<'_>, message: &[u8]) -> Option<()> {
    matches!(sys_write_orig(pipe, message), Ok(0)).then_some(())
}

/// Waits until a message that fills `room` has come out of a pipe.
#[inline]
pub fn receive(pipe: BorrowedFd<'_>, room: &mut [u8]) -> Option<()> {
    let mut unread = room.len();
    while unread > 0 {
        let read = room.len() - unread;
        match sys_read_orig(pipe, room.get_mut(read..)?) {
            Ok(left) if left < unread => unread = left,
            _ => return None,
        }
    }
    Some(())
}

/// The pipe of that number, if it was opened.
pub fn file(pipe: &AtomicI32) -> Option<BorrowedFd<'static>> {
    match pipe.load(Relaxed) {
        CLOSED => None,
        // SAFETY: `open` put the number of an open file there, which is never closed.
        fd => Some(unsafe { BorrowedFd::borrow_raw(fd) }),
    }
}

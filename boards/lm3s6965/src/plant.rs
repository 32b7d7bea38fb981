//! The way to the plant: two named pipes, reached by semihosting calls.
//!
//! A semihosting call stops virtual time until the host has answered, so the board and the plant run in lock step, whatever the wall clock does. The
//! pipes stand in the emulator's working directory. Without them (the firmware was started by hand) no exchange succeeds, which the runtime takes
//! as a lost plant.

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
const CLOSED: RawFd = -1;

static REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

/// Opens both pipes, which waits until the plant has opened its ends; they are never closed.
pub fn open() {
    // The replies first: opening to read makes no file where there is no pipe, opening to write would.
    for (pipe, path, mode) in [
        (&REPLIES, REPLY_PIPE, OpenMode::RDONLY_BINARY),
        (&REQUESTS, REQUEST_PIPE, OpenMode::WRONLY_TRUNC_BINARY),
    ] {
        match sys_open(path, mode) {
            Ok(opened) => pipe.store(opened.into_raw_fd(), Relaxed),
            Err(_) => return,
        }
    }
}

/// Sends `request` and waits for the reply. `None` if there is no plant or it went away.
///
/// Called by the slot timer's handler, and, when that will never run again, by the one that says why.
pub fn exchange(request: &Request) -> Option<[u8; REPLY_BYTES]> {
    let requests = file(&REQUESTS)?;
    let replies = file(&REPLIES)?;
    // A message is shorter than what a pipe takes in one piece, so it is written whole or not at all. Both calls tell how many bytes are left.
    if !matches!(sys_write_orig(requests, &request.encode()), Ok(0)) {
        return None;
    }
    let mut reply = [0; REPLY_BYTES];
    let mut unread = REPLY_BYTES;
    while unread > 0 {
        let rest = reply.get_mut(REPLY_BYTES - unread..)?;
        match sys_read_orig(replies, rest) {
            Ok(left) if left < unread => unread = left,
            _ => return None,
        }
    }
    Some(reply)
}

fn file(pipe: &AtomicI32) -> Option<BorrowedFd<'static>> {
    match pipe.load(Relaxed) {
        CLOSED => None,
        // SAFETY: `open` put the number of an open file there, which is never closed.
        fd => Some(unsafe { BorrowedFd::borrow_raw(fd) }),
    }
}

//! Frames of a link by way of the plant, where several processors run in one time: two pairs of
//! named pipes ([`rt_firmware::body::frames`]).
//!
//! Whoever starts the emulator decides, as for the link to the host: where the pipes stand in its
//! working directory, frames go by them and the UART carries none.

use core::ffi::CStr;
use core::sync::atomic::AtomicI32;

use rt_firmware::body::frames::{CarriedFrame, MESSAGE_BYTES};

use crate::plant::{self, CLOSED, file};

/// Carry frames to the plant, and its answers.
const OUT_REQUEST_PIPE: &CStr = c"frame-out-request";
const OUT_REPLY_PIPE: &CStr = c"frame-out-reply";
/// Carry questions, and frames from the plant.
const IN_REQUEST_PIPE: &CStr = c"frame-in-request";
const IN_REPLY_PIPE: &CStr = c"frame-in-reply";

static OUT_REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static OUT_REPLIES: AtomicI32 = AtomicI32::new(CLOSED);
static IN_REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static IN_REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

/// Opens the pipes, which waits until the plant has opened its ends. Answers whether frames go this
/// way.
pub fn open() -> bool {
    let sent = plant::open_pair(
        &OUT_REQUESTS,
        OUT_REQUEST_PIPE,
        &OUT_REPLIES,
        OUT_REPLY_PIPE,
    );
    let received = plant::open_pair(&IN_REQUESTS, IN_REQUEST_PIPE, &IN_REPLIES, IN_REPLY_PIPE);
    sent.is_some() && received.is_some()
}

/// Tells the plant of a frame that starts: when it was to, in robot time, and by how much it is too
/// late. None if the plant went away.
///
/// From the interrupt above the slots alone.
pub fn tell(start_us: u64, late_ns: u32, bytes: &[u8]) -> Option<()> {
    let message = CarriedFrame::new(start_us, late_ns, bytes);
    plant::send(file(&OUT_REQUESTS)?, message.as_bytes())?;
    plant::receive(file(&OUT_REPLIES)?, &mut [0])
}

/// Asks the plant for the first frame that had arrived at a robot time.
///
/// From the slots alone.
pub fn ask(until_us: u64) -> Option<CarriedFrame> {
    plant::send(file(&IN_REQUESTS)?, &until_us.to_le_bytes())?;
    let mut answer = [0; MESSAGE_BYTES];
    plant::receive(file(&IN_REPLIES)?, &mut answer)?;
    let frame = CarriedFrame::from_bytes(answer);
    (!frame.is_none()).then_some(frame)
}

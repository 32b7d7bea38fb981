//! What carries the frames of a link: a UART, CAN, memory that two processors share.

use esm_link::frames::receiver::{Arrived, InFrames, ReceiveError};
use esm_link::frames::wire::Header;

/// Takes what arrived, and when.
pub type Taken<'t> = &'t mut dyn FnMut(Result<Arrived<'_>, ReceiveError>, u64);

/// A medium, as the dispatchers of one link reach it. Times are on the robot's clock, in
/// microseconds since the first macro step of the first mission.
pub trait LinkDevice {
    /// Sets the rate that the mission declares. Called when the state of a dispatcher was entered.
    fn set_rate(&mut self, _rate_bps: u32) {}

    /// Gives `write` the place of a payload of so many bytes, in the buffer from which the frame is
    /// sent at `start_us`. Frames of one activation come in the order of their declarations, and
    /// not of their starts. False, and nothing is written, if there is no room.
    fn send(
        &mut self,
        start_us: u64,
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool;

    /// All frames of an activation were handed over: what has to be done once for them is done
    /// here.
    fn start_sending(&mut self) {}

    /// Gives `take` all that had arrived whole at `until_us`, in order, with the time of its last
    /// bit. Nothing is given twice.
    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>);
}

//! A firmware whose link goes by the UART alone, in the emulator, too: it is built without the
//! feature `plant-line`.

use rt_firmware::body::line::LinePart;

use crate::line_timer::LineTimer;

/// The link goes by the UART.
pub const fn start<C: LineTimer>() -> bool {
    false
}

/// No timer was started.
pub fn acknowledge<C: LineTimer>() {}

/// Nobody carries it.
pub fn swap(_part: &LinePart) -> Option<LinePart> {
    None
}

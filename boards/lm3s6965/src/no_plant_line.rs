//! A firmware whose link goes by the UART alone, in the emulator, too: it is built without the
//! feature `plant-line`.

use rt_firmware::body::line::LinePart;

/// The link goes by the UART.
pub const fn start() -> bool {
    false
}

/// No timer was started.
pub fn acknowledge() {}

/// Nobody carries it.
pub fn swap(_part: &LinePart) -> Option<LinePart> {
    None
}

//! Two wires of one line, a UART and USB: the link answers over the wire that the last byte came
//! from. So one host speaks at a time. Frames of two that speak at once would mix, and each would
//! find a wrong checksum.

use core::sync::atomic::{AtomicBool, Ordering};

/// Whether the last byte came over USB. The handlers that change it are of one priority.
static USB_SPOKE: AtomicBool = AtomicBool::new(false);

/// Where bytes come from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Speaker {
    /// The UART.
    Uart,
    /// USB.
    Usb,
}

impl Speaker {
    /// A byte has come from it.
    pub fn speaks(self) {
        USB_SPOKE.store(self == Speaker::Usb, Ordering::Relaxed);
    }

    /// Whether the link answers it.
    pub fn is_answered(self) -> bool {
        USB_SPOKE.load(Ordering::Relaxed) == (self == Speaker::Usb)
    }
}

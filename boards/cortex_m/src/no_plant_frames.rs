//! No plant carries the frames of a link.

use rt_firmware::body::frames::CarriedFrame;

/// They go over the UART.
pub const fn open() -> bool {
    false
}

/// Never called.
pub const fn tell(_start_us: u64, _late_ns: u32, _bytes: &[u8]) -> Option<()> {
    None
}

/// Never called.
pub const fn ask(_until_us: u64) -> Option<CarriedFrame> {
    None
}

//! What the emulator prints, for firmwares that tell what they measured.

use core::fmt::{self, Write};

use semihosting::sys::arm_compat::sys_writec;

/// The emulator's console. It needs an emulator, or a probe that serves semihosting: a core without
/// one stops at the first letter.
pub struct Console;

impl Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.bytes().for_each(sys_writec);
        Ok(())
    }
}

//! Files of the emulator's folder, and its console.

use core::ffi::CStr;
use core::fmt::{self, Write};

use semihosting::fd::AsFd;
use semihosting::sys::arm_compat::{OpenMode, sys_open, sys_read_orig, sys_writec};

/// Reads the beginning of a file; returns its length, 0 where there is none.
pub fn read(name: &CStr, room: &mut [u8]) -> usize {
    let Ok(opened) = sys_open(name, OpenMode::RDONLY_BINARY) else {
        return 0;
    };
    match sys_read_orig(opened.as_fd(), room) {
        Ok(left) => room.len().saturating_sub(left),
        Err(_) => 0,
    }
}

/// What the emulator prints.
pub struct Console;

impl Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.bytes().for_each(sys_writec);
        Ok(())
    }
}

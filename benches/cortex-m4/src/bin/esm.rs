//! Runs the missions of a plan; both are files in the emulator's folder.
#![no_std]
#![no_main]

use core::ffi::CStr;
use core::fmt::Write;

use bench_cortex_m4::bench_machines::{Meter, drive, esm::Machine};
use bench_cortex_m4::{Console, Instructions, end};
use semihosting::fd::AsFd;
use semihosting::sys::arm_compat::{OpenMode, sys_open, sys_read_orig};

/// Room for a plan.
const PLAN_BYTES: usize = 32 * 1024;
/// Room for a mission.
const BLOB_BYTES: usize = 128 * 1024;
/// Words for its machine.
const ARENA_WORDS: usize = 16 * 1024;
/// Bytes of a file's name, its end included.
const NAME_BYTES: usize = 32;

#[bench_cortex_m4::rt::entry]
fn main() -> ! {
    let mut plan = [0; PLAN_BYTES];
    let mut blob = [0; BLOB_BYTES];
    let mut arena = [0; ARENA_WORDS];
    let plan = read("plan", &mut plan).unwrap_or(&[]);
    let mut meter = Instructions::new();
    meter.tell("ram", &[size_of::<Machine<'_, '_>>() as u32]);
    for line in drive::lines(core::str::from_utf8(plan).unwrap_or("?")) {
        let Some(line) = line else {
            let _ = writeln!(Console, "a line of the plan is none");
            break;
        };
        let Some(blob) = read(line.mission, &mut blob) else {
            let _ = writeln!(Console, "{}: no mission {}", line.row, line.mission);
            break;
        };
        if let Err(problem) = drive::run(&mut meter, line, blob, &mut arena) {
            let _ = writeln!(Console, "{}: {problem:?}", line.row);
            break;
        }
    }
    end()
}

/// What is in a file; `None` if there is none, or no room for it.
fn read<'b>(name: &str, room: &'b mut [u8]) -> Option<&'b [u8]> {
    let mut path = [0; NAME_BYTES];
    path.get_mut(..name.len())?.copy_from_slice(name.as_bytes());
    let path = CStr::from_bytes_until_nul(&path).ok()?;
    let file = sys_open(path, OpenMode::RDONLY_BINARY).ok()?;
    let mut length = 0;
    while let Some(rest) = room.get_mut(length..).filter(|rest| !rest.is_empty()) {
        let unread = sys_read_orig(file.as_fd(), rest).ok()?;
        if unread == rest.len() {
            return room.get(..length);
        }
        length += rest.len() - unread;
    }
    None
}

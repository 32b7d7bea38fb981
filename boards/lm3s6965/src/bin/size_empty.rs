//! Nothing but a blob that the compiler knows nothing of: what [`size_interpreter`](../size_interpreter) is measured against.
#![no_std]
#![no_main]

use core::hint::black_box;

use lm3s6965::{BLOB_BYTES, cortex_m};

static BLOB: [u8; BLOB_BYTES] = [0; BLOB_BYTES];

#[lm3s6965::rt::entry]
fn main() -> ! {
    black_box(&BLOB);
    loop {
        cortex_m::asm::wfi();
    }
}

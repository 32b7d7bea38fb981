//! What the interpreter's size is measured against: [`common`] and nothing else.
#![no_std]
#![no_main]

use core::hint::black_box;

use lm3s6965::cortex_m;

#[path = "../measured/common.rs"]
mod common;

#[lm3s6965::rt::entry]
fn main() -> ! {
    black_box(common::blob());
    loop {
        cortex_m::asm::wfi();
    }
}

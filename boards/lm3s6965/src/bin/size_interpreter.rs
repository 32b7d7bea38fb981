//! Verifier and interpreter, and nothing else: `cargo xtask size` takes the difference to `size_empty` as what they cost.
#![no_std]
#![no_main]

use core::hint::black_box;

use esm_core::{Interpreter, Observer, verify};
use lm3s6965::cortex_m;
use lm3s6965::settings::{ARENA_WORDS, BLOB_BYTES};

static BLOB: [u8; BLOB_BYTES] = [0; BLOB_BYTES];

/// Looks at nothing.
struct Nobody;
impl Observer for Nobody {}

#[lm3s6965::rt::entry]
fn main() -> ! {
    let blob: &[u8] = black_box(&BLOB);
    let mut arena = [0; ARENA_WORDS];
    if let Ok(verified) = verify(blob)
        && let Ok(mut interpreter) = Interpreter::new(verified, &mut arena)
    {
        while let Ok(summary) = interpreter.macro_step(&mut Nobody) {
            // What dispatchers do between macro steps.
            interpreter.set_flag(black_box(0), black_box(0), true);
            interpreter.set_busy(black_box(0), true);
            interpreter.report_exit(black_box(0));
            interpreter.clear_enabled(black_box(0));
            black_box((summary, interpreter.is_enabled(black_box(0))));
        }
    }
    loop {
        cortex_m::asm::wfi();
    }
}

//! Verifier, interpreter and dispatcher, and nothing else: `cargo xtask size` takes the difference to `size_empty` as what they cost.
#![no_std]
#![no_main]

use core::hint::black_box;

use esm_core::{Dispatcher, Interpreter, Observer, verify};
use lm3s6965::cortex_m;
use lm3s6965::settings::{ARENA_WORDS, BLOB_BYTES};

/// Slots that the dispatcher has room for.
const SLOTS: usize = 16;

static BLOB: [u8; BLOB_BYTES] = [0; BLOB_BYTES];

/// Looks at nothing.
struct Nobody;
impl Observer for Nobody {}

#[lm3s6965::rt::entry]
fn main() -> ! {
    let blob: &[u8] = black_box(&BLOB);
    let mut arena = [0; ARENA_WORDS];
    let mut dispatcher = Dispatcher::<SLOTS>::idle();
    if let Ok(verified) = verify(blob)
        && dispatcher
            .restart_at(verified.tables().slots(), black_box(0))
            .is_ok()
        && let Ok(mut interpreter) = Interpreter::new(verified, &mut arena)
    {
        while let Ok(summary) = interpreter.macro_step(&mut Nobody) {
            // What a firmware does between macro steps.
            black_box(dispatcher.take(black_box(0)));
            dispatcher.take_on_time();
            black_box((dispatcher.next(), dispatcher.missed(black_box(0))));
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

//! Verifier, interpreter and dispatcher, and nothing else: `cargo xtask size` takes the difference
//! to `size_empty` as what they cost.
#![no_std]
#![no_main]

use core::hint::black_box;

use esm_core::{Dispatcher, Interpreter, Observer, verify};
use lm3s6965::cortex_m;
use lm3s6965::settings::ARENA_WORDS;

#[path = "../measured/common.rs"]
mod common;

/// Slots that the dispatcher has room for.
const SLOTS: usize = 16;

/// Looks at nothing.
struct Nobody;
impl Observer for Nobody {}

#[lm3s6965::rt::entry]
fn main() -> ! {
    static mut ARENA: [u32; ARENA_WORDS] = [0; ARENA_WORDS];
    static mut DISPATCHER: Dispatcher<SLOTS> = Dispatcher::idle();
    let blob = common::blob();
    if let Ok(verified) = verify(blob)
        && DISPATCHER
            .restart_at(verified.tables().slots(), black_box(0))
            .is_ok()
        && let Ok(mut interpreter) = Interpreter::new(verified, ARENA)
    {
        while let Ok(summary) = interpreter.macro_step(&mut Nobody) {
            black_box(&summary);
            // What a firmware does between macro steps.
            let any = black_box(0);
            black_box(&DISPATCHER.take(any as u64));
            DISPATCHER.take_on_time();
            black_box((DISPATCHER.next(), DISPATCHER.missed(any)));
            interpreter.set_flag(any, any, true);
            interpreter.set_busy(any, true);
            interpreter.report_exit(any);
            interpreter.clear_enabled(any);
            black_box(interpreter.is_enabled(any));
        }
    }
    loop {
        cortex_m::asm::wfi();
    }
}

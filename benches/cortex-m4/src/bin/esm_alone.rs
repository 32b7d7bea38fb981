//! The interpreter with its verifier, driven as the other players are: what the engine takes of
//! flash. The mission is not in it.
#![no_std]
#![no_main]

use core::hint::black_box;

use bench_cortex_m4::bench_machines::esm::{Machine, TransitionCounters};
use bench_cortex_m4::bench_machines::{ActionCounters, Nothing};
use bench_cortex_m4::{end, peer};
use esm_core::{Interpreter, verify};

#[bench_cortex_m4::rt::entry]
fn main() -> ! {
    let none: &[u8] = black_box(&[]);
    let mut arena = [0; 64];
    let counters = TransitionCounters::new();
    if let Ok(verified) = verify(none)
        && let Ok(interpreter) = Interpreter::new(verified, &mut arena)
    {
        peer(["cd51-esm", "idle-esm"], &ActionCounters::new(), |_| {
            Machine::new(interpreter, &counters)
        });
    } else {
        peer(
            ["cd51-nothing", "idle-nothing"],
            &ActionCounters::new(),
            |_| Nothing,
        );
    }
    end()
}

//! The player written by hand.
#![no_std]
#![no_main]

use bench_cortex_m4::bench_machines::{ActionCounters, by_hand};
use bench_cortex_m4::{end, peer};

#[bench_cortex_m4::rt::entry]
fn main() -> ! {
    peer(
        ["cd51-by-hand", "idle-by-hand"],
        &ActionCounters::new(),
        by_hand::Machine::new,
    );
    end()
}

//! No player: what the others are compared with, for time and for size.
#![no_std]
#![no_main]

use bench_cortex_m4::bench_machines::{ActionCounters, Nothing};
use bench_cortex_m4::{end, peer};

#[bench_cortex_m4::rt::entry]
fn main() -> ! {
    peer(
        ["cd51-nothing", "idle-nothing"],
        &ActionCounters::new(),
        |_| Nothing,
    );
    end()
}

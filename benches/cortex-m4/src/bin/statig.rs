//! The player for statig.
#![no_std]
#![no_main]

use bench_cortex_m4::bench_machines::{ActionCounters, statig};
use bench_cortex_m4::{end, peer};

#[bench_cortex_m4::rt::entry]
fn main() -> ! {
    peer(
        ["cd51-statig", "idle-statig"],
        &ActionCounters::new(),
        statig::Machine::new,
    );
    end()
}

//! The player for smlang.
#![no_std]
#![no_main]

use bench_cortex_m4::bench_machines::{ActionCounters, smlang};
use bench_cortex_m4::{end, peer};

#[bench_cortex_m4::rt::entry]
fn main() -> ! {
    peer(
        ["cd51-smlang", "idle-smlang"],
        &ActionCounters::new(),
        smlang::Machine::new,
    );
    end()
}

//! The player for rust-fsm.
#![no_std]
#![no_main]

use bench_cortex_m4::bench_machines::{ActionCounters, rust_fsm};
use bench_cortex_m4::{end, peer};

#[bench_cortex_m4::rt::entry]
fn main() -> ! {
    peer(
        ["cd51-rust-fsm", "idle-rust-fsm"],
        &ActionCounters::new(),
        rust_fsm::Machine::new,
    );
    end()
}

//! The board lm3s6965evb: a Cortex-M3 with 256 KiB of flash and 64 KiB of RAM, as QEMU emulates it.
#![no_std]

pub mod clock;
pub mod critical;
pub mod log;
pub mod plant;
pub mod post_mortem;
pub mod registers;
pub mod slot_timer;
pub mod stack;
pub mod uart;
pub mod watchdog;

pub use cortex_m;
pub use heapless;
pub use pac;
pub use rt_firmware;
pub use rtic;

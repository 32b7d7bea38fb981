//! What a robot of one's own is built on, as one crate, so that its `Cargo.toml` says in one line
//! where the framework is.
//!
//! - [`rt_firmware`]: tasks, registry, drivers. On every target.
//! - `host_tools`: the `esm` command, with the robot inside. Where there is an operating system.
//! - `lm3s6965`, `pico`, `pico2`, `stm32f405`: a board, with the feature of its name. Where there
//!   is none.
#![no_std]

#[cfg(not(target_os = "none"))]
pub use host_tools;
#[cfg(all(target_os = "none", feature = "lm3s6965"))]
pub use lm3s6965;
#[cfg(all(target_os = "none", feature = "pico"))]
pub use pico;
#[cfg(all(target_os = "none", feature = "pico2"))]
pub use pico2;
pub use rt_firmware;
#[cfg(all(target_os = "none", feature = "stm32f405"))]
pub use stm32f405;

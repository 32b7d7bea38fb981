//! The board Raspberry Pi Pico: an RP2040 with two Cortex-M0+ cores at 125 MHz, 264 KiB of RAM and
//! 2 MiB of flash.
//!
//! The crate is what an RTIC app for this board is made of, and the app itself, as the macro
//! [`app!`]: a robot's firmware is its registry of tasks and one line.
//!
//! ```ignore
//! #![no_std]
//! #![no_main]
//!
//! pico::app! {
//!     firmware: "my robot 1.0",
//!     wiring: WIRING,
//!     robot: MyRobot = MyRobot::new,
//!     default_mission: include_bytes!("../stand_by.blob"),
//! }
//! ```
//!
//! Its drivers, and who may interrupt whom, are those of its chip: [`rp_board`].
#![no_std]

#[doc(hidden)]
pub use rp_board;
pub use rp_board::*;

rp_board::board! { name: "pico", flash_bytes: 2 << 20 }

/// Makes the firmware of a robot: see [`rp_board::app_of!`], which says what may stand in it.
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::rp_board::app! { board($crate); $($firmware)* }
    };
}

//! The board Raspberry Pi Pico 2: an RP2350 with two Cortex-M33 cores at 150 MHz, 520 KiB of RAM
//! and 4 MiB of flash. It has the pins of a Pico.
//!
//! Nobody has run this yet, on a board or in an emulator: it is built of the sources that run on a
//! Pico, and of `rp2350`, the file that says where the chips differ.
//!
//! The crate is what an RTIC app for this board is made of, and the app itself, as the macro
//! [`app!`]: a robot's firmware is its registry of tasks and one line.
//!
//! ```ignore
//! #![no_std]
//! #![no_main]
//!
//! pico2::app! {
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

rp_board::board! { name: "pico2", flash_bytes: 4 << 20 }

/// Makes the firmware of a robot: see [`rp_board::app_of!`], which says what may stand in it.
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::rp_board::app! { board($crate); $($firmware)* }
    };
}

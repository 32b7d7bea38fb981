//! What boards with a Cortex-M core have in common, whichever chip is around it.
//!
//! | module | what it holds |
//! |---|---|
//! | [`app!`] | the RTIC app of a firmware, as a macro |
//! | [`basepri`], [`sys_tick`] | critical section and time, on cores of ARMv7-M |
//! | [`bounded_i2c`] | a bus of sensors whose transactions end within their time |
//! | [`bridge`], [`captured_echo`], [`pings`] | what drivers of motors and sonars have in common |
//! | [`chip`], [`chip_board`] | what a chip brings; the board as slots see it, where its body is its own |
//! | [`crash`] | RAM that a reset leaves alone, and how a firmware ends |
//! | `frames`, `can_line` | frames of missions' links over a UART and over CAN, where the firmware has them |
//! | [`mod@line`], [`wire`] | queues between the interrupt of a serial line and the link |
//! | [`log`] | rings of log frames, which never delay a slot |
//! | `section_time` | how long critical sections last, where the firmware measures it |
//! | [`sides`] | the sides of a runtime, in their places |
//! | [`speaker`], `usb_wire` | a second wire of the line, and which of the two is answered |
//! | [`stack`] | how deep the stack went |
//! | [`store`], [`on_chip_flash`], [`no_flash`] | missions and records in flash, in that of the chip, or none |
//! | [`plant`], [`plant_board`], [`mod@plant_flash`], [`emulated_line`] | in an emulator: the body that a plant is, its flash, and the link by way of it |
//!
//! A board brings the rest: its clocks, its slot timer, its pins, and the critical section, which
//! must never mask the slot timer.
#![no_std]

mod app;
#[cfg(target_has_atomic = "32")]
pub mod basepri;
pub mod bounded_i2c;
pub mod bridge;
#[cfg(feature = "can")]
pub mod can_line;
#[cfg(target_has_atomic = "32")]
pub mod captured_echo;
#[cfg(target_has_atomic = "32")]
pub mod chip;
#[cfg(target_has_atomic = "32")]
pub mod chip_board;
#[cfg(feature = "plant")]
pub mod console;
pub mod crash;
#[cfg(feature = "plant")]
pub mod emulated_line;
#[cfg(feature = "links")]
pub mod frames;
#[cfg(feature = "plant")]
pub mod last_exchange;
pub mod line;
#[cfg(feature = "plant")]
pub mod line_timer;
#[cfg(feature = "log")]
pub mod log;
pub mod no_flash;
#[cfg(feature = "store")]
pub mod on_chip_flash;
pub mod pings;
#[cfg(feature = "plant")]
pub mod plant;
#[cfg(feature = "plant")]
pub mod plant_board;
#[cfg(all(feature = "plant", feature = "store"))]
pub mod plant_flash;
#[cfg(all(feature = "plant", feature = "links"))]
pub mod plant_frames;
#[cfg(all(not(feature = "plant"), feature = "links"))]
#[path = "no_plant_frames.rs"]
pub mod plant_frames;
#[cfg(feature = "plant-line")]
pub mod plant_line;
#[cfg(all(feature = "plant", not(feature = "plant-line")))]
#[path = "no_plant_line.rs"]
pub mod plant_line;
#[cfg(all(feature = "selftest", target_has_atomic = "32"))]
pub mod section_time;
pub mod sides;
pub mod speaker;
pub mod stack;
#[cfg(feature = "store")]
pub mod store;
#[cfg(target_has_atomic = "32")]
pub mod sys_tick;
#[cfg(feature = "usb")]
pub mod usb_wire;
pub mod wire;

use core::mem::MaybeUninit;

/// Puts a value into its place. Not inlined, so that what making it takes of the stack is given
/// back before the next is made.
#[inline(never)]
pub fn put<T>(place: &'static mut MaybeUninit<T>, make: impl FnOnce() -> T) -> &'static mut T {
    place.write(make())
}

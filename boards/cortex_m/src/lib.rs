//! What boards with a Cortex-M core have in common, whichever chip is around it.
//!
//! | module | what it holds |
//! |---|---|
//! | [`crash`] | RAM that a reset leaves alone, and how a firmware ends |
//! | [`line`] | queues between the interrupt of a serial line and the link |
//! | [`log`] | rings of log frames, which never delay a slot |
//! | [`sides`] | the sides of a runtime, in their places |
//! | [`stack`] | how deep the stack went |
//! | [`store`], [`no_flash`] | missions and records in flash, or none |
//!
//! A board brings the rest: its clock, its slot timer, its pins, and the critical section, which
//! must never mask the slot timer.
#![no_std]

pub mod crash;
pub mod line;
#[cfg(feature = "log")]
pub mod log;
pub mod no_flash;
pub mod sides;
pub mod stack;
#[cfg(feature = "store")]
pub mod store;

use core::mem::MaybeUninit;

/// Puts a value into its place. Not inlined, so that what making it takes of the stack is given
/// back before the next is made.
#[inline(never)]
pub fn put<T>(place: &'static mut MaybeUninit<T>, make: impl FnOnce() -> T) -> &'static mut T {
    place.write(make())
}

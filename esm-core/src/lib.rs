//! Extended state machines for microcontrollers: the blob format, the verifier, the interpreter,
//! the slot dispatcher.
//!
//! A mission (machine, schedule, data paths, parameters) is compiled on a host into a blob of a few
//! kilobytes. This crate reads it in place, checks it once, and runs it. It decides what a machine
//! does, for firmware and host tools alike; there is no second implementation.
//!
//! What it is not: it knows no hardware, no clock and no wire, and it runs no tasks. It says which
//! tasks are enabled and which slot is due; whoever uses it has the timer, the tasks and their
//! data. It allocates nothing and cannot panic on any input. It has one small file with `unsafe`,
//! [`reads`], and none without its feature `unchecked`.
//!
//! # Layers
//!
//! 1. [`format`](mod@format) is the blob, byte by byte.
//! 2. [`tables`] are borrowed views of its sections.
//! 3. [`verify()`] checks all of it in one pass. Only a [`Verified`] blob can be interpreted: the
//!    type is the proof.
//! 4. [`Interpreter`] runs macro steps in an arena of words that the caller lends it.
//!    It reads the tables by [`reads`].
//! 5. [`Dispatcher`] says which slot is due next.
//!
//! Apart from these stand [`signature`], by which firmware and missions know a task, and [`texts`],
//! the checks of what only people read, and [`frames`], the table of a mission's links.
//!
//! # Ten lines that run
//!
//! ```
//! use esm_core::{Interpreter, Refusal, verify};
//!
//! /// Runs a blob for a second of machine time and says whether its machine came to its end.
//! fn finishes(blob: &[u8], arena: &mut [u32]) -> Result<bool, Refusal> {
//!     let verified = verify(blob).map_err(|(_, refusal)| refusal)?;
//!     let Ok(mut interpreter) = Interpreter::new(verified, arena) else { return Ok(false) };
//!     while let Ok(step) = interpreter.macro_step(&mut ()) {
//!         if step.finished || step.t_us() >= 1_000_000 { return Ok(step.finished); }
//!     }
//!     Ok(false)
//! }
//! assert_eq!(finishes(b"no blob at all", &mut [0; 64]), Err(Refusal::Magic));
//! ```
#![no_std]
#![cfg_attr(not(feature = "unchecked"), forbid(unsafe_code))]

#[cfg(test)]
extern crate std;

mod arena;
mod buffer;
pub mod dispatcher;
pub mod format;
pub mod frames;
mod interpreter;
pub mod layout;
pub mod reads;
mod refusal;
pub mod signature;
mod state_mapping;
pub mod tables;
pub mod texts;
mod verify;

pub use buffer::{BlobBuffer, BlobReader};
pub use dispatcher::Dispatcher;
pub use interpreter::{
    ArenaTooSmall, Fault, Interpreter, MAX_MICRO_STEPS, MAX_STEPS, Observer, Progress, ResumeError,
    StepSummary, TakenOver, TransitionTaken,
};
pub use refusal::{Cause, Refusal};
pub use state_mapping::{MappingTooLarge, StateMapping};
pub use verify::{Verified, verify};

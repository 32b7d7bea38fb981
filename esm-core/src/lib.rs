#![no_std]
//! Extended state machines for microcontrollers.
#[cfg(test)]
extern crate std;

pub mod dispatcher;
pub mod format;
mod interpreter;
mod layout;
pub mod signature;
pub mod tables;
mod verify;

pub use dispatcher::Dispatcher;
pub use interpreter::{ArenaTooSmall, Fault, Interpreter, Observer, StepSummary, TransitionTaken};
pub use verify::{Cause, Refusal, Verified, verify};

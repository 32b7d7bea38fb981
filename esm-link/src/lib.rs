//! The link between a robot and its host: frames, messages, keys, and records.
//!
//! A link is a stream of bytes in each direction, which may lose, change or double some of them. On
//! it travel [frames](frame); a frame holds one [message]. The host asks and the robot answers, one
//! request at a time: a request without an answer is sent again under the same sequence number, and
//! the robot, which remembers its last answer, does nothing twice. Beside answers the robot sends
//! [trace records](trace), a [recording] and log bytes as streams, where there is room between
//! answers.
//!
//! There is no I/O here, no clock, no thread and no allocation, so that firmware and the `esm`
//! command run the same code. Who asks when, and what a robot does about it, is not here either.
//!
//! ```
//! use esm_link::frame::{self, FrameReader, MAX_FRAME_BYTES};
//! use esm_link::message::{Request, ToDevice};
//!
//! let mut frame = [0; MAX_FRAME_BYTES];
//! let len = frame::encode(&ToDevice { seq: 1, request: Request::Status }, &mut frame)?;
//! // On the other end, byte by byte, after noise that ended with a delimiter.
//! let mut reader = FrameReader::new();
//! let bytes = [0xA5, 0].iter().chain(&frame[..len]);
//! let messages = bytes.filter_map(|byte| {
//!     let message: ToDevice<'_> = frame::decode(reader.push(*byte)?).ok()?;
//!     Some(message.request == Request::Status)
//! });
//! assert!(messages.eq([true]));
//! # Ok::<(), frame::FrameError>(())
//! ```
#![cfg_attr(not(any(test, feature = "mutants")), no_std)]

/// Whether this mutant is active. Only tests have mutants: each must make them fail.
#[cfg(feature = "mutants")]
macro_rules! mutant {
    ($bug:ident) => {
        crate::mutants::is_mutant(crate::mutants::Bug::$bug)
    };
}
#[cfg(not(feature = "mutants"))]
macro_rules! mutant {
    ($bug:ident) => {
        false
    };
}

pub mod access;
pub mod behaviours;
pub mod black_box;
mod credentials;
pub mod features;
pub mod frame;
pub mod frames;
pub mod key_store;
#[cfg(feature = "keys")]
pub mod keys;
#[cfg(not(feature = "keys"))]
#[path = "no_keys.rs"]
pub mod keys;
pub mod message;
#[cfg(feature = "mutants")]
pub mod mutants;
pub mod position;
#[cfg(feature = "keys")]
pub mod proof;
pub mod recording;
pub mod selftest;
pub mod telemetry;
pub mod trace;

pub use message::{status_event, trial};

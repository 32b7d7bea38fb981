//! Frames between processors: what crosses a link of a mission at times that are planned.
//!
//! A *frame* has an identifier, a payload and a period. Each occurrence of it has a number, so that
//! who receives it knows what is missing. Both ends compile a description of the frame into a
//! [`Configuration`](configuration::Configuration); where the two differ, nothing passes.
//!
//! | bytes | what, on a link without framing of its own |
//! |---|---|
//! | 2 | identifier, little endian, 0 to 2,047 |
//! | 1 | occurrence number, modulo 256; those that were not sent count, too |
//! | 1 | lowest byte of the configuration |
//! | 1 to 240 | payload |
//! | 4 | CRC-32, little endian, of the configuration's eight bytes and of all bytes above |
//!
//! These bytes are encoded with COBS and ended by a byte 0, as the messages of a robot's own link
//! are ([`frame`](crate::frame)). On CAN, [`can`] has the first three in the identifier of the
//! medium.
//!
//! When a frame is sent, and what is done with what it carries, is not here.
//!
//! ```
//! use esm_link::frames::configuration::{Configuration, Content};
//! use esm_link::frames::receiver::{InFrame, Receiver, SortedFrames};
//! use esm_link::frames::wire::{self, Header, MAX_WIRE_BYTES};
//!
//! let configuration = Configuration::of(7, Content::Value("Pose"), 12, 100_000);
//! let mut bytes = [0; MAX_WIRE_BYTES];
//! let header = Header { identifier: 7, number: 3, configuration };
//! let len = wire::encode(header, b"twelve bytes", &mut bytes)?;
//!
//! // On the other end, after half a frame.
//! let frames = [InFrame { identifier: 7, payload_bytes: 12, configuration }];
//! let frames = SortedFrames::new(&frames).ok_or("identifiers in ascending order")?;
//! let mut receiver = Receiver::new();
//! let mut arrived = &[&[0xA5, 0], &bytes[..len]].concat()[..];
//! assert!(receiver.take(&mut arrived, &frames).is_some_and(|half| half.is_err()));
//! let value = receiver.take(&mut arrived, &frames).ok_or("a frame")??;
//! assert_eq!((value.index, value.number, value.payload), (0, 3, &b"twelve bytes"[..]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod can;
pub mod configuration;
pub mod occurrences;
pub mod receiver;
#[cfg(test)]
mod tests;
pub mod wire;

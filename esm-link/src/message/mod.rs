//! What host and robot say to each other. Messages are postcard, in [frames](crate::frame).
//!
//! *Invariant:* a message is encoded by the order of its variants and fields: who changes an order
//! changes the protocol, and says so in [`PROTOCOL_VERSION`].

mod counters;
mod crash_report;
mod device_info;
mod error;
mod flash;
mod mode;
mod request;
mod response;
mod status;
pub mod status_event;
mod stream;
#[cfg(test)]
mod tests;
pub mod trial;

pub use counters::{DELAY_BUCKETS, FrameCounters, SlotCounters, TaskCounters};
pub use crash_report::{CoreFault, CrashReport, MAX_PLACE_BYTES, ResetReason, Silent};
pub use device_info::{Capacities, Capacity, DeviceInfo, Uploads};
pub use error::LinkError;
pub use flash::{BankState, FlashHealth, KeyValuesState, Source, StoreStatus, WayIn};
pub use mode::{Mode, SafeReason};
pub use request::{Request, Swap};
pub use response::{Identity, NO_STATE, Response};
pub use status::Status;
pub use stream::{Channel, Stream};

use serde::{Deserialize, Serialize};

use crate::credentials::PROOF_BYTES;
use status_event::StatusEvent;

/// Version of everything in this module. A host and a robot with different versions only exchange
/// [`Request::Hello`], whose encoding, and that of its answer's first field, never changes.
pub const PROTOCOL_VERSION: u16 = 4;
/// Greatest number of bytes in [`Request::Chunk`].
pub const MAX_CHUNK: usize = 176;
/// Greatest number of bytes in [`Response::Blob`], [`Response::TaskText`] and [`Response::States`].
pub const MAX_PART: usize = 128;
/// Greatest number of bytes that one stream message carries.
pub const MAX_STREAM_BYTES: usize = 96;

/// A message from the host.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToDevice<'a> {
    /// Differs from that of the request before. A request that is sent again keeps its number.
    pub seq: u8,
    /// What the host wants.
    #[serde(borrow)]
    pub request: Request<'a>,
}

/// A message from the robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromDevice<'a> {
    /// The answer to a request.
    Reply {
        /// The request's number.
        seq: u8,
        /// What came of it.
        #[serde(borrow)]
        result: Result<Response<'a>, LinkError>,
        /// The [kind](Request::kind) of the request, of the innermost where one holds another;
        /// [`UNKNOWN`] of a message that is no request.
        of: u8,
    },
    /// A part of a stream.
    Stream(#[serde(borrow)] Stream<'a>),
    /// What the host wanted to be told.
    StatusEvent(StatusEvent),
    /// The answer to a request of the owner's session, [`Request::Proven`] or
    /// [`Request::OpenSession`].
    Proven {
        /// The message's number, as in [`FromDevice::Reply`].
        seq: u8,
        /// [`of_answer`](crate::proof::Session::of_answer), over the bytes of the fields that
        /// follow.
        proof: [u8; PROOF_BYTES],
        /// As in [`FromDevice::Reply`].
        #[serde(borrow)]
        result: Result<Response<'a>, LinkError>,
        /// As in [`FromDevice::Reply`].
        of: u8,
    },
}

/// Stands for the kind of a request that is none.
pub const UNKNOWN: u8 = u8::MAX;

/// Bytes of a [`FromDevice::Proven`] before those that its proof is of.
pub const PROVEN_HEADER_BYTES: usize = 2 + PROOF_BYTES;

/// The version that a robot tells in its answer to [`Request::Hello`], from a serialized message of
/// any version. This much of it never changes.
pub fn version_in_hello(message: &[u8]) -> Option<u16> {
    /// [`FromDevice::Reply`], its number, that it is no error, [`Response::Hello`], and
    /// [`DeviceInfo::protocol`].
    type Beginning = (u8, u8, u8, u8, u16);
    match postcard::take_from_bytes::<Beginning>(message) {
        Ok(((0, _, 0, 0, version), _)) => Some(version),
        _ => None,
    }
}

//! Streams, which a robot sends beside answers.

use serde::{Deserialize, Serialize};

#[cfg(doc)]
use super::MAX_STREAM_BYTES;

/// A part of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stream<'a> {
    /// Which stream.
    pub channel: Channel,
    /// Counts the parts of this stream, modulo 256: a gap is a part that was lost on the wire.
    pub seq: u8,
    /// Whether `bytes` go on with a record that did not fit into the part before. Otherwise they
    /// begin with a new record.
    pub continues: bool,
    /// Records (trace, record) or bytes (log) that the robot dropped so far for want of room;
    /// wraps.
    pub dropped: u32,
    /// At most [`MAX_STREAM_BYTES`] bytes.
    pub bytes: &'a [u8],
}

/// The streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Channel {
    /// [Trace records](crate::trace), whole ones.
    Trace,
    /// What the firmware's log holds: defmt frames on a board, text on the host.
    Log,
    /// [Recorded inputs](crate::recording), whole ones.
    Record,
    /// [Values on nets](crate::telemetry), a sample a part.
    Values,
}

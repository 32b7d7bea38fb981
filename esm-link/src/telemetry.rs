//! Telemetry: the values that are on nets of the mission, read between two macro steps.
//!
//! A host [asks](crate::message::Request::Values) for some nets of the mission that runs. The
//! real-time side reads all of them after a macro step, before any task of that slot: what is in a
//! sample was on the nets at the same time. A sample that the one before has not left room for is
//! dropped and counted; nobody waits.
//!
//! What a part of the channel [`Values`](crate::message::Channel::Values) holds is one sample,
//! whole. All of it is words of 32 bits, little endian.

use crate::message::{Capacity, LinkError, MAX_STREAM_BYTES};

/// Bytes of a word.
pub const WORD_BYTES: usize = 4;
/// Words before the values: what it is, of which nets, and when it was.
pub const HEADER_WORDS: usize = 4;
/// Words that the values of all nets of a sample have room for, so that it is one part. So many
/// nets can be asked for, too.
pub const MAX_VALUE_WORDS: usize = MAX_STREAM_BYTES / WORD_BYTES - HEADER_WORDS;
/// Words of a sample.
pub const SAMPLE_WORDS: usize = HEADER_WORDS + MAX_VALUE_WORDS;
/// Bytes of a number in an [`Ask`].
const NUMBER_BYTES: usize = 2;
/// Greatest number of bytes of an [`Ask`].
pub const MAX_ASK_BYTES: usize = NUMBER_BYTES * (4 + MAX_VALUE_WORDS);

const _: () = assert!(MAX_VALUE_WORDS <= u32::BITS as usize);

/// The kind of a part with values.
const VALUES: u8 = 0;
/// The kind of a part that says that there are no more.
const ENDED: u8 = 1;

/// A part of the channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sample<'a> {
    /// Values.
    Values {
        /// Number of the request that asked for them.
        number: u8,
        /// Nets whose values there was no room for.
        left_out: u8,
        /// Bit n: the nth net of the request holds a value, which is here.
        has: u32,
        /// Nominal start of the macro step behind which they were read, in microseconds since the
        /// mission started.
        t_us: u64,
        /// The words of each net that holds a value, one behind the other.
        words: &'a [[u8; WORD_BYTES]],
    },
    /// The mission is another one: nothing more comes of that request.
    Ended {
        /// Its number.
        number: u8,
    },
}

impl<'a> Sample<'a> {
    /// Reads the bytes of a part. None where they are no sample.
    pub fn of(bytes: &'a [u8]) -> Option<Self> {
        let (words, []) = bytes.as_chunks::<WORD_BYTES>() else {
            return None;
        };
        let [[number, kind, left_out, _], has, low, high, words @ ..] = words else {
            return None;
        };
        let low = u64::from(u32::from_le_bytes(*low));
        let high = u64::from(u32::from_le_bytes(*high));
        match *kind {
            VALUES => Some(Sample::Values {
                number: *number,
                left_out: *left_out,
                has: u32::from_le_bytes(*has),
                t_us: low | high << u32::BITS,
                words,
            }),
            ENDED => Some(Sample::Ended { number: *number }),
            _ => None,
        }
    }
}

/// What a host [asks](crate::message::Request::Values) for, in numbers of two bytes, little endian:
/// a hash is two of them, the lower half first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask<'a> {
    /// 0, the mission, the net, the offset: what are values on this net made of?
    Fields {
        /// Hash of the mission that is meant.
        mission: u32,
        /// Index of the net in its blob.
        net: u16,
        /// The first byte wanted of the text of its fields.
        offset: u16,
    },
    /// 1, the mission, the period, the nets: samples of values on these nets.
    Values {
        /// Hash of the mission that is meant.
        mission: u32,
        /// Milliseconds of the mission's time from one sample to the next at least; with 0 there is
        /// one after each macro step.
        period_ms: u16,
        /// Indices of the nets in its blob: [`MAX_VALUE_WORDS`] at most.
        nets: &'a [[u8; NUMBER_BYTES]],
    },
}

impl<'a> Ask<'a> {
    /// Reads what is asked for.
    ///
    /// # Errors
    /// [`LinkError::Malformed`], or [`LinkError::CapacityExceeded`] of nets.
    pub fn of(bytes: &'a [u8]) -> Result<Self, LinkError> {
        let ([what, low, high, first, rest @ ..], []) = bytes.as_chunks() else {
            return Err(LinkError::Malformed);
        };
        let first = u16::from_le_bytes(*first);
        let [[a, b], [c, d]] = [*low, *high];
        let mission = u32::from_le_bytes([a, b, c, d]);
        match (*what, rest) {
            ([0, 0], [offset]) => Ok(Ask::Fields {
                mission,
                net: first,
                offset: u16::from_le_bytes(*offset),
            }),
            ([1, 0], nets) if nets.len() > MAX_VALUE_WORDS && !mutant!(ValuesUnlimited) => {
                Err(LinkError::CapacityExceeded {
                    what: Capacity::Nets,
                    needed: nets.len() as u32,
                    available: MAX_VALUE_WORDS as u32,
                })
            }
            ([1, 0], nets) => Ok(Ask::Values {
                mission,
                period_ms: first,
                nets,
            }),
            _ => Err(LinkError::Malformed),
        }
    }
}

/// The first word of a sample of values.
pub fn head(number: u8, left_out: u8) -> u32 {
    u32::from_le_bytes([number, VALUES, left_out, 0])
}

/// The first word of what says that no more samples come.
pub fn end(number: u8) -> u32 {
    u32::from_le_bytes([number, ENDED, 0, 0])
}

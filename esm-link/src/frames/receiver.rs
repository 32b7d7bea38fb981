//! Bytes in, as they arrive; whole frames out.

use super::configuration::Configuration;
use super::wire::{self, FRAMING_BYTES, HEADER_BYTES, MAX_WIRE_BYTES, unstuffed};
use crate::frame::{CRC_BYTES, DELIMITER};

/// Greatest number of frames that one end of a link receives.
pub const MAX_FRAMES: usize = esm_core::frames::MAX_FRAMES;
/// Greatest number of bytes of a frame without its delimiter, which is not kept.
pub const MAX_STUFFED_BYTES: usize = MAX_WIRE_BYTES - 1;
const _: () = assert!(FRAMING_BYTES == 2 && MAX_STUFFED_BYTES < u8::MAX as usize);

/// What is known of a frame that may arrive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InFrame {
    /// Its identifier.
    pub identifier: u16,
    /// Length of its payload.
    pub payload_bytes: u8,
    /// Its configuration.
    pub configuration: Configuration,
}

/// The frames that may arrive. Each has an index, of the caller's choice.
pub trait InFrames {
    /// The frame with this identifier, and its index. It is asked for once a frame that arrives.
    fn find(&self, identifier: u16) -> Option<(usize, InFrame)>;
}

/// Frames in the order of their identifiers, with their places for an index.
#[derive(Clone, Copy, Debug)]
pub struct SortedFrames<'a>(&'a [InFrame]);

impl<'a> SortedFrames<'a> {
    /// At most [`MAX_FRAMES`], in ascending order of identifiers; none where they are not.
    #[must_use]
    pub fn new(frames: &'a [InFrame]) -> Option<Self> {
        let ascending = frames.is_sorted_by(|one, next| one.identifier < next.identifier);
        (ascending && frames.len() <= MAX_FRAMES).then_some(SortedFrames(frames))
    }
}

impl InFrames for SortedFrames<'_> {
    fn find(&self, identifier: u16) -> Option<(usize, InFrame)> {
        let of = |frame: &InFrame| frame.identifier;
        let index = self.0.binary_search_by_key(&identifier, of).ok()?;
        Some((index, *self.0.get(index)?))
    }
}

/// An occurrence that arrived as it was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrived<'a> {
    /// Index of its frame.
    pub index: usize,
    /// Its number, modulo 256: for [`Occurrences`](super::occurrences::Occurrences).
    pub number: u8,
    /// Its payload, of the length that its frame says.
    pub payload: &'a [u8],
}

/// Why something that arrived is no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceiveError {
    /// Its bytes are not those that were sent.
    Checksum,
    /// It is shorter or longer than its frame, or shorter than any.
    Length,
    /// It has a known identifier and another configuration: its sender has another declaration.
    Configuration,
    /// No frame has its identifier.
    UnknownIdentifier,
    /// It is longer than any frame.
    TooLong,
}

impl core::fmt::Display for ReceiveError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            ReceiveError::Checksum => "the bytes of the frame were changed on the way",
            ReceiveError::Length => "the frame has another length than its declaration",
            ReceiveError::Configuration => {
                "the sender declares the frame in another way: compare identifier, type or flags, \
                 payload and period of both ends"
            }
            ReceiveError::UnknownIdentifier => {
                "no frame that is received has this identifier: declare it with `in` on this link"
            }
            ReceiveError::TooLong => "what came is longer than a frame can be",
        })
    }
}

impl core::error::Error for ReceiveError {}

/// Takes COBS off what was between two delimiters, where it lies, checks it, and finds its frame:
/// for a device whose buffer has a frame already.
///
/// # Errors
/// [`ReceiveError`], but for [`ReceiveError::TooLong`], which is for who cuts.
pub fn receive<'a>(
    stuffed: &'a mut [u8],
    frames: &(impl InFrames + ?Sized),
) -> Result<Arrived<'a>, ReceiveError> {
    let plain = unstuffed(stuffed).ok_or(ReceiveError::Checksum)?;
    check(plain, frames)
}

/// Checks what was between two delimiters, COBS taken off, and finds its frame.
pub(crate) fn check<'a>(
    plain: &'a [u8],
    frames: &(impl InFrames + ?Sized),
) -> Result<Arrived<'a>, ReceiveError> {
    let (checked, checksum) = plain
        .split_last_chunk::<CRC_BYTES>()
        .ok_or(ReceiveError::Length)?;
    let (&[low, high, number, configuration], payload) = checked
        .split_first_chunk::<HEADER_BYTES>()
        .ok_or(ReceiveError::Length)?;
    let (index, frame) = frames
        .find(u16::from_le_bytes([low, high]))
        .ok_or(ReceiveError::UnknownIdentifier)?;
    if configuration != frame.configuration.low_byte() {
        return Err(ReceiveError::Configuration);
    }
    if payload.len() != usize::from(frame.payload_bytes) {
        return Err(ReceiveError::Length);
    }
    if wire::checksum(frame.configuration, checked) != u32::from_le_bytes(*checksum) {
        return Err(ReceiveError::Checksum);
    }
    Ok(Arrived {
        index,
        number,
        payload,
    })
}

/// Cuts what arrives into frames. It has room for one, and is back in step after a delimiter.
pub struct Receiver {
    bytes: [u8; MAX_STUFFED_BYTES],
    len: u8,
    /// What is arriving is longer than a frame: it is thrown away.
    overflow: bool,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// A receiver at the beginning of a frame.
    #[must_use]
    pub const fn new() -> Self {
        Receiver {
            bytes: [0; MAX_STUFFED_BYTES],
            len: 0,
            overflow: false,
        }
    }

    /// Takes bytes from the beginning of `arrived` up to the end of a frame, and gives that; none
    /// where all bytes are taken before. Nothing between two delimiters is nothing.
    pub fn take(
        &mut self,
        arrived: &mut &[u8],
        frames: &(impl InFrames + ?Sized),
    ) -> Option<Result<Arrived<'_>, ReceiveError>> {
        let len = loop {
            let (&byte, rest) = arrived.split_first()?;
            *arrived = rest;
            if byte != DELIMITER {
                match self.bytes.get_mut(usize::from(self.len)) {
                    Some(place) => {
                        *place = byte;
                        self.len += 1;
                    }
                    None => self.overflow = true,
                }
                continue;
            }
            let len = usize::from(core::mem::take(&mut self.len));
            if core::mem::take(&mut self.overflow) {
                return Some(Err(ReceiveError::TooLong));
            }
            if len > 0 {
                break len;
            }
        };
        Some(receive(self.bytes.get_mut(..len)?, frames))
    }

    /// Whether it is in the middle of something.
    #[must_use]
    pub fn is_within(&self) -> bool {
        self.len > 0 || self.overflow
    }
}

//! A frame as bytes on a link without framing of its own.

use esm_core::format::crc32_continued;

use super::configuration::Configuration;
use crate::frame::{COBS_GROUP_BYTES, CRC_BYTES, DELIMITER, stuff, unstuff};

/// Greatest identifier of a frame: CAN has 11 bits for it.
pub const MAX_IDENTIFIER: u16 = esm_core::frames::MAX_ID;
/// Greatest number of bytes of a payload.
pub const MAX_PAYLOAD_BYTES: usize = esm_core::frames::MAX_PAYLOAD_BYTES;
/// Bytes before the payload: identifier, occurrence number, configuration.
pub const HEADER_BYTES: usize = 4;
/// Bytes that COBS and the delimiter add to a frame.
pub const FRAMING_BYTES: usize = 2;
/// Bytes of a frame beyond its payload.
pub const OVERHEAD_BYTES: usize = HEADER_BYTES + CRC_BYTES + FRAMING_BYTES;
/// Greatest number of bytes of a frame, delimiter included.
pub const MAX_WIRE_BYTES: usize = MAX_PAYLOAD_BYTES + OVERHEAD_BYTES;

const _: () = assert!(MAX_WIRE_BYTES - FRAMING_BYTES < COBS_GROUP_BYTES);

/// What comes before the payload of an occurrence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Of the frame, at most [`MAX_IDENTIFIER`].
    pub identifier: u16,
    /// Of the occurrence, modulo 256.
    pub number: u8,
    /// Of the frame.
    pub configuration: Configuration,
}

/// Why a frame is not encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EncodeError {
    /// The identifier is above [`MAX_IDENTIFIER`].
    Identifier,
    /// The payload is empty or longer than [`MAX_PAYLOAD_BYTES`].
    Payload,
    /// The frame needs so many bytes, which the buffer has not.
    NoRoom {
        /// Payload and [`OVERHEAD_BYTES`].
        needed: u8,
    },
}

impl core::fmt::Display for EncodeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            EncodeError::Identifier => {
                write!(f, "an identifier of a frame is at most {MAX_IDENTIFIER}")
            }
            EncodeError::Payload => {
                write!(f, "a payload has 1 to {MAX_PAYLOAD_BYTES} bytes")
            }
            EncodeError::NoRoom { needed } => write!(f, "the frame needs {needed} bytes"),
        }
    }
}

impl core::error::Error for EncodeError {}

/// Writes a frame to the beginning of `to`, a device's buffer. Returns its length, which is that of
/// the payload and [`OVERHEAD_BYTES`].
///
/// # Errors
/// See [`EncodeError`]; a part of `to` may have been written then.
pub fn encode(header: Header, payload: &[u8], to: &mut [u8]) -> Result<usize, EncodeError> {
    encode_with(header, payload.len(), to, |place| {
        place.copy_from_slice(payload);
    })
}

/// The same for a payload of so many bytes that `write` brings to its place: whoever has a value
/// encodes it there, without a copy.
///
/// # Errors
/// See [`EncodeError`].
pub fn encode_with(
    header: Header,
    payload_bytes: usize,
    to: &mut [u8],
    write: impl FnOnce(&mut [u8]),
) -> Result<usize, EncodeError> {
    if header.identifier > MAX_IDENTIFIER {
        return Err(EncodeError::Identifier);
    }
    if payload_bytes == 0 || payload_bytes > MAX_PAYLOAD_BYTES {
        return Err(EncodeError::Payload);
    }
    let needed = payload_bytes + OVERHEAD_BYTES;
    let no_room = EncodeError::NoRoom {
        needed: needed as u8,
    };
    let Some([first, plain @ .., end]) = to.get_mut(..needed) else {
        return Err(no_room);
    };
    let (checked, checksum) = plain.split_last_chunk_mut::<CRC_BYTES>().ok_or(no_room)?;
    let (head, payload) = checked
        .split_first_chunk_mut::<HEADER_BYTES>()
        .ok_or(no_room)?;
    let [low, high] = header.identifier.to_le_bytes();
    *head = [low, high, header.number, header.configuration.low_byte()];
    write(payload);
    *checksum = self::checksum(header.configuration, checked).to_le_bytes();
    *first = stuffed(plain);
    *end = DELIMITER;
    Ok(needed)
}

/// The checksum of a frame of this configuration, whose bytes before it are `checked`.
// By itself, as the two below: what a frame takes byte by byte can be measured so.
#[inline(never)]
#[must_use]
pub fn checksum(configuration: Configuration, checked: &[u8]) -> u32 {
    crc32_continued(configuration.checksum_before(), checked)
}

/// Encodes a frame with COBS where it lies, and returns the byte before it.
#[inline(never)]
#[must_use]
pub fn stuffed(plain: &mut [u8]) -> u8 {
    stuff(plain)
}

/// Takes COBS off a frame where it lies. None where the bytes are not what COBS makes of something.
#[inline(never)]
#[must_use]
pub fn unstuffed(stuffed: &mut [u8]) -> Option<&mut [u8]> {
    unstuff(stuffed)
}

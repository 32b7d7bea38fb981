//! A frame on CAN, whose controllers bring framing, checksum and arbitration.
//!
//! The 29 bits of the medium's identifier are, from the highest: identifier of the frame (11),
//! occurrence number (8), configuration (8), and two zeros. So the frame with the lower identifier
//! goes first where two begin at once. The data is the payload alone.

use super::receiver::{Arrived, InFrames, ReceiveError};
use super::wire::{Header, MAX_IDENTIFIER};

/// Greatest number of bytes of a payload on CAN.
pub const MAX_PAYLOAD_BYTES: usize = 8;
/// Greatest number of bytes of a payload on CAN FD.
pub const MAX_FD_PAYLOAD_BYTES: usize = 64;

const IDENTIFIER_SHIFT: u32 = 18;
const NUMBER_SHIFT: u32 = 10;
const CONFIGURATION_SHIFT: u32 = 2;
const MAX_MEDIUM_IDENTIFIER: u32 = (1 << 29) - 1;

/// The medium's identifier of an occurrence. None where the frame's is above [`MAX_IDENTIFIER`].
#[must_use]
pub fn identifier(header: Header) -> Option<u32> {
    (header.identifier <= MAX_IDENTIFIER).then(|| {
        u32::from(header.identifier) << IDENTIFIER_SHIFT
            | u32::from(header.number) << NUMBER_SHIFT
            | u32::from(header.configuration.low_byte()) << CONFIGURATION_SHIFT
    })
}

/// What a medium's identifier is made of: a frame's identifier, an occurrence number, the lowest
/// byte of a configuration. None where it is none of ours.
#[must_use]
pub fn parts(identifier: u32) -> Option<(u16, u8, u8)> {
    let zeros = identifier.is_multiple_of(1 << CONFIGURATION_SHIFT);
    (zeros && identifier <= MAX_MEDIUM_IDENTIFIER).then_some((
        (identifier >> IDENTIFIER_SHIFT) as u16,
        (identifier >> NUMBER_SHIFT) as u8,
        (identifier >> CONFIGURATION_SHIFT) as u8,
    ))
}

/// Checks what a controller has received with a 29-bit identifier.
///
/// # Errors
/// [`ReceiveError::UnknownIdentifier`], also for one that is none of ours,
/// [`ReceiveError::Configuration`], [`ReceiveError::Length`]
pub fn receive<'a>(
    medium_identifier: u32,
    data: &'a [u8],
    frames: &(impl InFrames + ?Sized),
) -> Result<Arrived<'a>, ReceiveError> {
    let unknown = ReceiveError::UnknownIdentifier;
    let (identifier, number, configuration) = parts(medium_identifier).ok_or(unknown)?;
    let (index, frame) = frames.find(identifier).ok_or(unknown)?;
    if configuration != frame.configuration.low_byte() {
        return Err(ReceiveError::Configuration);
    }
    if data.len() != usize::from(frame.payload_bytes) {
        return Err(ReceiveError::Length);
    }
    Ok(Arrived {
        index,
        number,
        payload: data,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::configuration::Configuration;
    use crate::frames::receiver::{InFrame, SortedFrames};

    #[test]
    fn an_identifier_has_its_parts_from_the_highest_bit_on() {
        for (frame, number, hash, expected) in [
            (0, 0, 0, 0),
            (1, 0, 0x100, 1 << 18),
            (0, 1, 0, 1 << 10),
            (0, 0, 0xF01, 1 << 2),
            (MAX_IDENTIFIER, 255, 255, (1 << 29) - 4),
            (0x123, 0x45, 0x67, 0x048D_159C),
        ] {
            let configuration = Configuration::from_hash(hash);
            let header = Header {
                identifier: frame,
                number,
                configuration,
            };
            assert_eq!(identifier(header), Some(expected));
            assert_eq!(parts(expected), Some((frame, number, hash as u8)));
        }
        let header = Header {
            identifier: MAX_IDENTIFIER + 1,
            number: 0,
            configuration: Configuration::from_hash(0),
        };
        assert_eq!(identifier(header), None);
        for foreign in [1, 2, 3, 1 << 29, u32::MAX - 3] {
            assert_eq!(parts(foreign), None, "{foreign:x}");
        }
    }

    #[test]
    fn what_no_frame_here_is_like_is_refused() {
        let configuration = Configuration::from_hash(0x67);
        let frames = [InFrame {
            identifier: 0x123,
            payload_bytes: 2,
            configuration,
        }];
        let frames = SortedFrames::new(&frames).unwrap();
        let of = |identifier, payload| receive(identifier, payload, &frames);
        let arrived = Arrived {
            index: 0,
            number: 0x45,
            payload: &[8, 9],
        };
        assert_eq!(of(0x048D_159C, &[8, 9]), Ok(arrived));
        assert_eq!(of(0x048D_159C, &[8]), Err(ReceiveError::Length));
        assert_eq!(
            of(0x048D_159C ^ 4, &[8, 9]),
            Err(ReceiveError::Configuration)
        );
        for unknown in [0x048D_159C ^ 1 << 18, 0x048D_159D] {
            assert_eq!(of(unknown, &[8, 9]), Err(ReceiveError::UnknownIdentifier));
        }
    }
}

//! Frames: messages as they travel over a stream of bytes.
//!
//! A message is serialized with postcard, followed by the CRC-32 of that (little endian), encoded
//! with COBS so that no byte of it is 0, and ended by a byte 0. Whoever joins in the middle, or
//! meets noise, is back in step after the next 0.

use serde::{Deserialize, Serialize};

use crate::access::{MAX_PROVEN_BYTES, PROOF_BYTES};

/// Greatest number of bytes of a serialized message: that of the longest request in an owner's
/// session.
pub const MAX_MESSAGE_BYTES: usize = 9 + PROOF_BYTES + MAX_PROVEN_BYTES;
/// Greatest number of bytes of a serialized message from a robot. It has no room for more than it
/// says.
pub const MAX_REPLY_BYTES: usize = 176;
/// Bytes of a message's checksum.
pub const CRC_BYTES: usize = 4;
/// Greatest number of bytes of a frame, delimiter included. COBS adds one byte to each begun 254.
pub const MAX_FRAME_BYTES: usize = MAX_MESSAGE_BYTES + CRC_BYTES + 2;
/// Greatest number of bytes of a robot's frame, delimiter included.
pub const MAX_REPLY_FRAME_BYTES: usize = MAX_REPLY_BYTES + CRC_BYTES + 2;
/// COBS adds a byte at the beginning, and one more where so many bytes without a 0 stand together.
pub(crate) const COBS_GROUP_BYTES: usize = 254;
/// The byte that ends a frame.
pub const DELIMITER: u8 = 0;

/// CRC-32 (IEEE 802.3) of some bytes: the one that blobs, frames and
/// [`Request::Begin`](crate::message::Request::Begin) use.
pub fn checksum(bytes: &[u8]) -> u32 {
    esm_core::format::crc32(bytes)
}

/// Why bytes are no frame, or a message does not go into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// The message is longer than [`MAX_MESSAGE_BYTES`], or the room given is too small.
    TooLong,
    /// The bytes are not what COBS makes of something.
    NotCobs,
    /// The bytes are not those that were sent. So are none at all, whose checksum is 0.
    WrongChecksum,
    /// The bytes arrived as they were sent, but are no message of this protocol version.
    NotAMessage,
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            FrameError::TooLong => "the message does not fit in a frame",
            FrameError::NotCobs => "the bytes are not encoded with COBS",
            FrameError::WrongChecksum => {
                "the bytes have another checksum: they were changed on the way"
            }
            FrameError::NotAMessage => {
                "the frame is whole, but holds no message of this protocol version"
            }
        })
    }
}

impl core::error::Error for FrameError {}

/// Writes a message as a frame, delimiter included, to the beginning of `frame`, which needs room
/// for [`MAX_FRAME_BYTES`] at most. Returns the frame's length.
///
/// # Errors
/// [`FrameError::TooLong`]
pub fn encode(message: &impl Serialize, frame: &mut [u8]) -> Result<usize, FrameError> {
    encode_with(message, frame, |_| ())
}

/// The same, of a message that is `completed` where it lies, serialized: with a proof of its own
/// bytes.
///
/// # Errors
/// [`FrameError::TooLong`]
pub fn encode_with(
    message: &impl Serialize,
    frame: &mut [u8],
    complete: impl FnOnce(&mut [u8]),
) -> Result<usize, FrameError> {
    let (first, rest) = frame.split_first_mut().ok_or(FrameError::TooLong)?;
    let room = rest.len().min(MAX_MESSAGE_BYTES);
    let room = rest.get_mut(..room).ok_or(FrameError::TooLong)?;
    let message = postcard::to_slice(message, room).map_err(|_| FrameError::TooLong)?;
    complete(message);
    let crc = checksum(message).to_le_bytes();
    let len = message.len();
    let end = rest.get_mut(len..).ok_or(FrameError::TooLong)?;
    let [place @ .., end] = end.get_mut(..=CRC_BYTES).ok_or(FrameError::TooLong)? else {
        return Err(FrameError::TooLong);
    };
    place.copy_from_slice(&crc);
    *end = DELIMITER;
    const { assert!(MAX_MESSAGE_BYTES + CRC_BYTES < COBS_GROUP_BYTES) };
    let len = len + CRC_BYTES;
    let plain = rest.get_mut(..len).ok_or(FrameError::TooLong)?;
    *first = stuff(plain);
    Ok(len + 2)
}

/// Encodes fewer than [`COBS_GROUP_BYTES`] bytes with COBS where they lie: each 0 gives way to the
/// distance to the next. Returns the byte before them, which tells the first distance.
pub(crate) fn stuff(plain: &mut [u8]) -> u8 {
    let mut distance = 1;
    for byte in plain.iter_mut().rev() {
        distance = if *byte == DELIMITER {
            *byte = distance;
            1
        } else {
            distance + 1
        };
    }
    distance
}

/// Takes COBS off fewer than [`COBS_GROUP_BYTES`] bytes where they lie: the inverse of [`stuff`],
/// with the byte before them. Each distance gives way to a 0, so that no byte is moved. None where
/// the bytes are not what COBS makes of something.
pub(crate) fn unstuff(stuffed: &mut [u8]) -> Option<&mut [u8]> {
    let length = stuffed.len();
    if length > COBS_GROUP_BYTES {
        return None;
    }
    let mut at = 0;
    while let Some(place) = stuffed.get_mut(at) {
        let distance = core::mem::replace(place, DELIMITER);
        if distance == DELIMITER {
            return None;
        }
        at += usize::from(distance);
    }
    // The last distance leads to the delimiter.
    if at == length {
        stuffed.get_mut(1..)
    } else {
        None
    }
}

/// Reads the message of a frame, whose delimiter may be left out. The bytes are decoded in place,
/// and the message borrows them.
///
/// # Errors
/// See [`FrameError`].
pub fn decode<'a, M: Deserialize<'a>>(frame: &'a mut [u8]) -> Result<M, FrameError> {
    parse(unpack(frame)?)
}

/// The bytes of the message of a frame, decoded in place. The frame's delimiter may be left out.
///
/// # Errors
/// [`FrameError::NotCobs`], [`FrameError::WrongChecksum`]
pub fn unpack(frame: &mut [u8]) -> Result<&[u8], FrameError> {
    let frame = match frame {
        [frame @ .., DELIMITER] => frame,
        frame => frame,
    };
    let len = cobs::decode_in_place(frame).map_err(|_| FrameError::NotCobs)?;
    let frame: &[u8] = frame;
    let (message, crc) = frame
        .get(..len)
        .and_then(<[u8]>::split_last_chunk::<CRC_BYTES>)
        .filter(|(message, _)| !message.is_empty())
        .ok_or(FrameError::WrongChecksum)?;
    if checksum(message) != u32::from_le_bytes(*crc) && !mutant!(FrameUnchecked) {
        return Err(FrameError::WrongChecksum);
    }
    Ok(message)
}

/// Reads a message of exactly these bytes.
///
/// # Errors
/// [`FrameError::NotAMessage`]
pub fn parse<'a, M: Deserialize<'a>>(message: &'a [u8]) -> Result<M, FrameError> {
    match postcard::take_from_bytes(message) {
        Ok((message, [])) => Ok(message),
        _ => Err(FrameError::NotAMessage),
    }
}

/// Cuts a stream of bytes into frames.
pub struct FrameReader {
    bytes: [u8; MAX_FRAME_BYTES],
    len: u8,
    /// The frame is longer than one can be: it is thrown away.
    overflow: bool,
}

impl Default for FrameReader {
    fn default() -> Self {
        Self::new()
    }
}

impl FrameReader {
    /// A reader at the beginning of a frame.
    pub const fn new() -> Self {
        FrameReader {
            bytes: [0; MAX_FRAME_BYTES],
            len: 0,
            overflow: false,
        }
    }

    /// Takes one byte. Returns a frame, to be [decoded](decode), if this byte ended one. Empty
    /// frames and such that are longer than frames can be are passed over.
    pub fn push(&mut self, byte: u8) -> Option<&mut [u8]> {
        if byte == DELIMITER {
            if mutant!(OutOfStep) && self.overflow {
                return None;
            }
            let len = usize::from(core::mem::take(&mut self.len));
            if core::mem::take(&mut self.overflow) || len == 0 {
                return None;
            }
            return self.bytes.get_mut(..len);
        }
        // Both lengths are bytes, of which a robot has few.
        const { assert!(MAX_FRAME_BYTES < u8::MAX as usize) };
        match self.bytes.get_mut(usize::from(self.len)) {
            Some(place) => {
                *place = byte;
                self.len += 1;
            }
            None => self.overflow = !mutant!(OverlongTaken),
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{MAX_CHUNK, Request, ToDevice};
    use std::vec::Vec;

    fn frame_of(request: Request<'_>) -> Vec<u8> {
        let mut frame = [0; MAX_FRAME_BYTES];
        let len = encode(&ToDevice { seq: 7, request }, &mut frame).unwrap();
        frame[..len].to_vec()
    }

    #[test]
    fn the_checksum_is_the_usual_one() {
        assert_eq!(checksum(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn cobs_is_taken_off_as_it_was_put_on() {
        let long = [7; COBS_GROUP_BYTES - 1];
        let texts: [&[u8]; 6] = [b"", b"\0", b"\0\0", b"one\0two\0", b"\0one", &long];
        for plain in texts {
            let mut bytes = [&[0], plain].concat();
            bytes[0] = stuff(&mut bytes[1..]);
            assert!(!bytes.contains(&DELIMITER));
            let mut other = bytes.clone();
            let length = cobs::decode_in_place(&mut other).unwrap();
            assert_eq!(&other[..length], plain);
            assert_eq!(unstuff(&mut bytes), Some(&mut plain.to_vec()[..]));
        }
    }

    #[test]
    fn what_cobs_never_makes_is_refused() {
        // A distance beyond the end, one of 0, none at all, and more than a group.
        let cases: [&[u8]; 5] = [&[3, 1], &[1, 0, 1], &[0], &[], &[1; COBS_GROUP_BYTES + 1]];
        for bytes in cases {
            assert_eq!(unstuff(&mut bytes.to_vec()), None, "{bytes:?}");
        }
    }

    #[test]
    fn what_is_encoded_decodes_to_the_same() {
        let chunk: Vec<u8> = (0..MAX_CHUNK).map(|i| (i % 3) as u8).collect();
        let requests = [
            Request::Hello,
            Request::Begin { len: 4096, crc: 0 },
            Request::Chunk {
                offset: 128,
                data: &chunk,
            },
            Request::Chunk {
                offset: 0,
                data: &[],
            },
            Request::Subscribe {
                trace: true,
                log: false,
                record: false,
            },
        ];
        for request in requests {
            let mut frame = frame_of(request);
            assert_eq!(frame.iter().filter(|byte| **byte == DELIMITER).count(), 1);
            assert_eq!(decode(&mut frame), Ok(ToDevice { seq: 7, request }));
        }
    }

    #[test]
    fn a_frame_is_what_cobs_makes_of_message_and_checksum() {
        for data in [
            &[][..],
            &[0; 20],
            &[0xff; MAX_CHUNK],
            b"\0zeros\0\0within\0",
        ] {
            let request = Request::Chunk { offset: 0, data };
            let mut message = [0; MAX_MESSAGE_BYTES];
            let len = postcard::to_slice(&ToDevice { seq: 7, request }, &mut message)
                .unwrap()
                .len();
            let mut plain = message[..len].to_vec();
            plain.extend(checksum(&plain).to_le_bytes());
            let mut expected = [0; MAX_FRAME_BYTES];
            let encoded = cobs::encode(&plain, &mut expected);
            expected[encoded] = DELIMITER;
            assert_eq!(frame_of(request), expected[..=encoded], "{data:?}");
        }
    }

    #[test]
    fn a_frame_needs_its_room_to_the_byte() {
        let message = ToDevice {
            seq: 7,
            request: Request::Status,
        };
        let needed = frame_of(Request::Status).len();
        let mut frame = [0; MAX_FRAME_BYTES];
        assert_eq!(encode(&message, &mut frame[..needed]), Ok(needed));
        for room in 0..needed {
            assert_eq!(
                encode(&message, &mut frame[..room]),
                Err(FrameError::TooLong),
                "{room} bytes"
            );
        }
    }

    #[test]
    fn every_changed_byte_and_every_prefix_is_refused() {
        let frame = frame_of(Request::Chunk {
            offset: 3,
            data: b"some bytes \0 and more",
        });
        for at in 0..frame.len() - 1 {
            for flip in 1..=255u8 {
                let mut changed = frame.clone();
                changed[at] ^= flip;
                assert!(
                    decode::<ToDevice<'_>>(&mut changed).is_err(),
                    "byte {at} ^ {flip}"
                );
            }
            assert!(
                decode::<ToDevice<'_>>(&mut frame[..at].to_vec()).is_err(),
                "{at} bytes"
            );
        }
    }

    #[test]
    fn bytes_after_a_message_are_refused() {
        #[derive(serde::Serialize)]
        struct Longer<'a>(ToDevice<'a>, u8);
        let mut frame = [0; MAX_FRAME_BYTES];
        let len = encode(
            &Longer(
                ToDevice {
                    seq: 1,
                    request: Request::Hello,
                },
                9,
            ),
            &mut frame,
        )
        .unwrap();
        assert_eq!(
            decode::<ToDevice<'_>>(&mut frame[..len]),
            Err(FrameError::NotAMessage)
        );
    }

    #[test]
    fn a_reader_finds_frames_after_garbage() {
        let frame = frame_of(Request::Status);
        let cases: [(&str, Vec<u8>); 5] = [
            ("nothing", Vec::new()),
            ("empty frames", [0; 5].to_vec()),
            ("half a frame", [&frame[1..], &[0]].concat()),
            ("noise that ends", [&[7; 20][..], &[0]].concat()),
            (
                "too much noise",
                [&[7; MAX_FRAME_BYTES + 1][..], &[0]].concat(),
            ),
        ];
        for (what, garbage) in cases {
            let mut reader = FrameReader::new();
            let mut messages = 0;
            for byte in garbage.iter().chain(&frame) {
                if let Some(frame) = reader.push(*byte) {
                    match decode::<ToDevice<'_>>(frame) {
                        Ok(message) => {
                            assert_eq!(message.request, Request::Status);
                            messages += 1;
                        }
                        Err(error) => assert_ne!(error, FrameError::TooLong),
                    }
                }
            }
            assert_eq!(messages, 1, "{what}");
        }
    }
}

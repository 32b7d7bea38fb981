//! Frames of a link of a robot whose body is simulated, carried by its exchange with the plant.
//!
//! A UART's bytes come by the clock on the wall. Where several processors run in one time, a board
//! swaps whole frames with the plant instead, as bytes of the wire, while its virtual time stands
//! still. What goes out goes by one way: a message at the very start of the frame, from the
//! interrupt that would start the UART, and an answer of one byte without a meaning. What comes in
//! goes by another: a message with a time, and an answer with the first frame that had arrived by
//! then, or without bytes. So neither mixes with the other, nor with the pins' exchange.
//!
//! Numbers are little endian, times are on the robot's clock in microseconds:
//!
//! | byte | what |
//! |---|---|
//! | 0 … 7 | a frame that goes out: its start. One that comes in: when its last bit was there |
//! | 8 … 11 | a frame that goes out: by how much it was started too late, in nanoseconds |
//! | 12 | how many bytes; one more than fit stands for more than a frame can have |
//! | 13 … | the bytes. Of a frame that goes out, with its delimiter; else without it |

use esm_link::frames::wire::MAX_WIRE_BYTES;

/// Size of a message in bytes.
pub const MESSAGE_BYTES: usize = HEAD_BYTES + MAX_WIRE_BYTES;
/// Size of the message that asks for what has come: a time.
pub const ASK_BYTES: usize = 8;

const HEAD_BYTES: usize = 13;
const LATE: usize = 8;
const LENGTH: usize = 12;
const TOO_LONG: u8 = MAX_WIRE_BYTES as u8 + 1;

/// A message, as its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CarriedFrame([u8; MESSAGE_BYTES]);

impl CarriedFrame {
    /// What says that no frame has come.
    pub const NONE: CarriedFrame = CarriedFrame([0; MESSAGE_BYTES]);

    /// A message with these bytes of the wire. More than a frame can have are left out.
    #[must_use]
    pub fn new(at_us: u64, late_ns: u32, bytes: &[u8]) -> Self {
        let mut message = Self::NONE;
        message.0[..LATE].copy_from_slice(&at_us.to_le_bytes());
        message.0[LATE..LENGTH].copy_from_slice(&late_ns.to_le_bytes());
        message.0[LENGTH] = TOO_LONG;
        if let Some(place) = message.0.get_mut(HEAD_BYTES..HEAD_BYTES + bytes.len()) {
            place.copy_from_slice(bytes);
            message.0[LENGTH] = bytes.len() as u8;
        }
        message
    }

    /// The message in `bytes`. Any bytes are a message.
    #[must_use]
    pub fn from_bytes(bytes: [u8; MESSAGE_BYTES]) -> Self {
        CarriedFrame(bytes)
    }

    /// The message as bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; MESSAGE_BYTES] {
        &self.0
    }

    /// When the frame is to start, or had arrived.
    #[must_use]
    pub fn at_us(&self) -> u64 {
        u64::from_le_bytes(core::array::from_fn(|byte| self.0[byte]))
    }

    /// By how much it was started too late, in nanoseconds.
    #[must_use]
    pub fn late_ns(&self) -> u32 {
        u32::from_le_bytes(core::array::from_fn(|byte| self.0[LATE + byte]))
    }

    /// Whether there is no frame.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.0[LENGTH] == 0
    }

    /// The bytes of the wire, to be decoded where they lie. None where there are more than a frame
    /// can have.
    pub fn carried(&mut self) -> Option<&mut [u8]> {
        let end = HEAD_BYTES + usize::from(self.0[LENGTH]);
        self.0.get_mut(HEAD_BYTES..end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_has_what_was_put_into_it() {
        let bytes: [u8; MAX_WIRE_BYTES] = core::array::from_fn(|byte| byte as u8);
        for count in [1, 26, MAX_WIRE_BYTES] {
            let message = CarriedFrame::new(u64::MAX - 7, 3_200, &bytes[..count]);
            let mut message = CarriedFrame::from_bytes(*message.as_bytes());
            assert_eq!((message.at_us(), message.late_ns()), (u64::MAX - 7, 3_200));
            assert!(!message.is_none());
            let mut expected = bytes;
            assert_eq!(message.carried(), Some(&mut expected[..count]));
        }
    }

    #[test]
    fn what_is_too_long_is_told_and_has_no_bytes() {
        for count in [MAX_WIRE_BYTES + 1, 1_000] {
            let mut message = CarriedFrame::new(5, 0, &[7; 1_000][..count]);
            assert!(!message.is_none() && message.carried().is_none());
        }
        assert!(CarriedFrame::from_bytes([0; MESSAGE_BYTES]).is_none());
        assert_eq!(
            CarriedFrame::from_bytes([255; MESSAGE_BYTES]).carried(),
            None
        );
    }
}

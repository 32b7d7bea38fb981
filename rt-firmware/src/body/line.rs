//! The link of a robot whose body is simulated, carried by its exchange with the plant.
//!
//! A UART's bytes come by the clock on the wall, so that no two runs in which something is asked of
//! the robot are the same. Where they are to be, the board swaps the link's bytes with the plant
//! instead, a message each way, each [`INTERVAL_US`] of its own time, with and without a mission:
//! [`PART_BYTES`] in each direction at most, which is what a line of 115,200 baud carries
//! meanwhile. Virtual time stands still until the answer is there.
//!
//! As those of the flash, the messages go by a way of their own beside the pins': they are swapped
//! below the slots, and one that a slot interrupts must not mix with that slot's exchange. Both
//! messages have the same shape:
//!
//! | byte | what |
//! |---|---|
//! | 0 | how many bytes of the link it carries, 0 to [`PART_BYTES`] |
//! | 1 | from the board: how many it has room for. From the plant: 0 |
//! | 2 … | the bytes; what is behind them is of no meaning |

/// How often the messages are swapped, in microseconds.
pub const INTERVAL_US: u32 = 3_125;

/// Bytes of the link in one message at most: at ten bits a byte, 115,200 baud are 36 in
/// [`INTERVAL_US`], and nothing is left over.
pub const PART_BYTES: usize = 36;

/// Size of a message in bytes.
pub const MESSAGE_BYTES: usize = HEAD_BYTES + PART_BYTES;

const HEAD_BYTES: usize = 2;

/// A message, as its bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinePart([u8; MESSAGE_BYTES]);

impl LinePart {
    /// A message without bytes of the link, from one who has room for so many.
    pub fn new(room: usize) -> Self {
        let mut message = [0; MESSAGE_BYTES];
        message[1] = room.min(PART_BYTES) as u8;
        LinePart(message)
    }

    /// The message in `bytes`. Any bytes are a message; more than a message has room for are none.
    pub fn from_bytes(bytes: [u8; MESSAGE_BYTES]) -> Self {
        LinePart(bytes)
    }

    /// The message as bytes.
    pub fn as_bytes(&self) -> &[u8; MESSAGE_BYTES] {
        &self.0
    }

    /// How many bytes the sender has room for.
    pub fn room(&self) -> usize {
        usize::from(self.0[1]).min(PART_BYTES)
    }

    /// Whether it takes another byte.
    pub fn is_full(&self) -> bool {
        usize::from(self.0[0]) >= PART_BYTES
    }

    /// Adds a byte of the link. Answers whether there was room.
    pub fn push(&mut self, byte: u8) -> bool {
        let end = HEAD_BYTES + usize::from(self.0[0]);
        match self.0.get_mut(end) {
            Some(place) => {
                *place = byte;
                self.0[0] += 1;
                true
            }
            None => false,
        }
    }

    /// The bytes of the link.
    pub fn carried(&self) -> &[u8] {
        let end = HEAD_BYTES + usize::from(self.0[0]);
        self.0.get(HEAD_BYTES..end).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_what_a_line_carries_in_its_interval() {
        const BITS_PER_BYTE: u64 = 10;
        let bits = PART_BYTES as u64 * BITS_PER_BYTE * 1_000_000;
        assert_eq!(bits, 115_200 * u64::from(INTERVAL_US));
    }

    #[test]
    fn bytes_come_out_as_they_went_in_up_to_the_last_place() {
        let mut part = LinePart::new(1_000);
        assert_eq!(part.room(), PART_BYTES);
        assert!(part.carried().is_empty());
        for byte in 0..PART_BYTES as u8 {
            assert!(!part.is_full() && part.push(byte ^ 0xA5));
        }
        assert!(part.is_full() && !part.push(0));
        let expected: [u8; PART_BYTES] = core::array::from_fn(|i| i as u8 ^ 0xA5);
        assert_eq!(LinePart::from_bytes(*part.as_bytes()).carried(), expected);
        assert_eq!(part.as_bytes()[..2], [36, 36]);
    }

    #[test]
    fn a_count_that_no_message_has_room_for_stands_for_no_bytes() {
        let mut part = LinePart::from_bytes([0xFF; MESSAGE_BYTES]);
        assert!(part.carried().is_empty() && part.is_full() && !part.push(1));
        assert_eq!(part.room(), PART_BYTES);
    }
}

//! What a host asks of a board that measures itself
//! ([`Request::Selftest`](crate::message::Request::Selftest)), and what that tells.
//!
//! Bytes of their own and not messages: so a firmware that has nothing of this has no more than one
//! request to refuse.

use crate::message::LinkError;

/// The longest that a line may have another rate, in milliseconds. A line of which nothing is heard
/// for longer looks dead to whoever wants to stop the robot.
pub const MAX_RATE_MS: u32 = 3_000;

/// Bytes of the longest [`Ask`].
pub const MAX_ASK_BYTES: usize = 9;
/// Bytes of [`Measures`].
pub const MEASURES_BYTES: usize = 8;

/// Stands for a time that no board can measure, since it is longer than any that it could.
const NOT_MEASURED: u32 = u32::MAX;

/// What a host asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// 0: what has the board measured of itself?
    Measures,
    /// 1, the rate, the time, four bytes each, little endian: once this is answered the line has
    /// this rate for so long, and then its own again.
    LineRate {
        /// In baud.
        baud: u32,
        /// In milliseconds, [`MAX_RATE_MS`] at most.
        ms: u32,
    },
}

impl Ask {
    /// Reads what is asked for.
    ///
    /// # Errors
    /// [`LinkError::Malformed`]
    pub fn of(bytes: &[u8]) -> Result<Self, LinkError> {
        match *bytes {
            [0] => Ok(Ask::Measures),
            [1, a, b, c, d, e, f, g, h] => {
                let baud = u32::from_le_bytes([a, b, c, d]);
                let ms = u32::from_le_bytes([e, f, g, h]);
                if baud == 0 || ms > MAX_RATE_MS {
                    return Err(LinkError::Malformed);
                }
                Ok(Ask::LineRate { baud, ms })
            }
            _ => Err(LinkError::Malformed),
        }
    }

    /// As bytes: so many of those that are answered.
    pub fn bytes(self) -> ([u8; MAX_ASK_BYTES], usize) {
        match self {
            Ask::Measures => ([0; MAX_ASK_BYTES], 1),
            Ask::LineRate { baud, ms } => {
                let ([a, b, c, d], [e, f, g, h]) = (baud.to_le_bytes(), ms.to_le_bytes());
                ([1, a, b, c, d, e, f, g, h], MAX_ASK_BYTES)
            }
        }
    }
}

/// What a board has measured of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Measures {
    /// The longest critical section since the robot started, in nanoseconds, where the board
    /// measures it. Slots interrupt one: those in which that happened do not count.
    pub critical_section_ns: Option<u32>,
    /// The rate of its line, in baud, where it can be another.
    pub baud: Option<u32>,
}

impl Measures {
    /// As bytes: two numbers, little endian.
    pub fn bytes(&self) -> [u8; MEASURES_BYTES] {
        let section_ns = self.critical_section_ns.unwrap_or(NOT_MEASURED);
        let ([a, b, c, d], [e, f, g, h]) = (
            section_ns.to_le_bytes(),
            self.baud.unwrap_or(0).to_le_bytes(),
        );
        [a, b, c, d, e, f, g, h]
    }

    /// From bytes; none where they are none.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let (words, []) = bytes.as_chunks() else {
            return None;
        };
        let [section_ns, baud] = *words else {
            return None;
        };
        let [section_ns, baud] = [section_ns, baud].map(u32::from_le_bytes);
        Some(Measures {
            critical_section_ns: Some(section_ns).filter(|ns| *ns != NOT_MEASURED),
            baud: Some(baud).filter(|baud| *baud != 0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_asked_for_is_read_as_it_was_written() {
        let (baud, ms) = (921_600, MAX_RATE_MS);
        for ask in [Ask::Measures, Ask::LineRate { baud, ms }] {
            let (bytes, length) = ask.bytes();
            assert_eq!(Ask::of(&bytes[..length]), Ok(ask));
            assert_eq!(Ask::of(&bytes[..length - 1]), Err(LinkError::Malformed));
        }
    }

    #[test]
    fn no_rate_and_a_time_without_end_are_refused() {
        for ask in [
            Ask::LineRate { baud: 0, ms: 1 },
            Ask::LineRate {
                baud: 9_600,
                ms: MAX_RATE_MS + 1,
            },
        ] {
            let (bytes, length) = ask.bytes();
            assert_eq!(Ask::of(&bytes[..length]), Err(LinkError::Malformed));
        }
    }

    #[test]
    fn measures_are_read_as_they_were_written() {
        for measures in [
            Measures::default(),
            Measures {
                critical_section_ns: Some(0),
                baud: Some(115_200),
            },
        ] {
            assert_eq!(Measures::of(&measures.bytes()), Some(measures));
        }
        assert_eq!(Measures::of(&[0; 7]), None);
    }
}

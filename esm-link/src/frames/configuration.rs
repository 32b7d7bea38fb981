//! What both ends of a frame must agree on, in eight bytes.

use esm_core::format::crc32;
use esm_core::signature::{fnv1a, fnv1a_continued};

/// What a payload is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content<'a> {
    /// The value of a data port, whose type has this name.
    Value(&'a str),
    /// So many flags, the first in the lowest bit of the first byte.
    Flags(u16),
}

/// The configuration of a frame: the [`fnv1a`] of `id type payload period_us`, numbers in decimal,
/// with single blanks between. A frame of flags has their number for a type, which no name is equal
/// to.
///
/// ```
/// use esm_link::frames::configuration::{Configuration, Content};
///
/// let pose = Configuration::of(7, Content::Value("Pose"), 12, 100_000);
/// assert_eq!(pose.hash(), esm_core::signature::fnv1a(b"7 Pose 12 100000"));
/// let alarm = Configuration::of(8, Content::Flags(2), 1, 50_000);
/// assert_eq!(alarm.hash(), esm_core::signature::fnv1a(b"8 2 1 50000"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration {
    hash: u64,
    /// CRC-32 of the eight bytes, so that no frame works it out.
    crc: u32,
}

impl Configuration {
    /// The configuration of a frame that is declared like this.
    #[must_use]
    pub fn of(identifier: u16, content: Content<'_>, payload_bytes: u8, period_us: u32) -> Self {
        let mut hash = decimal(fnv1a(&[]), identifier.into());
        hash = fnv1a_continued(hash, b" ");
        hash = match content {
            Content::Value(type_name) => fnv1a_continued(hash, type_name.as_bytes()),
            Content::Flags(count) => decimal(hash, count.into()),
        };
        hash = decimal(fnv1a_continued(hash, b" "), payload_bytes.into());
        Self::from_hash(decimal(fnv1a_continued(hash, b" "), period_us))
    }

    /// The configuration with this hash: from a blob, for which a compiler has worked it out.
    #[must_use]
    pub fn from_hash(hash: u64) -> Self {
        Configuration {
            hash,
            crc: crc32(&hash.to_le_bytes()),
        }
    }

    /// All eight bytes.
    #[must_use]
    pub fn hash(self) -> u64 {
        self.hash
    }

    /// What each frame carries of it.
    #[must_use]
    pub fn low_byte(self) -> u8 {
        self.hash as u8
    }

    /// The checksum of a frame begins with the eight bytes: this is the one of them alone.
    pub(crate) fn checksum_before(self) -> u32 {
        self.crc
    }
}

/// Continues a hash with a number's digits.
fn decimal(mut hash: u64, number: u32) -> u64 {
    let mut place = 1_000_000_000;
    while place > 0 {
        if number >= place || place == 1 {
            let digit = (number / place % 10) as u8;
            hash = fnv1a_continued(hash, &[b'0' + digit]);
        }
        place /= 10;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::format;

    #[test]
    fn flags_and_a_type_that_is_called_like_their_number_cannot_be_mixed_up() {
        // No name begins with a digit, so texts are equal only where all parts are.
        let flags = Configuration::of(1, Content::Flags(3), 1, 1000);
        assert_eq!(flags, Configuration::of(1, Content::Value("3"), 1, 1000));
        assert_ne!(flags, Configuration::of(1, Content::Value("T3"), 1, 1000));
    }

    proptest! {
        #[test]
        fn a_configuration_is_the_hash_of_its_text(
            identifier in 0..2048_u16,
            type_name in "[A-Za-z][A-Za-z0-9_]{0,20}",
            payload_bytes in 1..=240_u8,
            period_us: u32,
        ) {
            let content = Content::Value(&type_name);
            let of = Configuration::of(identifier, content, payload_bytes, period_us);
            let text = format!("{identifier} {type_name} {payload_bytes} {period_us}");
            prop_assert_eq!(of.hash(), fnv1a(text.as_bytes()));
            prop_assert_eq!(of, Configuration::from_hash(of.hash()));
        }
    }
}

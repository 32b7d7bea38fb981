//! Why a blob is refused.

use core::error::Error;
use core::fmt;
use core::num::NonZeroU32;

use serde::{Deserialize, Serialize};

use crate::format::{MAX_SLOTS, Section};

/// Why a blob is refused. It must be built again, or sent again; none of these can be put right on
/// the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// It does not begin as a blob of this format's version does.
    Magic,
    /// It ends too early, or lengths in it are wrong.
    Cut,
    /// There are bytes between its last section and the CRC.
    TrailingBytes,
    /// Its bytes changed on the way.
    Checksum {
        /// What the blob says.
        stored: u32,
        /// What its bytes give.
        computed: u32,
    },
    /// The length of a section is no multiple of its record's, or more than indices can reach.
    SectionLength(Section),
    /// A record is wrong.
    Record {
        /// Its table.
        section: Section,
        /// Its position in the table, or the table's length where records are missing.
        index: u16,
        /// What is wrong.
        cause: Cause,
    },
}

/// What is wrong with a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum Cause {
    /// An index points outside of what it may point to.
    Index = 1,
    /// A part does not begin where the one before it ended, or parts are missing or left over.
    Order,
    /// A number is outside its range.
    Range,
    /// A kind or an operation is unknown, or not allowed there.
    Kind,
    /// A jump does not go ahead, or goes too far.
    Direction,
    /// A record of the instance tree is not what its template makes of it.
    Template,
    /// A text is malformed, or its hash or its counts differ; reported by
    /// [`texts::check`](crate::texts::check) alone.
    Text,
    /// A port's type is not that of its net; reported by [`texts::check`](crate::texts::check)
    /// alone.
    Type,
    /// Two slots overlap, or have the same number.
    Overlap,
}

impl Cause {
    /// Its number, which is not 0.
    pub(crate) fn number(self) -> NonZeroU32 {
        NonZeroU32::new(self as u32).unwrap_or(NonZeroU32::MIN)
    }

    /// The cause with a number. Others than those of causes do not occur.
    // Spelt out it is next to no code, where a table would have to be looked up.
    pub(crate) fn with_number(number: u8) -> Self {
        match number {
            1 => Self::Index,
            2 => Self::Order,
            3 => Self::Range,
            4 => Self::Kind,
            5 => Self::Direction,
            6 => Self::Template,
            7 => Self::Text,
            8 => Self::Type,
            _ => Self::Overlap,
        }
    }
}

impl fmt::Display for Refusal {
    /// What is wrong, where, and what to do about it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Magic => f.write_str("it does not begin as a blob of this version does"),
            Self::Cut => f.write_str("it ends too early"),
            Self::TrailingBytes => f.write_str("there are bytes behind its end"),
            Self::Checksum { stored, computed } => write!(
                f,
                "its bytes changed on the way: their checksum is {computed:08x}, \
                 it says {stored:08x}"
            ),
            Self::SectionLength(Section::Slots) => write!(
                f,
                "the length of its section `Slots` is no whole number of records, \
                 or it has more than {MAX_SLOTS} slots"
            ),
            Self::SectionLength(section) => write!(
                f,
                "the length of its section `{section:?}` is no whole number of records, \
                 or too large"
            ),
            Self::Record {
                section,
                index,
                cause,
            } => write!(
                f,
                "record {index} of its section `{section:?}` is wrong: {cause}"
            ),
        }?;
        f.write_str("; build it again with `esm build`")
    }
}

impl Error for Refusal {}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Index => "an index points outside of its table",
            Self::Order => "a part is missing, left over, or not where it belongs",
            Self::Range => "a number is out of its range",
            Self::Kind => "its kind is unknown, or not allowed there",
            Self::Direction => "a jump does not go ahead, or goes too far",
            Self::Template => "it is not what its container makes of it",
            Self::Text => "a text is malformed, or is not what its hash says",
            Self::Type => "a port's type is not that of its net",
            Self::Overlap => "two slots overlap, or have the same number",
        })
    }
}

impl Error for Cause {}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn refusals_say_what_and_where_and_what_to_do() {
        let cases = [
            (Refusal::Cut, "it ends too early; build"),
            (
                Refusal::Checksum {
                    stored: 1,
                    computed: 0xABCD,
                },
                "checksum is 0000abcd, it says 00000001; build",
            ),
            (
                Refusal::SectionLength(Section::Slots),
                "or it has more than 4096 slots; build",
            ),
            (
                Refusal::Record {
                    section: Section::Transitions,
                    index: 7,
                    cause: Cause::Index,
                },
                "record 7 of its section `Transitions` is wrong: \
                 an index points outside of its table; build",
            ),
        ];
        for (refusal, words) in cases {
            let said = refusal.to_string();
            assert!(said.contains(words), "{said}");
        }
    }
}

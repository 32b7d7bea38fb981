//! The verifier's refusals in words.

use std::fmt;

use esm_core::format::{MAX_SLOTS, Section};
use esm_core::{Cause, Refusal};

/// A refusal as a person reads it: what is wrong with the blob, where, and what to do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Explained(pub Refusal);

impl fmt::Display for Explained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Refusal::Magic => f.write_str("it does not begin as a blob of this version does"),
            Refusal::Cut => f.write_str("it ends too early"),
            Refusal::TrailingBytes => f.write_str("there are bytes behind its end"),
            Refusal::Checksum { stored, computed } => {
                write!(
                    f,
                    "its bytes changed on the way: their checksum is {computed:08x}, it says {stored:08x}"
                )
            }
            Refusal::SectionLength(Section::Slots) => {
                write!(
                    f,
                    "the length of its section `Slots` is no whole number of records, or it has more than {MAX_SLOTS} slots"
                )
            }
            Refusal::SectionLength(section) => {
                write!(
                    f,
                    "the length of its section `{section:?}` is no whole number of records, or too large"
                )
            }
            Refusal::Record {
                section,
                index,
                cause,
            } => {
                write!(
                    f,
                    "record {index} of its section `{section:?}` is wrong: {}",
                    cause_text(cause)
                )
            }
        }?;
        f.write_str("; build it again with `esm build`")
    }
}

fn cause_text(cause: Cause) -> &'static str {
    match cause {
        Cause::Index => "an index points outside of its table",
        Cause::Order => "a part is missing, left over, or not where it belongs",
        Cause::Range => "a number is out of its range",
        Cause::Kind => "its kind is unknown, or not allowed there",
        Cause::Direction => "a jump does not go ahead, or goes too far",
        Cause::Template => "it is not what its container makes of it",
        Cause::Text => "a text is malformed, or is not what its hash says",
        Cause::Type => "a port's type is not that of its net",
        Cause::Overlap => "two slots overlap, or have the same number",
    }
}

#[cfg(test)]
mod tests {
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
                "record 7 of its section `Transitions` is wrong: an index points outside of its table; build",
            ),
        ];
        for (refusal, words) in cases {
            let said = Explained(refusal).to_string();
            assert!(said.contains(words), "{said}");
        }
    }
}

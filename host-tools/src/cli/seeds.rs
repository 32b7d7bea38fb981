//! Seeds of many runs.

use std::ops::RangeInclusive;
use std::str::FromStr;

use thiserror::Error;

/// The most seeds of one command: a day of runs.
const SEEDS_LIMIT: u64 = 100_000;

/// Seeds in a row, as a person writes them: `1..=100`, or one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seeds(pub RangeInclusive<u64>);

/// Why a text is no [`Seeds`].
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SeedsError {
    /// It has another form.
    #[error("write the first and the last seed, as in `1..=100`, or one")]
    Form,
    /// The last one comes before the first.
    #[error("there is no seed from {first} to {last}: write the smaller one first")]
    None {
        /// What stands first.
        first: u64,
        /// What stands last.
        last: u64,
    },
    /// More than there is time for.
    #[error("more than {SEEDS_LIMIT} seeds; write fewer")]
    TooMany,
}

impl FromStr for Seeds {
    type Err = SeedsError;

    fn from_str(text: &str) -> Result<Self, SeedsError> {
        let number = |text: &str| text.trim().parse().map_err(|_| SeedsError::Form);
        let (first, last): (u64, u64) = match text.split_once("..=") {
            Some((first, last)) => (number(first)?, number(last)?),
            None => (number(text)?, number(text)?),
        };
        match last.checked_sub(first) {
            None => Err(SeedsError::None { first, last }),
            Some(more) if more >= SEEDS_LIMIT => Err(SeedsError::TooMany),
            Some(_) => Ok(Seeds(first..=last)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_a_range_or_one() {
        for (text, expected) in [
            ("1..=100", Ok(Seeds(1..=100))),
            (" 3 ..= 3 ", Ok(Seeds(3..=3))),
            ("7", Ok(Seeds(7..=7))),
            ("0..=99999", Ok(Seeds(0..=99_999))),
            ("0..=100000", Err(SeedsError::TooMany)),
            ("0..=18446744073709551615", Err(SeedsError::TooMany)),
            ("5..=4", Err(SeedsError::None { first: 5, last: 4 })),
            ("1..100", Err(SeedsError::Form)),
            ("-1..=2", Err(SeedsError::Form)),
            ("", Err(SeedsError::Form)),
        ] {
            assert_eq!(text.parse(), expected, "{text:?}");
        }
    }
}

//! Spans of robot time as people write them.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// A span of robot time, written as in `.esm` files: `200 ms`, `60s`, `1500 us`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Time {
    /// In microseconds.
    pub us: u64,
}

/// Why a text is no [`Time`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum TimeError {
    /// No digits at the start.
    #[error("a time starts with a whole number, as in `200 ms`")]
    NoNumber,
    /// A number without a unit.
    #[error("the unit is missing: write `us`, `ms` or `s` behind the number, as in `200 ms`")]
    NoUnit,
    /// Something else than a unit behind the number.
    #[error("the unit of a time is `us`, `ms` or `s`, as in `200 ms`")]
    UnknownUnit,
    /// More microseconds than 64 bits hold.
    #[error("that is more time than can be counted (the limit is 2^64 microseconds)")]
    TooLong,
}

/// Microseconds in one `unit` of the language, `None` for any other word.
pub fn unit_us(unit: &str) -> Option<u64> {
    match unit {
        "us" => Some(1),
        "ms" => Some(1_000),
        "s" => Some(1_000_000),
        _ => None,
    }
}

impl FromStr for Time {
    type Err = TimeError;

    fn from_str(text: &str) -> Result<Self, TimeError> {
        let text = text.trim();
        let digits_end = text
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(text.len());
        let (digits, unit) = text.split_at(digits_end);
        if digits.is_empty() {
            return Err(TimeError::NoNumber);
        }
        let unit = unit.trim_start();
        if unit.is_empty() {
            return Err(TimeError::NoUnit);
        }
        let unit_us = unit_us(unit).ok_or(TimeError::UnknownUnit)?;
        let number: u64 = digits.parse().map_err(|_| TimeError::TooLong)?;
        Ok(Time {
            us: number.checked_mul(unit_us).ok_or(TimeError::TooLong)?,
        })
    }
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.us {
            us if us % 1_000_000 == 0 => write!(f, "{} s", us / 1_000_000),
            us if us % 1_000 == 0 => write!(f, "{} ms", us / 1_000),
            us => write!(f, "{us} us"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_as_in_the_language() {
        let cases: [(&str, Result<u64, TimeError>); 14] = [
            ("1500 us", Ok(1_500)),
            ("200ms", Ok(200_000)),
            ("200 ms", Ok(200_000)),
            (" 60 \t s ", Ok(60_000_000)),
            ("0s", Ok(0)),
            ("18446744073709551615us", Ok(u64::MAX)),
            ("18446744073709551616us", Err(TimeError::TooLong)),
            ("18446744073709552 s", Err(TimeError::TooLong)),
            ("", Err(TimeError::NoNumber)),
            ("s", Err(TimeError::NoNumber)),
            ("-1 s", Err(TimeError::NoNumber)),
            ("60", Err(TimeError::NoUnit)),
            ("1.5 s", Err(TimeError::UnknownUnit)),
            ("1 min", Err(TimeError::UnknownUnit)),
        ];
        for (text, expected) in cases {
            assert_eq!(
                text.parse::<Time>().map(|time| time.us),
                expected,
                "{text:?}"
            );
        }
    }

    #[test]
    fn a_time_shown_reads_back_as_itself() {
        for us in [0, 1, 999, 1_000, 1_001, 1_500_000, 60_000_000, u64::MAX] {
            assert_eq!(Time { us }.to_string().parse(), Ok(Time { us }));
        }
    }
}

//! Values that several commands take on the command line.

pub use crate::scenario::time::{Time, TimeError};
pub use crate::serial::port::{Port, PortError};

/// The greatest measure of a robot that is taken, in whichever unit: far beyond all robots, and
/// small enough for sums and products of measures.
const MOST_MEASURE: f64 = 1e9;

/// A measure of a robot: a number above zero.
///
/// # Errors
/// What is wrong with it, in words.
pub fn measure(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 1.0 / MOST_MEASURE && number < MOST_MEASURE => Ok(number),
        Ok(number) if number <= 0.0 => Err("a measure is above zero".to_owned()),
        Ok(_) => Err("no robot has such a measure".to_owned()),
        Err(_) => Err("expected a number, such as 32.5".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measures_are_above_zero_and_those_of_a_robot() {
        for (text, expected) in [
            ("32.5", Ok(32.5)),
            ("1e3", Ok(1_000.0)),
            ("0", Err("a measure is above zero")),
            ("-2", Err("a measure is above zero")),
            ("inf", Err("no robot has such a measure")),
            ("NaN", Err("no robot has such a measure")),
            ("1e-30", Err("no robot has such a measure")),
            ("32,5", Err("expected a number, such as 32.5")),
            ("", Err("expected a number, such as 32.5")),
        ] {
            assert_eq!(measure(text), expected.map_err(str::to_owned), "{text}");
        }
    }
}

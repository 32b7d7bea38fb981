//! A position, or a correction of one, as a person writes it.

use std::str::FromStr;

use esm_link::position::{
    Correction, MAX_CORRECTION_M, MAX_CORRECTION_RAD, MAX_HEADING_RAD, MAX_POSITION_M,
};
use rt_firmware::tasks::Pose;
use thiserror::Error;

/// Why a text is neither.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PlaceError {
    /// It is not made of names with numbers.
    #[error("write names and numbers, as in 'x_m = 1, y_m = 0, heading_rad = 1.57'")]
    Form,
    /// No such name.
    #[error("there is no `{0}`: a position has x_m, y_m and heading_rad")]
    Name(String),
    /// A name stands there twice.
    #[error("`{0}` stands there twice")]
    Twice(&'static str),
    /// What is to be set is to be whole.
    #[error("`{0}` is missing: say all of x_m, y_m and heading_rad; --by corrects less")]
    Missing(&'static str),
    /// It is beyond what a robot takes.
    #[error(
        "a position is at most {MAX_POSITION_M} m along each axis, its heading at most {MAX_HEADING_RAD} rad"
    )]
    SetOutside,
    /// It is beyond what a robot takes.
    #[error(
        "a correction is at most {MAX_CORRECTION_M} m along each axis and {MAX_CORRECTION_RAD} rad: set the position instead"
    )]
    DifferenceOutside,
}

/// The names, in the order of a pose.
const NAMES: [&str; 3] = ["x_m", "y_m", "heading_rad"];

/// Reads a position (all of `x_m = 1, y_m = 0, heading_rad = 1.57`), or a correction, of which what
/// is left out is 0.
///
/// # Errors
/// [`PlaceError`]
pub fn place(text: &str, correction: Correction) -> Result<Pose, PlaceError> {
    let mut given = [None; NAMES.len()];
    for part in text.split(',') {
        let (name, value) = part.split_once('=').ok_or(PlaceError::Form)?;
        let name = name.trim();
        let known = NAMES
            .iter()
            .zip(&mut given)
            .find(|(known, _)| **known == name);
        let (known, place) = known.ok_or_else(|| PlaceError::Name(name.to_owned()))?;
        let value: f32 = value.trim().parse().map_err(|_| PlaceError::Form)?;
        if place.replace(value).is_some() {
            return Err(PlaceError::Twice(known));
        }
    }
    if correction == Correction::Set
        && let Some((name, _)) = NAMES.iter().zip(given).find(|(_, value)| value.is_none())
    {
        return Err(PlaceError::Missing(name));
    }
    let [x_m, y_m, heading_rad] = given.map(Option::unwrap_or_default);
    if correction.allows(x_m, y_m, heading_rad) {
        Ok(Pose {
            x_m,
            y_m,
            heading_rad,
        })
    } else {
        Err(match correction {
            Correction::Set => PlaceError::SetOutside,
            Correction::Difference => PlaceError::DifferenceOutside,
        })
    }
}

/// A position, to be set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position(pub Pose);

impl FromStr for Position {
    type Err = PlaceError;

    fn from_str(text: &str) -> Result<Self, PlaceError> {
        place(text, Correction::Set).map(Self)
    }
}

/// A correction of a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference(pub Pose);

impl FromStr for Difference {
    type Err = PlaceError;

    fn from_str(text: &str) -> Result<Self, PlaceError> {
        place(text, Correction::Difference).map(Self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_is_whole_and_a_correction_what_it_says() {
        let pose = |x_m, y_m, heading_rad| Pose {
            x_m,
            y_m,
            heading_rad,
        };
        for (text, correction, expected) in [
            (
                "x_m = 1, y_m=-2,heading_rad = 1.57",
                Correction::Set,
                Ok(pose(1.0, -2.0, 1.57)),
            ),
            (
                "heading_rad = 0.1",
                Correction::Difference,
                Ok(pose(0.0, 0.0, 0.1)),
            ),
            (
                "x_m = 1, y_m = 2",
                Correction::Set,
                Err(PlaceError::Missing("heading_rad")),
            ),
            (
                "x_m = 1001, y_m = 0, heading_rad = 0",
                Correction::Set,
                Err(PlaceError::SetOutside),
            ),
            (
                "x_m = NaN, y_m = 0, heading_rad = 0",
                Correction::Set,
                Err(PlaceError::SetOutside),
            ),
            (
                "x_m = 1.1",
                Correction::Difference,
                Err(PlaceError::DifferenceOutside),
            ),
            ("", Correction::Difference, Err(PlaceError::Form)),
            ("x_m 1", Correction::Difference, Err(PlaceError::Form)),
            ("x_m = a", Correction::Difference, Err(PlaceError::Form)),
            (
                "x = 1",
                Correction::Difference,
                Err(PlaceError::Name("x".into())),
            ),
            (
                "x_m = 0, x_m = 1",
                Correction::Difference,
                Err(PlaceError::Twice("x_m")),
            ),
        ] {
            assert_eq!(place(text, correction), expected, "{text}");
        }
    }
}

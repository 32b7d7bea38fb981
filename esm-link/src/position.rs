//! Where a robot is told that it is: what a position and a correction may be, on both ends.

/// How far from the origin a position may be, in metres along each axis: on more ground an `f32`
/// keeps less than a tenth of a millimetre.
pub const MAX_POSITION_M: f32 = 1_000.0;
/// The greatest heading of a position, in radians: half a turn, rounded up.
pub const MAX_HEADING_RAD: f32 = 3.15;
/// The largest correction along each axis, in metres. What is seen farther off than this is another
/// landmark: doors and corners of rooms are farther apart than twice as much.
pub const MAX_CORRECTION_M: f32 = 1.0;
/// The largest correction of the heading, in radians: less than an eighth of a turn, so that no
/// wall is taken for the one at a right angle to it.
pub const MAX_CORRECTION_RAD: f32 = 0.6;

/// What a robot is told of its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Correction {
    /// It is there.
    Set,
    /// It is so far from where it believes itself to be, seen from there.
    Difference,
}

impl Correction {
    /// Whether these are numbers within its bounds.
    pub fn allows(self, x_m: f32, y_m: f32, heading_rad: f32) -> bool {
        let (most_m, most_rad) = match self {
            Self::Set => (MAX_POSITION_M, MAX_HEADING_RAD),
            Self::Difference => (MAX_CORRECTION_M, MAX_CORRECTION_RAD),
        };
        // NaN is within nothing.
        let is_within = |value: f32, most: f32| (-most..=most).contains(&value);
        is_within(x_m, most_m) && is_within(y_m, most_m) && is_within(heading_rad, most_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_or_beyond_its_bounds_is_not_allowed() {
        for (correction, x_m, y_m, heading_rad, is_allowed) in [
            (Correction::Set, 1_000.0, -1_000.0, 3.15, true),
            (Correction::Set, 1_000.1, 0.0, 0.0, false),
            (Correction::Set, 0.0, -1_000.1, 0.0, false),
            (Correction::Set, 0.0, 0.0, 3.2, false),
            (Correction::Set, f32::NAN, 0.0, 0.0, false),
            (Correction::Set, 0.0, f32::INFINITY, 0.0, false),
            (Correction::Difference, -1.0, 1.0, 0.6, true),
            (Correction::Difference, 1.01, 0.0, 0.0, false),
            (Correction::Difference, 0.0, 1.01, 0.0, false),
            (Correction::Difference, 0.0, 0.0, -0.61, false),
            (Correction::Difference, 0.0, 0.0, f32::NAN, false),
        ] {
            assert_eq!(correction.allows(x_m, y_m, heading_rad), is_allowed);
        }
    }
}

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

/// Bytes of what a robot is told of its position.
pub const POSITION_BYTES: usize = 1 + 3 * VALUE_BYTES;
const VALUE_BYTES: usize = 4;

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

    /// The bytes of such a message: 1 for a difference, otherwise 0; then the bits of x (ahead) and
    /// y (to the left) in metres and of the heading in radians, little endian.
    pub fn to_bytes(self, values: [f32; 3]) -> [u8; POSITION_BYTES] {
        let mut bytes = [0; POSITION_BYTES];
        let (is_difference, rest) = bytes.split_at_mut(1);
        is_difference.fill(u8::from(self == Self::Difference));
        for (place, value) in rest.chunks_exact_mut(VALUE_BYTES).zip(values) {
            place.copy_from_slice(&value.to_le_bytes());
        }
        bytes
    }

    /// Reads them: what it is, and x, y and heading, which may be beyond
    /// [its bounds](Self::allows). None where they are none.
    pub fn of_bytes(bytes: &[u8]) -> Option<(Self, [f32; 3])> {
        let (&[is_difference], values) = bytes.split_first_chunk()?;
        let (&[x_m, y_m, heading_rad], []) = values.as_chunks::<VALUE_BYTES>() else {
            return None;
        };
        let correction = match is_difference {
            0 => Self::Set,
            1 => Self::Difference,
            _ => return None,
        };
        Some((correction, [x_m, y_m, heading_rad].map(f32::from_le_bytes)))
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

    #[test]
    fn bytes_read_back_and_others_are_none() {
        let values = [1.5, -0.25, 3.0];
        for correction in [Correction::Set, Correction::Difference] {
            let bytes = correction.to_bytes(values);
            assert_eq!(Correction::of_bytes(&bytes), Some((correction, values)));
            for short in 0..POSITION_BYTES {
                assert_eq!(Correction::of_bytes(&bytes[..short]), None);
            }
            let mut bad = bytes;
            bad[0] = 2;
            assert_eq!(Correction::of_bytes(&bad), None);
        }
        assert_eq!(Correction::of_bytes(&[0; POSITION_BYTES + 1]), None);
    }
}

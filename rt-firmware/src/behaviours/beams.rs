//! Where a wall is, by the sonars that look at it.

use core::f32::consts::FRAC_1_SQRT_2;

use crate::odometry::sine_and_cosine;
use crate::tasks::{Bearing, RIM_M};

/// Sine and cosine of half a beam's width, 12°: a sonar hears the nearest that is in its beam.
const BEAM_SINE: f32 = 0.208_46;
const BEAM_COSINE: f32 = 0.978_03;

/// Tangent of half a beam's width: an opening looks narrower by it, on both sides, for each metre
/// that it is away.
pub(super) const BEAM_TANGENT: f32 = BEAM_SINE / BEAM_COSINE;

/// A side of the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Left,
    Right,
}

/// Which side a sonar looks to, and which part of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// At a right angle.
    Beside,
    /// Half ahead.
    Ahead,
    /// Half behind.
    Behind,
}

/// What a sonar looks at in a corridor; none for those that look along it.
pub(super) fn looks_at(bearing: Bearing) -> Option<(Side, Part)> {
    Some(match bearing {
        Bearing::Ahead | Bearing::Behind => return None,
        Bearing::Left => (Side::Left, Part::Beside),
        Bearing::AheadLeft => (Side::Left, Part::Ahead),
        Bearing::BehindLeft => (Side::Left, Part::Behind),
        Bearing::Right => (Side::Right, Part::Beside),
        Bearing::AheadRight => (Side::Right, Part::Ahead),
        Bearing::BehindRight => (Side::Right, Part::Behind),
    })
}

/// What a beam that is turned off a wall's normal makes of the range that it hears: the wall is at
/// `range · reached + rim_m` from the robot's centre.
#[derive(Clone, Copy, Debug)]
struct Beam {
    reached: f32,
    rim_m: f32,
}

impl Beam {
    /// Turned off the normal by an angle of this sine, without its sign, and this cosine.
    fn new(sine: f32, cosine: f32) -> Self {
        let reached = if sine < BEAM_SINE {
            1.0
        } else {
            cosine * BEAM_COSINE + sine * BEAM_SINE
        };
        Self {
            reached,
            rim_m: RIM_M * cosine,
        }
    }
}

/// How a robot looks that stands in a corridor, by the beams of its sonars. A sonar that looks half
/// ahead on the left is as far off the normal of its wall as the one that looks half behind on the
/// right is off that of the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Heading {
    beside: Beam,
    ahead_left: Beam,
    ahead_right: Beam,
}

impl Heading {
    /// To the left of the walls' direction, in radians.
    pub fn new(heading_rad: f32) -> Self {
        let (sine, cosine) = sine_and_cosine(heading_rad);
        let (half_sine, half_cosine) = (sine * FRAC_1_SQRT_2, cosine * FRAC_1_SQRT_2);
        let (sum, difference) = (half_cosine + half_sine, half_cosine - half_sine);
        Self {
            beside: Beam::new(sine.abs(), cosine),
            ahead_left: Beam::new(difference.abs(), sum),
            ahead_right: Beam::new(sum.abs(), difference),
        }
    }

    /// Distance from the robot's centre to the wall on a side, in metres, if what the sonar heard
    /// there is that wall.
    ///
    /// A sonar at the rim whose beam is α off the wall's normal, and β to each side wide, hears the
    /// wall at r where r·cos(α - β) + R·cos α is the wall's distance; within the beam, at right
    /// angles.
    pub fn wall_m(self, side: Side, part: Part, range_m: f32) -> f32 {
        let beam = match (part, side) {
            (Part::Beside, _) => self.beside,
            (Part::Ahead, Side::Left) | (Part::Behind, Side::Right) => self.ahead_left,
            (Part::Ahead, Side::Right) | (Part::Behind, Side::Left) => self.ahead_right,
        };
        range_m * beam.reached + beam.rim_m
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_4;

    use super::*;

    #[test]
    fn a_wall_is_as_far_away_as_it_is_however_the_robot_looks() {
        const BEAM_RAD: f32 = 0.21;
        for (side, sign) in [(Side::Left, 1.0), (Side::Right, -1.0)] {
            for (part, bearing_rad) in [
                (Part::Beside, 0.0),
                (Part::Ahead, -FRAC_PI_4),
                (Part::Behind, FRAC_PI_4),
            ] {
                for heading_rad in [-0.5, -0.1, 0.0, 0.15, 0.5] {
                    let off_rad: f32 = bearing_rad + sign * heading_rad;
                    let nearest_rad = (off_rad.abs() - BEAM_RAD).max(0.0);
                    let rim_m = 0.9 - RIM_M * libm::cosf(off_rad);
                    let range_m = rim_m / libm::cosf(nearest_rad);
                    let found_m = Heading::new(heading_rad).wall_m(side, part, range_m);
                    assert!(
                        (found_m - 0.9).abs() < 2e-3,
                        "{side:?} {part:?} {heading_rad}: {found_m}"
                    );
                }
            }
        }
    }
}

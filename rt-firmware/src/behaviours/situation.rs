//! Situations: what is watched beside a behaviour, and what becomes of the behaviour then.
//!
//! Source: Schoute, "Behaviour-based control framework for an autonomous mobile robot", section
//! 3.2.

use crate::tasks::{Bearing, Pose, Ranges, Twist};

/// What a situation does to the behaviour that executes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reaction {
    /// IDLE executes in its place; it resumes by itself when the situation has passed.
    Suspend,
    /// It ends.
    Cancel,
}

/// Something that may happen while a behaviour executes.
pub trait Situation {
    /// Looks for it: `pose` is in the behaviour's local frame, `twist` what the behaviour asks for.
    fn look(&self, pose: &Pose, twist: &Twist, ranges: Option<&Ranges>) -> Option<Reaction>;
}

/// The way that the robot is to take is not free: SAFETY_CHECK, which each behaviour has.
#[derive(Clone, Copy, Debug)]
pub struct SafetyCheck;

impl SafetyCheck {
    /// Free way that is left when the robot has stopped, in metres from its rim.
    pub const CLEARANCE_M: f32 = 0.2;

    /// Time from a change in the world to the first effect of the brakes: two pings of a sonar, a
    /// period of the slot.
    pub const REACTION_S: f32 = 0.2;

    /// How fast the robot brakes, in m/s²: two thirds of what `WheelSpeed` allows by default.
    pub const BRAKE_M_PER_S2: f32 = 0.8;

    /// So much of the stop distance must be free half left and half right of the way, where the
    /// robot's shoulders go.
    const DIAGONAL_PART: f32 = 0.5;

    /// The way that must be free to go on at this speed, in metres from the rim.
    pub fn stop_distance_m(speed_m_per_s: f32) -> f32 {
        Self::CLEARANCE_M + Self::way_to_stop_m(speed_m_per_s)
    }

    fn way_to_stop_m(speed_m_per_s: f32) -> f32 {
        let speed = speed_m_per_s.abs();
        speed * Self::REACTION_S + speed * speed / (2.0 * Self::BRAKE_M_PER_S2)
    }
}

impl SafetyCheck {
    /// So much more must be free before the robot goes on after it has stopped, in metres: else the
    /// noise of a sonar would let it go on towards what it has stopped before.
    pub const MORE_M: f32 = 0.03;

    /// Whether the way of this movement is free.
    pub fn is_free(twist: &Twist, ranges: Option<&Ranges>) -> bool {
        Self::is_free_but(Self::CLEARANCE_M, twist, ranges)
    }

    /// Whether the way is free where so much is to be left when the robot has stopped, in metres.
    pub fn is_free_but(clearance_m: f32, twist: &Twist, ranges: Option<&Ranges>) -> bool {
        let ways = if twist.forward_m_per_s > 0.0 {
            [Bearing::Ahead, Bearing::AheadLeft, Bearing::AheadRight]
        } else if twist.forward_m_per_s < 0.0 {
            [Bearing::Behind, Bearing::BehindLeft, Bearing::BehindRight]
        } else {
            return true;
        };
        let stop_m = clearance_m + Self::way_to_stop_m(twist.forward_m_per_s);
        let [straight, diagonals @ ..] = ways;
        // A direction in which no sonar looks is nobody's fault, but straight on.
        ranges.is_some_and(|ranges| {
            ranges.free_m(straight) > stop_m
                && diagonals
                    .iter()
                    .all(|way| ranges.free_unless_seen_m(*way) > stop_m * Self::DIAGONAL_PART)
        })
    }
}

impl Situation for SafetyCheck {
    fn look(&self, _: &Pose, twist: &Twist, ranges: Option<&Ranges>) -> Option<Reaction> {
        (!Self::is_free(twist, ranges)).then_some(Reaction::Suspend)
    }
}

/// The robot is too far from where the behaviour began: OUTSIDE_RANGE.
#[derive(Clone, Copy, Debug)]
pub struct OutsideRange {
    /// How far is too far, in metres; 0 is no limit.
    pub radius_m: f32,
}

impl Situation for OutsideRange {
    fn look(&self, pose: &Pose, _: &Twist, _: Option<&Ranges>) -> Option<Reaction> {
        let square_m2 = pose.x_m * pose.x_m + pose.y_m * pose.y_m;
        let is_outside = self.radius_m > 0.0 && square_m2 > self.radius_m * self.radius_m;
        is_outside.then_some(Reaction::Cancel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn forwards(forward_m_per_s: f32) -> Twist {
        Twist {
            forward_m_per_s,
            turn_rad_per_s: 0.0,
        }
    }

    #[test]
    fn the_way_is_checked_where_the_robot_goes() {
        // 0.2 m, and at 0.3 m/s 60 mm for the reaction and 56 mm to brake.
        let stop_m = SafetyCheck::stop_distance_m(0.3);
        assert!((stop_m - 0.316).abs() < 0.001, "{stop_m}");
        for (sonar, range_m, speed, is_free) in [
            (0, stop_m - 0.01, 0.3, false),
            (0, stop_m + 0.01, 0.3, true),
            (0, stop_m - 0.01, 0.1, true),
            (0, 0.0, 0.3, false),
            (0, 0.0, -0.3, true),
            (4, stop_m - 0.01, -0.3, false),
            (4, 0.0, 0.3, true),
            (1, stop_m * 0.4, 0.3, false),
            (7, stop_m * 0.6, 0.3, true),
            (2, 0.0, 0.3, true),
            (0, 0.0, 0.0, true),
        ] {
            let mut ranges = Ranges::FREE;
            ranges.range_m[sonar] = range_m;
            let reaction = SafetyCheck.look(&Pose::START, &forwards(speed), Some(&ranges));
            let expected = (!is_free).then_some(Reaction::Suspend);
            assert_eq!(
                reaction, expected,
                "sonar {sonar}: {range_m} m at {speed} m/s"
            );
        }
    }

    #[test]
    fn a_little_more_must_be_free_before_it_goes_on() {
        let stop_m = SafetyCheck::stop_distance_m(0.3);
        for (more_m, is_free, is_free_again) in [
            (0.01, true, false),
            (SafetyCheck::MORE_M + 0.001, true, true),
            (-0.01, false, false),
        ] {
            let mut ranges = Ranges::FREE;
            ranges.range_m[0] = stop_m + more_m;
            let (twist, ranges) = (forwards(0.3), Some(&ranges));
            assert_eq!(SafetyCheck::is_free(&twist, ranges), is_free, "{more_m}");
            let clearance_m = SafetyCheck::CLEARANCE_M + SafetyCheck::MORE_M;
            assert_eq!(
                SafetyCheck::is_free_but(clearance_m, &twist, ranges),
                is_free_again,
                "{more_m}"
            );
        }
    }

    #[test]
    fn nobody_drives_where_nobody_knows_the_way() {
        let look = |speed| SafetyCheck.look(&Pose::START, &forwards(speed), None);
        assert_eq!(look(0.1), Some(Reaction::Suspend));
        assert_eq!(look(0.0), None);
        // A robot with one sonar, which looks ahead.
        let mut ranges = Ranges::FREE;
        ranges.sonars = 1;
        let look = |speed| SafetyCheck.look(&Pose::START, &forwards(speed), Some(&ranges));
        assert_eq!(look(0.3), None);
        assert_eq!(look(-0.1), Some(Reaction::Suspend));
    }

    #[test]
    fn outside_is_beyond_the_radius_in_any_direction() {
        let pose = Pose {
            x_m: -0.6,
            y_m: 0.8,
            heading_rad: 0.0,
        };
        for (radius_m, reaction) in [(0.99, Some(Reaction::Cancel)), (1.01, None), (0.0, None)] {
            let outside = OutsideRange { radius_m };
            assert_eq!(outside.look(&pose, &Twist::STILL, None), reaction);
        }
    }
}

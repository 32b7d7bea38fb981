//! Situations: what is watched beside a behaviour.
//!
//! [`SafetyCheck`] is beside each. [`Situation`] is what others are, those of scripts and those of
//! a mission's task states.
//!
//! Source: Schoute, "Behaviour-based control framework for an autonomous mobile robot", section
//! 3.2.

use crate::declaration::Params;
use crate::tasks::{Bearing, Bearings, Pose, Ranges, Twist};
use esm_link::black_box::OWN_SITUATION;

/// What a situation is looked for in.
#[derive(Clone, Copy, Debug)]
pub struct Circumstances<'a> {
    /// Where the robot is, in the local frame, if anybody knows.
    pub pose: Option<Pose>,
    /// How the behaviour that executes has asked to move; still where none does.
    pub asked: Twist,
    /// What is around the robot; none where nobody knows.
    pub ranges: Option<&'a Ranges>,
    /// Of the battery, in volts, if anybody knows.
    pub battery_v: Option<f32>,
    /// Time since the last look, in microseconds.
    pub period_us: u32,
}

/// Something that may happen while a behaviour executes.
pub trait Situation: Send {
    /// Looks for it, in each activation of its slot. Returns whether it is up.
    fn look(&mut self, seen: &Circumstances<'_>, params: &Params) -> bool;

    /// Its number in the flight recorder, which knows those that ship by their names.
    fn number(&self) -> u8 {
        OWN_SITUATION
    }
}

/// Whether a place is farther than `radius_m` metres from the centre of its frame: OUTSIDE_RANGE.
pub fn is_outside(pose: &Pose, radius_m: f32) -> bool {
    pose.x_m * pose.x_m + pose.y_m * pose.y_m > radius_m * radius_m
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
        let mut stop_distance = StopDistance::UNKNOWN;
        stop_distance.is_free(clearance_m, twist, ranges)
    }
}

/// Whether a number is above 0, by its bits: a comparison takes a core without a floating-point
/// unit twenty instructions.
pub(super) const fn is_positive(number: f32) -> bool {
    number.to_bits() as i32 > 0
}

/// The way that must be free for a movement, kept as long as that stays the same.
#[derive(Clone, Copy, Debug, Default)]
pub struct StopDistance {
    /// What it is of: bits of the speed ahead and of the clearance.
    of: [u32; 2],
    /// Straight on, in metres.
    straight_m: f32,
    /// Half left and half right of the way, in metres.
    diagonal_m: f32,
}

impl StopDistance {
    /// That of a robot that does not drive, which no movement asks for.
    pub const UNKNOWN: Self = Self {
        of: [0; 2],
        straight_m: 0.0,
        diagonal_m: 0.0,
    };

    /// Whether the way of a movement is free where so much is to be left when the robot has
    /// stopped, in metres.
    pub fn is_free(&mut self, clearance_m: f32, twist: &Twist, ranges: Option<&Ranges>) -> bool {
        const AHEAD: [Bearings; 2] = [
            Bearings::of(&[Bearing::Ahead]),
            Bearings::of(&[Bearing::AheadLeft, Bearing::AheadRight]),
        ];
        const BEHIND: [Bearings; 2] = [
            Bearings::of(&[Bearing::Behind]),
            Bearings::of(&[Bearing::BehindLeft, Bearing::BehindRight]),
        ];
        let speed_m_per_s = twist.forward_m_per_s;
        let [straight, diagonals] = if is_positive(speed_m_per_s) {
            AHEAD
        } else if is_positive(-speed_m_per_s) {
            BEHIND
        } else {
            return true;
        };
        let Some(ranges) = ranges else {
            return false;
        };
        let of = [speed_m_per_s, clearance_m].map(f32::to_bits);
        if self.of != of {
            let straight_m = clearance_m + SafetyCheck::way_to_stop_m(speed_m_per_s);
            *self = Self {
                of,
                straight_m,
                diagonal_m: straight_m * SafetyCheck::DIAGONAL_PART,
            };
        }
        // A direction in which no sonar looks is nobody's fault, but straight on.
        ranges.is_free((straight, self.straight_m), (diagonals, self.diagonal_m))
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
            assert_eq!(
                SafetyCheck::is_free(&forwards(speed), Some(&ranges)),
                is_free,
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
        let is_free = |speed| SafetyCheck::is_free(&forwards(speed), None);
        assert!(!is_free(0.1) && is_free(0.0));
        // A robot with one sonar, which looks ahead.
        let mut ranges = Ranges::FREE;
        ranges.sonars = 1;
        let is_free = |speed| SafetyCheck::is_free(&forwards(speed), Some(&ranges));
        assert!(is_free(0.3) && !is_free(-0.1));
    }

    #[test]
    fn outside_is_beyond_the_radius_in_any_direction() {
        let pose = Pose {
            x_m: -0.6,
            y_m: 0.8,
            heading_rad: 0.0,
        };
        assert!(is_outside(&pose, 0.99) && !is_outside(&pose, 1.01));
    }
}
